//! Evaluates battery reports: the level, whether the battery charges, and when it is low. Bad news
//! is believed at the first report, good news only when several reports confirm it; silence counts
//! as low.

use std::time::Duration;

use tokio::time::Instant;

use super::Limits;
use super::streak::{FASTEST_CHARGE, Latch, Proof, Streak};
use crate::robot::Percent;
use crate::wire::Power;

/// Why the battery counts as low.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LowCause {
    /// A report at or below the low level.
    Level(Percent),
    /// No report for this time, the longest that is allowed.
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

/// What a fact or the passing of time has changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BatteryChange {
    /// The robot must go home.
    BecameLow(LowCause),
    /// The robot may move again.
    Released,
}

/// Whether the battery charges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Charging {
    /// The last report denies it, or whether it charges is not known.
    No,
    /// One report says so, and nothing confirms it yet. The robot stays where it is: it is not
    /// driven, and not released either.
    Unconfirmed,
    /// Several reports say so, or one report while the robot reports that it is on its station.
    Confirmed,
}

/// Remembers whether the battery is low. One report is enough to be low; release takes charging or
/// the `ok` level, each confirmed.
#[derive(Debug, Clone)]
pub struct BatteryGuard {
    low: Percent,
    ok: Percent,
    silence: Duration,
    level: Option<(Percent, Instant)>,
    leapt: Streak,
    low_cause: Option<LowCause>,
    good: Streak,
    low_level: Latch,
    critical: Percent,
    critical_level: Latch,
    charging: Charging,
    charged: Streak,
    /// Since when charging has been reported but not believed.
    unconfirmed_since: Option<Instant>,
    reported: Option<Instant>,
}

impl BatteryGuard {
    /// How long one unconfirmed report of charging counts.
    pub const UNCONFIRMED_TIMEOUT: Duration = Duration::from_secs(120);

    /// The most points by which a level changes from one report to the next, besides ...
    const STEP: f64 = 10.0;
    /// ... this many points a second that driving explains.
    const FASTEST_DRAIN: f64 = 0.3;

    /// Begins without a report; without a report the robot does not move, because there is no link.
    pub fn new(limits: &Limits) -> BatteryGuard {
        BatteryGuard {
            low: limits.low,
            ok: limits.ok,
            silence: limits.power_silence.get(),
            level: None,
            leapt: Streak::new(Proof::LEVEL),
            low_cause: None,
            good: Streak::new(Proof::LEVEL),
            low_level: Latch::new(),
            critical: limits.critical,
            critical_level: Latch::new(),
            charging: Charging::No,
            charged: Streak::new(Proof::CHARGING),
            unconfirmed_since: None,
            reported: None,
        }
    }

    /// Handles a battery report; `contact`: the robot has reported that it is on its station.
    pub fn report(&mut self, power: Power, contact: bool, now: Instant) -> Option<BatteryChange> {
        let level = Percent::saturating(power.percent);
        self.reported = Some(now);
        self.judge_charging(power, contact, now);
        self.judge_level(level, power, now);
        self.low_level.observe(level <= self.low, power, now);
        self.critical_level
            .observe(level <= self.critical, power, now);
        let good = self.good.observe(level >= self.ok, power, now);
        if good || self.charging == Charging::Confirmed {
            return self.release();
        }
        if level <= self.low && self.charging == Charging::No {
            self.become_low(LowCause::Level(level))
        } else {
            None
        }
    }

    /// Handles the robot's report that it is on its station, which confirms a report of charging.
    pub fn contact(&mut self) -> Option<BatteryChange> {
        if self.charging != Charging::Unconfirmed {
            return None;
        }
        (self.charging, self.unconfirmed_since) = (Charging::Confirmed, None);
        self.release()
    }

    /// Handles the robot's report that it has left its station.
    pub fn undocked(&mut self) {
        (self.charging, self.unconfirmed_since) = (Charging::No, None);
        self.charged.forget();
    }

