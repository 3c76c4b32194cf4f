//! The battery: drains faster while driving and charges on the station; and when the robot sends its
//! level as POWER (how often a real robot does is not known: `PROTOCOL.md`, *Not known*).

use std::collections::VecDeque;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use wire::Power;

use super::firmware::PowerWhileCharging;
use crate::world::settings::{BatterySettings, PowerReading};

/// Energy left, percent, and the voltage of the battery at rest, as a share of the range from 1.0 to
/// 1.4 V a cell: an assumption from the discharge curves in data sheets of NiMH cells; no genuine
/// battery was measured.
const VOLTAGE: [[f64; 2]; 8] = [
    [0.0, 0.0],
    [3.0, 20.0],
    [8.0, 40.0],
    [15.0, 52.0],
    [50.0, 60.0],
    [85.0, 68.0],
    [95.0, 80.0],
    [100.0, 100.0],
];
/// By how much the voltage sags while both tracks run at full speed.
const SAG: f64 = 14.0;
/// By how much the voltage rises while the battery charges.
const RISE: f64 = 20.0;

#[derive(Debug, Clone, Default)]
pub(crate) struct Battery {
    settings: BatterySettings,
    /// The level, 0..=100, unrounded.
    pub(super) percent: f64,
    /// The motors' load, 0..=1.
    effort: f64,
    /// Charging does not stop at 100 %.
    pub(super) charging: bool,
    full_reported: bool,
}

impl Battery {
    pub(crate) fn new(settings: BatterySettings) -> Battery {
        Battery {
            settings,
            percent: settings.level,
            ..Battery::default()
        }
    }

    /// Sets the level, clamped to 0..=100; NaN counts as 0.
    pub(crate) fn set_percent(&mut self, percent: f64) {
        self.percent = if percent.is_nan() {
            0.0
        } else {
            percent.clamp(0.0, 100.0)
        };
    }

    pub(crate) fn set_charging(&mut self, charging: bool) {
        if charging != self.charging {
            self.full_reported = false;
        }
        self.charging = charging;
    }

    /// Whether the motors have no power: the battery is empty and not charging.
    pub(crate) fn empty(&self) -> bool {
        self.percent <= 0.0 && !self.charging
    }

    pub(crate) fn step(&mut self, dt: Duration, effort: f64) {
        self.effort = effort.clamp(0.0, 1.0);
        let rate = if self.charging {
            self.settings.charge_per_minute
        } else {
            let driving = self.settings.driving_drain_per_minute;
            let idle = self.settings.idle_drain_per_minute;
            -(idle + (driving - idle) * self.effort)
        };
        self.set_percent(self.percent + rate * dt.as_secs_f64() / 60.0);
    }

    /// Whether the battery has become full since the last call. True once per stay on the charger.
    pub(crate) fn take_full(&mut self) -> bool {
        let newly_full = self.charging && self.percent >= 100.0 && !self.full_reported;
        self.full_reported |= newly_full;
        newly_full
    }

    /// Returns the content of POWER. A charging battery reports at least 1, because the wire format
    /// encodes charging in the sign and has no negative zero.
    pub(crate) fn power(&self) -> Power {
        let percent = match self.settings.power {
            PowerReading::Percent => self.percent,
            PowerReading::Voltage => self.voltage(),
        };
        let percent = percent.round() as u8;
        Power {
            percent: percent.max(u8::from(self.charging)),
            charging: self.charging,
        }
    }

    fn voltage(&self) -> f64 {
        let higher = VOLTAGE.partition_point(|[energy, _]| *energy < self.percent);
        let higher = higher.clamp(1, VOLTAGE.len() - 1);
        let [from, low] = VOLTAGE[higher - 1];
        let [to, high] = VOLTAGE[higher];
        let at_rest = low + (high - low) * (self.percent - from) / (to - from);
        let change = if self.charging {
            RISE
        } else {
            -SAG * self.effort
        };
        (at_rest + change).clamp(0.0, 100.0)
    }
}

/// Maximum number of levels kept: far more than the changes within the longest delay.
const MAX_LEVELS: usize = 1000;

/// The last reported level, and when the next POWER is due.
#[derive(Debug)]
pub(super) struct PowerReports {
    session: bool,
    last_reported: Option<Power>,
    left: Duration,
    /// How far the reported level lags behind.
    lag: Duration,
    /// The level to report, followed by the newer ones, each with its age.
    levels: VecDeque<(Duration, Power)>,
    while_charging: PowerWhileCharging,
    /// How many reports without a level were sent.
    beyond: usize,
    random: StdRng,
}

impl PowerReports {
    /// The largest error of a level, in points, with [`PowerWhileCharging::Noisy`].
    const NOISE: i16 = 15;

    pub(super) fn new(
        lag: Duration,
        while_charging: PowerWhileCharging,
        seed: u64,
    ) -> PowerReports {
        PowerReports {
            session: false,
            last_reported: None,
            left: Duration::ZERO,
            lag,
            levels: VecDeque::new(),
            while_charging,
            beyond: 0,
            random: StdRng::seed_from_u64(seed ^ 0x0070_6f77_6572),
        }
    }

    /// Starts the session of a user; the first POWER follows after `delay`.
    pub(super) fn begin_session(&mut self, delay: Duration) {
        self.session = true;
        self.last_reported = None;
        self.left = delay;
    }

    pub(super) fn end_session(&mut self) {
        self.session = false;
    }

    pub(super) fn step(&mut self, dt: Duration) {
        self.left = self.left.saturating_sub(dt);
        for (age, _) in &mut self.levels {
            *age += dt;
        }
    }

