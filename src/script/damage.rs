//! Counts a script's damaged frames, and says so in its log, not too often.

use std::time::Duration;

use tokio::time::Instant;

/// Least time between two log lines about damaged frames.
const PAUSE: Duration = Duration::from_secs(10);

#[derive(Debug, Default)]
pub(super) struct Damage {
    count: u64,
    newest: Option<u64>,
    reported: u64,
    said_at: Option<Instant>,
    why: String,
}

impl Damage {
    /// Counts frame number `seq`, once even if it is noted repeatedly. Returns a log message if one
    /// is due.
    pub(super) fn record(&mut self, seq: u64, why: &str, now: Instant) -> Option<String> {
        if self.newest == Some(seq) {
            return None;
        }
        self.newest = Some(seq);
        self.count += 1;
        why.clone_into(&mut self.why);
        let lately = |at: Instant| now.saturating_duration_since(at) < PAUSE;
        if self.said_at.is_some_and(lately) {
            return None;
        }
        self.said_at = Some(now);
        self.rest()
    }

    /// Returns a log message if there are unreported damaged frames.
    pub(super) fn rest(&mut self) -> Option<String> {
        if self.reported == self.count {
            return None;
        }
        self.reported = self.count;
        Some(match self.count {
            1 => format!("a damaged frame: {}", self.why),
            count => format!("{count} damaged frames so far; the newest: {}", self.why),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_is_reported_at_once_and_further_ones_together() {
        let mut damage = Damage::default();
        let start = Instant::now();
        let first = damage.record(1, "cut short", start);
        assert_eq!(first.as_deref(), Some("a damaged frame: cut short"));
        for seq in 2..=5 {
            assert_eq!(damage.record(seq, "torn", start + PAUSE / 2), None);
        }
        let text = damage.record(6, "torn", start + PAUSE).unwrap();
        assert!(text.starts_with("6 damaged frames"), "{text}");
        assert_eq!(damage.rest(), None);
    }

    #[test]
    fn a_frame_is_counted_once_even_if_noted_repeatedly() {
        let mut damage = Damage::default();
        let start = Instant::now();
        for seq in [7, 7, 7, 9, 9] {
            damage.record(seq, "torn", start);
        }
        assert!(damage.rest().unwrap().starts_with("2 damaged frames"));
    }
}
