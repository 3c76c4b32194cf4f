//! What scripts find in the camera's frames, for viewers. Sending never blocks: slow receivers miss
//! some.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::broadcast;

use super::param::ParamBoard;

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

/// What one behaviour found in one frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Detections {
    /// The behaviour.
    pub behaviour: String,
    /// The frame's number.
    pub frame: u64,
    /// The objects.
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

    /// The parameters of behaviours.
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
