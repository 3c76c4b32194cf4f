//! How often failures of the script are logged: explained the first time, then ever more rarely for
//! the same place.

use std::collections::BTreeMap;

use super::events::is_round;

/// Number of places whose failures are counted; failures of further places are logged each time.
const MAX_PLACES: usize = 256;

/// Explains the VM's text of a failure, such as `a.lua:3: attempt to index nil`, in plain words.
/// Returns `None` if the failure is not in the file `chunk`, or if there is nothing to add.
pub type Explain = fn(text: &str, chunk: &str, source: &str) -> Option<String>;

/// See the module documentation.
#[derive(Default)]
pub(super) struct FailureLog {
    pub(super) explain: Option<Explain>,
    /// The script's text, to show its lines.
    pub(super) source: String,
    counts: BTreeMap<String, u64>,
}

/// How a failure is logged.
pub(super) enum LogForm {
    /// With its explanation: it is the first at its place.
    Explained,
    /// Without an explanation or a count.
    Plain,
    /// With the number of times that it has happened.
    Counted(u64),
    /// Not at all.
    Silent,
}

impl FailureLog {
    /// Counts a failure at the place that its text begins with, and returns how to log it.
    pub(super) fn count(&mut self, text: &str) -> LogForm {
        let location = text.split(": ").next().unwrap_or(text);
        let known = self.counts.contains_key(location);
        if !known && self.counts.len() >= MAX_PLACES {
            return LogForm::Plain;
        }
        let count = self.counts.entry(location.to_owned()).or_default();
        *count += 1;
        match *count {
            1 => LogForm::Explained,
            count if is_round(count) => LogForm::Counted(count),
            _ => LogForm::Silent,
        }
    }
}
