mod waiting;

use super::*;
use crate::clock::{Date, Zone};
use crate::timetable::Rule;
use proptest::prelude::*;

const MINUTE: Duration = Duration::from_secs(60);

fn table(rules: &[(&str, &str, Option<&str>)], catch_up: &str) -> Timetable {
    let rule = |(run, at, lasts): &(&str, &str, Option<&str>)| Rule {
        run: (*run).to_owned(),
        at: at.parse().unwrap(),
        lasts: lasts.map(|text| text.parse().unwrap()),
    };
    Timetable {
        rules: rules.iter().map(rule).collect(),
        zone: "Europe/Rome".parse().unwrap(),
        quiet: None,
        catch_up: catch_up.parse().unwrap(),
    }
}

/// A simulated service without a robot: a wall clock, and elapsed time.
struct World {
    planner: Planner,
    now: Timestamp,
    at: Instant,
    ready: bool,
    running: Vec<String>,
    acts: Vec<(Timestamp, Act)>,
}

impl World {
    fn new(table: Timetable, date: &str) -> World {
        World::after(table, date, Record::default())
    }

    fn after(table: Timetable, date: &str, record: Record) -> World {
        World {
            now: when(date),
            planner: Planner::new(table, record),
            at: Instant::now(),
            ready: true,
            running: Vec::new(),
            acts: Vec::new(),
        }
    }

    fn poll(&mut self) {
        let inputs = PlannerInputs {
            now: self.now,
            at: self.at,
            ready: self.ready,
            running: &self.running,
        };
        for act in self.planner.poll(inputs) {
            match &act {
                Act::Start { run, .. } => self.running.push(run.clone()),
                Act::End { run } => {
                    self.running.retain(|name| name != run);
                    self.planner.ended(run);
                }
                Act::Report(_) => {}
            }
            self.acts.push((self.now, act));
        }
    }

    /// Polls as the service does until this time has passed.
    fn pass(&mut self, time: Duration) {
        let end = self.at + time;
        self.poll();
        while self.at < end {
            let pause = self.planner.pause(self.now, self.at).min(end - self.at);
            self.at += pause;
            self.now += pause;
            self.poll();
        }
    }

    fn set_clock(&mut self, date: &str) {
        self.now = when(date);
    }

    fn starts(&self) -> Vec<String> {
        let zone: Zone = "Europe/Rome".parse().unwrap();
        let start = |(at, act): &(Timestamp, Act)| match act {
            Act::Start { run, .. } => {
                Some(format!("{run} {}", zone.time(*at).strftime("%d %H:%M")))
            }
            _ => None,
        };
        self.acts.iter().filter_map(start).collect()
    }

    fn notices(&self) -> Vec<&Notice> {
        let is_notice = |(_, act): &'_ (Timestamp, Act)| matches!(act, Act::Report(_));
        let notices = self.acts.iter().filter(|act| is_notice(act));
        notices
            .map(|(_, act)| match act {
                Act::Report(notice) => notice,
                _ => unreachable!(),
            })
            .collect()
    }
}

fn when(date: &str) -> Timestamp {
    date.parse::<Date>()
        .unwrap()
        .at(&"Europe/Rome".parse().unwrap())
}

fn patrol() -> Timetable {
    table(&[("patrol", "0 9,21 * * *", Some("30m"))], "10m")
}

#[test]
fn a_behaviour_starts_on_time_and_is_ended_on_time() {
    let mut world = World::new(patrol(), "2026-05-04 08:00");
    world.pass(24 * 60 * MINUTE);
    assert_eq!(world.starts(), ["patrol 04 09:00", "patrol 04 21:00"]);
    let ends = world
        .acts
        .iter()
        .filter(|(_, act)| matches!(act, Act::End { .. }));
    let ends: Vec<Timestamp> = ends.map(|(at, _)| *at).collect();
    assert_eq!(ends, [when("2026-05-04 09:30"), when("2026-05-04 21:30")]);
    assert!(world.notices().is_empty());
}

#[test]
fn a_year_has_two_patrols_a_day_across_both_clock_changes() {
    let mut world = World::new(patrol(), "2026-01-01 00:00");
    world.pass(365 * 24 * 60 * MINUTE);
    assert_eq!(world.starts().len(), 2 * 365);
    let on_time = |text: &String| text.ends_with(" 09:00") || text.ends_with(" 21:00");
    assert!(world.starts().iter().all(on_time));
    assert!(world.notices().is_empty(), "{:?}", world.notices());
}

