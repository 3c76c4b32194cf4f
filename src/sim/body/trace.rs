//! What a robot did: where it was when, and what happened there. Kept by every simulated robot, in
//! bounded memory, for the picture of a run and for tests of behaviours.

use std::time::Duration;

use crate::wire::{Led, Sound};

use crate::sim::geometry::{Point, Pose};

/// Samples that are kept; then every other one is forgotten.
const MAX_SAMPLES: usize = 16_384;
/// Happenings that are kept; later ones are only counted.
const MAX_EVENTS: usize = 2048;
/// A sample is taken when the robot went so far, metres, or turned so far, radians.
const STRIDE: f64 = 0.02;
const TURN: f64 = 0.1;
/// Metres in one step: a longer one is not driving; the robot was placed.
const LEAP: f64 = 0.1;

/// Where the robot was at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Simulated time since the start.
    pub at: Duration,
    /// Where it was.
    pub pose: Pose,
    /// The robot was placed here; it did not drive here from the sample before.
    pub leapt: bool,
}

/// Something that happened to the robot, or that it was told.
#[derive(Debug, Clone, PartialEq)]
pub struct Happening {
    /// Simulated time since the start.
    pub at: Duration,
    /// Where the robot was.
    pub pose: Pose,
    /// What it was.
    pub what: What,
}

/// What can happen.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// It ran into something of this name.
    Collision(String),
    /// It was told to find its station, by the watchdog or a script.
    FindBase,
    /// It stands on its station.
    Docked,
    /// It has left its station.
    Undocked,
    /// It gave up finding its station.
    BaseNotFound,
    /// It was told to play a sound.
    Sound(Sound),
    /// It was told to switch a light.
    Light {
        /// Which one.
        led: Led,
        /// On or off.
        on: bool,
    },
    /// It played the sound of a camera, which behaviours do when they keep a picture.
    Photo,
    /// A note of an observer; see [`Handle::note`](crate::sim::Handle::note).
    Note(String),
}

/// Where all that moves besides the robot is: so many balls first, then people.
pub(crate) struct Movers<I> {
    pub(crate) places: I,
    pub(crate) balls: usize,
}

/// What one robot did so far.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    samples: Vec<Sample>,
    /// Only every so many strides are kept.
    thin: u32,
    skipped: u32,
    events: Vec<Happening>,
    missed: usize,
    now: Sample,
    balls: Vec<Point>,
    walkers: Vec<Point>,
    distance: f64,
}

impl Default for Sample {
    fn default() -> Sample {
        Sample {
            at: Duration::ZERO,
            pose: Pose::default(),
            leapt: true,
        }
    }
}

impl Trace {
    /// Begins where the robot starts.
    pub(crate) fn from(pose: Pose) -> Trace {
        let start = Sample {
            pose,
            ..Sample::default()
        };
        Trace {
            samples: vec![start],
            thin: 1,
            now: start,
            ..Trace::default()
        }
    }

    /// The robot is here now.
    pub(crate) fn follow(
        &mut self,
        at: Duration,
        pose: Pose,
        movers: Movers<impl Iterator<Item = Point>>,
    ) {
        let leapt = pose.point().distance(self.now.pose.point()) > LEAP;
        if !leapt {
            self.distance += pose.point().distance(self.now.pose.point());
        }
        self.now = Sample { at, pose, leapt };
        let Movers { places, balls } = movers;
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
        let turned = crate::sim::geometry::wrap(pose.heading - last.pose.heading).abs();
        if !leapt && turned < TURN && last.pose.point().distance(pose.point()) < STRIDE {
            return;
        }
        self.skipped += 1;
        if leapt || self.skipped >= self.thin {
            self.skipped = 0;
            self.samples.push(self.now);
        }
        if self.samples.len() >= MAX_SAMPLES {
            let mut index = 0;
            self.samples.retain(|sample| {
                index += 1;
                sample.leapt || index % 2 == 1
            });
            // Bounds the number of placements too.
            self.samples.truncate(MAX_SAMPLES - 1);
            self.thin *= 2;
        }
    }

    /// Something happens now.
    pub(crate) fn note(&mut self, what: What) {
        if self.events.len() == MAX_EVENTS {
            self.missed += 1;
            return;
        }
        let (at, pose) = (self.now.at, self.now.pose);
        self.events.push(Happening { at, pose, what });
    }

    /// Where it was, oldest first, a few centimetres apart; the last one is now.
    pub fn samples(&self) -> impl Iterator<Item = Sample> {
        self.samples.iter().copied().chain([self.now])
    }

    /// What happened, oldest first; of very many the first ones.
    pub fn events(&self) -> &[Happening] {
        &self.events
    }

    /// How many happenings there were beyond [`Trace::events`].
    pub fn missed(&self) -> usize {
        self.missed
    }

    /// Simulated time that has passed.
    pub fn duration(&self) -> Duration {
        self.now.at
    }

    /// Metres driven.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Where the balls are now, in the world's order.
    pub fn balls(&self) -> &[Point] {
        &self.balls
    }

    /// Where the people are now, in the world's order.
    pub fn walkers(&self) -> &[Point] {
        &self.walkers
    }

    /// What the robot ran into, oldest first.
    pub fn collisions(&self) -> impl Iterator<Item = &str> {
        self.events.iter().filter_map(|event| match &event.what {
            What::Collision(name) => Some(name.as_str()),
            _ => None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn nothing() -> Movers<std::iter::Empty<Point>> {
        Movers {
            places: std::iter::empty(),
            balls: 0,
        }
    }

    fn pose(x: f64) -> Pose {
        Pose::new(x, 1.0, 0.0)
    }

    #[test]
    fn a_long_way_is_kept_coarser_and_no_longer() {
        let mut trace = Trace::from(pose(0.0));
        for step in 1..=200_000 {
            let at = Duration::from_millis(20) * step;
            trace.follow(at, pose(f64::from(step) * 0.021), nothing());
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
                .all(|two| two[0].at <= two[1].at && !two[1].leapt)
        );
        assert_eq!(
            samples.last().map(|last| last.at),
            Some(Duration::from_secs(4000))
        );
        assert!((trace.distance() - 4200.0).abs() < 1e-6);
    }

    #[test]
    fn a_robot_that_is_put_somewhere_has_not_driven() {
        let mut trace = Trace::from(pose(0.0));
        trace.follow(Duration::from_secs(1), pose(3.0), nothing());
        assert_eq!(trace.distance(), 0.0);
        assert!(trace.samples().last().is_some_and(|sample| sample.leapt));
    }

    #[test]
    fn happenings_without_end_are_counted() {
        let mut trace = Trace::from(pose(0.0));
        (0..MAX_EVENTS + 5).for_each(|_| trace.note(What::Photo));
        assert_eq!((trace.events().len(), trace.missed()), (MAX_EVENTS, 5));
    }
}
