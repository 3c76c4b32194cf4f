//! When the battery is low: hysteresis between two levels, and silence that counts as low.

use std::time::Duration;

use tokio::time::Instant;

use super::Limits;
use crate::robot::Percent;
use crate::wire::Power;

/// Why the battery counts as low.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LowCause {
    /// A report at or below the low level.
    Level(Percent),
    /// No report for longer than allowed.
    Silence(Duration),
}

impl std::fmt::Display for LowCause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LowCause::Level(level) => write!(f, "battery at {level}"),
            LowCause::Silence(silence) => {
                write!(f, "no battery level for {} s", silence.as_secs())
            }
        }
    }
}

/// What a fact has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BatteryChange {
    /// The robot must go home.
    BecameLow(LowCause),
    /// The robot may move again.
    Released,
}

/// Remembers whether the battery is low. One report is enough to be low; charging or the `ok`
/// level is needed to be released.
#[derive(Debug)]
pub struct BatteryGuard {
    low: Percent,
    ok: Percent,
    critical: Percent,
    silence: Duration,
    level: Option<Percent>,
    low_cause: Option<LowCause>,
    reported: Option<Instant>,
}

impl BatteryGuard {
    /// Nothing is known yet; what is not known moves nothing, because there is no link.
    pub fn new(limits: &Limits) -> BatteryGuard {
        BatteryGuard {
            low: limits.low,
            ok: limits.ok,
            critical: limits.critical,
            silence: limits.power_silence.get(),
            level: None,
            low_cause: None,
            reported: None,
        }
    }

    /// A report came.
    pub fn report(&mut self, power: Power, now: Instant) -> Option<BatteryChange> {
        let level = Percent::saturating(power.percent);
        (self.level, self.reported) = (Some(level), Some(now));
        if power.charging || level >= self.ok {
            return self.low_cause.take().map(|_| BatteryChange::Released);
        }
        if level <= self.low {
            self.become_low(LowCause::Level(level))
        } else {
            None
        }
    }

    /// Time passes off the station: silence counts as low.
    pub fn poll(&mut self, now: Instant) -> Option<BatteryChange> {
        let due = self.next_deadline()?;
        if due > now {
            None
        } else {
            self.become_low(LowCause::Silence(self.silence))
        }
    }

    /// When silence will count as low; `None` if it does already.
    pub fn next_deadline(&self) -> Option<Instant> {
        let reported = self.reported.filter(|_| self.low_cause.is_none())?;
        Some(reported + self.silence)
    }

    /// On the station silence is no danger: counts from now.
    pub fn excuse_silence(&mut self, now: Instant) {
        self.reported = self.reported.map(|_| now);
    }

    /// A report came within the time after which silence counts.
    pub fn is_fresh(&self, now: Instant) -> bool {
        self.reported
            .is_some_and(|reported| now < reported + self.silence)
    }

    /// Low, and not released yet.
    pub fn low(&self) -> Option<LowCause> {
        self.low_cause
    }

    /// The last level is at or below the low threshold, charging or not.
    pub fn at_or_below_low(&self) -> bool {
        self.level.is_some_and(|level| level <= self.low)
    }

    /// The last level is at or below the critical one, charging or not.
    pub fn critical(&self) -> bool {
        self.level.is_some_and(|level| level <= self.critical)
    }

    fn become_low(&mut self, cause: LowCause) -> Option<BatteryChange> {
        let news = self
            .low_cause
            .is_none()
            .then_some(BatteryChange::BecameLow(cause));
        self.low_cause = self.low_cause.or(Some(cause));
        news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard() -> (BatteryGuard, Instant) {
        (BatteryGuard::new(&Limits::default()), Instant::now())
    }

    fn power(percent: u8, charging: bool) -> Power {
        Power { percent, charging }
    }

    fn low_at(percent: u8) -> Option<BatteryChange> {
        Some(BatteryChange::BecameLow(LowCause::Level(
            Percent::new(percent).unwrap(),
        )))
    }

    #[test]
    fn one_report_at_the_low_level_is_enough() {
        let (mut guard, now) = guard();
        assert_eq!(guard.report(power(21, false), now), None);
        assert_eq!(guard.report(power(20, false), now), low_at(20));
        assert_eq!(guard.report(power(19, false), now), None, "said once");
    }

    #[test]
    fn a_cause_is_told_in_words() {
        let level = LowCause::Level(Percent::saturating(20));
        assert_eq!(level.to_string(), "battery at 20 %");
        let silence = LowCause::Silence(Duration::from_secs(600));
        assert_eq!(silence.to_string(), "no battery level for 600 s");
    }

    #[test]
    fn released_at_the_ok_level_and_not_before() {
        let (mut guard, now) = guard();
        guard.report(power(20, false), now);
        assert_eq!(guard.report(power(49, false), now), None);
        assert!(guard.low().is_some());
        assert_eq!(
            guard.report(power(50, false), now),
            Some(BatteryChange::Released)
        );
    }

    #[test]
    fn released_by_charging() {
        let (mut guard, now) = guard();
        guard.report(power(10, false), now);
        assert_eq!(
            guard.report(power(10, true), now),
            Some(BatteryChange::Released)
        );
        assert!(guard.at_or_below_low());
    }

    #[test]
    fn silence_counts_as_low_until_a_good_report() {
        let (mut guard, now) = guard();
        guard.report(power(80, false), now);
        let due = now + Duration::from_secs(600);
        assert_eq!(guard.next_deadline(), Some(due));
        let silence = LowCause::Silence(Duration::from_secs(600));
        assert_eq!(guard.poll(due), Some(BatteryChange::BecameLow(silence)));
        assert_eq!(guard.next_deadline(), None);
        assert_eq!(
            guard.report(power(80, false), due),
            Some(BatteryChange::Released)
        );
    }

    #[test]
    fn a_level_is_fresh_until_silence_counts() {
        let (mut guard, now) = guard();
        assert!(!guard.is_fresh(now), "never heard");
        guard.report(power(10, false), now);
        assert!(guard.is_fresh(now + Duration::from_millis(599_999)));
        assert!(!guard.is_fresh(now + Duration::from_secs(600)));
    }

    #[test]
    fn on_the_station_silence_is_excused() {
        let (mut guard, now) = guard();
        guard.report(power(80, true), now);
        let later = now + Duration::from_secs(599);
        guard.excuse_silence(later);
        assert_eq!(guard.poll(now + Duration::from_secs(700)), None);
    }

    #[test]
    fn critical_holds_even_while_charging() {
        let (mut guard, now) = guard();
        guard.report(power(8, true), now);
        assert!(guard.critical());
        guard.report(power(9, true), now);
        assert!(!guard.critical());
    }
}
