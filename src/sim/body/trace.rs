//! The trace of a robot: its path over time, and the events along it. Every simulated robot keeps
//! one, in bounded memory, for the map of a run and for tests of behaviours.

use std::time::Duration;

use wire::{Led, Sound};

use crate::geometry::{Point, Pose, wrap};

/// Maximum number of samples; at this number, every other one is dropped.
const MAX_SAMPLES: usize = 16_384;
/// Maximum number of events kept; later ones are only counted.
const MAX_EVENTS: usize = 2048;
/// A sample is taken when the robot has moved this far, metres, or turned this far, radians.
const STRIDE: f64 = 0.02;
const TURN: f64 = 0.1;
/// Metres and radians per step; in a longer step the robot did not drive but was placed.
const MAX_STEP: f64 = 0.1;
const MAX_TURN: f64 = 0.5;

/// A point of the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Simulated time since the start.
    pub at: Duration,
    /// The robot's pose at that time.
    pub pose: Pose,
    /// The robot was placed here; it did not drive here from the previous sample.
    pub placed: bool,
}

/// An event: something that happened to the robot, or a command that it received.
#[derive(Debug, Clone, PartialEq)]
pub struct TraceEvent {
    /// Simulated time since the start.
    pub at: Duration,
    /// The robot's pose at that time.
    pub pose: Pose,
    /// What happened.
    pub kind: TraceEventKind,
}

/// What can happen to a robot, as a map shows it.
#[derive(Debug, Clone, PartialEq)]
pub enum TraceEventKind {
    /// The robot ran into the thing with this name.
    Collision(String),
    /// The watchdog or a script commanded the robot to find its station.
    FindBase,
    /// The robot touched the contacts of its station.
    Docked,
    /// The robot left the contacts.
    Undocked,
    /// The robot gave up searching for its station.
    BaseNotFound,
    /// PLAY: a sound other than that of the camera.
    Sound(Sound),
    /// LED.
    Light {
        /// Which light.
        led: Led,
        /// Whether it is on now.
        on: bool,
    },
    /// The robot played the camera sound, which behaviours use when they keep a picture.
    Photo,
    /// A note by an observer; see [`Handle::note`](crate::Handle::note).
    Note(String),
}

/// A robot's path and events so far.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    samples: Vec<Sample>,
    /// One in this many strides is kept.
    thin: u32,
    skipped: u32,
    events: Vec<TraceEvent>,
    missed: usize,
    now: Sample,
    balls: Vec<Point>,
    walkers: Vec<Point>,
    distance: f64,
    turned: f64,
}

impl Trace {
    pub(crate) fn from(pose: Pose) -> Trace {
        let start = Sample {
            at: Duration::ZERO,
            pose,
            placed: true,
        };
        Trace {
            samples: vec![start],
            thin: 1,
            now: start,
            ..Trace::default()
        }
    }

    /// Records the robot's current pose, and the places of everything else that moves: first
    /// `balls` balls, then people.
    pub(crate) fn add_sample(
        &mut self,
        at: Duration,
        pose: Pose,
        places: impl Iterator<Item = Point>,
        balls: usize,
    ) {
        let placed = pose.point().distance(self.now.pose.point()) > MAX_STEP;
        let turn = wrap(pose.heading - self.now.pose.heading);
        if !placed && turn.abs() < MAX_TURN {
            self.turned += turn;
        }
        if !placed {
            self.distance += pose.point().distance(self.now.pose.point());
        }
        self.now = Sample { at, pose, placed };
        self.balls.clear();
        self.walkers.clear();
        for (index, place) in places.enumerate() {
            let kind = if index < balls {
                &mut self.balls
            } else {
                &mut self.walkers
            };
            kind.push(place);
        }
        let Some(last) = self.samples.last() else {
            return;
        };
        let turned = wrap(pose.heading - last.pose.heading).abs();
        if !placed && turned < TURN && last.pose.point().distance(pose.point()) < STRIDE {
            return;
        }
        self.skipped += 1;
        if placed || self.skipped >= self.thin {
            self.skipped = 0;
            self.samples.push(self.now);
        }
        if self.samples.len() >= MAX_SAMPLES {
            let mut index = 0;
            self.samples.retain(|sample| {
                index += 1;
                sample.placed || index % 2 == 1
            });
            // This bounds the number of placements too.
            self.samples.truncate(MAX_SAMPLES - 1);
            self.thin *= 2;
        }
    }

