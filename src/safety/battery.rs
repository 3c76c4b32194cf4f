//! Evaluates battery reports: the level, whether the battery charges, and when it is low. Bad news
//! is believed at the first report, good news only when several reports confirm it; silence counts
//! as low.
//!
//! While it charges, a robot may report numbers that are no level (`PROTOCOL.md`, *POWER*). They are
//! no silence on the station, and tell that it charges: a negative one as any negative level does, a
//! positive one only while the robot reports that it is on its station. Off the station they say
//! nothing: the time since the last level goes on. No report without a level makes a low battery
//! good; a long charge does.

use std::time::Duration;

use tokio::time::Instant;

use super::Limits;
use super::debounce::{Debounce, DebounceRule, DebouncedFlag, FASTEST_CHARGE};
use crate::robot::Percent;
use crate::wire::Power;

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
pub struct BatteryMonitor {
    low: Percent,
    ok: Percent,
    silence: Duration,
    level: Option<(Percent, Instant)>,
    /// When the last report with a level came.
    told: Option<Instant>,
    /// Reports come, but none has had a level for [`BatteryMonitor::LEVEL_LIFETIME`].
    level_unknown: bool,
    charging_since: Option<Instant>,
    /// It has charged for [`BatteryMonitor::FILL_TIME`], or the robot has reported that it is full.
    filled: bool,
    outlier: Debounce,
    low_cause: Option<LowCause>,
    good: Debounce,
    low_level: DebouncedFlag,
    critical: Percent,
    critical_level: DebouncedFlag,
    charging: Charging,
    charged: Debounce,
    /// Since when charging has been reported but not believed.
    unconfirmed_since: Option<Instant>,
    reported: Option<Instant>,
}

impl BatteryMonitor {
    /// How long one unconfirmed report of charging counts.
    pub const UNCONFIRMED_TIMEOUT: Duration = Duration::from_secs(120);

    /// How long a level counts while reports without one come.
    pub const LEVEL_LIFETIME: Duration = Duration::from_secs(60);

    /// How long a battery must charge to count as good although its level is not known. Many stations
    /// end charging after four hours (`PROTOCOL.md`, *The station*), so an hour is at least a quarter
    /// of a charge: a robot that came home at 30 % has 55 % then, and a small battery is full.
    pub const FILL_TIME: Duration = Duration::from_secs(60 * 60);

    /// The most points by which a level changes from one report to the next, besides ...
    const STEP: f64 = 10.0;
    /// ... this many points a second that driving explains.
    const FASTEST_DRAIN: f64 = 0.3;

    /// Begins without a report; without a report the robot does not move, because there is no link.
    pub fn new(limits: &Limits) -> BatteryMonitor {
        BatteryMonitor {
            low: limits.low,
            ok: limits.ok,
            silence: limits.power_silence.get(),
            level: None,
            told: None,
            level_unknown: false,
            charging_since: None,
            filled: false,
            outlier: Debounce::new(DebounceRule::LEVEL),
            low_cause: None,
            good: Debounce::new(DebounceRule::LEVEL),
            low_level: DebouncedFlag::new(),
            critical: limits.critical,
            critical_level: DebouncedFlag::new(),
            charging: Charging::No,
            charged: Debounce::new(DebounceRule::CHARGING),
            unconfirmed_since: None,
            reported: None,
        }
    }

