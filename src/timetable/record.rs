//! What outlives the program: what was started, and until when the timetable is dealt with.

use serde::{Deserialize, Serialize};

/// What a program that starts must know of the one before.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    /// Starts up to here are dealt with; seconds since 1970.
    pub looked: Option<i64>,
    /// What was started and has not ended.
    pub under_way: Vec<UnderWay>,
}

/// A run that the timetable has started.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnderWay {
    /// Which behaviour.
    pub run: String,
    /// When that was planned; seconds since 1970.
    pub planned: i64,
    /// When it is to be ended; seconds since 1970.
    pub until: Option<i64>,
}
