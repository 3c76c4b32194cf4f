use super::*;
use proptest::prelude::*;

/// A battery with a true level, and the estimate learnt from it.
struct Rig {
    drain: Drain,
    level: f64,
    now: Instant,
}

impl Rig {
    fn at(level: f64) -> Rig {
        let (drain, now) = (Drain::default(), Instant::now());
        let mut rig = Rig { drain, level, now };
        rig.report(false);
        rig
    }

    fn report(&mut self, charging: bool) {
        self.drain
            .level(self.level.round() as u8, charging, self.now);
    }

    /// Spends this many minutes on an activity; the level is reported every five seconds.
    fn spend(&mut self, activity: Activity, minutes: f64, rate: f64) {
        self.drain.advance(activity, self.now);
        for _ in 0..(minutes * 12.0).round() as u32 {
            self.now += Duration::from_secs(5);
            self.level -= rate / 12.0;
            self.report(rate < 0.0);
        }
    }

    fn left(&self) -> f64 {
        self.drain.minutes_left().unwrap()
    }
}

fn near(found: f64, expected: f64, share: f64) -> bool {
    (found - expected).abs() <= expected * share
}

#[test]
fn no_rate_is_known_before_two_percent_have_drained() {
    let mut rig = Rig::at(80.2);
    rig.spend(Activity::Standing, 2.6, 1.0);
    assert_eq!(rig.level.round(), 78.0);
    assert_eq!(rig.drain.minutes_left(), None);
    assert_eq!(rig.drain.rate(Activity::Standing), None);
    rig.spend(Activity::Standing, 1.0, 1.0);
    assert!(near(rig.left(), 77.0, 0.1), "{}", rig.left());
    assert_eq!(rig.drain.rate(Activity::Driving), None);
}

#[test]
fn after_a_leap_the_minutes_left_are_unknown() {
    let mut rig = Rig::at(80.0);
    rig.spend(Activity::Standing, 6.0, 1.0);
    assert!(rig.drain.minutes_left().is_some());
    rig.level = 40.0;
    rig.report(false);
    assert_eq!(rig.drain.minutes_left(), None);
    let rate = rig.drain.rate(Activity::Standing).unwrap();
    assert!(near(rate, 1.0, 0.1), "what was learnt stays: {rate}");
    rig.spend(Activity::Standing, 5.0, 1.0);
    assert!(near(rig.left(), rig.level, 0.1));
}

#[test]
fn a_flickering_level_does_not_distort_the_rate() {
    let mut rig = Rig::at(80.0);
    rig.drain.advance(Activity::Standing, rig.now);
    for step in 0..600u32 {
        rig.now += Duration::from_secs(5);
        rig.level -= 1.0 / 12.0;
        let flicker = u8::from(step % 3 == 0);
        rig.drain
            .level(rig.level.round() as u8 + flicker, false, rig.now);
    }
    assert!(near(rig.left(), rig.level, 0.1), "{}", rig.left());
}

#[test]
fn charging_has_its_own_rate_and_no_minutes_left() {
    let mut rig = Rig::at(30.0);
    rig.spend(Activity::Standing, 5.0, 1.0);
    rig.spend(Activity::Standing, 5.0, -2.0);
    assert_eq!(rig.drain.minutes_left(), None);
    assert!(near(rig.drain.charging_rate().unwrap(), 2.0, 0.1));
    rig.spend(Activity::Standing, 1.0, 1.0);
    assert!(near(rig.left(), rig.level, 0.1), "the rate before");
}

#[test]
fn time_without_a_link_is_not_learnt_from() {
    let mut rig = Rig::at(80.0);
    rig.spend(Activity::Standing, 6.0, 1.0);
    rig.drain.interrupt();
    rig.now += Duration::from_secs(3600);
    rig.level = 71.0;
    rig.report(false);
    assert!(near(rig.left(), 71.0, 0.1), "{}", rig.left());
    rig.spend(Activity::Standing, 6.0, 1.0);
    assert!(near(rig.left(), rig.level, 0.1));
}

#[test]
fn the_fast_batteries_of_demonstrations_do_not_leap() {
    let mut rig = Rig::at(90.0);
    rig.drain.advance(Activity::Driving, rig.now);
    for _ in 0..4 {
        rig.now += Duration::from_secs(60);
        rig.level -= 17.0;
        rig.report(false);
    }
    assert!(near(rig.left(), 22.0 / 17.0, 0.01), "{}", rig.left());
}

