//! What an argument of the command line must be, where it is not.

use crate::behaviour::MAX_NAME;
use crate::clock::ClockError;

/// What an argument of the command line must be, where it is not.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum ArgumentError {
    /// `learn --name`.
    #[error("expected a letter and then letters, digits, _ or -, at most {0}")]
    Colour(usize),
    /// `history --since` and `--until`.
    #[error(
        "expected so long ago, such as 30m, 12h, 7d or 2w, or a day such as 2026-11-01, or \
         2026-11-01T21:30"
    )]
    Moment,
    /// The name of a picture that is written.
    #[error("expected a file that ends in .png")]
    Png,
    /// `new NAME`.
    #[error(
        "expected at most {MAX_NAME} letters, digits, `_` and `-`, beginning with a letter and not \
         ending in `_test`"
    )]
    Project,
    /// `calibrate camera --station`.
    #[error("expected a distance from {0} to {1} metres, such as 1.5")]
    Distance(f64, f64),
    /// `calibrate camera --board`.
    #[error("expected COLUMNSxROWS, 3 to 40 inner corners each way, such as 9x6")]
    Board,
    /// `--timeout` of tests and lessons.
    #[error("expected a number of seconds, 0.1 to 86400")]
    Timeout,
    /// `discover --timeout`: no number.
    #[error("expected a number of seconds")]
    Number,
    /// `discover --timeout`: too short or too long.
    #[error("expected 0.1 to 60 seconds")]
    Search,
    /// `run --for`.
    #[error("expected a number of seconds, at most {0}")]
    Duration(f64),
    /// `sim --fps`.
    #[error("expected 0.1 to 60 frames per second")]
    FrameRate,
    /// `--roi`.
    #[error("expected x,y,w,h in whole pixels, such as 100,80,40,30; w and h at least 1")]
    Roi,
    /// `lesson`: no number or name of one.
    #[error("there are lessons 1 to {0}; `spykee lesson list` shows them")]
    Lesson(usize),
    /// `service unit --user`.
    #[error("a user's name has letters, digits, -, _ and dots, at most 31")]
    User,
    /// `--param`.
    #[error("expected NAME=VALUE, such as speed=50, or BEHAVIOUR.NAME=VALUE")]
    Param,
    /// `behaviour start --for`: no length of time.
    #[error(transparent)]
    Span(#[from] ClockError),
    /// `behaviour start --for 0s`.
    #[error("it would end before it begins")]
    NoTime,
}
