//! Decides which behaviours are started and ended. A state machine: takes the time of day and other
//! facts, returns decisions; it never waits and never reads a clock.

use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use super::hold::{Hold, TimetableOrder};
use super::pattern::TimetableError;
use super::rule::{NextStart, Timetable};
use crate::clock::is_plausible;

/// A start this late is still on time: the service polls several times a minute.
const GRACE: Duration = Duration::from_secs(60);
/// The clock was set if it has advanced this much more, or less, than the elapsed time.
const CLOCK_LEAP: SignedDuration = SignedDuration::from_secs(30);
/// If the clock is put back by at most this, no start is repeated; if by more, planning restarts at
/// the time it shows.
const MAX_SETBACK: SignedDuration = SignedDuration::from_hours(1);
/// Maximum number of starts of one rule that are counted after a leap of the clock; the rest was
/// missed anyway.
const MAX_MISSED: usize = 1000;
/// Maximum number of waiting starts in the record: the newest.
const MAX_WAITING: usize = 100;

#[derive(Debug, Clone, Copy)]
pub struct PlannerInputs<'a> {
    pub now: Timestamp,
    pub at: Instant,
    pub ready: bool,
    /// The running behaviours, started by the timetable or not.
    pub running: &'a [String],
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Due {
    pub run: String,
    pub planned: Timestamp,
    /// It will be ended after this time.
    pub lasts: Option<Duration>,
    /// Whether this resumes a run that was under way when the program ended.
    pub resumed: bool,
    expires: Option<Instant>,
}

#[derive(Debug, Clone)]
struct ActiveRun {
    due: Due,
    /// When it must be ended.
    until: Option<(Instant, Timestamp)>,
    ending: bool,
}

/// Plans the starts and ends of behaviours.
#[derive(Debug, Clone)]
pub struct Planner {
    table: Timetable,
    record: Record,
    hold: Hold,
    /// The clock time at the last poll, and its monotonic time.
    last_poll: Option<(Timestamp, Instant)>,
    /// Starts up to this time are handled.
    looked: Option<Timestamp>,
    /// The next start of each rule.
    next: Vec<Option<Timestamp>>,
    due: Vec<Due>,
    started: Vec<ActiveRun>,
}

impl Planner {
    pub fn new(table: Timetable, record: Record) -> Planner {
        Planner {
            table,
            hold: record.hold.clone(),
            record,
            last_poll: None,
            looked: None,
            next: Vec::new(),
            due: Vec::new(),
            started: Vec::new(),
        }
    }

    /// Replaces the timetable. Runs already started keep their planned end.
    pub fn replace(&mut self, table: Timetable) {
        self.due
            .retain(|due| table.rules.iter().any(|rule| rule.run == due.run));
        self.table = table;
        if let Some(looked) = self.looked {
            self.plan_from(looked);
        }
    }

    /// Whether a start is waiting for the robot.
    pub fn is_due(&self) -> bool {
        !self.due.is_empty()
    }

    /// Forgets the starts that wait for the robot: a person has stopped everything.
    pub fn forget_waiting(&mut self) {
        self.due.clear();
    }

    /// Changes what a person asks for. Returns what is different now, for the journal, if anything is.
    pub fn change(
        &mut self,
        order: &TimetableOrder,
        now: Timestamp,
    ) -> Result<Option<String>, TimetableError> {
        if self.table.rules.is_empty() {
            return Err(TimetableError::NoRules);
        }
        let Some(looked) = self.looked else {
            return Err(TimetableError::NoClock);
        };
        let next = self.next_start();
        let changed = self.hold.change(order, next, now, &self.table.zone)?;
        if self.hold.paused.is_some() {
            self.due.clear();
        }
        self.plan_from(looked);
        Ok(changed)
    }

    pub fn hold(&self) -> &Hold {
        &self.hold
    }

    /// Returns the next start after the last poll.
    pub fn next_start(&self) -> Option<NextStart> {
        let next = self.next.iter().zip(&self.table.rules);
        let next = next.filter_map(|(at, rule)| Some(((*at)?, rule.run.as_str())));
        let (at, run) = next.min()?;
        Some(self.hold.shown(at, run))
    }

