//! Bounds of numbers.

/// A number's bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bounds {
    /// From the first number to the second, both included.
    Between(f64, f64),
    /// Above the first number, up to and including the second.
    Above(f64, f64),
}

/// How long a call may wait, in seconds: up to thirty days.
pub(super) const SECONDS: Bounds = Bounds::Between(0.0, 30.0 * 86_400.0);

impl Bounds {
    /// Whether a number is within the bounds.
    pub fn contains(self, number: f64) -> bool {
        match self {
            Bounds::Between(low, high) => (low..=high).contains(&number),
            Bounds::Above(low, high) => number > low && number <= high,
        }
    }

    /// The bounds in words, such as `between 0 and 100`, or `of at least 0` without an upper bound.
    pub fn describe(self) -> String {
        match self {
            Bounds::Between(low, f64::MAX) => format!("of at least {low}"),
            Bounds::Between(low, high) => format!("between {low} and {high}"),
            Bounds::Above(low, high) => format!("above {low} and at most {high}"),
        }
    }
}
