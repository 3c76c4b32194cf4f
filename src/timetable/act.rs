//! The planner's decisions, and its notices for people.

use std::time::Duration;

use jiff::Timestamp;

/// A decision of the planner.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Act {
    /// Start a behaviour. If that fails, the caller reports it with
    /// [`Planner::ended`](super::Planner::ended), or if the robot was not connected, with
    /// [`Planner::postpone`](super::Planner::postpone).
    Start {
        /// The behaviour.
        run: String,
        /// The planned time.
        planned: Timestamp,
        /// It will be ended after this time.
        lasts: Option<Duration>,
        /// Whether this resumes a run that was under way when the program ended.
        resumed: bool,
    },
    /// End a behaviour: its time is over.
    End {
        /// The behaviour.
        run: String,
    },
    /// Inform people.
    Report(Notice),
}

/// A notice for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// Starts were missed: the program did not run, or the clock was not set.
    Missed {
        /// The behaviour.
        run: String,
        /// The planned time of the latest start, which is missed or made up for.
        planned: Timestamp,
        /// The number of missed starts.
        count: usize,
    },
    /// A start was missed: no robot was connected before it was too late.
    NoRobot {
        /// The behaviour.
        run: String,
        /// The planned time.
        planned: Timestamp,
    },
    /// A start was skipped: the behaviour still runs.
    Overlap {
        /// The behaviour.
        run: String,
        /// The planned time.
        planned: Timestamp,
    },
    /// The clock was set.
    ClockSet {
        /// By how many seconds; negative: back.
        seconds: i64,
    },
}
