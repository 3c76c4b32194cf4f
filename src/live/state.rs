//! The state of the run for the page. Its words are keys of the page's table of texts.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::Instant;

use crate::control::{Run, RunStatus};
use crate::robot::Use;
use crate::wire::Stream;

/// Period over which frames are counted.
const RATE: Duration = Duration::from_secs(1);

/// The state of the run and of its viewers.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct State {
    /// The state of the run.
    #[serde(flatten)]
    pub run: RunStatus,
    /// Frames per second.
    pub fps: u32,
    /// The viewer that drives by hand.
    pub driver: Option<Person>,
    /// The number of viewers.
    pub viewers: usize,
}

/// A viewer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Person {
    /// The viewer's number.
    pub id: u32,
    /// The viewer's name.
    pub name: String,
}

/// Counts frames per second.
#[derive(Debug)]
pub(super) struct Rate {
    since: Instant,
    frames: u64,
    rate: u32,
}

impl Rate {
    pub(super) fn new(now: Instant) -> Rate {
        Rate {
            since: now,
            frames: 0,
            rate: 0,
        }
    }

    /// The rate, given the number of frames so far.
    pub(super) fn count(&mut self, frames: u64, now: Instant) -> u32 {
        let passed = now.saturating_duration_since(self.since);
        if passed >= RATE {
            let new = frames.saturating_sub(self.frames);
            self.rate = (new as f64 / passed.as_secs_f64()).round() as u32;
            self.since = now;
            self.frames = frames;
        }
        self.rate
    }
}

pub(super) fn has_camera(run: &Run) -> bool {
    run.streams.usage(Stream::Video) != Use::Off
}
