//! Errors in times that a person wrote.

/// What a duration must be.
pub(super) const SPAN_EXPECTED: &str =
    "a duration such as 90s, 30m, 1h30m or 7d, or a number of seconds, at most 366d";

/// Errors in times that a person wrote.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ClockError {
    /// Not a date with a time of day.
    #[error("`{0}` is not a date such as \"2026-03-29 01:30\"")]
    Date(String),
    /// Not a duration, or one longer than a year.
    #[error("expected {SPAN_EXPECTED}, found `{0}`")]
    Span(String),
    /// Not the name of a time zone.
    #[error("there is no time zone `{0}`")]
    Zone(String),
}