#[test]
fn alternating_activities_each_have_their_rate() {
    let mut rig = Rig::at(99.0);
    for _ in 0..20 {
        rig.spend(Activity::Standing, 1.3, 0.6);
        rig.spend(Activity::Driving, 0.7, 2.4);
        rig.spend(Activity::Searching, 0.5, 1.2);
    }
    for (activity, rate) in [
        (Activity::Standing, 0.6),
        (Activity::Searching, 1.2),
        (Activity::Driving, 2.4),
    ] {
        let found = rig.drain.rate(activity).unwrap();
        assert!(near(found, rate, 0.35), "{activity:?} {found}");
    }
    let driving = rig.drain.minutes_left_if(Activity::Driving).unwrap();
    let standing = rig.drain.minutes_left_if(Activity::Standing).unwrap();
    assert!(driving < rig.left() && rig.left() < standing);
}

#[test]
fn an_account_remembers_ten_percent() {
    let mut account = Account::default();
    account.add(8.0, 8.0);
    assert_eq!((account.percent, account.minutes), (8.0, 8.0));
    account.add(8.0, 4.0);
    assert_eq!((account.percent, account.minutes), (10.0, 7.5));
}

#[test]
fn no_rate_is_learnt_in_no_time() {
    let account = Account {
        percent: 5.0,
        minutes: 0.0,
    };
    assert_eq!(account.rate(), None);
}

#[test]
fn an_unknown_rate_is_estimated_from_the_known_ones() {
    let mut drain = Drain::default();
    assert_eq!(drain.needs(), [1.0, 1.5, 2.0]);
    let known = |minutes| Account {
        percent: 6.0,
        minutes,
    };
    drain.activities[Activity::Driving as usize] = known(1.0);
    assert_eq!(drain.needs(), [3.0, 4.5, 6.0]);
    drain.activities[Activity::Standing as usize] = known(6.0);
    assert_eq!(drain.needs(), [1.0, 3.0, 6.0]);
}

#[test]
fn a_level_that_moves_back_flickers_up_to_two_points_and_leaps_beyond() {
    for (back, known) in [(1.0, true), (2.0, true), (3.0, false), (4.0, false)] {
        let mut rig = Rig::at(80.0);
        rig.spend(Activity::Standing, 6.0, 1.0);
        rig.level = rig.level.round() + back;
        rig.report(false);
        assert_eq!(rig.drain.minutes_left().is_some(), known, "{back}");
    }
}

#[test]
fn a_sudden_change_of_more_than_five_points_is_a_leap() {
    for (seconds, points, known) in [(0, 5.0, true), (0, 6.0, false), (5, 15.0, false)] {
        let mut rig = Rig::at(80.0);
        rig.spend(Activity::Standing, 6.0, 1.0);
        // No time has passed since the last change of the level.
        rig.level = rig.level.round() - 1.0;
        rig.report(false);
        rig.level -= points;
        rig.now += Duration::from_secs(seconds);
        rig.report(false);
        let found = rig.drain.minutes_left().is_some();
        assert_eq!(found, known, "{points} in {seconds} s");
    }
}

#[test]
fn a_charge_of_two_points_a_second_is_not_a_leap() {
    let mut rig = Rig::at(5.0);
    rig.drain.advance(Activity::Standing, rig.now);
    for (seconds, level) in [(0, 5.0), (1, 6.0), (60, 80.0)] {
        rig.now += Duration::from_secs(seconds);
        rig.level = level;
        rig.report(true);
    }
    assert_eq!(rig.drain.charging_rate(), Some(74.0));
}

proptest! {
    #[test]
    fn after_five_percent_of_steady_drain_the_minutes_left_are_right_within_a_fifth(
        level in 30.0..100.0f64,
        rate in 0.2..15.0f64,
        period in 1..40u64,
    ) {
        let mut rig = Rig::at(level);
        rig.drain.advance(Activity::Standing, rig.now);
        let start = level;
        // A report comes at least once per half percent.
        let period = Duration::from_secs_f64((period as f64).min(30.0 / rate));
        while rig.level > start - 6.0 {
            rig.now += period;
            rig.level -= rate * minutes(period);
            rig.report(false);
        }
        let true_left = rig.level / rate;
        prop_assert!(near(rig.left(), true_left, 0.2), "{} for {true_left}", rig.left());
    }

    #[test]
    fn all_rates_are_positive_and_finite(
        steps in prop::collection::vec((0..=100u8, any::<bool>(), 0..3usize, 0..5_000u64), 0..200),
    ) {
        let (mut drain, mut now) = (Drain::default(), Instant::now());
        for (level, charging, activity, seconds) in steps {
            drain.advance(Activity::ALL[activity], now);
            now += Duration::from_secs(seconds);
            drain.level(level, charging, now);
            let rates = Activity::ALL.map(|one| drain.rate(one));
            for rate in rates.into_iter().chain([drain.charging_rate()]).flatten() {
                prop_assert!(rate.is_finite() && rate > 0.0);
            }
            prop_assert!(drain.minutes_left().is_none_or(|left| left.is_finite() && left >= 0.0));
        }
    }
}
