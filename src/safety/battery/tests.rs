use super::*;
use proptest::prelude::*;

const SECOND: Duration = Duration::from_secs(1);

/// A guard with the default limits, and a clock.
struct Rig {
    guard: BatteryGuard,
    now: Instant,
}

impl Rig {
    fn new() -> Rig {
        let (guard, now) = (BatteryGuard::new(&Limits::default()), Instant::now());
        Rig { guard, now }
    }

    /// After a long time at this level.
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
    fn report_in(&mut self, percent: u8, charging: bool, contact: bool) -> Option<BatteryChange> {
        self.now += 5 * SECOND;
        let power = Power { percent, charging };
        self.guard.report(power, contact, self.now)
    }

    fn level(&self) -> Option<u8> {
        self.guard.level().map(Percent::get)
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
    assert_eq!(rig.report(21, false), None);
    assert_eq!(rig.report(20, false), low_at(20));
    assert_eq!(rig.report(19, false), None, "reported once");
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
    assert_eq!(rig.guard.charging(), Charging::Unconfirmed);
    assert_eq!(rig.report(10, false), None);
    assert_eq!(rig.guard.charging(), Charging::No);
    assert_eq!(rig.report(10, true), None);
    assert_eq!(rig.report(10, true), RELEASED);
    assert_eq!(rig.guard.charging(), Charging::Confirmed);
    assert!(rig.guard.at_or_below_low());
    assert_eq!(rig.report(10, false), low_at(10), "and low again at one");
}

#[test]
fn on_the_contact_one_report_of_charging_is_enough_whichever_comes_first() {
    assert_eq!(Rig::at(10).report_in(10, true, true), RELEASED);
    let mut rig = Rig::at(10);
    assert_eq!(rig.guard.contact(), None, "contact alone is not charging");
    rig.report(10, true);
    assert_eq!(rig.guard.contact(), RELEASED);
    assert_eq!(rig.guard.charging(), Charging::Confirmed);
}

#[test]
fn two_reports_of_charging_at_levels_far_apart_contradict_each_other() {
    let mut rig = Rig::at(10);
    for percent in [100, 30, 70] {
        assert_eq!(rig.report(percent, true), None);
        assert_eq!(rig.guard.charging(), Charging::Unconfirmed);
    }
}

#[test]
fn a_low_level_counts_when_an_unconfirmed_report_of_charging_expires() {
    let mut rig = Rig::at(30);
    assert_eq!(rig.report(15, true), None);
    let due = rig.now + BatteryGuard::UNCONFIRMED_TIMEOUT;
    assert_eq!(rig.guard.unconfirmed_deadline(), Some(due));
    rig.guard.excuse_silence(rig.now + SECOND);
    assert_eq!(rig.guard.expire_unconfirmed(due - SECOND), None);
    assert_eq!(rig.guard.expire_unconfirmed(due), low_at(15));
    assert_eq!(rig.guard.charging(), Charging::No);
    assert_eq!(rig.guard.unconfirmed_deadline(), None);
    rig.now = due;
    assert_eq!(rig.report(15, true), RELEASED, "late, but two in a row");
}

#[test]
fn after_undocking_charging_must_be_confirmed_again() {
    let mut rig = Rig::at(60);
    rig.report(60, true);
    rig.report(60, true);
    rig.guard.undocked();
    assert_eq!(rig.guard.charging(), Charging::No);
    rig.report(60, true);
    assert_eq!(rig.guard.charging(), Charging::Unconfirmed);
}

#[test]
fn silence_counts_as_low_until_good_reports() {
    let mut rig = Rig::at(80);
    let due = rig.now + Duration::from_secs(600);
    assert_eq!(rig.guard.next_deadline(), Some(due));
    let silence = LowCause::Silence(Duration::from_secs(600));
    assert_eq!(rig.guard.poll(due), Some(BatteryChange::BecameLow(silence)));
    assert_eq!(rig.guard.next_deadline(), None);
    rig.now = due;
    // The same reports before the silence counted too.
    assert_eq!(rig.report(80, false), RELEASED);
}

#[test]
fn a_level_is_fresh_until_silence_counts() {
    let mut rig = Rig::new();
    assert!(!rig.guard.is_fresh(rig.now), "no report yet");
    rig.report(10, false);
    let later = |ms| rig.now + Duration::from_millis(ms);
    assert!(rig.guard.is_fresh(later(599_999)));
    assert!(!rig.guard.is_fresh(later(600_000)));
}

#[test]
fn on_the_station_silence_is_excused() {
    let mut rig = Rig::new();
    rig.report(80, true);
    let later = rig.now + Duration::from_secs(599);
    rig.guard.excuse_silence(later);
    assert_eq!(rig.guard.poll(rig.now + Duration::from_secs(700)), None);
}

#[test]
fn critical_holds_while_charging_and_until_three_reports_deny_it() {
    let mut rig = Rig::new();
    rig.report(8, true);
    for percent in [9, 9, 8, 9, 60, 10, 9] {
        rig.report(percent, true);
        assert!(rig.guard.critical(), "{percent}");
    }
    rig.report(9, true);
    assert!(!rig.guard.critical());
    assert!(rig.guard.at_or_below_low());
}

#[test]
fn a_level_that_leaps_is_believed_at_the_third_report() {
    let mut rig = Rig::at(60);
    for (percent, believed) in [
        (30, 60),
        (59, 59),
        (100, 59),
        (30, 59),
        (31, 59),
        (30, 30),
        (29, 29),
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
    let due = rig.now + BatteryGuard::UNCONFIRMED_TIMEOUT;
    for percent in [100, 30].into_iter().cycle().take(23) {
        rig.report(percent, true);
        assert_eq!(rig.guard.charging(), Charging::Unconfirmed);
        assert_eq!(rig.guard.unconfirmed_deadline(), Some(due));
    }
    rig.report(30, true);
    assert_eq!(rig.now, due);
    assert_eq!(
        rig.guard.unconfirmed_deadline(),
        Some(due + BatteryGuard::UNCONFIRMED_TIMEOUT)
    );
}

/// The reports of a battery at `truth` with garbage in between, never two garbage reports in a row.
fn garbled(truth: u8) -> impl Strategy<Value = Vec<(u8, bool)>> {
    let garbage = prop_oneof![
        (0..=100u8, any::<bool>()),
        Just((60, false)),
        Just((100, false)),
        Just((truth, true)),
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
            prop_assert!(rig.guard.low().is_some() && rig.guard.at_or_below_low());
            prop_assert!(rig.guard.critical() || !critical);
            prop_assert!(rig.level() <= Some(truth + 10), "{:?}", rig.level());
            prop_assert!(rig.guard.charging() != Charging::Confirmed);
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
        prop_assert!(released || rig.guard.low().is_none());
        let levels = (1..8).map(|step| (from.max(9) + step * gain).min(100));
        levels.for_each(|level| { rig.report(level, true); });
        prop_assert!(!rig.guard.critical());
        prop_assert_eq!(rig.guard.charging(), Charging::Confirmed);
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
        prop_assert_eq!(rig.guard.low().is_some(), level <= 20 || (level < 50 && rig.guard.low().is_some()));
    }
}
