//! The result of a delivery.

/// The result of a delivery.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Delivery {
    /// The message was delivered.
    Done,
    /// It was not delivered, and a retry may succeed; the reason in words.
    Later(String),
    /// It was not delivered, and a retry cannot succeed; the reason in words.
    Refused(String),
}