    pub(super) fn level(&mut self, power: Power) -> Power {
        if self.levels.back().is_none_or(|(_, last)| *last != power) {
            self.levels.push_back((Duration::ZERO, power));
        }
        let old =
            |entry: Option<&(Duration, Power)>| entry.is_some_and(|(age, _)| *age >= self.lag);
        while old(self.levels.get(1)) || self.levels.len() > MAX_LEVELS {
            self.levels.pop_front();
        }
        self.levels.front().map_or(power, |(_, level)| *level)
    }

    /// Whether this level must be sent now.
    pub(super) fn due(&self, power: Power) -> bool {
        let changed = self.last_reported.is_some_and(|last| last != power);
        self.session && (changed || self.left.is_zero())
    }

    /// Notes that this level is reported now. Returns what POWER says of it.
    pub(super) fn send(&mut self, power: Power, period: Duration) -> Power {
        self.last_reported = Some(power);
        self.left = period;
        match self.while_charging {
            _ if !power.charging => power,
            PowerWhileCharging::Exact => power,
            PowerWhileCharging::Noisy => self.noisy(power),
            PowerWhileCharging::OutOfRange => {
                self.beyond += 1;
                let byte: i8 = [-110, -128, 110][(self.beyond - 1) % 3];
                Power::from_byte(byte.cast_unsigned())
            }
        }
    }

    fn noisy(&mut self, power: Power) -> Power {
        if self.random.random_bool(0.25) {
            return Power {
                percent: self.random.random_range(101..=127),
                charging: self.random.random_bool(0.5),
            };
        }
        let error = self.random.random_range(-Self::NOISE..=Self::NOISE);
        let level = (i16::from(power.percent) + error).clamp(1, 127);
        Power {
            percent: level as u8,
            charging: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn battery(level: f64) -> Battery {
        Battery::new(BatterySettings {
            level,
            idle_drain_per_minute: 1.0,
            driving_drain_per_minute: 4.0,
            charge_per_minute: 10.0,
            power: PowerReading::Percent,
        })
    }

    const MINUTE: Duration = Duration::from_secs(60);

    #[test]
    fn driving_drains_faster_than_standing() {
        let mut standing = battery(50.0);
        let mut driving = battery(50.0);
        standing.step(MINUTE, 0.0);
        driving.step(MINUTE, 1.0);
        assert!((standing.percent - 49.0).abs() < 1e-9);
        assert!((driving.percent - 46.0).abs() < 1e-9);
    }

    #[test]
    fn an_empty_charging_battery_reports_one_percent() {
        let mut battery = battery(0.0);
        assert!(battery.empty());
        battery.set_charging(true);
        assert_eq!(
            battery.power(),
            Power {
                percent: 1,
                charging: true
            }
        );
        battery.step(MINUTE, 0.0);
        assert_eq!(
            battery.power(),
            Power {
                percent: 10,
                charging: true
            }
        );
        assert!(!battery.empty());
    }

    #[test]
    fn full_is_reported_once_per_stay_on_the_charger() {
        let mut battery = battery(95.0);
        battery.set_charging(true);
        battery.step(MINUTE, 0.0);
        assert_eq!(battery.percent, 100.0);
        assert!(battery.take_full());
        assert!(!battery.take_full());
        battery.set_charging(false);
        battery.set_charging(true);
        assert!(battery.take_full());
    }

    #[test]
    fn levels_stay_within_their_range() {
        let mut battery = battery(0.5);
        battery.step(MINUTE, 1.0);
        assert_eq!(battery.percent, 0.0);
        battery.set_percent(f64::NAN);
        assert_eq!(battery.percent, 0.0);
        battery.set_percent(1e9);
        assert_eq!(battery.percent, 100.0);
    }

    #[test]
    fn a_level_is_reported_when_it_is_old_enough() {
        let power = |percent| Power {
            percent,
            charging: false,
        };
        let second = Duration::from_secs(1);
        let exact = PowerWhileCharging::Exact;
        let mut reports = PowerReports::new(3 * second, exact, 0);
        assert_eq!(reports.level(power(50)), power(50));
        reports.step(second);
        assert_eq!(reports.level(power(49)), power(50));
        reports.step(2 * second);
        assert_eq!(reports.level(power(48)), power(50));
        reports.step(second);
        assert_eq!(reports.level(power(48)), power(49));
        reports.step(2 * second);
        assert_eq!(reports.level(power(48)), power(48));
        let mut prompt = PowerReports::new(Duration::ZERO, exact, 0);
        for percent in [50, 49, 48] {
            assert_eq!(prompt.level(power(percent)), power(percent));
        }
    }

    fn told(while_charging: PowerWhileCharging, power: Power) -> Vec<i8> {
        let mut reports = PowerReports::new(Duration::ZERO, while_charging, 7);
        let mut told = || reports.send(power, MINUTE).to_byte().cast_signed();
        (0..400).map(|_| told()).collect()
    }

    #[test]
    fn a_charging_battery_may_report_what_is_no_level() {
        use PowerWhileCharging::{Exact, Noisy, OutOfRange};
        let power = |charging| Power {
            percent: 60,
            charging,
        };
        for while_charging in [Exact, Noisy, OutOfRange] {
            assert_eq!(told(while_charging, power(false)), [60; 400]);
        }
        assert_eq!(told(Exact, power(true)), [-60; 400]);
        assert_eq!(told(OutOfRange, power(true))[..4], [-110, -128, 110, -110]);
        let noisy = told(Noisy, power(true));
        let count = |says: &dyn Fn(&i8) -> bool| noisy.iter().filter(|byte| says(byte)).count();
        assert!((30..80).contains(&count(&|byte| *byte > 100)));
        assert!((30..80).contains(&count(&|byte| *byte < -100)));
        assert!((250..350).contains(&count(&|byte| (-75..=-45).contains(byte))));
    }
}
