//! Camera frames as received.

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

/// One camera frame, as received.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Frame {
    /// Counts the frames of a run from 1; a slow reader sees gaps.
    pub seq: u64,
    /// When its last byte arrived. Between processes, whose clocks differ, it is sent as an age.
    #[serde(with = "age")]
    pub at: Instant,
    /// The JPEG.
    pub jpeg: Bytes,
}

/// A frame that has been received in part.
#[derive(Debug, Clone)]
pub struct PartialFrame {
    /// The number that the frame will have.
    pub seq: u64,
    /// Its first bytes.
    pub jpeg: Bytes,
}

/// The frames of the camera.
#[derive(Debug, Clone, Default)]
pub struct Pictures {
    /// The newest frame, which may be damaged.
    pub newest: Option<Frame>,
    /// The one before it, for a reader that finds the newest damaged.
    pub before: Option<Frame>,
    /// The one being received.
    pub partial: Option<PartialFrame>,
}

impl Pictures {
    /// Stores a new frame.
    pub fn push(&mut self, frame: Frame) {
        self.before = self.newest.replace(frame);
        self.partial = None;
    }
}

mod age {
    use std::time::Duration;

    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};
    use tokio::time::Instant;

    pub(super) fn serialize<S: Serializer>(at: &Instant, to: S) -> Result<S::Ok, S::Error> {
        at.elapsed().serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Instant, D::Error> {
        let age = Duration::deserialize(from)?;
        let now = Instant::now();
        Ok(now.checked_sub(age).unwrap_or(now))
    }
}
