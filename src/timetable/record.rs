//! The planner's state that outlives the program: the runs that were started or wait for the robot,
//! and up to when the timetable is handled.

use serde::{Deserialize, Serialize};

/// What a new program must know of the previous one.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    /// Starts up to this time are handled; seconds since 1970.
    pub looked: Option<i64>,
    /// The runs that were started and have not ended, and the starts that wait for the robot.
    pub under_way: Vec<UnderWay>,
}

/// A run that the timetable has started, or that waits for the robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnderWay {
    /// The behaviour.
    pub run: String,
    /// The planned time; seconds since 1970.
    pub planned: i64,
    /// When it must be ended; seconds since 1970. For a start that waits: if it were on time.
    pub until: Option<i64>,
    /// Whether it has not started yet: it waits for the robot.
    #[serde(default)]
    pub waits: bool,
}
