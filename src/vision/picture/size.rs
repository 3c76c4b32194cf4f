//! Picture sizes.

use serde::{Deserialize, Serialize};

/// Widest picture that is decoded, in pixels.
pub const MAX_WIDTH: u32 = 1280;
/// Highest picture that is decoded, in pixels.
pub const MAX_HEIGHT: u32 = 1024;

/// Width and height in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Size {
    /// Number of columns, 1..=[`MAX_WIDTH`].
    pub width: u32,
    /// Number of rows, 1..=[`MAX_HEIGHT`].
    pub height: u32,
}
