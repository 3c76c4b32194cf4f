//! Camera frames as received.

use bytes::Bytes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use crate::wire::Stream;

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

/// When a stream is on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Use {
    /// From the start, whatever scripts ask for.
    On,
    /// While a script wants it, and for two seconds after it was last used.
    #[default]
    Auto,
    /// Never: its events do not happen, and the script's log says so; only `robot.stream` is an
    /// error.
    Off,
}

/// When each of the robot's streams is on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Streams {
    /// Pictures of the camera.
    pub video: Use,
    /// Sound of the microphone.
    pub audio_in: Use,
    /// Sound for the speaker.
    pub audio_out: Use,
}

/// A stream that the config keeps off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the config keeps {0} off; it has streams: {{ {0}: off }}")]
pub struct StreamOff(&'static str);

impl Streams {
    /// When this stream is on.
    pub fn usage(&self, stream: Stream) -> Use {
        match stream {
            Stream::Video => self.video,
            Stream::AudioIn => self.audio_in,
            Stream::AudioOut => self.audio_out,
            Stream::Unknown(_) => Use::Auto,
        }
    }

    /// Checks that a script may have a stream.
    /// Fails with [`StreamOff`] if the config keeps it off.
    pub fn allow(&self, stream: Stream) -> Result<(), StreamOff> {
        if self.usage(stream) == Use::Off {
            return Err(StreamOff(stream.name()));
        }
        Ok(())
    }

    /// The streams with this usage.
    pub fn used(self, usage: Use) -> impl Iterator<Item = Stream> {
        let all = Stream::ALL.iter().copied();
        all.filter(move |stream| self.usage(*stream) == usage)
    }
}
