//! What POWER says of the energy in the battery. Some robots may report a share of a voltage instead
//! of a charge (`PROTOCOL.md`, *Not known*): it sags while the tracks run, rises while the battery
//! charges, hardly changes over most of the energy, and falls steeply at the end. Such a number is
//! recognized by its sag and converted, so that every other rule sees a share of the energy.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use crate::wire::Power;

/// What the number in POWER means.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
pub enum PowerMeaning {
    /// A share of the energy, until it sags twice while the tracks run: then a voltage.
    #[default]
    Auto,
    /// A share of the energy.
    Percent,
    /// A share of a voltage.
    Voltage,
}

/// What the motors take now, as far as the agent knows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotorLoad {
    /// The mean power of both tracks, 0..=1.
    pub effort: f64,
    /// Since when the tracks move, or stand.
    pub since: Instant,
}

/// The last level in a motion or a rest.
#[derive(Debug, Clone, Copy)]
struct Phase {
    since: Instant,
    effort: f64,
    level: f64,
}

/// The lowest level in motion.
#[derive(Debug, Clone, Copy)]
struct Sag {
    level: f64,
    effort: f64,
    /// How long the motion had lasted.
    after: Duration,
}

/// Converts POWER into a share of the energy.
#[derive(Debug, Clone)]
pub struct PowerGauge {
    meaning: PowerMeaning,
    phase: Option<Phase>,
    at_rest: Option<f64>,
    /// The lowest level of the motions since.
    sag: Option<Sag>,
    /// How many motions in a row have sagged.
    sagged: u32,
    /// By how much the level sags at full power.
    full_sag: Option<f64>,
    /// The last level while the battery charged, if it has not been at rest since.
    charging: Option<f64>,
    /// By how much the level rises while the battery charges.
    rise: f64,
    /// The level that the battery would have at rest now.
    rested: Option<f64>,
}

/// The level at rest of a voltage, and the energy that is left at least, percent. From the discharge
/// curves in data sheets of NiMH cells, with 0 % at 1.0 V and 100 % at 1.4 V a cell; no genuine battery
/// was measured.
const ENERGY: [[f64; 2]; 9] = [
    [0.0, 0.0],
    [20.0, 2.0],
    [40.0, 6.0],
    [50.0, 11.0],
    [54.0, 20.0],
    [60.0, 45.0],
    [68.0, 80.0],
    [80.0, 92.0],
    [100.0, 100.0],
];

impl PowerGauge {
    /// While a motion or a rest lasts, its levels count after this time.
    const SETTLED: Duration = Duration::from_millis(250);
    /// A percentage does not change by so many points when the tracks start, and back when they stop.
    const LEAST_SAG: f64 = 3.0;
    /// So many motions in a row prove a voltage.
    const PROOF: u32 = 2;
    /// A motion of this effort and length that does not sag proves the opposite.
    const CLEAR_EFFORT: f64 = 0.3;
    const CLEAR_MOTION: Duration = Duration::from_secs(2);
    /// The sag at full power until it is measured, and the largest that is believed.
    const ASSUMED_SAG: f64 = 10.0;
    const LARGEST_SAG: f64 = 30.0;
    /// Levels are whole numbers: two of the same voltage may differ by less than this.
    const ROUNDING: f64 = 1.5;
    /// The rise until it is measured, and the least and the largest that are believed.
    const ASSUMED_RISE: f64 = 25.0;
    const LEAST_RISE: f64 = 10.0;
    const LARGEST_RISE: f64 = 40.0;

    pub fn new(meaning: PowerMeaning) -> PowerGauge {
        PowerGauge {
            meaning,
            phase: None,
            at_rest: None,
            sag: None,
            sagged: 0,
            full_sag: None,
            charging: None,
            rise: PowerGauge::ASSUMED_RISE,
            rested: None,
        }
    }

    pub fn is_voltage(&self) -> bool {
        self.meaning == PowerMeaning::Voltage
    }

    /// Takes in a report; returns it with a share of the energy. A report without a level stays as it
    /// is.
    pub fn read(&mut self, power: Power, load: MotorLoad, now: Instant) -> Power {
        let Some(level) = power.level().map(f64::from) else {
            return power;
        };
        if self.meaning == PowerMeaning::Percent {
            return power;
        }
        if power.charging {
            self.note_charging(level);
        } else {
            self.end_phase(load.since);
            let phase = Phase {
                since: load.since,
                effort: load.effort,
                level,
            };
            self.phase = Some(phase);
            if load.effort > 0.0 {
                self.note_level_in_motion(level, load.effort);
            }
            if now >= load.since + PowerGauge::SETTLED {
                self.settle(phase, now);
            }
            self.rested = self.rested.or(Some(level));
        }
        match self.rested {
            Some(rested) if self.is_voltage() => Power {
                percent: energy(rested).max(u8::from(power.charging)),
                ..power
            },
            _ => power,
        }
    }

