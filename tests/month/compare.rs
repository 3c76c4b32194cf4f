//! The history's own account against the simulator's.

use std::path::Path;
use std::time::Duration;

use spykee::agent::RESCUE_NAME;
use spykee::journal::{JournalReader, Record, Span};
use spykee::simulation::{Event, EventKind, Simulation};
use spykee::wire::{Command, Led, Sound};

use super::super::Events;
use super::super::soak::Ledger;
use super::{CATCH_UP, PATROL, Wall, rome};

/// What is done at once is done within this.
const SOON: Duration = Duration::from_secs(15);
/// From the end of a power cut to the first look at the timetable with the robot there.
const BACK: Duration = Duration::from_secs(60);
/// A power cut loses what happened within the last second.
const LOST: Duration = Duration::from_secs(1);

pub const RUNS: &str = "every run of the robot is in the history, from its beginning to its end";
pub const NO_OTHERS: &str = "the history has no run that the robot has not seen";
pub const STARTS: &str = "each start of the timetable has happened, or the history says why not";
pub const ENDS: &str = "each patrol ends when its time is over";
pub const NO_REASON: &str = "nothing was started without a reason";
pub const FAILS: &str = "neither patrol nor look fails";
pub const DOCKS: &str = "every docking of the robot is in the history";
pub const DOCKED: &str = "a docking that the history calls done is one of the robot's";
pub const ALARMS: &str = "every alarm of the robot is in the history";
pub const ALARMED: &str = "an alarm of the history was heard unless it was a quiet hour";
pub const LEVELS: &str = "every level of the battery in the history is the robot's";
pub const BATTERY_RECORDED: &str =
    "every level of the battery that the robot tells is in the history";
pub const MINUTES: &str = "while the robot is there the history has its battery each minute";
pub const SCRIPT_ROWS_RECORDED: &str = "what scripts add is in the history";

/// Rows with their moments.
type Rows = Vec<(Duration, Record)>;

/// A run of the history.
struct Run {
    behaviour: String,
    began: Duration,
    /// With its reason.
    ended: Option<(Duration, String)>,
}

/// What is compared with what.
pub struct Comparison<'a> {
    pub truth: &'a GroundTruth,
    pub wall: &'a Wall,
    pub ledger: &'a mut Ledger,
    /// The end of all.
    pub until: Duration,
    /// What was before is forgotten.
    pub since: Duration,
}

