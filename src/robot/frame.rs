//! Camera frames as they come.

use bytes::Bytes;
use tokio::time::Instant;

/// One camera frame, as it came.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Counts the frames of a run from 1; gaps are frames that a slow reader missed.
    pub seq: u64,
    /// When its last byte arrived.
    pub at: Instant,
    /// The JPEG.
    pub jpeg: Bytes,
}

/// A frame of which a part has come.
#[derive(Debug, Clone)]
pub struct Coming {
    /// The number that it will have.
    pub seq: u64,
    /// Its first bytes.
    pub jpeg: Bytes,
}

/// What the camera shows.
#[derive(Debug, Clone, Default)]
pub struct Pictures {
    /// The newest frame.
    pub newest: Option<Frame>,
    /// The one on its way.
    pub coming: Option<Coming>,
}
