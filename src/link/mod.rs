//! The connection to the robot: discovery, connecting, logging in, and the two halves of an open
//! connection. Knows bytes, time limits and pauses; what to send to the robot is decided elsewhere.

pub mod discover;
mod error;
mod pace;
mod reader;
mod send_queue;
mod session;
mod target;
mod writer;

pub use error::LinkError;
pub use pace::{Delays, Executes};
pub use reader::Reader;
pub use session::{
    AcceptedLogin, Delivery, MAX_EARLY_REPORTS, Options, Session, Supervision, close_gracefully,
    connect, hang_up, open,
};
pub use target::{Target, TargetError, host_of, is_host_name};
pub use writer::{Confirmation, Writer};
