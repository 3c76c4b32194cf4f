//! What the tracks did for a while, and the way that this makes.

use serde::{Deserialize, Serialize};

/// A part of a way: what each track did, in seconds at full power, negative backwards. Both evenly, so
/// that it is a straight line, a turn on the spot or one curve.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Stroke {
    /// Left track.
    pub left: f32,
    /// Right track.
    pub right: f32,
}

impl Stroke {
    /// How much the busier track did.
    pub fn length(self) -> f32 {
        self.left.abs().max(self.right.abs())
    }

    /// One after the other as if it were one.
    pub fn and(self, next: Stroke) -> Stroke {
        Stroke {
            left: self.left + next.left,
            right: self.right + next.right,
        }
    }
}
