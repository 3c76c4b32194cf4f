//! Logs messages caused by clients of the broker, within a daily budget: any client can send
//! endless orders, which must not fill the disk.

use tokio::time::Instant;
use tracing::{info, warn};

use crate::budget::Budget;

/// Bytes per day.
const PER_DAY: u64 = 1 << 20;

/// Writes log lines within a budget, and counts those that are dropped.
#[derive(Debug)]
pub(super) struct Scribe {
    budget: Budget,
    left_out: u64,
}

impl Scribe {
    pub(super) fn new() -> Scribe {
        Scribe {
            budget: Budget::new(PER_DAY),
            left_out: 0,
        }
    }

    pub(super) fn info(&mut self, line: &str) {
        if let Some(left_out) = self.take(line, Instant::now()) {
            info!("{line}{left_out}");
        }
    }

    pub(super) fn warn(&mut self, line: &str) {
        if let Some(left_out) = self.take(line, Instant::now()) {
            warn!("{line}{left_out}");
        }
    }

    /// Returns `None` if the line must be dropped; otherwise a remark about dropped lines, to be
    /// appended, which may be empty.
    fn take(&mut self, line: &str, now: Instant) -> Option<String> {
        if !self.budget.take(line.len() as u64, now) {
            self.left_out += 1;
            return None;
        }
        Some(match std::mem::take(&mut self.left_out) {
            0 => String::new(),
            left_out => format!(" ({left_out} lines about the broker's messages were dropped)"),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_flood_is_limited_and_counted_and_later_lines_are_written() {
        let (mut scribe, mut now) = (Scribe::new(), Instant::now());
        let line = "x".repeat(100);
        let written = (0..10_000).filter(|_| scribe.take(&line, now).is_some());
        assert!((100..1000).contains(&written.count()));
        now += Duration::from_secs(3600);
        let said = scribe.take(&line, now).unwrap();
        assert!(said.contains("lines about the broker's messages"), "{said}");
        assert_eq!(scribe.take(&line, now).as_deref(), Some(""));
    }
}
