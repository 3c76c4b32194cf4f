//! What is wrong with a time that a person wrote.

/// What is wrong with a time that a person wrote.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ClockError {
    /// No date with a time of day.
    #[error("`{0}` is no date such as \"2026-03-29 01:30\"")]
    Date(String),
    /// No length of time, or one beyond a year.
    #[error("`{0}` is no length of time such as 90s, 30m, 1h30m or 7d")]
    Span(String),
    /// No name of a time zone.
    #[error("no time zone is called `{0}`")]
    Zone(String),
}
