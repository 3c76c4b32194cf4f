//! A grant: between two searches for the station one behaviour drives for some time.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{BehaviourId, Percent, Setpoint, TrackPower};

/// A grant, under way or finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DriveGrant {
    by: BehaviourId,
    until: Instant,
    /// The grant ends then unless a motion is requested; `None` while a motion is on.
    idle_until: Option<Instant>,
    used: bool,
}

impl DriveGrant {
    /// The longest wait for the first motion.
    pub const FIRST: Duration = Duration::from_millis(1500);
    /// The longest wait from the end of a motion to the next one.
    pub const NEXT: Duration = Duration::from_secs(1);

    /// The longest grant, also after a search that took all of its time.
    pub const LONGEST: Duration = Duration::from_secs(40);

    /// How long a grant lasts: twice as long as the search before it took, and `least` at least. Many
    /// short grants between long searches spend the battery on searches from places close to each
    /// other.
    pub fn time_after(search: Duration, least: Duration) -> Duration {
        (2 * search).clamp(least, DriveGrant::LONGEST.max(least))
    }

    /// Begins a grant of at most `time`.
    pub fn start(by: BehaviourId, time: Duration, now: Instant) -> DriveGrant {
        DriveGrant {
            by,
            until: now + time,
            idle_until: Some(now + DriveGrant::FIRST),
            used: false,
        }
    }

    pub fn grantee(&self) -> BehaviourId {
        self.by
    }

    pub fn used(&self) -> bool {
        self.used
    }

    /// Notes whether the grantee has a motion now.
    pub fn record(&mut self, moves: bool, now: Instant) {
        self.used |= moves;
        if moves {
            self.idle_until = None;
        } else {
            self.idle_until.get_or_insert(now + DriveGrant::NEXT);
        }
    }

    /// Whether its time is over, or no motion was requested in time.
    pub fn is_over(&self, now: Instant) -> bool {
        self.next_deadline() <= now
    }

    /// When it ends unless the grantee's motion begins or ends before.
    pub fn next_deadline(&self) -> Instant {
        self.idle_until
            .map_or(self.until, |idle| idle.min(self.until))
    }
}

/// The same curve with no track above this power: both tracks are scaled alike.
pub fn capped(setpoint: Setpoint, power: Percent) -> Setpoint {
    let most = f64::from(power.get()) / 100.0 * f64::from(TrackPower::MAX);
    let left = f64::from(setpoint.left.get());
    let right = f64::from(setpoint.right.get());
    let fastest = left.abs().max(right.abs());
    if fastest <= most {
        return setpoint;
    }
    let scaled = |track: f64| TrackPower::new((track * most / fastest).trunc() as i8);
    match (scaled(left), scaled(right)) {
        (Some(left), Some(right)) => Setpoint { left, right },
        _ => Setpoint::STOP,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);
    const WHO: BehaviourId = BehaviourId(3);

    fn grant() -> (DriveGrant, Instant) {
        let now = Instant::now();
        (DriveGrant::start(WHO, 8000 * MS, now), now)
    }

    #[test]
    fn an_unused_grant_ends_soon() {
        let (mut grant, now) = grant();
        grant.record(false, now + 1000 * MS);
        assert!(!grant.is_over(now + 1499 * MS));
        assert!(grant.is_over(now + 1500 * MS) && !grant.used());
    }

    #[test]
    fn a_grant_ends_a_second_after_the_last_motion() {
        let (mut grant, now) = grant();
        grant.record(true, now + 1000 * MS);
        assert_eq!(grant.next_deadline(), now + 8000 * MS);
        grant.record(false, now + 3000 * MS);
        grant.record(false, now + 3500 * MS);
        assert!(!grant.is_over(now + 3999 * MS));
        assert!(grant.is_over(now + 4000 * MS) && grant.used());
    }

    #[test]
    fn no_motion_makes_a_grant_longer() {
        let (mut grant, now) = grant();
        grant.record(true, now + 1000 * MS);
        grant.record(true, now + 7999 * MS);
        assert!(grant.is_over(now + 8000 * MS));
        assert_eq!(grant.grantee(), WHO);
    }

    #[test]
    fn a_cap_keeps_the_curve() {
        let thirty = Percent::saturating(30);
        let curve = |left, right| {
            let wanted = Setpoint::from_percent(left, right).unwrap();
            let Setpoint { left, right } = capped(wanted, thirty);
            (left.get(), right.get())
        };
        assert_eq!(curve(100.0, -100.0), (27, -27));
        assert_eq!(curve(100.0, 50.0), (27, 13));
        assert_eq!(curve(-30.0, 20.0), (-27, 18), "slow enough");
        assert_eq!(curve(0.0, 0.0), (0, 0));
    }

    proptest! {
        #[test]
        fn no_track_is_ever_above_the_cap(
            left in -100.0..=100.0f64,
            right in -100.0..=100.0f64,
            percent in 0..=100u8,
        ) {
            let wanted = Setpoint::from_percent(left, right).unwrap();
            let Setpoint { left, right } = capped(wanted, Percent::saturating(percent));
            let most = f64::from(percent) * 0.9;
            prop_assert!(f64::from(left.get()).abs() <= most);
            prop_assert!(f64::from(right.get()).abs() <= most);
        }
    }
}
