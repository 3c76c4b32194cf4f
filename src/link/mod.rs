//! The line to the robot: finding it, connecting, logging in, and the two halves of an open
//! connection. Knows bytes, time limits and pauses; what to say to the robot is decided elsewhere.
//!
//! [`connect`] gives a [`Session`] whose tracks have just been told to rest. [`Backoff`] says how
//! long to pause before the next try, [`discover`] who is there at all. [`open`] does the same over
//! any transport that reads and writes bytes.

mod backoff;
mod delivery;
mod dial;
pub mod discover;
mod error;
mod options;
mod reader;
mod send_queue;
mod session;
mod speech;
mod target;
mod unsent;
mod writer;

pub use backoff::Backoff;
pub use delivery::{Delivery, farewell};
pub use error::LinkError;
pub use options::Options;
pub use reader::{Reader, Received};
pub use session::{MAX_EARLY_REPORTS, Session, connect, open};
pub use target::{Target, TargetError};
pub use writer::Writer;
