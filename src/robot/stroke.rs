//! Strokes, the parts of the robot's path.

use serde::{Deserialize, Serialize};

/// A part of a path: what each track did, in seconds at full power, negative backwards. Both tracks
/// run evenly, so that it is a straight line, a turn on the spot or one curve.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Stroke {
    /// Left track.
    pub left: f32,
    /// Right track.
    pub right: f32,
}

impl Stroke {
    /// The length of the faster track.
    pub fn length(self) -> f32 {
        self.left.abs().max(self.right.abs())
    }

    /// Both strokes, one after the other, merged into one.
    pub fn and(self, next: Stroke) -> Stroke {
        Stroke {
            left: self.left + next.left,
            right: self.right + next.right,
        }
    }
}