    /// Handles a battery report; `contact`: the robot has reported that it is on its station.
    pub fn report(&mut self, power: Power, contact: bool, now: Instant) -> Option<BatteryChange> {
        let Some(level) = power.level().map(Percent::saturating) else {
            return self.report_without_level(power, contact, now);
        };
        self.reported = Some(now);
        self.told = Some(now);
        self.level_unknown = false;
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

    fn report_without_level(
        &mut self,
        power: Power,
        contact: bool,
        now: Instant,
    ) -> Option<BatteryChange> {
        self.reported.get_or_insert(now);
        let told = *self.told.get_or_insert(now);
        self.level_unknown = self.level.is_none() || now >= told + Self::LEVEL_LIFETIME;
        let claim = Power {
            charging: power.charging || contact,
            ..power
        };
        self.judge_charging(claim, contact && power.charging, now);
        let charged = self
            .charging_since
            .is_some_and(|since| now >= since + Self::FILL_TIME);
        if self.level_unknown && charged {
            self.fill();
        }
        match (self.charging, self.level) {
            (Charging::Confirmed, _) => self.release(),
            (Charging::No, Some((level, _))) if self.low_level.is_on() => {
                self.become_low(LowCause::Level(level))
            }
            _ => None,
        }
    }

    /// Handles the robot's report that its battery is full. It counts only while it charges and its
    /// level is not known.
    pub fn full(&mut self) {
        if self.level_unknown && self.charging == Charging::Confirmed {
            self.fill();
        }
    }

    /// The battery counts as good until a level says otherwise.
    fn fill(&mut self) {
        self.filled = true;
        self.level = None;
        self.low_level.turn_off();
        self.critical_level.turn_off();
    }

    /// Handles the robot's report that it is on its station, which confirms a report of charging.
    pub fn contact(&mut self, now: Instant) -> Option<BatteryChange> {
        if self.charging != Charging::Unconfirmed {
            return None;
        }
        self.set_charging(Charging::Confirmed, now);
        self.release()
    }

    /// Handles the robot's report that it has left its station.
    pub fn undocked(&mut self, now: Instant) {
        self.set_charging(Charging::No, now);
        self.charged.forget();
    }

    /// Discards an unconfirmed report of charging when its time is over.
    pub fn expire_unconfirmed(&mut self, now: Instant) -> Option<BatteryChange> {
        if self.unconfirmed_deadline().is_none_or(|due| due > now) {
            return None;
        }
        self.set_charging(Charging::No, now);
        let (level, _) = self.level?;
        if level > self.low {
            return None;
        }
        self.become_low(LowCause::Level(level))
    }

    /// When [`BatteryMonitor::expire_unconfirmed`] has something to do.
    pub fn unconfirmed_deadline(&self) -> Option<Instant> {
        let since = self.unconfirmed_since?;
        Some(since + BatteryMonitor::UNCONFIRMED_TIMEOUT)
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

    /// Why the battery is low; `None` if it is not, or was released.
    pub fn low(&self) -> Option<LowCause> {
        self.low_cause
    }

    /// The believed level: the last one, unless it is an outlier and nothing confirms it yet. `None`
    /// before the first, and while it is not known.
    pub fn level(&self) -> Option<Percent> {
        if self.level_unknown {
            return None;
        }
        self.level.map(|(level, _)| level)
    }

    pub fn has_report(&self) -> bool {
        self.reported.is_some()
    }

    /// Whether the battery is good enough to leave the station. If its level is not known: the last
    /// one was at least `ok`, or it has charged for long.
    pub fn may_leave(&self) -> bool {
        if !self.level_unknown {
            return !self.at_or_below_low();
        }
        self.filled || self.level.is_some_and(|(level, _)| level >= self.ok)
    }

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
        let charging = match self.charging {
            _ if !power.charging => Charging::No,
            Charging::Confirmed => Charging::Confirmed,
            _ if contact || proved => Charging::Confirmed,
            _ => Charging::Unconfirmed,
        };
        if stale {
            self.unconfirmed_since = None;
        }
        self.set_charging(charging, now);
    }

    fn set_charging(&mut self, charging: Charging, now: Instant) {
        self.charging = charging;
        self.unconfirmed_since = match charging {
            Charging::Unconfirmed => self.unconfirmed_since.or(Some(now)),
            Charging::No | Charging::Confirmed => None,
        };
        self.charging_since = match charging {
            Charging::Confirmed => self.charging_since.or(Some(now)),
            Charging::No | Charging::Unconfirmed => None,
        };
        self.filled &= charging == Charging::Confirmed;
    }

    /// Believes a level that is an outlier when it is confirmed; one that falls to low, at once.
    fn judge_level(&mut self, level: Percent, power: Power, now: Instant) {
        let is_outlier = self.is_outlier(level, now);
        let falls = self.level.is_some_and(|(before, _)| level < before);
        let proved = self.outlier.observe(is_outlier, power, now);
        if !is_outlier || proved || (falls && level <= self.low) {
            self.level = Some((level, now));
            self.outlier.forget();
        }
    }

    fn is_outlier(&self, level: Percent, now: Instant) -> bool {
        let Some((before, at)) = self.level else {
            return false;
        };
        let seconds = now.saturating_duration_since(at).as_secs_f64();
        let change = f64::from(level.get()) - f64::from(before.get());
        let explained = match self.charging {
            _ if change < 0.0 => BatteryMonitor::FASTEST_DRAIN * seconds,
            Charging::Confirmed => FASTEST_CHARGE * seconds,
            Charging::Unconfirmed | Charging::No => 0.0,
        };
        change.abs() > BatteryMonitor::STEP + explained
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
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: Duration = Duration::from_secs(1);

    struct Rig {
        monitor: BatteryMonitor,
        now: Instant,
    }

    impl Rig {
        fn new() -> Rig {
            let monitor = BatteryMonitor::new(&Limits::default());
            let now = Instant::now();
            Rig { monitor, now }
        }

        fn at(percent: u8) -> Rig {
            let mut rig = Rig::new();
            for _ in 0..4 {
                rig.report(percent, false);
            }
            rig
        }

        fn report(&mut self, percent: u8, charging: bool) -> Option<BatteryChange> {
            self.report_in(percent, charging, false)
        }

        /// A report, five seconds after the one before.
        fn report_in(
            &mut self,
            percent: u8,
            charging: bool,
            contact: bool,
        ) -> Option<BatteryChange> {
            self.now += 5 * SECOND;
            let power = Power { percent, charging };
            self.monitor.report(power, contact, self.now)
        }

        fn level(&self) -> Option<u8> {
            self.monitor.level().map(Percent::get)
        }
    }

    fn low_at(percent: u8) -> Option<BatteryChange> {
        Some(BatteryChange::BecameLow(LowCause::Level(
            Percent::new(percent).unwrap(),
        )))
    }

    const RELEASED: Option<BatteryChange> = Some(BatteryChange::Released);

    #[test]
    fn one_report_at_the_low_level_is_enough() {
        let mut rig = Rig::new();
        assert_eq!(rig.report(31, false), None);
        assert_eq!(rig.report(30, false), low_at(30));
        assert_eq!(rig.report(29, false), None, "reported once");
        assert_eq!(
            Rig::at(90).report(3, false),
            low_at(3),
            "however far it leaps"
        );
    }

    #[test]
    fn a_cause_has_a_description() {
        let level = LowCause::Level(Percent::saturating(20));
        assert_eq!(level.to_string(), "battery at 20 %");
        let silence = LowCause::Silence(Duration::from_secs(600));
        assert_eq!(silence.to_string(), "no battery level for 600 s");
    }

    #[test]
    fn the_third_report_at_the_ok_level_releases() {
        let mut rig = Rig::at(20);
        for percent in [49, 50, 51, 49, 50, 80, 50] {
            assert_eq!(rig.report(percent, false), None);
        }
        assert_eq!(rig.report(52, false), None);
        assert_eq!(rig.report(51, false), RELEASED);
        assert_eq!(rig.report(51, false), None, "reported once");
    }

    #[test]
    fn one_report_of_charging_is_not_enough_and_two_are() {
        let mut rig = Rig::at(10);
        assert_eq!(rig.report(10, true), None);
        assert_eq!(rig.monitor.charging(), Charging::Unconfirmed);
        assert_eq!(rig.report(10, false), None);
        assert_eq!(rig.monitor.charging(), Charging::No);
        assert_eq!(rig.report(10, true), None);
        assert_eq!(rig.report(10, true), RELEASED);
        assert_eq!(rig.monitor.charging(), Charging::Confirmed);
        assert!(rig.monitor.at_or_below_low());
        assert_eq!(rig.report(10, false), low_at(10), "and low again at one");
    }

    #[test]
    fn two_reports_of_charging_at_levels_far_apart_contradict_each_other() {
        let mut rig = Rig::at(10);
        for percent in [100, 30, 70] {
            assert_eq!(rig.report(percent, true), None);
            assert_eq!(rig.monitor.charging(), Charging::Unconfirmed);
        }
    }

    #[test]
    fn a_low_level_counts_when_an_unconfirmed_report_of_charging_expires() {
        let mut rig = Rig::at(40);
        assert_eq!(rig.report(15, true), None);
        let due = rig.now + BatteryMonitor::UNCONFIRMED_TIMEOUT;
        assert_eq!(rig.monitor.unconfirmed_deadline(), Some(due));
        rig.monitor.excuse_silence(rig.now + SECOND);
        assert_eq!(rig.monitor.expire_unconfirmed(due - SECOND), None);
        assert_eq!(rig.monitor.expire_unconfirmed(due), low_at(15));
        assert_eq!(rig.monitor.charging(), Charging::No);
        assert_eq!(rig.monitor.unconfirmed_deadline(), None);
        rig.now = due;
        assert_eq!(rig.report(15, true), RELEASED, "late, but two in a row");
    }

    #[test]
    fn after_undocking_charging_must_be_confirmed_again() {
        let mut rig = Rig::at(60);
        rig.report(60, true);
        rig.report(60, true);
        rig.monitor.undocked(rig.now);
        assert_eq!(rig.monitor.charging(), Charging::No);
        rig.report(60, true);
        assert_eq!(rig.monitor.charging(), Charging::Unconfirmed);
    }

    #[test]
    fn silence_counts_as_low_until_good_reports() {
        let mut rig = Rig::at(80);
        let due = rig.now + Duration::from_secs(600);
        assert_eq!(rig.monitor.next_deadline(), Some(due));
        let silence = LowCause::Silence(Duration::from_secs(600));
        assert_eq!(
            rig.monitor.poll(due),
            Some(BatteryChange::BecameLow(silence))
        );
        assert_eq!(rig.monitor.next_deadline(), None);
        rig.now = due;
        // The same reports before the silence counted too.
        assert_eq!(rig.report(80, false), RELEASED);
    }

    #[test]
    fn critical_holds_while_charging_and_until_three_reports_deny_it() {
        let mut rig = Rig::new();
        rig.report(8, true);
        for percent in [9, 9, 8, 9, 60, 10, 9] {
            rig.report(percent, true);
            assert!(rig.monitor.critical(), "{percent}");
        }
        rig.report(9, true);
        assert!(!rig.monitor.critical());
        assert!(rig.monitor.at_or_below_low());
    }

    #[test]
    fn a_level_that_leaps_is_believed_at_the_third_report() {
        let mut rig = Rig::at(60);
        for (percent, believed) in [
            (40, 60),
            (59, 59),
            (100, 59),
            (40, 59),
            (41, 59),
            (40, 40),
            (39, 39),
        ] {
            rig.report(percent, false);
            assert_eq!(rig.level(), Some(believed), "{percent}");
        }
        rig.report(12, false);
        assert_eq!(rig.level(), Some(12), "low at once");
    }

    #[test]
    fn time_on_the_charger_explains_a_level_that_rose() {
        let mut rig = Rig::at(30);
        rig.report_in(30, true, true);
        rig.now += 20 * SECOND;
        rig.report(75, true);
        assert_eq!(rig.level(), Some(75));
    }

    #[test]
    fn a_level_may_change_by_ten_points_and_by_what_driving_explains() {
        for (seconds, percent, believed) in [
            (5, 70, 70),
            (5, 71, 60),
            (5, 49, 49),
            (5, 46, 60),
            (100, 25, 25),
        ] {
            let mut rig = Rig::at(60);
            rig.now += (seconds - 5) * SECOND;
            rig.report(percent, false);
            assert_eq!(rig.level(), Some(believed), "{percent} in {seconds} s");
        }
    }

    #[test]
    fn no_charge_explains_a_level_that_falls() {
        let mut rig = Rig::at(60);
        rig.report_in(60, true, true);
        rig.now += 15 * SECOND;
        rig.report(35, true);
        assert_eq!(rig.level(), Some(60));
    }

    #[test]
    fn repeated_reports_do_not_extend_the_timeout_and_a_report_after_it_begins_a_new_one() {
        let mut rig = Rig::at(30);
        rig.report(30, true);
        let due = rig.now + BatteryMonitor::UNCONFIRMED_TIMEOUT;
        for percent in [100, 30].into_iter().cycle().take(23) {
            rig.report(percent, true);
            assert_eq!(rig.monitor.charging(), Charging::Unconfirmed);
            assert_eq!(rig.monitor.unconfirmed_deadline(), Some(due));
        }
        rig.report(30, true);
        assert_eq!(rig.now, due);
        assert_eq!(
            rig.monitor.unconfirmed_deadline(),
            Some(due + BatteryMonitor::UNCONFIRMED_TIMEOUT)
        );
    }

    /// Reports without a level on the contacts, one each minute.
    fn charge(rig: &mut Rig, minutes: u32, charging: bool) -> Vec<BatteryChange> {
        let mut changes = Vec::new();
        for _ in 0..minutes {
            rig.now += 55 * SECOND;
            changes.extend(rig.report_in(110, charging, true));
        }
        changes
    }

    #[test]
    fn a_report_without_a_level_is_charging_if_negative_or_on_the_contact() {
        let mut rig = Rig::new();
        assert!(!rig.monitor.has_report());
        assert_eq!(rig.report_in(128, true, true), None);
        assert_eq!(rig.monitor.charging(), Charging::Confirmed);
        assert!(rig.monitor.has_report() && rig.level().is_none());

        let mut rig = Rig::new();
        rig.report_in(110, false, true);
        assert_eq!(rig.monitor.charging(), Charging::Unconfirmed, "no sign");
        rig.report_in(110, false, true);
        assert_eq!(rig.monitor.charging(), Charging::Confirmed);

        let mut rig = Rig::new();
        rig.report(110, true);
        assert_eq!(rig.monitor.charging(), Charging::Unconfirmed, "no contact");
        rig.report(128, true);
        assert_eq!(rig.monitor.charging(), Charging::Confirmed);
        rig.report(110, false);
        assert_eq!(rig.monitor.charging(), Charging::No);
    }

    #[test]
    fn a_level_is_not_known_when_reports_have_had_none_for_a_minute() {
        let mut rig = Rig::at(60);
        for _ in 0..11 {
            rig.report_in(110, true, true);
            assert_eq!(rig.level(), Some(60));
        }
        rig.report_in(110, true, true);
        assert_eq!(rig.level(), None);
        rig.report_in(62, true, true);
        assert_eq!(rig.level(), Some(62));
    }

    #[test]
    fn without_a_level_low_stays_low_until_it_charges_and_again_when_that_ends() {
        let mut rig = Rig::at(15);
        for _ in 0..20 {
            assert_eq!(rig.report(110, false), None);
            assert!(rig.monitor.low().is_some());
        }
        assert_eq!(rig.report(110, true), None);
        assert_eq!(rig.report(110, true), RELEASED);
        assert!(rig.monitor.at_or_below_low());
        assert_eq!(rig.report(110, false), low_at(15));
    }

    #[test]
    fn off_the_station_reports_without_a_level_do_not_end_the_silence() {
        for before in [Some(80), None] {
            let mut rig = before.map_or_else(Rig::new, Rig::at);
            let mut due = None;
            for _ in 0..119 {
                assert_eq!(rig.report(110, false), None);
                let first = *due.get_or_insert(rig.monitor.next_deadline());
                assert_eq!(rig.monitor.next_deadline(), first);
                assert_eq!(rig.monitor.poll(rig.now), None);
            }
            let due = due.flatten().unwrap();
            let silence = LowCause::Silence(Duration::from_secs(600));
            assert_eq!(
                rig.monitor.poll(due),
                Some(BatteryChange::BecameLow(silence))
            );
        }
    }

    #[test]
    fn it_may_leave_at_an_unknown_level_if_the_last_was_good_or_it_has_charged_for_an_hour() {
        let mut good = Rig::at(50);
        charge(&mut good, 3, true);
        assert!(good.monitor.may_leave() && good.level().is_none());
        let befores = [None, Some(49), Some(15), Some(5)];
        for (before, charging) in befores.into_iter().zip([true, false, true, false]) {
            let mut rig = before.map_or_else(Rig::new, Rig::at);
            charge(&mut rig, 60, charging);
            assert!(!rig.monitor.may_leave(), "{before:?}");
            charge(&mut rig, 2, charging);
            assert!(rig.monitor.may_leave(), "{before:?}");
            assert!(!rig.monitor.at_or_below_low() && !rig.monitor.critical());
            assert_eq!(rig.report_in(7, true, true), None);
            assert!(!rig.monitor.may_leave(), "a level counts again");
        }
    }

    #[test]
    fn a_pause_in_charging_begins_the_hour_anew_and_a_full_battery_ends_it() {
        let mut rig = Rig::at(30);
        charge(&mut rig, 59, true);
        rig.monitor.undocked(rig.now);
        charge(&mut rig, 30, true);
        assert!(!rig.monitor.may_leave());
        rig.monitor.full();
        assert!(rig.monitor.may_leave());
        let mut known = Rig::at(15);
        known.report_in(15, true, true);
        known.monitor.full();
        assert!(!known.monitor.may_leave(), "its level says otherwise");
    }

    /// The reports of a battery at `truth` with garbage in between, never two garbage reports in a row.
    fn garbled(truth: u8) -> impl Strategy<Value = Vec<(u8, bool)>> {
        let garbage = prop_oneof![
            (0..=100u8, any::<bool>()),
            Just((60, false)),
            Just((100, false)),
            Just((truth, true)),
            (101..=128u8, any::<bool>()),
        ];
        let piece = (1..4usize, garbage);
        prop::collection::vec(piece, 1..30).prop_map(move |pieces| {
            let piece = |(count, garbage)| [vec![(truth, false); count], vec![garbage]].concat();
            pieces.into_iter().flat_map(piece).collect()
        })
    }

    proptest! {
        #[test]
        fn garbage_among_true_levels_never_releases(
            (truth, reports) in (1..=20u8).prop_flat_map(|truth| (Just(truth), garbled(truth))),
            pause in 100..60_000u64,
        ) {
            let mut rig = Rig::at(truth);
            let critical = truth <= 8;
            for (percent, charging) in reports {
                rig.now += Duration::from_millis(pause);
                prop_assert_eq!(rig.report(percent, charging), None);
                prop_assert!(rig.monitor.low().is_some() && rig.monitor.at_or_below_low());
                prop_assert!(rig.monitor.critical() || !critical);
                prop_assert!(rig.level() <= Some(truth + 10), "{:?}", rig.level());
                prop_assert!(rig.monitor.charging() != Charging::Confirmed);
            }
        }

        #[test]
        fn a_true_charge_always_releases_by_the_second_report_and_ends_critical_by_the_third_above(
            before in (1..=20u8).prop_flat_map(garbled),
            from in 1..90u8,
            gain in 0..6u8,
        ) {
            let mut rig = Rig::at(15);
            for (percent, charging) in before {
                rig.report(percent, charging);
            }
            // The report before may have been garbage that a true report contradicts.
            let released = (0..3).any(|_| rig.report(from, true) == RELEASED);
            prop_assert!(released || rig.monitor.low().is_none());
            let levels = (1..8).map(|step| (from.max(9) + step * gain).min(100));
            levels.for_each(|level| { rig.report(level, true); });
            prop_assert!(!rig.monitor.critical());
            prop_assert_eq!(rig.monitor.charging(), Charging::Confirmed);
        }

        #[test]
        fn a_confirmed_level_is_always_believed_by_the_third_report(
            before in (1..=100u8).prop_flat_map(garbled),
            level in 0..=100u8,
        ) {
            let mut rig = Rig::new();
            for (percent, charging) in before {
                rig.report(percent, charging);
            }
            for _ in 0..3 {
                rig.report(level, false);
            }
            prop_assert_eq!(rig.level(), Some(level));
            prop_assert_eq!(rig.monitor.low().is_some(), level <= 30 || (level < 50 && rig.monitor.low().is_some()));
        }
    }
}
