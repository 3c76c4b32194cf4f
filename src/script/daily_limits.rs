//! The script's daily limits for what it sends to people besides its log: journal entries with the
//! names of pictures, and messages. The agent enforces the same limits.

use tokio::time::Instant;

use super::options::Limits;
use crate::rate_limit::Budget;

/// The longest `kind` of an entry, in bytes.
pub(crate) const MAX_KIND: usize = 40;
/// The longest entry, in bytes of JSON.
pub(crate) const MAX_ENTRY: usize = 4096;
/// The longest message, in bytes.
pub(crate) const MAX_NOTICE: usize = 1000;
/// Bytes of a journal entry besides its texts.
const OVERHEAD: usize = 100;

/// See the module documentation.
#[derive(Debug)]
pub(super) struct DailyLimits {
    bytes: Budget,
    notices: Budget,
}

impl DailyLimits {
    pub(super) fn new(limits: &Limits) -> DailyLimits {
        DailyLimits {
            bytes: Budget::new(limits.journal_bytes_a_day),
            notices: Budget::new(limits.notices_a_day),
        }
    }

    /// Takes the share of a journal entry with texts of this many bytes; `false` if too little is
    /// left today.
    pub(super) fn take_entry(&mut self, length: usize, now: Instant) -> bool {
        self.bytes.take((OVERHEAD + length) as u64, now)
    }

    /// Takes the share of one message; `false` if none is left.
    pub(super) fn take_notice(&mut self, now: Instant) -> bool {
        self.notices.take(1, now)
    }
}
