//! The state of the camera's frames: the newest frame, its decoder, and the planned check of a
//! frame for the robot's own motion.

use std::cell::Cell;
use std::rc::Rc;

use tokio::time::Instant;

use super::annotated_frame::DetectionsRecorder;
use super::options::Options;
use crate::odometry::TimedMotion;
use crate::robot::Frame;
use crate::vision::{Damage, FrameAnalyser, Size};

/// A received frame; its bytes are counted while it is referenced.
pub(super) struct HeldFrame {
    pub(super) frame: Frame,
    pub(super) size: Size,
    held: Rc<Cell<u64>>,
}

impl HeldFrame {
    /// Creates a held frame; `size` is from the markers of the JPEG. Its bytes count in `held`
    /// until it is dropped.
    pub(super) fn new(frame: Frame, size: Size, held: &Rc<Cell<u64>>) -> HeldFrame {
        held.set(held.get() + frame.jpeg.len() as u64);
        HeldFrame {
            frame,
            size,
            held: Rc::clone(held),
        }
    }
}

impl Drop for HeldFrame {
    fn drop(&mut self) {
        let bytes = self.frame.jpeg.len() as u64;
        self.held.set(self.held.get().saturating_sub(bytes));
    }
}

/// See the module documentation.
pub(super) struct FrameState {
    pub(super) newest: Option<Rc<HeldFrame>>,
    /// JPEG bytes of all frames that are still referenced.
    pub(super) held_bytes: Rc<Cell<u64>>,
    pub(super) analyser: FrameAnalyser,
    /// Number of trackers and motion detectors that exist.
    pub(super) watchers: Rc<Cell<u32>>,
    /// A frame that is still to be examined for the robot's own motion.
    pub(super) motion_check: Option<MotionCheck>,
    /// When the last frame arrived during which the tracks turned the robot.
    pub(super) turned: Option<Instant>,
    /// Frames that were not valid pictures.
    pub(super) damage: Damage,
    /// Set only if somebody wants to see what the script sees.
    pub(super) recorder: Option<DetectionsRecorder>,
}

/// How to examine a frame for the robot's own motion, with the state at the time when the frame
/// arrived.
pub(super) struct MotionCheck {
    pub(super) held: Rc<HeldFrame>,
    /// The timed motion that was active.
    pub(super) timed: Option<TimedMotion>,
    /// Whether the frame may show a turn.
    pub(super) turns: bool,
}

impl FrameState {
    pub(super) fn new(options: &Options) -> FrameState {
        FrameState {
            newest: None,
            held_bytes: Rc::default(),
            analyser: FrameAnalyser::new(options.camera),
            watchers: Rc::default(),
            motion_check: None,
            turned: None,
            damage: Damage::default(),
            recorder: DetectionsRecorder::from_options(options),
        }
    }
}
