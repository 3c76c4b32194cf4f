//! A frame that someone holds: its bytes are counted until it is let go.

use std::cell::Cell;
use std::rc::Rc;

use crate::robot::Frame;
use crate::vision::Size;

/// A frame as it came, counted while anyone holds it.
pub(super) struct HeldFrame {
    pub(super) frame: Frame,
    pub(super) size: Size,
    held: Rc<Cell<u64>>,
}

impl HeldFrame {
    /// As it came.
    pub(super) fn frame(&self) -> &Frame {
        &self.frame
    }

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
