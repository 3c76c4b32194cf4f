//! Consecutive reports that confirm each other: a claim in a single report may be garbage; a claim
//! on which several agree is believed.

use std::time::Duration;

use tokio::time::Instant;

use crate::wire::Power;

/// Points a second that a battery on a charger may gain at most. Real batteries need hours; the
/// small simulated ones of demonstrations need a minute.
pub(super) const FASTEST_CHARGE: f64 = 2.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DebounceRule {
    /// This many reports in a row ...
    pub(super) count: u32,
    /// ... the first and the last at least this far apart ...
    pub(super) span: Duration,
    /// ... with levels within this many points of each other, besides what charging explains.
    /// Reports without a level agree with all.
    pub(super) spread: u8,
}

impl DebounceRule {
    pub(super) const LEVEL: DebounceRule = DebounceRule {
        count: 3,
        span: Duration::from_secs(2),
        spread: 5,
    };
    /// For charging, which is a flag in each report and not a number that drifts.
    pub(super) const CHARGING: DebounceRule = DebounceRule {
        count: 2,
        span: Duration::from_secs(1),
        spread: 10,
    };
}

#[derive(Debug, Clone, Copy)]
struct Run {
    began: Instant,
    count: u32,
    /// The lowest and the highest level so far.
    levels: Option<(u8, u8)>,
    charging: bool,
}

impl Run {
    fn new(power: Power, now: Instant) -> Run {
        Run {
            began: now,
            count: 1,
            levels: power.level().map(|level| (level, level)),
            charging: power.charging,
        }
    }

    /// The run with one more report; `None` if that report contradicts the earlier ones.
    fn with(self, power: Power, spread: u8, now: Instant) -> Option<Run> {
        let levels = match (self.levels, power.level()) {
            (Some((lowest, highest)), Some(level)) => Some((lowest.min(level), highest.max(level))),
            (None, Some(level)) => Some((level, level)),
            (levels, None) => levels,
        };
        let gain = if power.charging {
            FASTEST_CHARGE * (now - self.began).as_secs_f64()
        } else {
            0.0
        };
        let apart = levels.map_or(0, |(lowest, highest)| highest - lowest);
        let agrees = f64::from(apart) <= f64::from(spread) + gain;
        (agrees && power.charging == self.charging).then_some(Run {
            count: self.count.saturating_add(1),
            levels,
            ..self
        })
    }
}

#[derive(Debug, Clone)]
pub(super) struct Debounce {
    rule: DebounceRule,
    run: Option<Run>,
}

impl Debounce {
    pub(super) fn new(rule: DebounceRule) -> Debounce {
        Debounce { rule, run: None }
    }

    /// Takes in each report; `claims` tells whether it makes the claim. Returns true once the claim
    /// is proved.
    pub(super) fn observe(&mut self, claims: bool, power: Power, now: Instant) -> bool {
        let longer = |run: Run| run.with(power, self.rule.spread, now);
        self.run = claims.then(|| {
            self.run
                .and_then(longer)
                .unwrap_or_else(|| Run::new(power, now))
        });
        self.run
            .is_some_and(|run| run.count >= self.rule.count && now - run.began >= self.rule.span)
    }

    pub(super) fn forget(&mut self) {
        self.run = None;
    }
}

/// Turns on at the first report that says so, and off when several in a row deny it.
#[derive(Debug, Clone)]
pub(super) struct DebouncedFlag {
    on: bool,
    denied: Debounce,
}

impl DebouncedFlag {
    pub(super) fn new() -> DebouncedFlag {
        DebouncedFlag {
            on: false,
            denied: Debounce::new(DebounceRule::LEVEL),
        }
    }

    pub(super) fn observe(&mut self, says: bool, power: Power, now: Instant) {
        let denied = self.denied.observe(!says, power, now);
        self.on = says || (self.on && !denied);
    }

    pub(super) fn is_on(&self) -> bool {
        self.on
    }

    pub(super) fn turn_off(&mut self) {
        *self = DebouncedFlag::new();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the last of these reports (seconds, level, charging) proves a level of 50 or more.
    fn proves(rule: DebounceRule, reports: &[(f64, u8, bool)]) -> bool {
        let start = Instant::now();
        let mut debounce = Debounce::new(rule);
        let mut proved = false;
        for &(at, percent, charging) in reports {
            let power = Power { percent, charging };
            let claims = percent >= 50 || rule == DebounceRule::CHARGING && charging;
            proved = debounce.observe(claims, power, start + Duration::from_secs_f64(at));
        }
        proved
    }

    #[test]
    fn a_level_is_proved_by_three_reports_in_a_row_that_agree_over_two_seconds() {
        let level = |reports: &[(f64, u8, bool)]| proves(DebounceRule::LEVEL, reports);
        let yes = [(0.0, 60, false), (1.0, 57, false), (2.0, 62, false)];
        assert!(level(&yes));
        assert!(!level(&yes[..2]), "two");
        let apart = [(0.0, 60, false), (1.0, 65, false), (2.0, 59, false)];
        assert!(!level(&apart), "the last two");
        for (why, at, percent, charging) in [
            ("too soon", 1.9, 60, false),
            ("another level", 2.0, 63, false),
            ("not the claim", 2.0, 49, false),
            ("another sign", 2.0, 60, true),
        ] {
            let no = [yes[0], yes[1], (at, percent, charging)];
            assert!(!level(&no), "{why}");
            let later = [2.5, 3.5, 4.5].map(|at| (at, 60, false));
            assert!(level(&[&no[..], &later[..]].concat()), "{why}");
        }
    }

    #[test]
    fn charging_explains_levels_that_rise() {
        let slow = [(0.0, 50, true), (60.0, 80, true), (120.0, 100, true)];
        assert!(proves(DebounceRule::LEVEL, &slow));
        assert!(proves(
            DebounceRule::CHARGING,
            &[(0.0, 10, true), (60.0, 90, true)]
        ));
        let fast = [(0.0, 10, true), (1.0, 60, true)];
        assert!(!proves(DebounceRule::CHARGING, &fast));
        assert!(proves(DebounceRule::CHARGING, &[fast[0], (1.0, 11, true)]));
        assert!(!proves(DebounceRule::CHARGING, &[fast[0], (0.9, 10, true)]));
    }

    #[test]
    fn a_latch_holds_until_it_is_denied_by_several() {
        let start = Instant::now();
        let mut flag = DebouncedFlag::new();
        let mut says = |seconds, percent: u8| {
            let power = Power {
                percent,
                charging: false,
            };
            flag.observe(percent <= 8, power, start + Duration::from_secs(seconds));
            flag.is_on()
        };
        assert!(!says(0, 9));
        assert!(says(1, 8));
        assert!(says(2, 9) && says(3, 9) && says(4, 8));
        assert!(says(5, 10) && says(6, 9));
        assert!(!says(7, 9));
    }
}
