//! Camera frames as received, and what scripts find in them, for viewers. Sending never blocks: slow
//! receivers miss some.

use bytes::Bytes;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast;
use tokio::time::Instant;

use super::param::ParamBoard;
use crate::wire::Stream;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Frame {
    /// Counts the frames of a run from 1; a slow reader sees gaps.
    pub seq: u64,
    /// When its last byte arrived. Between processes, whose clocks differ, it is sent as an age.
    #[serde(with = "age")]
    pub at: Instant,
    pub jpeg: Bytes,
}

#[derive(Debug, Clone, Default)]
pub struct Pictures {
    /// The newest frame, which may be damaged.
    pub newest: Option<Frame>,
    /// The one before it, for a reader that finds the newest damaged.
    pub before: Option<Frame>,
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

impl Streams {
    pub fn usage(&self, stream: Stream) -> Use {
        match stream {
            Stream::Video => self.video,
            Stream::AudioIn => self.audio_in,
            Stream::AudioOut => self.audio_out,
            Stream::Unknown(_) => Use::Auto,
        }
    }

    /// Checks that a script may have a stream: the error says that the config keeps it off.
    pub fn allow(&self, stream: Stream) -> Result<(), String> {
        if self.usage(stream) == Use::Off {
            let name = stream.name();
            return Err(format!(
                "the config keeps {name} off; it has streams: {{ {name}: off }}"
            ));
        }
        Ok(())
    }

    pub fn used(self, usage: Use) -> impl Iterator<Item = Stream> {
        let all = Stream::ALL.iter().copied();
        all.filter(move |stream| self.usage(*stream) == usage)
    }
}

/// The most detections of one frame, and the most letters of each.
const MAX_DETECTIONS: usize = 64;
const LONGEST: usize = 40;
/// The most frames that a viewer may be behind.
const BEHIND: usize = 32;

/// An object found in a frame, in pixels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Found")]
pub struct Detection {
    /// Left edge.
    pub x: u32,
    /// Upper edge.
    pub y: u32,
    /// Width.
    pub w: u32,
    /// Height.
    pub h: u32,
    /// A label: the colour's name, the track's id.
    pub text: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Detections {
    pub behaviour: String,
    pub frame: u64,
    pub list: Vec<Detection>,
}

/// The channel to viewers, and what else behaviours and viewers exchange: parameters. Cheap to
/// clone.
#[derive(Debug, Clone)]
pub struct ViewerChannel {
    found: broadcast::Sender<Detections>,
    params: ParamBoard,
}

impl Default for ViewerChannel {
    fn default() -> ViewerChannel {
        ViewerChannel {
            found: broadcast::Sender::new(BEHIND),
            params: ParamBoard::default(),
        }
    }
}

impl ViewerChannel {
    /// Sends detections to all viewers. A compromised host may send anything, so the length is
    /// bounded.
    pub fn send(&self, mut found: Detections) {
        found.list.truncate(MAX_DETECTIONS);
        for one in &mut found.list {
            if let Some((at, _)) = one.text.char_indices().nth(LONGEST) {
                one.text.truncate(at);
            }
        }
        // Fails only without receivers.
        let _ = self.found.send(found);
    }

    /// Subscribes to what is found from now on.
    pub fn detections(&self) -> broadcast::Receiver<Detections> {
        self.found.subscribe()
    }

    pub fn params(&self) -> &ParamBoard {
        &self.params
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detections_are_limited_and_a_slow_viewer_delays_nothing() {
        let viewers = ViewerChannel::default();
        let mut slow = viewers.detections();
        let text = "x".repeat(1000);
        let one = Detection {
            x: 1,
            y: 2,
            w: 3,
            h: 4,
            text,
        };
        for frame in 0..1000 {
            let behaviour = "a".to_owned();
            let list = vec![one.clone(); 500];
            viewers.send(Detections {
                behaviour,
                frame,
                list,
            });
        }
        assert!(matches!(
            slow.try_recv(),
            Err(broadcast::error::TryRecvError::Lagged(_))
        ));
        let next = slow.try_recv().unwrap();
        assert_eq!(
            (next.list.len(), next.list[0].text.len()),
            (MAX_DETECTIONS, LONGEST)
        );
    }
}
