//! The arguments of calls by a scenario's script. The runtime has already validated them against
//! the API table and filled in the defaults, so all values have the right types and are within
//! their bounds.

use std::time::Duration;

use serde_json::Value;

/// The arguments of one call.
#[derive(Clone, Copy)]
pub(super) struct Arguments<'a>(pub(super) &'a [Value]);

impl<'a> Arguments<'a> {
    pub(super) fn value(self, index: usize) -> &'a Value {
        self.0.get(index).unwrap_or(&Value::Null)
    }

    pub(super) fn number(self, index: usize) -> f64 {
        self.value(index).as_f64().unwrap_or_default()
    }

    pub(super) fn seconds(self, index: usize) -> Duration {
        seconds(self.value(index))
    }

    pub(super) fn is_true(self, index: usize) -> bool {
        self.value(index) == &Value::Bool(true)
    }

    pub(super) fn text(self, index: usize) -> Option<&'a str> {
        self.value(index).as_str()
    }

    /// Returns an option of the table at `index`.
    pub(super) fn option(self, index: usize, key: &str) -> Option<f64> {
        self.value(index).get(key)?.as_f64()
    }
}

/// Converts a number of seconds to a duration; zero for any other value.
pub(super) fn seconds(value: &Value) -> Duration {
    let seconds = value.as_f64().unwrap_or_default();
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}