#[test]
fn nothing_starts_until_the_clock_is_plausible() {
    let mut world = World::new(
        table(&[("patrol", "* * * * *", None)], "10m"),
        "1970-01-02 00:00",
    );
    world.pass(24 * 60 * MINUTE);
    assert!(world.acts.is_empty());
    world.set_clock("2026-05-04 08:59");
    world.pass(2 * MINUTE);
    // Starts of earlier years are not made up for.
    assert_eq!(world.starts().len(), 1, "{:?}", world.acts);
}

#[test]
fn a_start_missed_by_less_than_catch_up_is_made_up_for_once() {
    let mut world = World::new(patrol(), "2026-05-04 09:08");
    world.pass(60 * MINUTE);
    assert_eq!(world.starts(), ["patrol 04 09:08"]);
    let mut late = World::new(patrol(), "2026-05-04 09:11");
    late.pass(60 * MINUTE);
    assert!(late.starts().is_empty());
    // The next program knows that this start was made up for.
    let record = world.planner.record();
    let mut next = World::after(patrol(), "2026-05-04 09:09", record);
    next.pass(60 * MINUTE);
    assert!(next.starts().is_empty(), "{:?}", next.acts);
}

#[test]
fn a_service_that_did_not_run_reports_what_it_missed() {
    let mut world = World::new(patrol(), "2026-05-04 08:00");
    world.pass(MINUTE);
    let record = world.planner.record();
    let mut next = World::after(patrol(), "2026-05-06 09:01", record);
    next.pass(MINUTE);
    let missed = Notice::Missed {
        run: "patrol".to_owned(),
        planned: when("2026-05-06 09:00"),
        count: 4,
    };
    assert_eq!(next.notices(), [&missed]);
    assert_eq!(
        next.starts(),
        ["patrol 06 09:01"],
        "the newest is made up for"
    );
}

#[test]
fn a_run_ended_by_a_power_cut_resumes_for_the_rest_of_its_time() {
    let mut world = World::new(patrol(), "2026-05-04 09:00");
    world.pass(5 * MINUTE);
    let record = world.planner.record();
    let mut next = World::after(patrol(), "2026-05-04 09:20", record.clone());
    next.pass(60 * MINUTE);
    let expected = Act::Start {
        run: "patrol".to_owned(),
        planned: when("2026-05-04 09:00"),
        lasts: Some(10 * MINUTE),
        resumed: true,
    };
    assert_eq!(next.acts[0].1, expected);
    assert_eq!(next.acts[1].0, when("2026-05-04 09:30"));
    assert_eq!(next.acts.len(), 2);
    let mut late = World::after(patrol(), "2026-05-04 09:31", record);
    late.pass(60 * MINUTE);
    assert!(late.acts.is_empty(), "{:?}", late.acts);
}

#[test]
fn a_resumed_run_ends_as_planned_however_late_the_robot_connects() {
    let mut world = World::new(patrol(), "2026-05-04 09:00");
    world.pass(5 * MINUTE);
    let record = world.planner.record();
    let waiting = |minutes: u32| {
        let mut next = World::after(patrol(), "2026-05-04 09:10", record.clone());
        next.ready = false;
        next.pass(minutes * MINUTE);
        // A second power cut does not make it longer.
        let mut third = World::after(patrol(), "2026-05-04 09:25", next.planner.record());
        next.ready = true;
        next.pass(60 * MINUTE);
        third.pass(60 * MINUTE);
        (next, third)
    };
    let (next, third) = waiting(15);
    for world in [next, third] {
        assert_eq!(world.starts(), ["patrol 04 09:25"]);
        assert_eq!(world.acts[1].0, when("2026-05-04 09:30"));
    }
    let (late, _) = waiting(30);
    assert!(late.acts.is_empty(), "{:?}", late.acts);
}

#[test]
fn a_run_that_has_ended_is_not_resumed() {
    let mut world = World::new(patrol(), "2026-05-04 09:00");
    world.pass(5 * MINUTE);
    world.planner.ended("patrol");
    let record = world.planner.record();
    let mut next = World::after(patrol(), "2026-05-04 09:07", record);
    next.pass(60 * MINUTE);
    assert!(next.acts.is_empty(), "{:?}", next.acts);
}

