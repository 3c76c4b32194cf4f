//! What the planner wants done, and what a person should know of it.

use std::time::Duration;

use jiff::Timestamp;

/// What is to be done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Act {
    /// Start a behaviour. How that went is told by [`Planner::ended`](super::Planner::ended), if it failed.
    Start {
        /// Which.
        run: String,
        /// When that was planned.
        planned: Timestamp,
        /// It will be ended after this.
        lasts: Option<Duration>,
        /// It was under way when the program ended.
        resumed: bool,
    },
    /// End a behaviour: its time is over.
    End {
        /// Which.
        run: String,
    },
    /// Tell a person.
    Tell(Notice),
}

/// What a person should know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// A start was missed: the program did not run then.
    Missed {
        /// Which behaviour.
        run: String,
        /// The newest that was missed.
        planned: Timestamp,
        /// How many.
        count: usize,
    },
    /// A start was missed: there was no robot until it was too late.
    NoRobot {
        /// Which behaviour.
        run: String,
        /// When that was planned.
        planned: Timestamp,
    },
    /// A start is refused: the behaviour still runs.
    Overlap {
        /// Which behaviour.
        run: String,
        /// When that was planned.
        planned: Timestamp,
    },
    /// The clock was set, by so many seconds.
    ClockSet {
        /// Negative: back.
        seconds: i64,
    },
}
