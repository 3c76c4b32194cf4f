//! What is wrong with a time of the timetable that a person wrote.

/// What is wrong with a time of the timetable that a person wrote.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TimetableError {
    /// Not a cron pattern, or a pattern that matches no day.
    #[error("`{text}` is not a pattern of times: {why}")]
    Pattern {
        /// As written.
        text: String,
        /// In words.
        why: String,
    },
    /// A pattern that is too long.
    #[error("a pattern of times is at most 200 letters long")]
    LongPattern,
    /// No quiet hours.
    #[error("`{0}` is not a span of hours such as 22:00-07:00")]
    Quiet(String),
}
