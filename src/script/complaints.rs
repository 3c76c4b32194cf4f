//! Failures of the script, as the log tells them: explained the first time, then ever more rarely for
//! the same place.

use std::collections::BTreeMap;

use super::events::is_round;

/// Places whose complaints are counted; those of further places are logged each time.
const MAX_PLACES: usize = 256;

/// Puts the VM's text of a failure, such as `a.lua:3: attempt to index nil`, into words: the text,
/// the file, its source. `None` if it is not of this file, or has nothing to add.
pub type Explain = fn(text: &str, chunk: &str, source: &str) -> Option<String>;

/// See the module.
#[derive(Default)]
pub(super) struct Complaints {
    pub(super) explain: Option<Explain>,
    /// The script's text, to show its lines.
    pub(super) source: String,
    counts: BTreeMap<String, u64>,
}

/// How a failure is logged.
pub(super) enum Telling {
    /// It is the first of its place.
    Explained,
    /// As it is.
    Plain,
    /// With how often it has happened.
    Counted(u64),
    /// Not at all.
    Silent,
}

impl Complaints {
    /// Counts a failure by the place that its text begins with.
    pub(super) fn count(&mut self, text: &str) -> Telling {
        let place = text.split(": ").next().unwrap_or(text);
        let known = self.counts.contains_key(place);
        if !known && self.counts.len() >= MAX_PLACES {
            return Telling::Plain;
        }
        let count = self.counts.entry(place.to_owned()).or_default();
        *count += 1;
        match *count {
            1 => Telling::Explained,
            count if is_round(count) => Telling::Counted(count),
            _ => Telling::Silent,
        }
    }
}