    /// Discards an unconfirmed report of charging when its time is over.
    pub fn expire_unconfirmed(&mut self, now: Instant) -> Option<BatteryChange> {
        if self.unconfirmed_deadline().is_none_or(|due| due > now) {
            return None;
        }
        (self.charging, self.unconfirmed_since) = (Charging::No, None);
        let level = self.level().filter(|level| *level <= self.low)?;
        self.become_low(LowCause::Level(level))
    }

    /// When [`BatteryGuard::expire_unconfirmed`] has something to do.
    pub fn unconfirmed_deadline(&self) -> Option<Instant> {
        let since = self.unconfirmed_since?;
        Some(since + BatteryGuard::UNCONFIRMED_TIMEOUT)
    }

    /// Checks, off the station, whether the silence counts as low.
    pub fn poll(&mut self, now: Instant) -> Option<BatteryChange> {
        let due = self.next_deadline()?;
        if due > now {
            None
        } else {
            self.become_low(LowCause::Silence(self.silence))
        }
    }

    /// When silence will count as low; `None` if the battery is low already, or was never reported.
    pub fn next_deadline(&self) -> Option<Instant> {
        if self.low_cause.is_some() {
            return None;
        }
        Some(self.reported? + self.silence)
    }

    /// Restarts the time of silence: on the station silence is no danger.
    pub fn excuse_silence(&mut self, now: Instant) {
        self.reported = self.reported.map(|_| now);
    }

    /// Whether the last report is so recent that the silence does not count as low yet.
    pub fn is_fresh(&self, now: Instant) -> bool {
        self.reported
            .is_some_and(|reported| now < reported + self.silence)
    }

    /// Why the battery is low; `None` if it is not, or was released.
    pub fn low(&self) -> Option<LowCause> {
        self.low_cause
    }

    /// The believed level: the last one, unless it leapt and nothing confirms it yet.
    pub fn level(&self) -> Option<Percent> {
        self.level.map(|(level, _)| level)
    }

    /// Whether the battery charges.
    pub fn charging(&self) -> Charging {
        self.charging
    }

    /// Whether the level is at or below the low threshold, charging or not, until several reports
    /// deny it.
    pub fn at_or_below_low(&self) -> bool {
        self.low_level.is_on()
    }

    /// Whether the level is at or below the critical threshold, charging or not, until several
    /// reports deny it.
    pub fn critical(&self) -> bool {
        self.critical_level.is_on()
    }

    fn judge_charging(&mut self, power: Power, contact: bool, now: Instant) {
        let proved = self.charged.observe(power.charging, power, now);
        let stale = self.unconfirmed_deadline().is_some_and(|due| due <= now);
        self.charging = match self.charging {
            _ if !power.charging => Charging::No,
            Charging::Confirmed => Charging::Confirmed,
            _ if contact || proved => Charging::Confirmed,
            _ => Charging::Unconfirmed,
        };
        self.unconfirmed_since = match self.charging {
            Charging::Unconfirmed if stale => Some(now),
            Charging::Unconfirmed => self.unconfirmed_since.or(Some(now)),
            Charging::No | Charging::Confirmed => None,
        };
    }

    /// Believes a level that leaps when it is confirmed; one that falls to low, at once.
    fn judge_level(&mut self, level: Percent, power: Power, now: Instant) {
        let leaps = self
            .level
            .is_some_and(|before| self.leaps(before, level, now));
        let falls = self.level().is_some_and(|before| level < before);
        let proved = self.leapt.observe(leaps, power, now);
        if !leaps || proved || (falls && level <= self.low) {
            self.level = Some((level, now));
            self.leapt.forget();
        }
    }

    fn leaps(&self, (before, at): (Percent, Instant), level: Percent, now: Instant) -> bool {
        let seconds = now.saturating_duration_since(at).as_secs_f64();
        let change = f64::from(level.get()) - f64::from(before.get());
        let explained = match self.charging {
            _ if change < 0.0 => BatteryGuard::FASTEST_DRAIN * seconds,
            Charging::Confirmed => FASTEST_CHARGE * seconds,
            Charging::Unconfirmed | Charging::No => 0.0,
        };
        change.abs() > BatteryGuard::STEP + explained
    }

    fn release(&mut self) -> Option<BatteryChange> {
        self.low_cause.take().map(|_| BatteryChange::Released)
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
mod tests;
