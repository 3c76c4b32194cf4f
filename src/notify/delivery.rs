//! What becomes of a message.

/// What became of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Delivery {
    /// It has arrived.
    Done,
    /// It has not, and may later; in words.
    Later(String),
    /// It has not and never will; in words.
    Refused(String),
}
