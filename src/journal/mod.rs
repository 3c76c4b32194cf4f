//! What happened in February: a SQLite file in the data folder that remembers what an agent says on its
//! bus. Links, the battery's level, docks, alarms, runs and their endings, pictures, and what scripts
//! want to be remembered.
//!
//! Written by a thread of its own. What if the disk is full, slow or gone? The thread waits, the bus
//! does not: what does not fit is counted, and the count is written once there is room. A process
//! that is killed loses what happened within its last half second.

mod error;
mod history;
mod ledger;
mod local;
mod options;
mod pending;
mod recorder;
mod retention;
mod row;
mod schema;

pub use error::JournalError;
pub use history::{History, Kinds, Record, Span};
pub use ledger::{folder, journal_file};
pub use local::LabJournal;
pub use options::{About, Options, When};
pub use recorder::Journal;