    pub(crate) fn add_event(&mut self, kind: TraceEventKind) {
        if self.events.len() == MAX_EVENTS {
            self.missed += 1;
            return;
        }
        self.events.push(TraceEvent {
            at: self.now.at,
            pose: self.now.pose,
            kind,
        });
    }

    /// Returns the samples, oldest first, a few centimetres apart; the last one is the current
    /// pose.
    pub fn samples(&self) -> impl Iterator<Item = Sample> {
        self.samples.iter().copied().chain([self.now])
    }

    /// Returns the events, oldest first; of very many, only the first ones.
    pub fn events(&self) -> &[TraceEvent] {
        &self.events
    }

    /// Returns the number of events not contained in [`Trace::events`].
    pub fn missed(&self) -> usize {
        self.missed
    }

    /// Returns the simulated time of the trace.
    pub fn duration(&self) -> Duration {
        self.now.at
    }

    /// Returns the distance driven, in metres.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Returns how far it has turned, in radians; turns to the left minus turns to the right.
    pub fn turned(&self) -> f64 {
        self.turned
    }

    /// Returns the current places of the balls, in the world's order.
    pub fn balls(&self) -> &[Point] {
        &self.balls
    }

    /// Returns the current places of the people, in the world's order.
    pub fn walkers(&self) -> &[Point] {
        &self.walkers
    }

    /// Returns the names of the things the robot ran into, oldest first.
    pub fn collisions(&self) -> impl Iterator<Item = &str> {
        self.events.iter().filter_map(|event| match &event.kind {
            TraceEventKind::Collision(name) => Some(name.as_str()),
            _ => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(x: f64) -> Pose {
        Pose::new(x, 1.0, 0.0)
    }

    #[test]
    fn a_long_path_is_thinned_out() {
        let mut trace = Trace::from(pose(0.0));
        for step in 1..=200_000 {
            let at = Duration::from_millis(20) * step;
            trace.add_sample(at, pose(f64::from(step) * 0.021), std::iter::empty(), 0);
        }
        let samples: Vec<Sample> = trace.samples().collect();
        assert!(
            (MAX_SAMPLES / 4..=MAX_SAMPLES).contains(&samples.len()),
            "{}",
            samples.len()
        );
        assert!(
            samples
                .windows(2)
                .all(|two| two[0].at <= two[1].at && !two[1].placed)
        );
        assert_eq!(
            samples.last().map(|last| last.at),
            Some(Duration::from_secs(4000))
        );
        assert!((trace.distance() - 4200.0).abs() < 1e-6);
    }

    #[test]
    fn turns_add_up_beyond_a_full_circle_and_placing_is_none() {
        let mut trace = Trace::from(pose(0.0));
        let mut turn = |heading: f64| {
            let at = Pose::new(0.0, 1.0, wrap(heading));
            trace.add_sample(Duration::ZERO, at, std::iter::empty(), 0);
            trace.turned()
        };
        let whole = (1..=80).map(|step| turn(0.1 * f64::from(step))).last();
        assert!((whole.unwrap() - 8.0).abs() < 1e-9);
        assert!((turn(8.0 + 2.0) - 8.0).abs() < 1e-9, "it was placed");
        assert!((turn(10.0 - 0.3) - 7.7).abs() < 1e-9);
    }

    #[test]
    fn placing_the_robot_does_not_count_as_driving() {
        let mut trace = Trace::from(pose(0.0));
        trace.add_sample(Duration::from_secs(1), pose(3.0), std::iter::empty(), 0);
        assert_eq!(trace.distance(), 0.0);
        assert!(trace.samples().last().is_some_and(|sample| sample.placed));
    }

    #[test]
    fn events_beyond_the_limit_are_counted() {
        let mut trace = Trace::from(pose(0.0));
        (0..MAX_EVENTS + 5).for_each(|_| trace.add_event(TraceEventKind::Photo));
        assert_eq!((trace.events().len(), trace.missed()), (MAX_EVENTS, 5));
    }
}
