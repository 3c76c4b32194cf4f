//! Decides which behaviours are started and ended. A state machine: takes the time of day and other
//! facts, returns decisions; it never waits and never reads a clock.

use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::time::Instant;

use super::act::{Act, Notice};
use super::record::{Record, UnderWay};
use super::rule::Timetable;
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

/// The inputs of a decision.
#[derive(Debug, Clone, Copy)]
pub struct PlannerInputs<'a> {
    /// The time of day.
    pub now: Timestamp,
    /// The monotonic time.
    pub at: Instant,
    /// Whether a robot is connected.
    pub ready: bool,
    /// The running behaviours, started by the timetable or not.
    pub running: &'a [String],
}

/// A start whose time has come.
#[derive(Debug, Clone)]
struct Due {
    run: String,
    planned: Timestamp,
    lasts: Option<Duration>,
    /// Whether this resumes an interrupted run.
    resumed: bool,
    expires: Option<Instant>,
}

/// A behaviour that the timetable has started.
#[derive(Debug, Clone)]
struct ActiveRun {
    due: Due,
    /// When it must be ended.
    until: Option<(Instant, Timestamp)>,
    ending: bool,
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Planner {
    table: Timetable,
    record: Record,
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
    /// Creates a planner that continues where the record ends.
    pub fn new(table: Timetable, record: Record) -> Planner {
        Planner {
            table,
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

    /// Returns the next start after the last poll, and its behaviour.
    pub fn next_start(&self) -> Option<(Timestamp, &str)> {
        let next = self.next.iter().zip(&self.table.rules);
        let next = next.filter_map(|(at, rule)| Some(((*at)?, rule.run.as_str())));
        next.min()
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

    /// Returns the record from which the next program continues.
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
        let next = self.next_start().map(|(next, _)| next.duration_since(now));
        let next = next.map(|next| next.unsigned_abs());
        let ends = self.started.iter().filter_map(|one| one.until);
        let ends = ends.map(|(until, _)| until.saturating_duration_since(at));
        let soonest = ends.chain(next).min().unwrap_or(GRACE);
        // The clock may be set meanwhile.
        soonest.clamp(Duration::from_millis(100), GRACE / 4)
    }

    /// Returns what must be done now.
    pub fn poll(&mut self, inputs: PlannerInputs<'_>) -> Vec<Act> {
        if !is_plausible(inputs.now) {
            return Vec::new();
        }
        let mut acts = Vec::new();
        let moves = self.check_clock(inputs, &mut acts);
        if moves {
            self.collect_due(inputs.now, &mut acts);
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
            acts.push(Act::Report(Notice::ClockSet { seconds }));
        }
        if looked.duration_since(inputs.now) > MAX_SETBACK {
            self.plan_from(inputs.now);
            return true;
        }
        inputs.now >= looked
    }

    /// Initialises the planner at the first poll.
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
        for one in std::mem::take(&mut self.record.under_way) {
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

    fn plan_from(&mut self, from: Timestamp) {
        let table = &self.table;
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
                let notice = Notice::Missed {
                    run,
                    planned,
                    count,
                };
                acts.push(Act::Report(notice));
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
                    acts.push(Act::Report(Notice::Overlap { run, planned }));
                }
            } else if !due.resumed && inputs.now.duration_since(planned) > allowed(&self.table) {
                acts.push(Act::Report(Notice::NoRobot { run, planned }));
            } else if inputs.ready {
                acts.push(self.start(due, inputs));
            } else {
                self.due.push(due);
            }
        }
    }

    fn start(&mut self, due: Due, inputs: PlannerInputs<'_>) -> Act {
        let Due {
            run,
            planned,
            lasts,
            resumed,
            ..
        } = due.clone();
        let until = lasts.map(|lasts| {
            let shown = inputs.now.checked_add(lasts).unwrap_or(Timestamp::MAX);
            (inputs.at + lasts, shown)
        });
        self.started.push(ActiveRun {
            due,
            until,
            ending: false,
        });
        Act::Start {
            run,
            planned,
            lasts,
            resumed,
        }
    }
}

/// How late a start may be.
fn allowed(table: &Timetable) -> SignedDuration {
    let allowed = table.catch_up.get().max(GRACE);
    SignedDuration::try_from(allowed).unwrap_or(SignedDuration::MAX)
}

#[cfg(test)]
mod tests;
