//! The connection to the robot: discovery, connecting, logging in, and the two halves of an open
//! connection. Knows bytes, time limits and pauses; what to send to the robot is decided elsewhere.
//!
//! [`connect`] returns a [`Session`] whose first command was a stop of the tracks. [`Backoff`]
//! computes the pause before the next attempt, [`discover`] finds robots. [`open`] does the same
//! over any transport that reads and writes bytes.

mod backoff;
mod delivery;
pub mod discover;
mod error;
mod host;
mod options;
mod reader;
mod send_queue;
mod session;
mod speech;
mod supervision;
mod target;
mod tcp_connect;
mod writer;

pub use backoff::Backoff;
pub use delivery::{Delivery, close_gracefully};
pub use error::LinkError;
pub use host::{host_of, is_host_name};
pub use options::Options;
pub use reader::{Incoming, Reader};
pub use session::{MAX_EARLY_REPORTS, Session, connect, open};
pub use supervision::Supervision;
pub use target::{Target, TargetError};
pub use writer::Writer;
