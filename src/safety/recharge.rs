//! A robot that stands on its station and no longer charges, though its battery is not low: many
//! stations end charging after some hours (`PROTOCOL.md`, *The station*). It leaves its station and
//! docks again while its battery still has the energy for that, which begins the station's time anew.
//!
//! [`Recharge`] decides when; the watchdog does it as a docking of its own, which any behaviour that
//! wants to drive ends.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{DockEnd, Percent};

/// What follows a docking that was to begin the charge anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AfterRecharge {
    /// It charges, or somebody else drives: nothing.
    Nothing,
    /// It is off its station and tries again after this time.
    Again(Duration),
    Alarm,
}

/// When to leave the station and dock again.
#[derive(Debug, Clone, Default)]
pub struct Recharge {
    /// Since when it stands on its station without charging.
    idle_since: Option<Instant>,
    /// The level at which it docks again.
    trigger: Option<Percent>,
    tried: bool,
    /// The docking under way is this one's.
    docking: bool,
    /// It has left its station and has not come back: when it tries again.
    again: Option<Instant>,
    failures: u32,
}

impl Recharge {
    /// How far the level falls before it docks again. A battery that lasts an hour or more takes ten
    /// minutes at least for that, and the station has hours to give it back.
    const DROP: u8 = 20;
    /// It docks again at the latest this many points above the low level.
    const RESERVE: u8 = 10;
    /// How long it must have stood without charging: charging may begin late.
    const IDLE_TIME: Duration = Duration::from_secs(120);
    /// The pause before it searches again for the station that it has left.
    const PAUSE: Duration = Duration::from_secs(60);
    /// After so many failures a person is called.
    const FAILURES: u32 = 3;

    /// It charges, somebody else has moved it, or its battery is low.
    pub fn forget(&mut self) {
        *self = Recharge::default();
    }

    /// Whether the docking under way is this one's.
    pub fn is_docking(&self) -> bool {
        self.docking
    }

    /// Whether it has left its station to dock again, and is not back.
    pub fn is_away(&self) -> bool {
        self.docking || self.again.is_some()
    }

    /// It stands on its station without charging, at this level.
    pub fn stand(&mut self, level: Percent, low: Percent, now: Instant) {
        self.again = None;
        if self.idle_since.is_none() {
            self.idle_since = Some(now);
            if !self.tried {
                self.trigger = first_trigger(level, low);
            }
        }
    }

    /// When to leave the station, standing on it at this level.
    pub fn due(&self, level: Percent, low: Percent) -> Option<Instant> {
        let reached = level > low && self.trigger.is_some_and(|trigger| level <= trigger);
        if !reached {
            return None;
        }
        Some(self.idle_since? + Recharge::IDLE_TIME)
    }

    /// When to search again, off the station.
    pub fn due_again(&self) -> Option<Instant> {
        self.again
    }

    /// A docking has begun, at this level.
    pub fn begin(&mut self, level: Option<Percent>, low: Percent) {
        self.docking = true;
        self.tried = true;
        (self.idle_since, self.again) = (None, None);
        self.trigger = level.and_then(|level| next_trigger(level, low));
    }

    pub fn ended(&mut self, end: DockEnd, now: Instant) -> AfterRecharge {
        self.docking = false;
        match end {
            DockEnd::Done | DockEnd::AlreadyDocked | DockEnd::Preempted | DockEnd::Cancelled => {
                self.forget();
                AfterRecharge::Nothing
            }
            DockEnd::NotCharging => AfterRecharge::Alarm,
            _ => {
                self.failures += 1;
                self.again = Some(now + Recharge::PAUSE);
                if self.failures == Recharge::FAILURES {
                    AfterRecharge::Alarm
                } else {
                    AfterRecharge::Again(Recharge::PAUSE)
                }
            }
        }
    }
}

/// The level at which a robot that stands at this one docks again; at once if it is nearly low.
fn first_trigger(level: Percent, low: Percent) -> Option<Percent> {
    next_trigger(level, low).or(Some(level))
}

/// The same after it has tried; `None` if it is nearly low.
fn next_trigger(level: Percent, low: Percent) -> Option<Percent> {
    let reserve = low.get().saturating_add(Recharge::RESERVE);
    if level.get() <= reserve {
        return None;
    }
    let fallen = level.get().saturating_sub(Recharge::DROP);
    Some(Percent::saturating(fallen.max(reserve)))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOW: Percent = Percent::saturating(20);

    fn at(percent: u8) -> Percent {
        Percent::saturating(percent)
    }

    #[test]
    fn it_docks_again_when_the_level_has_fallen_by_a_fifth_and_before_it_is_low() {
        let now = Instant::now();
        for (first, trigger) in [(100, 80), (60, 40), (45, 30), (31, 30), (28, 28)] {
            let mut recharge = Recharge::default();
            recharge.stand(at(first), LOW, now);
            assert_eq!(recharge.due(at(trigger + 1), LOW), None, "{first}");
            let due = Some(now + Recharge::IDLE_TIME);
            assert_eq!(recharge.due(at(trigger), LOW), due, "{first}");
            assert_eq!(recharge.due(at(20), LOW), None, "low is another rule's");
        }
    }

    #[test]
    fn after_a_try_it_waits_for_the_next_fifth_and_nearly_low_tries_no_more() {
        let now = Instant::now();
        let mut recharge = Recharge::default();
        recharge.stand(at(100), LOW, now);
        for (level, next) in [(80, Some(60)), (60, Some(40)), (40, Some(30)), (30, None)] {
            recharge.begin(Some(at(level)), LOW);
            assert!(recharge.is_docking());
            let after = recharge.ended(DockEnd::NotCharging, now);
            assert_eq!(after, AfterRecharge::Alarm);
            recharge.stand(at(level), LOW, now);
            assert_eq!(recharge.trigger, next.map(at));
        }
    }

    #[test]
    fn off_the_station_it_searches_again_until_somebody_drives() {
        let now = Instant::now();
        let mut recharge = Recharge::default();
        let pause = AfterRecharge::Again(Recharge::PAUSE);
        for after in [pause, pause, AfterRecharge::Alarm, pause] {
            recharge.begin(Some(at(80)), LOW);
            assert_eq!(recharge.ended(DockEnd::BaseNotFound, now), after);
            assert_eq!(recharge.due_again(), Some(now + Recharge::PAUSE));
        }
        recharge.begin(Some(at(80)), LOW);
        let after = recharge.ended(DockEnd::Preempted, now);
        assert_eq!(
            (after, recharge.due_again()),
            (AfterRecharge::Nothing, None)
        );
        assert!(!recharge.is_away());
    }
}