    fn note_charging(&mut self, level: f64) {
        self.phase = None;
        self.sag = None;
        self.at_rest = None;
        self.charging = Some(level);
        self.rested = Some(level - self.rise);
    }

    /// A robot may report changes only: if the tracks have started or stopped since the last report, its
    /// level was that until then.
    fn end_phase(&mut self, next: Instant) {
        if let Some(phase) = self.phase
            && phase.since != next
        {
            self.settle(phase, next);
        }
    }

    fn note_level_in_motion(&mut self, level: f64, effort: f64) {
        let full_sag = self.full_sag.unwrap_or(PowerGauge::ASSUMED_SAG);
        let unloaded = level + full_sag * effort;
        // A battery that is not charged does not rise.
        self.rested = match self.rested {
            Some(rested) if unloaded > rested - PowerGauge::ROUNDING => Some(rested),
            _ => Some(unloaded),
        };
    }

    fn settle(&mut self, phase: Phase, now: Instant) {
        let Phase { effort, level, .. } = phase;
        let after = now.saturating_duration_since(phase.since);
        if effort > 0.0 {
            if self.sag.is_none_or(|sag| level <= sag.level) {
                self.sag = Some(Sag {
                    level,
                    effort,
                    after,
                });
            }
            return;
        }
        let has_sagged = |rested| level < rested - PowerGauge::ROUNDING;
        if after < PowerGauge::SETTLED && self.rested.is_some_and(has_sagged) {
            return;
        }
        if let Some(charged) = self.charging.take() {
            let rise = charged - level;
            self.rise = rise.clamp(PowerGauge::LEAST_RISE, PowerGauge::LARGEST_RISE);
        }
        if let (Some(sag), Some(before)) = (self.sag.take(), self.at_rest) {
            self.judge(sag, before, level);
        }
        self.at_rest = Some(level);
        self.rested = Some(level);
    }

    /// Judges the motions between two rests.
    fn judge(&mut self, sag: Sag, before: f64, after: f64) {
        let depth = before.min(after) - sag.level;
        if depth >= PowerGauge::LEAST_SAG {
            self.sagged += 1;
            let full = ((after - sag.level) / sag.effort).min(PowerGauge::LARGEST_SAG);
            self.full_sag = Some(self.full_sag.map_or(full, |known| 0.7 * known + 0.3 * full));
        } else if depth < 1.0
            && sag.effort >= PowerGauge::CLEAR_EFFORT
            && sag.after >= PowerGauge::CLEAR_MOTION
        {
            self.sagged = 0;
        }
        if self.sagged >= PowerGauge::PROOF {
            self.meaning = PowerMeaning::Voltage;
        }
    }
}