    /// Records that a behaviour has ended, or could not be started.
    pub fn ended(&mut self, run: &str) {
        self.started.retain(|one| one.due.run != run);
    }

    /// Lets a start that did not reach the robot wait for it. Returns false if its time is over.
    pub fn postpone(&mut self, run: &str) -> bool {
        let waits = |one: &ActiveRun| one.due.run == run && !one.ending;
        let Some(at) = self.started.iter().position(waits) else {
            return false;
        };
        self.due.push(self.started.remove(at).due);
        true
    }

    pub fn record(&self) -> Record {
        let resumed = self.due.iter().filter(|due| due.resumed);
        let new = || self.due.iter().filter(|due| !due.resumed);
        let older = new().count().saturating_sub(MAX_WAITING);
        let due = resumed.chain(new().skip(older)).map(|due| UnderWay {
            run: due.run.clone(),
            planned: due.planned.as_second(),
            until: due.lasts.and_then(|lasts| {
                let from = if due.resumed {
                    self.looked?
                } else {
                    due.planned
                };
                Some(from.as_second().saturating_add_unsigned(lasts.as_secs()))
            }),
            waits: !due.resumed,
        });
        let started = self.started.iter().filter(|one| !one.ending);
        let started = started.map(|one| UnderWay {
            run: one.due.run.clone(),
            planned: one.due.planned.as_second(),
            until: one.until.map(|(_, until)| until.as_second()),
            waits: false,
        });
        Record {
            hold: self.hold.clone(),
            looked: match self.looked {
                Some(now) => Some(now.as_second()),
                None => self.record.looked,
            },
            under_way: match self.looked {
                Some(_) => started.chain(due).collect(),
                None => self.record.under_way.clone(),
            },
        }
    }

    /// Returns the longest time until the next poll, unless something happens before.
    pub fn pause(&self, now: Timestamp, at: Instant) -> Duration {
        let next = self.next_start().map(|next| next.at.duration_since(now));
        let next = next.map(|next| next.unsigned_abs());
        let ends = self.started.iter().filter_map(|one| one.until);
        let ends = ends.map(|(until, _)| until.saturating_duration_since(at));
        let soonest = ends.chain(next).min().unwrap_or(GRACE);
        // The clock may be set meanwhile.
        soonest.clamp(Duration::from_millis(100), GRACE / 4)
    }

    pub fn poll(&mut self, inputs: PlannerInputs<'_>) -> Vec<Act> {
        if !is_plausible(inputs.now) {
            return Vec::new();
        }
        let mut acts = Vec::new();
        let moves = self.check_clock(inputs, &mut acts);
        if moves {
            self.collect_due(inputs.now, &mut acts);
            self.hold.expire(inputs.now);
            self.looked = Some(inputs.now);
        }
        self.end_expired(inputs.at, &mut acts);
        self.start_due(inputs, &mut acts);
        acts
    }

    /// Detects changes of the clock. Returns whether it shows a time that is not handled yet.
    fn check_clock(&mut self, inputs: PlannerInputs<'_>, acts: &mut Vec<Act>) -> bool {
        let last_poll = self.last_poll.replace((inputs.now, inputs.at));
        let (Some((before, at)), Some(looked)) = (last_poll, self.looked) else {
            self.begin(inputs);
            return true;
        };
        let passed = SignedDuration::try_from(inputs.at.saturating_duration_since(at));
        let leap = inputs.now.duration_since(before) - passed.unwrap_or_default();
        if leap.abs() > CLOCK_LEAP {
            let seconds = leap.as_secs();
            acts.push(Act::ReportClockSet { seconds });
        }
        if looked.duration_since(inputs.now) > MAX_SETBACK {
            self.plan_from(inputs.now);
            return true;
        }
        inputs.now >= looked
    }