impl Comparison<'_> {
    pub fn make(mut self, data: &Path) {
        let history = JournalReader::open(data).unwrap().unwrap();
        let all = Span::default();
        let events = self.rows(history.records(&[], &all).unwrap());
        let battery = self.rows(history.battery(&all).unwrap());
        let runs = runs(&events);
        self.runs(&runs);
        self.timetable(&runs, &events);
        self.docks(&events);
        self.alarms(&events);
        self.battery(&battery);
        self.looks(&events);
    }

    fn rows(&self, records: Vec<Record>) -> Rows {
        let moments = self.wall.moments(records.iter().map(|record| record.at));
        moments.into_iter().zip(records).collect()
    }

    fn note(&mut self, words: &'static str, kept: bool, how: impl FnOnce() -> String) {
        self.ledger.note(words, (!kept).then(how));
    }

    /// The service was cut off within the second after this moment.
    fn cut(&self, moment: Duration) -> bool {
        was(&self.truth.alive, moment, moment + LOST, false)
    }

    fn runs(&mut self, runs: &[Run]) {
        let truth = self.truth;
        let since = self.since;
        let patrols = || runs.iter().filter(|run| run.behaviour == "patrol");
        for &(moment, on) in truth.lights.iter().filter(|(moment, _)| *moment >= since) {
            let of_a_run = patrols().any(|run| {
                let end = run.ended.as_ref().map(|(end, _)| *end);
                let end = end.or(truth.end_of_life(run.began)).unwrap_or(self.until);
                run.began <= moment + LOST && moment <= end + LOST
            });
            let kept = of_a_run || self.cut(moment);
            let what = if on { "began" } else { "ended" };
            self.note(RUNS, kept, || format!("a patrol {what} at {moment:.0?}"));
        }
        for run in patrols().filter(|run| run.began > since) {
            let light = |from: Duration, on: bool| {
                let mut lights = truth.lights.iter();
                lights.any(|(moment, is)| {
                    *is == on && from <= *moment + LOST && *moment <= from + SOON
                })
            };
            let began = run.began;
            let calm = truth.is_calm(run.began, run.began + SOON);
            if calm {
                self.note(NO_OTHERS, light(began, true), || {
                    format!("begun at {began:.0?}")
                });
            }
            if let Some((ended, _)) = &run.ended
                && truth.is_calm(*ended, *ended + SOON)
            {
                // Its last words are said before its end is told.
                let kept = light(*ended - LOST, false);
                self.note(NO_OTHERS, kept, || format!("ended at {ended:.0?}"));
            }
        }
        for run in runs.iter().filter(|run| run.ended.is_some()) {
            let reason = run.ended.as_ref().map_or("", |(_, reason)| reason);
            let fine = matches!(reason, "done" | "cancelled");
            let name = &run.behaviour;
            let began = run.began;
            self.note(FAILS, fine, || {
                format!("{name} of {began:.0?} ended by {reason}")
            });
        }
    }

    fn timetable(&mut self, runs: &[Run], events: &Rows) {
        let truth = self.truth;
        let since = self.since;
        let planned = self.wall.planned(self.until - CATCH_UP - BACK);
        let missed = |run: &str, from: Duration, until: Duration| {
            let mut rows = events
                .iter()
                .filter(|(_, row)| row.kind() == "start_missed");
            rows.any(|(moment, row)| {
                row.text("behaviour") == run && from <= *moment && *moment <= until
            })
        };
        for &(moment, name) in planned.iter().filter(|(moment, _)| *moment >= since) {
            let late = moment + CATCH_UP + BACK;
            let started = runs.iter().any(|run| {
                run.behaviour == name && moment <= run.began + LOST && run.began <= late
            });
            // A computer that is dark says so when it is back.
            let told = truth.alive_after(moment).max(late) + BACK;
            let kept = started || missed(name, moment, told);
            self.note(STARTS, kept, || format!("{name} of {moment:.0?}"));
        }
        // The rescue behaviour is the watchdog's, and has its own reasons.
        let ours = |run: &&Run| run.began > since && run.behaviour != RESCUE_NAME;
        for run in runs.iter().filter(ours) {
            let began = run.began;
            let name = &run.behaviour;
            let planned_for = planned
                .iter()
                .rev()
                .find(|(moment, planned)| planned == name && *moment <= began + LOST);
            let lasts = if name == "patrol" {
                PATROL
            } else {
                Duration::ZERO
            };
            let in_time = planned_for.is_some_and(|(moment, _)| began <= *moment + CATCH_UP + BACK);
            let resumed = planned_for.is_some_and(|(moment, _)| {
                began <= *moment + CATCH_UP + lasts + BACK
                    && was(&truth.alive, *moment, began, false)
            });
            let end = self.until < began + lasts;
            self.note(NO_REASON, in_time || resumed || end, || {
                format!("{name} at {began:.0?}")
            });
            if let (Some((ended, _)), true) = (&run.ended, name == "patrol" && in_time) {
                let ran = *ended - began;
                let on_time = ran <= PATROL + SOON;
                self.note(ENDS, on_time, || format!("of {began:.0?} ran {ran:.0?}"));
            }
        }
    }

    fn docks(&mut self, events: &Rows) {
        let truth = self.truth;
        let since = self.since;
        let docked = |record: &Record| match record.kind() {
            "dock" => matches!(record.text("end"), "done" | "already_docked"),
            // Of a robot that came home while it was alone.
            "link_up" | "watchdog" => record.is("docked"),
            _ => false,
        };
        for pair in truth.docked.windows(2).filter(|pair| pair[1].1) {
            let moment = pair[1].0;
            // One that has slid off at once, or that nobody could see.
            let seen = held(&truth.alive, moment, moment + SOON, true)
                && held(&truth.users, moment, moment + SOON, true)
                && held(&truth.docked, moment, moment + SOON, true);
            if moment < since || !seen {
                continue;
            }
            let kept = events.iter().any(|(row, record)| {
                docked(record) && moment <= *row + SOON && *row <= moment + SOON
            });
            self.note(DOCKS, kept, || format!("at {moment:.0?}"));
        }
        let done = events.iter().filter(|(moment, record)| {
            *moment > since && record.kind() == "dock" && record.text("end") == "done"
        });
        for (moment, _) in done {
            let kept = was(
                &truth.docked,
                moment.saturating_sub(SOON),
                *moment + LOST,
                true,
            );
            self.note(DOCKED, kept, || format!("at {moment:.0?}"));
        }
    }

    fn alarms(&mut self, events: &Rows) {
        let truth = self.truth;
        let since = self.since;
        let alarms: Vec<Duration> = events
            .iter()
            .filter(|(_, record)| record.kind() == "safety" && record.text("action") == "alarm")
            .map(|(moment, _)| *moment)
            .collect();
        // It sounds again and again; the history has its beginning.
        let mut last = None;
        for &moment in truth.alarms.iter().filter(|moment| **moment >= since) {
            let first = last.is_none_or(|last| moment > last + 4 * SOON);
            last = Some(moment);
            if first && !self.cut(moment) {
                let known = alarms
                    .iter()
                    .any(|row| *row <= moment + LOST && moment <= *row + Duration::from_secs(3600));
                self.note(ALARMS, known, || format!("at {moment:.0?}"));
            }
        }
        for moment in alarms.into_iter().filter(|moment| *moment > since) {
            let shown = self.wall.at(moment);
            let hour = shown.to_zoned(rome()).hour();
            if (7..22).contains(&hour) && truth.is_calm(moment, moment + SOON) {
                let mut heard = truth.alarms.iter();
                let heard =
                    heard.any(|heard| moment <= *heard + LOST && *heard <= moment + 2 * SOON);
                self.note(ALARMED, heard, || format!("at {moment:.0?}"));
            }
        }
    }

    fn battery(&mut self, battery: &Rows) {
        let truth = self.truth;
        let since = self.since;
        for (moment, row) in battery {
            let level = told(row);
            let kept = was(
                &truth.levels,
                moment.saturating_sub(SOON),
                *moment + LOST,
                level,
            );
            let near = at(&truth.levels, *moment);
            self.note(LEVELS, kept, || {
                format!("{level:?} at {moment:.0?}, it was {near:?}")
            });
        }
        for &(moment, level) in truth.levels.iter().filter(|(at, _)| *at >= since) {
            if !truth.is_calm(moment, moment + SOON) {
                continue;
            }
            let first = battery.partition_point(|(row, _)| *row + LOST < moment);
            let rows = battery[first..].iter();
            let kept = rows
                .take_while(|(row, _)| *row <= moment + SOON)
                .any(|(_, row)| told(row) == level);
            self.note(BATTERY_RECORDED, kept, || {
                format!("{level:?} at {moment:.0?}")
            });
        }
        let minute = Duration::from_secs(62);
        for pair in battery.windows(2) {
            let from = pair[0].0;
            let until = pair[1].0;
            // Who has taken the robot over is a user too.
            if truth.is_calm(from, until) && from >= since {
                self.note(MINUTES, until <= from + minute, || {
                    format!("from {from:.0?} to {until:.0?}")
                });
            }
        }
    }

    fn looks(&mut self, events: &Rows) {
        let entries: Vec<Duration> = events
            .iter()
            .filter(|(_, record)| record.kind() == "entry")
            .map(|(moment, _)| *moment)
            .collect();
        for &moment in &self.truth.looks {
            let soon = moment + 2 * SOON;
            if moment < self.since || !self.truth.is_calm(moment, soon) {
                continue;
            }
            let kept = entries.iter().any(|row| moment <= *row && *row <= soon);
            self.note(SCRIPT_ROWS_RECORDED, kept, || format!("of {moment:.0?}"));
        }
    }
}