/// The energy that is left at this level at rest, percent.
fn energy(level: f64) -> u8 {
    let level = level.clamp(0.0, 100.0);
    let higher = ENERGY.partition_point(|[at, _]| *at < level);
    let higher = higher.clamp(1, ENERGY.len() - 1);
    let [from, low] = ENERGY[higher - 1];
    let [to, high] = ENERGY[higher];
    (low + (high - low) * (level - from) / (to - from)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    struct Rig {
        gauge: PowerGauge,
        now: Instant,
        since: Instant,
        effort: f64,
    }

    impl Rig {
        fn new(meaning: PowerMeaning) -> Rig {
            let now = Instant::now();
            Rig {
                gauge: PowerGauge::new(meaning),
                now,
                since: now,
                effort: 0.0,
            }
        }

        /// The tracks run, or stand, for 20 s with these levels.
        fn run(&mut self, effort: f64, levels: [u8; 4]) -> [u8; 4] {
            self.effort = effort;
            self.since = self.now;
            levels.map(|level| self.report(level, false))
        }

        fn report(&mut self, percent: u8, charging: bool) -> u8 {
            self.now += 5 * SECOND;
            let load = MotorLoad {
                effort: self.effort,
                since: self.since,
            };
            let power = Power { percent, charging };
            self.gauge.read(power, load, self.now).percent
        }
    }

    #[test]
    fn two_motions_that_sag_prove_a_voltage() {
        let mut rig = Rig::new(PowerMeaning::Auto);
        assert_eq!(rig.run(0.0, [60; 4]), [60; 4]);
        assert_eq!(rig.run(0.5, [55; 4]), [55; 4]);
        assert_eq!(rig.run(0.0, [60; 4]), [60; 4]);
        assert_eq!(rig.run(0.5, [55; 4]), [55; 4]);
        assert!(!rig.gauge.is_voltage());
        assert_eq!(rig.run(0.0, [60; 4]), [45; 4]);
        assert!(rig.gauge.is_voltage());
        assert_eq!(
            rig.run(0.5, [55, 55, 54, 54])[3],
            45,
            "a point may be rounding"
        );
        assert_eq!(rig.run(0.5, [49; 4])[3], 20);
    }

    #[test]
    fn a_share_of_the_energy_is_never_taken_for_a_voltage() {
        let mut rig = Rig::new(PowerMeaning::Auto);
        for level in (40..100).rev() {
            let effort = f64::from(level % 2);
            let jitter = if level % 3 == 0 { 1 } else { 0 };
            let levels = [level, level - jitter, level + jitter, level];
            assert_eq!(rig.run(effort, levels), levels);
        }
        let mut rig = Rig::new(PowerMeaning::Percent);
        for level in [60, 50].repeat(10) {
            assert_eq!(rig.run(f64::from(60 - level), [level; 4]), [level; 4]);
        }
    }

    #[test]
    fn one_sag_among_clear_motions_proves_nothing() {
        let mut rig = Rig::new(PowerMeaning::Auto);
        for sag in [10, 0, 10, 0] {
            rig.run(0.0, [60; 4]);
            rig.run(0.5, [60 - sag; 4]);
        }
        rig.run(0.0, [60; 4]);
        assert!(!rig.gauge.is_voltage());
    }

    #[test]
    fn a_voltage_while_charging_is_no_charge() {
        let mut rig = Rig::new(PowerMeaning::Voltage);
        assert_eq!(rig.report(75, true), 11, "15 to 25 points above the rest");
        assert_eq!(rig.report(100, true), 87);
        assert_eq!(rig.run(0.0, [85; 4])[3], 94);
        assert_eq!(rig.report(75, true), 45, "15 points above, as measured");
        assert_eq!(rig.report(1, true), 1, "0 would not charge");
    }

    #[test]
    fn a_cliff_under_way_is_seen_without_a_rest() {
        let mut rig = Rig::new(PowerMeaning::Voltage);
        rig.run(0.0, [60; 4]);
        let cliff = rig.run(1.0, [49, 44, 34, 20]);
        assert!(cliff[0] > 20 && cliff[1] <= 20 && cliff[3] < 8, "{cliff:?}");
    }

    #[test]
    fn motions_too_short_to_settle_do_not_hide_a_falling_level() {
        let mut rig = Rig::new(PowerMeaning::Voltage);
        rig.run(0.0, [60; 4]);
        for level in (20..60).rev() {
            rig.effort = 1.0;
            rig.since = rig.now + 5 * SECOND - SECOND / 8;
            rig.report(level, false);
            rig.effort = 0.0;
            rig.since = rig.now + 5 * SECOND - SECOND / 8;
            rig.report(level, false);
        }
        assert!(rig.report(20, false) < 8);
    }

    #[test]
    fn a_robot_that_reports_changes_only_is_recognized_by_short_motions() {
        let mut rig = Rig::new(PowerMeaning::Auto);
        rig.report(60, false);
        for level in [54, 60].repeat(3) {
            rig.effort = if level < 60 { 0.6 } else { 0.0 };
            rig.since = rig.now;
            let load = MotorLoad {
                effort: rig.effort,
                since: rig.since,
            };
            let power = Power {
                percent: level,
                charging: false,
            };
            rig.gauge.read(power, load, rig.now + SECOND / 10);
            rig.now += SECOND / 5;
        }
        assert!(rig.gauge.is_voltage());
    }

    #[test]
    fn a_rest_too_short_to_recover_does_not_count_as_empty() {
        let mut rig = Rig::new(PowerMeaning::Voltage);
        rig.run(0.0, [60; 4]);
        rig.run(1.0, [50; 4]);
        rig.effort = 0.0;
        rig.since = rig.now + 5 * SECOND - SECOND / 10;
        assert_eq!(rig.report(50, false), 45);
        rig.effort = 1.0;
        rig.since = rig.now;
        assert_eq!(rig.report(50, false), 45);
    }

    #[test]
    fn a_report_without_a_level_stays_as_it_is() {
        let mut rig = Rig::new(PowerMeaning::Voltage);
        assert_eq!(rig.report(110, true), 110);
        assert_eq!(rig.report(128, true), 128);
    }
}