    fn begin(&mut self, inputs: PlannerInputs<'_>) {
        let now = inputs.now;
        let earliest = now
            .checked_sub(self.table.catch_up.get())
            .unwrap_or(Timestamp::MIN);
        let looked = self
            .record
            .looked
            .and_then(|at| Timestamp::from_second(at).ok());
        let from = looked.map_or(earliest, |looked| looked.min(now));
        self.plan_from(from);
        let under_way = std::mem::take(&mut self.record.under_way);
        if self.hold.paused.is_some_and(|until| now < until) {
            return;
        }
        for one in under_way {
            let Ok(planned) = Timestamp::from_second(one.planned) else {
                continue;
            };
            // The clock may have been put back before the start, or its rule removed.
            let known = self.table.rules.iter().any(|rule| rule.run == one.run);
            if one.waits && (planned > now || !known) {
                continue;
            }
            let from = if one.waits { planned } else { now };
            let left = one
                .until
                .map(|until| until.saturating_sub(from.as_second()));
            let lasts = match left.map(u64::try_from) {
                Some(Ok(left)) if left > 0 => Some(Duration::from_secs(left)),
                Some(_) => continue,
                None => None,
            };
            self.due.push(Due {
                run: one.run,
                planned,
                lasts,
                resumed: !one.waits,
                expires: match lasts {
                    Some(lasts) if !one.waits => Some(inputs.at + lasts),
                    _ => None,
                },
            });
        }
    }

    /// Plans the starts after this time, and after a pause.
    fn plan_from(&mut self, from: Timestamp) {
        let table = &self.table;
        let from = self.hold.first_after(from);
        let next = table
            .rules
            .iter()
            .map(|rule| rule.at.next_after(from, &table.zone));
        self.next = next.collect();
    }

    /// Collects the starts whose time has come; reports those that are too late.
    fn collect_due(&mut self, now: Timestamp, acts: &mut Vec<Act>) {
        for (rule, next) in self.table.rules.iter().zip(&mut self.next) {
            let recent = now.checked_sub(self.table.catch_up.get()).unwrap_or(now);
            let mut missed = 0;
            let mut newest = None;
            while let Some(planned) = next.filter(|next| *next <= now) {
                if missed == MAX_MISSED && planned < recent {
                    *next = rule.at.next_after(recent, &self.table.zone);
                    missed += 1;
                    continue;
                }
                *next = rule.at.next_after(planned, &self.table.zone);
                if self.hold.shown(planned, &rule.run).skipped {
                    continue;
                }
                missed += usize::from(newest.is_some());
                newest = Some(planned);
            }
            let Some(planned) = newest else { continue };
            let run = rule.run.clone();
            let late = now.duration_since(planned);
            let late_too = late > allowed(&self.table);
            let count = missed + usize::from(late_too);
            if count > 0 {
                let run = run.clone();
                acts.push(Act::ReportMissed {
                    run,
                    planned,
                    count,
                });
            }
            if !late_too {
                self.due.push(Due {
                    run,
                    planned,
                    lasts: rule.lasts.map(|lasts| lasts.get()),
                    resumed: false,
                    expires: None,
                });
            }
        }
    }

    fn end_expired(&mut self, at: Instant, acts: &mut Vec<Act>) {
        for one in &mut self.started {
            if !one.ending && one.until.is_some_and(|(until, _)| until <= at) {
                one.ending = true;
                let run = one.due.run.clone();
                acts.push(Act::End { run });
            }
        }
    }

    fn start_due(&mut self, inputs: PlannerInputs<'_>, acts: &mut Vec<Act>) {
        for mut due in std::mem::take(&mut self.due) {
            if let Some(expires) = due.expires {
                let left = expires.saturating_duration_since(inputs.at);
                if left.is_zero() {
                    continue;
                }
                due.lasts = Some(left);
            }
            let Due { run, planned, .. } = due.clone();
            let busy = inputs.running.contains(&run);
            let busy = busy || self.started.iter().any(|one| one.due.run == run);
            if busy {
                if !due.resumed {
                    acts.push(Act::ReportOverlap { run, planned });
                }
            } else if !due.resumed && inputs.now.duration_since(planned) > allowed(&self.table) {
                acts.push(Act::ReportNoRobot { run, planned });
            } else if inputs.ready {
                acts.push(self.start(due, inputs));
            } else {
                self.due.push(due);
            }
        }
    }

    fn start(&mut self, due: Due, inputs: PlannerInputs<'_>) -> Act {
        let until = due.lasts.map(|lasts| {
            let shown = inputs.now.checked_add(lasts).unwrap_or(Timestamp::MAX);
            (inputs.at + lasts, shown)
        });
        self.started.push(ActiveRun {
            due: due.clone(),
            until,
            ending: false,
        });
        Act::Start(due)
    }
}

