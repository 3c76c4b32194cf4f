//! What a script may tell people beside its log: entries for the journal, messages, pictures. Its own
//! shares of the day; the agent holds it to the same.

use tokio::time::Instant;

use super::options::Limits;
use crate::budget::Budget;

/// The longest kind of an entry, in bytes.
pub(crate) const MAX_KIND: usize = 40;
/// The longest entry, in bytes of JSON.
pub(crate) const MAX_ENTRY: usize = 4096;
/// The longest message, in bytes.
pub(crate) const MAX_NOTICE: usize = 1000;
/// What the journal has of an entry besides its texts.
const OVERHEAD: usize = 100;

/// See the module documentation.
#[derive(Debug)]
pub(super) struct Shares {
    bytes: Budget,
    notices: Budget,
}

impl Shares {
    pub(super) fn new(limits: &Limits) -> Shares {
        Shares {
            bytes: Budget::new(limits.journal_bytes_a_day),
            notices: Budget::new(limits.notices_a_day),
        }
    }

    /// Whether the journal has room for texts of so many bytes today.
    pub(super) fn takes_entry(&mut self, length: usize, now: Instant) -> bool {
        self.bytes.take((OVERHEAD + length) as u64, now)
    }

    /// Whether one more message may go out.
    pub(super) fn takes_notice(&mut self, now: Instant) -> bool {
        self.notices.take(1, now)
    }
}