#[test]
fn a_start_while_the_behaviour_runs_is_skipped_and_reported() {
    let rules = [
        ("patrol", "0 9 * * *", Some("2h")),
        ("patrol", "0 10 * * *", None),
    ];
    let mut world = World::new(table(&rules, "10m"), "2026-05-04 08:00");
    world.pass(4 * 60 * MINUTE);
    assert_eq!(world.starts(), ["patrol 04 09:00"]);
    let overlap = Notice::Overlap {
        run: "patrol".to_owned(),
        planned: when("2026-05-04 10:00"),
    };
    assert_eq!(world.notices(), [&overlap]);
    // A person has started it.
    let mut world = World::new(patrol(), "2026-05-04 08:00");
    world.running.push("patrol".to_owned());
    world.pass(2 * 60 * MINUTE);
    assert!(world.starts().is_empty() && world.notices().len() == 1);
}

#[test]
fn a_start_waits_for_the_robot_as_long_as_it_may_be_late() {
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.ready = false;
    world.pass(5 * MINUTE);
    assert!(world.planner.is_due() && world.acts.is_empty());
    world.ready = true;
    world.pass(MINUTE);
    assert_eq!(world.starts().len(), 1);
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.ready = false;
    world.pass(30 * MINUTE);
    assert!(matches!(world.notices()[..], [Notice::NoRobot { .. }]));
    assert!(!world.planner.is_due());
}

#[test]
fn a_clock_that_is_put_back_a_little_repeats_no_start() {
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.pass(40 * MINUTE);
    world.set_clock("2026-05-04 08:58");
    world.pass(3 * 60 * MINUTE);
    assert_eq!(world.starts(), ["patrol 04 09:00"]);
    assert!(matches!(world.notices()[..], [Notice::ClockSet { seconds }] if *seconds < -2000));
}

#[test]
fn a_clock_that_is_put_back_a_day_counts_as_it_is() {
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.pass(40 * MINUTE);
    world.set_clock("2026-05-03 08:58");
    world.pass(60 * MINUTE);
    world.set_clock("2026-05-04 10:40");
    world.pass(60 * MINUTE);
    assert_eq!(world.starts(), ["patrol 04 09:00", "patrol 03 09:00"]);
}

#[test]
fn a_leap_over_many_starts_causes_only_one() {
    let every = table(&[("blink", "* * * * *", Some("10s"))], "10m");
    let mut world = World::new(every, "2026-05-04 08:59");
    world.pass(MINUTE + MINUTE / 2);
    let before = world.starts().len();
    world.set_clock("2026-07-04 09:00");
    world.poll();
    assert_eq!(world.starts().len(), before + 1);
}

#[test]
fn a_new_timetable_applies_from_then_on() {
    let mut world = World::new(patrol(), "2026-05-04 08:59");
    world.pass(10 * MINUTE);
    world
        .planner
        .replace(table(&[("greet", "0 10 * * *", None)], "10m"));
    world.pass(60 * MINUTE);
    assert_eq!(world.starts(), ["patrol 04 09:00", "greet 04 10:00"]);
    let ends = world
        .acts
        .iter()
        .filter(|(_, act)| matches!(act, Act::End { .. }));
    assert_eq!(ends.count(), 1, "the running behaviour ends as planned");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn however_the_clock_is_set_no_behaviour_runs_twice_at_a_time(
        steps in prop::collection::vec((0i64..200_000, 0u64..90, any::<bool>()), 1..60),
    ) {
        let rules = [("a", "*/7 * * * *", Some("3m")), ("b", "30 2 * * *", Some("1h")), ("a", "0 9 * * *", None)];
        let mut world = World::new(table(&rules, "15m"), "2026-03-28 12:00");
        let mut runs: Vec<String> = Vec::new();
        for (leap, minutes, ready) in steps {
            world.ready = ready;
            if leap % 5 == 0 {
                world.now = when("2026-03-28 12:00") + SignedDuration::from_secs(leap);
            }
            world.acts.clear();
            world.pass(MINUTE * u32::try_from(minutes).unwrap());
            for (_, act) in &world.acts {
                match act {
                    Act::Start { run, .. } => {
                        prop_assert!(!runs.contains(run), "{run} twice");
                        runs.push(run.clone());
                    }
                    Act::End { run } => {
                        prop_assert!(runs.contains(run));
                        runs.retain(|name| name != run);
                    }
                    Act::Report(_) => {}
                }
            }
            if runs.contains(&"a".to_owned()) && leap % 3 == 0 {
                runs.retain(|name| name != "a");
                world.running.retain(|name| name != "a");
                world.planner.ended("a");
            }
        }
        let record = world.planner.record();
        prop_assert!(record.under_way.iter().filter(|one| !one.waits).count() <= 2);
    }
}
