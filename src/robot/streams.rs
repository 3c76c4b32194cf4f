//! Which of the robot's streams may be on: the config takes precedence over scripts.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::wire::Stream;

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
    ///
    /// # Errors
    /// [`StreamOff`] if the config keeps it off.
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
