//! Which of the robot's streams a script has switched on, and for how long. A stream is on as long
//! as the script has asked for it with `robot.stream`, listens to it or waits for it. Without
//! `robot.stream` it stays on for [`LINGER`] longer, so that a loop with `robot.wait_frame` does
//! not switch the camera on and off each time.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use tokio::time::Instant;

use crate::wire::Stream;

/// How long after its last use a stream is switched off.
pub(super) const LINGER: Duration = Duration::from_secs(2);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Demand {
    /// `robot.stream(name, true)`: until it is switched off by the same call.
    Explicit,
    /// A handler, a wait or `robot.frame()`: while it lasts.
    WhileUsed,
}

#[derive(Debug, Default)]
pub(super) struct WantedStreams {
    explicit: BTreeSet<Stream>,
    on: BTreeMap<Stream, Instant>,
}

impl WantedStreams {
    pub(super) fn is_on(&self, stream: Stream) -> bool {
        self.on.contains_key(&stream)
    }

    /// Records that a stream is needed; `true` if it was off.
    pub(super) fn switch_on(&mut self, stream: Stream, by: Demand, now: Instant) -> bool {
        if by == Demand::Explicit {
            self.explicit.insert(stream);
        }
        self.on.insert(stream, now).is_none()
    }

    /// Switches a stream off, for `robot.stream(name, false)`; `true` if it was on.
    pub(super) fn switch_off(&mut self, stream: Stream) -> bool {
        self.explicit.remove(&stream);
        self.on.remove(&stream).is_some()
    }

    /// The streams that are on only while something uses them.
    pub(super) fn temporary(&self) -> Vec<Stream> {
        let on = self.on.keys().copied();
        on.filter(|stream| !self.explicit.contains(stream))
            .collect()
    }

    pub(super) fn note_use(&mut self, stream: Stream, now: Instant) {
        if let Some(used) = self.on.get_mut(&stream) {
            *used = now;
        }
    }

    /// When a stream is switched off if nothing uses it.
    pub(super) fn end_of(&self, stream: Stream) -> Option<Instant> {
        self.on.get(&stream).map(|used| *used + LINGER)
    }

    /// Removes an unused stream if its time is over; `true` if it was removed.
    pub(super) fn drop_if_unused(&mut self, stream: Stream, now: Instant) -> bool {
        self.end_of(stream).is_some_and(|end| end <= now) && self.on.remove(&stream).is_some()
    }
}
