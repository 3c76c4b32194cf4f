//! The journal: a SQLite file in the data folder with the events of an agent's bus: connections,
//! the battery level, dockings, alarms, runs and their endings, pictures, and entries of scripts.
//!
//! A separate thread writes it. If the disk is full, slow or missing, that thread waits but the bus
//! does not: events that do not fit into the queue are counted, and the count is written once there
//! is room. A process that is killed loses the events of its last half second.

mod database;
mod error;
mod history;
mod local;
mod options;
mod pending;
mod recorder;
mod retention;
mod row;
mod schema;

pub use database::{folder, journal_file};
pub use error::JournalError;
pub use history::{JournalReader, Kinds, LevelRange, Record, Span};
pub use local::SimulationJournal;
pub use options::{Options, RunInfo, When};
pub use recorder::Journal;
