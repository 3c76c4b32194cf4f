//! Errors of invalid command-line arguments.

use crate::behaviour::MAX_NAME;
use crate::clock::ClockError;

/// An invalid command-line argument; the message says what was expected.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum ArgumentError {
    /// A whole number, such as `test --seeds`.
    #[error("expected a whole number from {low} to {high}")]
    Whole {
        /// The least.
        low: u64,
        /// The greatest.
        high: u64,
    },
    /// `learn --name`.
    #[error("expected a letter followed by letters, digits, _ or -, at most {0} characters in all")]
    Colour(usize),
    /// `history --since` and `--until`.
    #[error(
        "expected an age with its unit, such as 30m, 12h, 7d or 2w, or a date such as 2026-11-01 \
         or 2026-11-01T21:30"
    )]
    Moment,
    /// The name of a picture to write.
    #[error("expected a file that ends in .png")]
    Png,
    /// `new NAME`.
    #[error(
        "expected at most {MAX_NAME} letters, digits, `_` and `-`, beginning with a letter and not \
         ending in `_test`"
    )]
    Project,
    /// `--timeout` of tests and lessons.
    #[error("expected a number of seconds, 0.1 to 86400")]
    Timeout,
    /// `discover --timeout`: not a number.
    #[error("expected a number of seconds")]
    Number,
    /// `discover --timeout`: too short or too long.
    #[error("expected 0.1 to 60 seconds")]
    Search,
    /// `--roi`.
    #[error("expected x,y,w,h in whole pixels, such as 100,80,40,30; w and h at least 1")]
    Roi,
    /// `lesson`: neither a lesson's number nor its name.
    #[error("expected a lesson's name or a number from 1 to {0}; `spykee lesson list` shows them")]
    Lesson(usize),
    /// `service --user`.
    #[error("expected a user name: at most 31 letters, digits, -, _ and dots")]
    User,
    /// `--param`.
    #[error("expected NAME=VALUE, such as speed=50, or BEHAVIOUR.NAME=VALUE")]
    Param,
    /// `behaviour start --for`: not a duration.
    #[error(transparent)]
    Span(#[from] ClockError),
    /// `behaviour start --for 0s`.
    #[error("expected a duration above zero")]
    NoTime,
}