fn allowed(table: &Timetable) -> SignedDuration {
    let allowed = table.catch_up.get().max(GRACE);
    SignedDuration::try_from(allowed).unwrap_or(SignedDuration::MAX)
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Act {
    /// Start a behaviour. If that fails, the caller reports it with
    /// [`Planner::ended`](super::Planner::ended), or if the robot was not connected, with
    /// [`Planner::postpone`](super::Planner::postpone).
    Start(Due),
    End {
        run: String,
    },
    /// Starts were missed: the program did not run, or the clock was not set.
    ReportMissed {
        run: String,
        /// The planned time of the latest start, which is missed or made up for.
        planned: Timestamp,
        count: usize,
    },
    /// A start was missed: no robot was connected before it was too late.
    ReportNoRobot {
        run: String,
        planned: Timestamp,
    },
    /// A start was skipped: the behaviour still runs.
    ReportOverlap {
        run: String,
        planned: Timestamp,
    },
    ReportClockSet {
        /// By how many seconds; negative: back.
        seconds: i64,
    },
}

/// What a new program must know of the previous one.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    /// Starts up to this time are handled; seconds since 1970.
    pub looked: Option<i64>,
    /// The runs that were started and have not ended, and the starts that wait for the robot.
    pub under_way: Vec<UnderWay>,
    #[serde(default)]
    pub hold: Hold,
}

