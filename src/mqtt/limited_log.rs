//! Logs messages caused by clients of the broker, within a daily budget: any client can send
//! endless commands, which must not fill the disk.

use tokio::time::Instant;
use tracing::{info, warn};

use crate::rate_limit::Budget;

/// Bytes per day.
const PER_DAY: u64 = 1 << 20;

/// Writes log lines within a budget, and counts those that are dropped.
#[derive(Debug)]
pub(super) struct LimitedLog {
    budget: Budget,
    dropped: u64,
}

impl LimitedLog {
    pub(super) fn new() -> LimitedLog {
        LimitedLog {
            budget: Budget::new(PER_DAY),
            dropped: 0,
        }
    }

    pub(super) fn info(&mut self, line: &str) {
        if let Some(dropped) = self.take(line, Instant::now()) {
            info!("{line}{dropped}");
        }
    }

    pub(super) fn warn(&mut self, line: &str) {
        if let Some(dropped) = self.take(line, Instant::now()) {
            warn!("{line}{dropped}");
        }
    }

    /// Returns `None` if the line must be dropped; otherwise a remark about dropped lines, to be
    /// appended, which may be empty.
    fn take(&mut self, line: &str, now: Instant) -> Option<String> {
        if !self.budget.take(line.len() as u64, now) {
            self.dropped += 1;
            return None;
        }
        Some(match std::mem::take(&mut self.dropped) {
            0 => String::new(),
            dropped => format!(" ({dropped} lines about the broker's messages were dropped)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_flood_is_limited_and_counted_and_later_lines_are_written() {
        let mut log = LimitedLog::new();
        let mut now = Instant::now();
        let line = "x".repeat(100);
        let written = std::iter::repeat_with(|| log.take(&line, now))
            .take(10_000)
            .flatten();
        assert!((100..1000).contains(&written.count()));
        now += Duration::from_secs(3600);
        let remark = log.take(&line, now).unwrap();
        assert!(
            remark.contains("lines about the broker's messages"),
            "{remark}"
        );
        assert_eq!(log.take(&line, now).as_deref(), Some(""));
    }
}
