//! The simulator's own account of the month: what the robot heard and how it was, second by second.

use std::time::Duration;

use spykee::simulation::{Event, EventKind, Simulation};
use spykee::wire::{Command, Led, Sound};

use super::super::Events;

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
