//! A loan: between two searches of a robot with a low battery one behaviour drives for a few
//! seconds.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{BehaviourId, Percent, Setpoint, TrackPower};

/// A loan, under way or finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Loan {
    by: BehaviourId,
    until: Instant,
    /// The loan ends then unless a motion is requested; `None` while a motion is on.
    idle_until: Option<Instant>,
    used: bool,
}

impl Loan {
    /// The longest wait for the first motion.
    pub const FIRST: Duration = Duration::from_millis(1500);
    /// The longest wait from the end of a motion to the next one.
    pub const NEXT: Duration = Duration::from_secs(1);

    /// Begins a loan of at most `time`.
    pub fn start(by: BehaviourId, time: Duration, now: Instant) -> Loan {
        Loan {
            by,
            until: now + time,
            idle_until: Some(now + Loan::FIRST),
            used: false,
        }
    }

    /// The behaviour that the tracks are lent to.
    pub fn borrower(&self) -> BehaviourId {
        self.by
    }

    /// Whether any motion was requested.
    pub fn used(&self) -> bool {
        self.used
    }

    /// Notes whether the borrower has a motion now.
    pub fn note(&mut self, moves: bool, now: Instant) {
        self.used |= moves;
        if moves {
            self.idle_until = None;
        } else {
            self.idle_until.get_or_insert(now + Loan::NEXT);
        }
    }

    /// Whether its time is over, or no motion was requested in time.
    pub fn is_over(&self, now: Instant) -> bool {
        self.next_deadline() <= now
    }

    /// When it ends unless the borrower's motion begins or ends before.
    pub fn next_deadline(&self) -> Instant {
        self.idle_until
            .map_or(self.until, |idle| idle.min(self.until))
    }
}

/// The same curve with no track above this power: both tracks are scaled alike.
pub fn capped(setpoint: Setpoint, power: Percent) -> Setpoint {
    let most = f64::from(power.get()) / 100.0 * f64::from(TrackPower::MAX);
    let (left, right) = (
        f64::from(setpoint.left.get()),
        f64::from(setpoint.right.get()),
    );
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

    fn loan() -> (Loan, Instant) {
        let now = Instant::now();
        (Loan::start(WHO, 8000 * MS, now), now)
    }

    #[test]
    fn an_unused_loan_ends_soon() {
        let (mut loan, now) = loan();
        loan.note(false, now + 1000 * MS);
        assert!(!loan.is_over(now + 1499 * MS));
        assert!(loan.is_over(now + 1500 * MS) && !loan.used());
    }

    #[test]
    fn a_loan_ends_a_second_after_the_last_motion() {
        let (mut loan, now) = loan();
        loan.note(true, now + 1000 * MS);
        assert_eq!(loan.next_deadline(), now + 8000 * MS);
        loan.note(false, now + 3000 * MS);
        loan.note(false, now + 3500 * MS);
        assert!(!loan.is_over(now + 3999 * MS));
        assert!(loan.is_over(now + 4000 * MS) && loan.used());
    }

    #[test]
    fn no_motion_makes_a_loan_longer() {
        let (mut loan, now) = loan();
        loan.note(true, now + 1000 * MS);
        loan.note(true, now + 7999 * MS);
        assert!(loan.is_over(now + 8000 * MS));
        assert_eq!(loan.borrower(), WHO);
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