impl GroundTruth {
    /// When the service that was there at this moment ended, if it did.
    fn end_of_life(&self, moment: Duration) -> Option<Duration> {
        let rest = within(&self.alive, moment, Duration::MAX);
        rest.into_iter()
            .find(|(_, alive)| !alive)
            .map(|(end, _)| *end)
    }

    /// This moment, or the next at which the service was there.
    fn alive_after(&self, moment: Duration) -> Duration {
        if at(&self.alive, moment) == Some(true) {
            return moment;
        }
        let mut rest = within(&self.alive, moment, Duration::MAX);
        rest.find(|(_, alive)| *alive)
            .map_or(moment, |(back, _)| *back)
    }
}

/// The level of a row: percent, charging.
fn told(row: &Record) -> (u8, bool) {
    (row.number("percent").unwrap() as u8, row.is("charging"))
}

/// The runs of `started` and `ended` rows.
fn runs(events: &Rows) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    let mut open = std::collections::BTreeMap::new();
    for (moment, record) in events {
        let key = (record.session, record.text("behaviour").to_owned());
        match record.kind() {
            "started" => {
                open.insert(key.clone(), runs.len());
                runs.push(Run {
                    behaviour: key.1,
                    began: *moment,
                    ended: None,
                });
            }
            "ended" => {
                if let Some(index) = open.remove(&key) {
                    runs[index].ended = Some((*moment, record.text("reason").to_owned()));
                }
            }
            _ => {}
        }
    }
    runs
}

/// How often it looks.
pub const LOOK_EVERY: Duration = Duration::from_secs(1);
/// After a trouble things need a while to be as they were.
const AFTERMATH: Duration = Duration::from_secs(90);

/// What was so from a moment on.
pub type Changes<T> = Vec<(Duration, T)>;