/// A run that the timetable has started, or that waits for the robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnderWay {
    pub run: String,
    /// The planned time; seconds since 1970.
    pub planned: i64,
    /// When it must be ended; seconds since 1970. For a start that waits: if it were on time.
    pub until: Option<i64>,
    /// Whether it has not started yet: it waits for the robot.
    #[serde(default)]
    pub waits: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{Date, Zone};
    use crate::timetable::{Rule, TimetableChange};
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
                    Act::Start(due) => self.running.push(due.run.clone()),
                    Act::End { run } => {
                        self.running.retain(|name| name != run);
                        self.planner.ended(run);
                    }
                    _ => {}
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
                Act::Start(due) => {
                    let run = &due.run;
                    Some(format!("{run} {}", zone.time(*at).strftime("%d %H:%M")))
                }
                _ => None,
            };
            self.acts.iter().filter_map(start).collect()
        }

        /// What is reported.
        fn notices(&self) -> Vec<&Act> {
            let is_order = |act: &Act| matches!(act, Act::Start(_) | Act::End { .. });
            let acts = self.acts.iter().map(|(_, act)| act);
            acts.filter(|act| !is_order(act)).collect()
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

    fn order(change: TimetableChange, until: Option<&str>) -> TimetableOrder {
        TimetableOrder {
            change,
            until: until.map(str::to_owned),
            start: None,
            by: "a test".to_owned(),
            answer: tokio::sync::oneshot::channel().0,
        }
    }

    #[test]
    fn the_next_start_is_left_out_once_also_after_a_restart() {
        let rules = [("go", "0 9 * * *", Some("1m"))];
        let mut world = World::new(table(&rules, "10m"), "2026-05-04 08:00");
        world.poll();
        let skip = order(TimetableChange::Skip, None);
        let changed = world.planner.change(&skip, world.now).unwrap();
        let words = "go on Mon 2026-05-04 09:00 is left out";
        assert_eq!(changed.as_deref(), Some(words));
        // A second person wants the same.
        assert_eq!(world.planner.change(&skip, world.now), Ok(None));
        assert!(world.planner.next_start().unwrap().skipped);
        let record = world.planner.record();
        let mut next = World::after(table(&rules, "10m"), "2026-05-04 08:30", record);
        next.pass(MINUTE * 60);
        assert_eq!(next.starts(), Vec::<String>::new());
        assert!(!next.planner.next_start().unwrap().skipped);
        next.pass(MINUTE * 60 * 24);
        assert_eq!(next.starts(), ["go 05 09:00"]);
    }

    #[test]
    fn a_start_that_is_left_out_can_be_taken_back_and_another_is_not_meant() {
        let rules = [("go", "0 9,21 * * *", None)];
        let mut world = World::new(table(&rules, "10m"), "2026-05-04 08:00");
        world.poll();
        let other = TimetableOrder {
            start: Some(when("2026-05-04 21:00")),
            ..order(TimetableChange::Skip, None)
        };
        let refused = world.planner.change(&other, world.now).unwrap_err();
        assert!(refused.to_string().contains("it is go on Mon"), "{refused}");
        for change in [TimetableChange::Skip, TimetableChange::Unskip] {
            let changed = world.planner.change(&order(change, None), world.now);
            assert!(changed.unwrap().is_some());
        }
        world.pass(MINUTE * 90);
        assert_eq!(world.starts(), ["go 04 09:00"]);
    }

    #[test]
    fn a_paused_timetable_starts_nothing_and_makes_up_for_nothing_also_after_a_restart() {
        let rules = [("go", "0 * * * *", Some("1m"))];
        let table = table(&rules, "12h");
        let mut world = World::new(table.clone(), "2026-05-04 08:30");
        world.ready = false;
        world.poll();
        let pause = order(TimetableChange::Pause, Some("2026-05-04 18:00"));
        let changed = world.planner.change(&pause, world.now).unwrap();
        let words = "nothing starts until Mon 2026-05-04 18:00";
        assert_eq!(changed.as_deref(), Some(words));
        world.ready = true;
        world.pass(MINUTE * 100);
        assert_eq!(world.starts(), Vec::<String>::new());
        let mut next = World::after(table, "2026-05-04 17:30", world.planner.record());
        next.pass(MINUTE * 45);
        assert_eq!(next.starts(), ["go 04 18:00"]);
        assert_eq!(next.planner.hold(), &Hold::default());
    }

    #[test]
    fn a_pause_that_is_ended_early_does_not_bring_back_what_it_has_left_out() {
        let rules = [("go", "0 * * * *", Some("1m"))];
        let mut world = World::new(table(&rules, "12h"), "2026-05-04 08:30");
        world.running = vec!["go".to_owned()];
        world.poll();
        world.running.clear();
        let pause = order(TimetableChange::Pause, Some("2026-06-01"));
        world.planner.change(&pause, world.now).unwrap();
        world.pass(MINUTE * 60);
        let resume = order(TimetableChange::Resume, None);
        assert!(world.planner.change(&resume, world.now).unwrap().is_some());
        world.pass(MINUTE * 60);
        assert_eq!(world.starts(), ["go 04 10:00"]);
    }

    #[test]
    fn a_change_that_makes_no_sense_changes_nothing_and_says_why() {
        let rules = [("go", "0 9 * * *", None)];
        let mut world = World::new(table(&rules, "10m"), "2026-05-04 08:00");
        world.poll();
        for (change, until, why) in [
            (TimetableChange::Pause, Some("2026-05-04 07:59"), "is over"),
            (
                TimetableChange::Pause,
                Some("tomorrow"),
                "is no time such as",
            ),
            (TimetableChange::Pause, Some(""), "is no time such as"),
            (TimetableChange::Pause, None, "needs a time `until`"),
            (
                TimetableChange::Skip,
                Some("2026-05-05"),
                "needs a time `until`",
            ),
        ] {
            let refused = world.planner.change(&order(change, until), world.now);
            let refused = refused.unwrap_err().to_string();
            assert!(refused.contains(why), "{refused}");
        }
        assert_eq!(world.planner.hold(), &Hold::default());
        let skip = order(TimetableChange::Skip, None);
        let mut without = World::new(table(&[], "10m"), "2026-05-04 08:00");
        without.poll();
        let refused = without.planner.change(&skip, without.now);
        assert_eq!(refused, Err(TimetableError::NoRules));
        let mut early = World::new(table(&rules, "10m"), "1970-01-01 08:00");
        early.poll();
        let refused = early.planner.change(&skip, early.now);
        assert_eq!(refused, Err(TimetableError::NoClock));
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
        let missed = Act::ReportMissed {
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
        let Act::Start(resumed) = &next.acts[0].1 else {
            panic!("{:?}", next.acts);
        };
        assert!(resumed.resumed && resumed.run == "patrol");
        assert_eq!(resumed.planned, when("2026-05-04 09:00"));
        assert_eq!(resumed.lasts, Some(10 * MINUTE));
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
        let overlap = Act::ReportOverlap {
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
        assert!(matches!(world.notices()[..], [Act::ReportNoRobot { .. }]));
        assert!(!world.planner.is_due());
    }

    #[test]
    fn a_clock_that_is_put_back_a_little_repeats_no_start() {
        let mut world = World::new(patrol(), "2026-05-04 08:59");
        world.pass(40 * MINUTE);
        world.set_clock("2026-05-04 08:58");
        world.pass(3 * 60 * MINUTE);
        assert_eq!(world.starts(), ["patrol 04 09:00"]);
        assert!(
            matches!(world.notices()[..], [Act::ReportClockSet { seconds }] if *seconds < -2000)
        );
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
                        Act::Start(Due { run, .. }) => {
                            prop_assert!(!runs.contains(run), "{run} twice");
                            runs.push(run.clone());
                        }
                        Act::End { run } => {
                            prop_assert!(runs.contains(run));
                            runs.retain(|name| name != run);
                        }
                        _ => {}
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

    #[test]
    fn a_start_that_waits_for_the_robot_outlives_the_service() {
        let mut world = World::new(patrol(), "2026-05-04 08:59");
        world.ready = false;
        world.pass(2 * MINUTE);
        let record = world.planner.record();
        world.pass(2 * MINUTE);
        // It is not written at each poll.
        assert_eq!(world.planner.record().under_way, record.under_way);
        let mut next = World::after(patrol(), "2026-05-04 09:02", record.clone());
        next.ready = false;
        next.pass(MINUTE);
        next.ready = true;
        next.pass(60 * MINUTE);
        assert_eq!(next.starts(), ["patrol 04 09:03"]);
        assert_eq!(
            next.acts[1].0,
            when("2026-05-04 09:33"),
            "it has all its time"
        );
        assert!(next.notices().is_empty(), "{:?}", next.acts);
        let mut late = World::after(patrol(), "2026-05-04 09:11", record.clone());
        late.pass(60 * MINUTE);
        assert!(late.starts().is_empty(), "{:?}", late.acts);
        assert!(matches!(late.notices()[..], [Act::ReportNoRobot { .. }]));
        // The clock was put back before the start.
        let mut early = World::after(patrol(), "2026-05-04 08:50", record.clone());
        early.pass(60 * MINUTE);
        assert_eq!(early.starts(), ["patrol 04 09:00"]);
        let other = table(&[("greet", "0 10 * * *", None)], "10m");
        let mut changed = World::after(other, "2026-05-04 09:02", record);
        changed.pass(MINUTE);
        assert!(changed.acts.is_empty(), "{:?}", changed.acts);
    }

    #[test]
    fn a_start_that_does_not_reach_the_robot_waits_for_it() {
        let mut world = World::new(patrol(), "2026-05-04 09:00");
        world.pass(5 * MINUTE);
        let record = world.planner.record();
        let new = World::new(patrol(), "2026-05-04 09:00");
        let resumed = World::after(patrol(), "2026-05-04 09:00", record);
        // A new run has all its time; a resumed one ends as planned.
        for (mut world, end) in [(new, "2026-05-04 09:35"), (resumed, "2026-05-04 09:30")] {
            world.poll();
            (world.ready, world.running) = (false, Vec::new());
            assert!(world.planner.postpone("patrol"));
            world.pass(5 * MINUTE);
            world.ready = true;
            world.pass(60 * MINUTE);
            assert_eq!(world.starts(), ["patrol 04 09:00", "patrol 04 09:05"]);
            assert_eq!(world.acts[2].0, when(end));
            assert_eq!(world.acts.len(), 3, "{:?}", world.acts);
        }
    }

    #[test]
    fn a_start_that_does_not_reach_the_robot_in_its_time_is_over() {
        let mut planner = Planner::new(patrol(), Record::default());
        let mut inputs = PlannerInputs {
            now: when("2026-05-04 09:00"),
            at: Instant::now(),
            ready: true,
            running: &[],
        };
        assert_eq!(planner.poll(inputs).len(), 1);
        (inputs.now, inputs.at) = (inputs.now + 30 * MINUTE, inputs.at + 30 * MINUTE);
        assert!(matches!(planner.poll(inputs)[..], [Act::End { .. }]));
        assert!(!planner.postpone("patrol") && !planner.is_due());
    }
}
