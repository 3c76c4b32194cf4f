//! Errors in the times of a timetable.

/// Errors in the times of a timetable.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TimetableError {
    /// Not a cron pattern, or a pattern that matches no day.
    #[error("`{text}` is not a pattern of times: {why}")]
    Pattern {
        /// The text as written.
        text: String,
        /// The reason, in words.
        why: String,
    },
    /// A pattern that is too long.
    #[error("a pattern of times is at most 200 characters long")]
    LongPattern,
    /// Not a span of quiet hours.
    #[error("`{0}` is not a span of hours such as 22:00-07:00")]
    Quiet(String),
}