/// See the module.
pub struct GroundTruth {
    events: Events,
    heard: usize,
    /// The left light was switched: a patrol begins or ends, or its light is restored after an outage.
    pub lights: Vec<(Duration, bool)>,
    /// The right light: a look was taken.
    pub looks: Vec<Duration>,
    /// The alarm sounded.
    pub alarms: Vec<Duration>,
    /// What the robot told of its battery, in its own words: percent, charging.
    pub levels: Changes<(u8, bool)>,
    pub docked: Changes<bool>,
    /// Somebody is logged in.
    pub users: Changes<bool>,
    /// The service is there.
    pub alive: Changes<bool>,
    /// What was wrong, from when to when.
    pub troubles: Vec<(Duration, Duration)>,
    /// Where the patrol was, in its own words: `round 2, leg 3`.
    pub legs: Vec<(Duration, String)>,
    /// Errors in the log of a program that should have none.
    pub errors: Vec<String>,
}

impl GroundTruth {
    pub fn new(events: Events) -> GroundTruth {
        GroundTruth {
            events,
            heard: 0,
            lights: Vec::new(),
            looks: Vec::new(),
            alarms: Vec::new(),
            levels: Vec::new(),
            docked: Vec::new(),
            users: Vec::new(),
            alive: Vec::new(),
            troubles: Vec::new(),
            legs: Vec::new(),
            errors: Vec::new(),
        }
    }

    /// One look.
    pub fn look(&mut self, simulation: &Simulation) {
        let state = simulation.sim().state();
        let now = simulation.now();
        note(&mut self.docked, now, state.docked);
        note(&mut self.users, now, state.user.is_some());
        for heard in simulation.sim().heard_since(self.heard) {
            self.heard = heard.index + 1;
            match heard.command {
                Command::Led { led: Led::Left, on } => self.lights.push((heard.at, on)),
                Command::Led {
                    led: Led::Right,
                    on: true,
                } => self.looks.push(heard.at),
                Command::Play(Sound::Alarm) => self.alarms.push(heard.at),
                _ => {}
            }
        }
        for event in self.events.take() {
            if let Some(level) = level(&event) {
                note(&mut self.levels, event.at, level);
            } else if event.kind == EventKind::Log && event.text.starts_with("round ") {
                self.legs.push((event.at, event.text));
            } else if event.level == "error" {
                self.errors
                    .push(format!("{:.0?}: {}", event.at, event.text));
            }
        }
    }

    /// From now on for so long things go wrong.
    pub fn trouble(&mut self, now: Duration, lasts: Duration) {
        self.troubles.push((now, now + lasts));
    }

    /// Nothing was wrong between these moments, and the service was there and had the robot.
    pub fn is_calm(&self, from: Duration, until: Duration) -> bool {
        let wrong =
            |(began, ended): &(Duration, Duration)| *began <= until && from <= *ended + AFTERMATH;
        !self.troubles.iter().any(wrong)
            && held(&self.alive, from, until, true)
            && held(&self.users, from, until, true)
    }
}

/// The level that the robot tells with this, percent and charging: `Power(Power { percent: 56, charging: false })`.
fn level(event: &Event) -> Option<(u8, bool)> {
    let told = event.text.strip_prefix("Power(Power { percent: ")?;
    let (percent, charging) = told.strip_suffix(" })")?.split_once(", charging: ")?;
    let said = event.kind == EventKind::Said;
    said.then_some((percent.parse().ok()?, charging.parse().ok()?))
}

/// Writes down what is new.
pub fn note<T: PartialEq>(changes: &mut Changes<T>, now: Duration, what: T) {
    if changes.last().is_none_or(|(_, last)| *last != what) {
        changes.push((now, what));
    }
}

/// What was so at a moment.
pub fn at<T: Copy>(changes: &Changes<T>, moment: Duration) -> Option<T> {
    let after = changes.partition_point(|(since, _)| *since <= moment);
    after.checked_sub(1).map(|index| changes[index].1)
}

/// It was so all the time.
pub fn held<T: Copy + PartialEq>(
    changes: &Changes<T>,
    from: Duration,
    until: Duration,
    what: T,
) -> bool {
    at(changes, from) == Some(what) && within(changes, from, until).all(|(_, other)| *other == what)
}

/// It was so at some moment.
pub fn was<T: Copy + PartialEq>(
    changes: &Changes<T>,
    from: Duration,
    until: Duration,
    what: T,
) -> bool {
    at(changes, from) == Some(what) || within(changes, from, until).any(|(_, other)| *other == what)
}

/// The changes between two moments.
pub fn within<T>(
    changes: &Changes<T>,
    from: Duration,
    until: Duration,
) -> impl Iterator<Item = &(Duration, T)> {
    let first = changes.partition_point(|(since, _)| *since < from);
    let last = changes.partition_point(|(since, _)| *since <= until);
    changes[first..last.max(first)].iter()
}
