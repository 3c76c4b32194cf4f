//! What the script sees: the newest frame, what decodes it, and what looks from frame to frame.

use std::cell::Cell;
use std::rc::Rc;

use tokio::time::Instant;

use super::going::Going;
use super::options::Options;
use super::sighting::Witness;
use crate::robot::Frame;
use crate::vision::{Damage, Eyes, Size};

/// A frame as it came, counted while anyone holds it.
pub(super) struct HeldFrame {
    pub(super) frame: Frame,
    pub(super) size: Size,
    held: Rc<Cell<u64>>,
}

impl HeldFrame {
    /// `size` is what its markers say. Adds its bytes to `held` for as long as it lives.
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
pub(super) struct Sight {
    pub(super) newest: Option<Rc<HeldFrame>>,
    /// JPEG bytes of all frames that anyone holds.
    pub(super) held_bytes: Rc<Cell<u64>>,
    pub(super) eyes: Eyes,
    /// Trackers and motion detectors that live.
    pub(super) watchers: Rc<Cell<u32>>,
    /// A frame that is still to be looked at for the robot's own movement.
    pub(super) look: Option<Look>,
    /// When the last frame came during which the tracks turned the robot.
    pub(super) turned: Option<Instant>,
    /// Frames that were no pictures.
    pub(super) damage: Damage,
    /// Only where someone wants to see what the script sees.
    pub(super) witness: Option<Witness>,
}

/// What is to be found out from a frame about the robot's own movement, as things stood when it came.
pub(super) struct Look {
    pub(super) held: Rc<HeldFrame>,
    /// The timed motion that was on.
    pub(super) going: Option<Going>,
    /// It may show a turn.
    pub(super) turns: bool,
}

impl Sight {
    pub(super) fn new(options: &Options) -> Sight {
        Sight {
            newest: None,
            held_bytes: Rc::default(),
            eyes: Eyes::new(options.camera),
            watchers: Rc::default(),
            look: None,
            turned: None,
            damage: Damage::default(),
            witness: Witness::of(options),
        }
    }
}
