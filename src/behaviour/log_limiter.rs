//! Limits a host's lines in the log, per second and per day, and the length of each. An honest host
//! limits itself; this also holds for a compromised one.

use std::time::Duration;

use tokio::time::Instant;

use crate::rate_limit::{Budget, Repeats};
use crate::script::{Level, LogLine};

/// Maximum number of lines per second. An honest host sends at most 100, and a few of its own.
const MAX_LINES: u32 = 120;
const WINDOW: Duration = Duration::from_secs(1);
/// Minimum interval between two reports of dropped lines.
const REPORT_INTERVAL: Duration = Duration::from_secs(60);
/// Maximum length of a text, a field name and a field value, in characters; an honest host cuts
/// them shorter.
const LONGEST: usize = 4096;
const MAX_FIELDS: usize = 64;
/// Bytes counted for each line besides its text: time, level, names.
const OVERHEAD: usize = 80;

#[derive(Debug)]
pub(super) struct LogLimiter {
    day: Budget,
    window: Option<Instant>,
    lines: u32,
    reports: Repeats<()>,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) enum Admission {
    Written(LogLine),
    /// Dropped, to be reported with the number of lines dropped since the last report.
    Dropped(u64),
    /// The line is dropped; a recent report already said so.
    DroppedSilently,
}

impl LogLimiter {
    /// Creates the limiter of a behaviour that may log this many bytes per day.
    pub(super) fn new(per_day: u64) -> LogLimiter {
        LogLimiter {
            day: Budget::new(per_day),
            window: None,
            lines: 0,
            reports: Repeats::new(REPORT_INTERVAL),
        }
    }

    pub(super) fn admit(&mut self, line: LogLine, now: Instant) -> Admission {
        let line = cut(line);
        if self.has_room(now) && self.day.take(cost(&line), now) {
            return Admission::Written(line);
        }
        self.reports
            .record((), now)
            .map_or(Admission::DroppedSilently, Admission::Dropped)
    }

    fn has_room(&mut self, now: Instant) -> bool {
        let fresh = |begun: Instant| now.saturating_duration_since(begun) < WINDOW;
        if !self.window.is_some_and(fresh) {
            (self.window, self.lines) = (Some(now), 0);
        }
        self.lines = self.lines.saturating_add(1);
        self.lines <= MAX_LINES
    }
}

fn cut(mut line: LogLine) -> LogLine {
    let shorten = |text: &mut String| {
        if let Some((at, _)) = text.char_indices().nth(LONGEST) {
            text.truncate(at);
        }
    };
    shorten(&mut line.text);
    line.fields.truncate(MAX_FIELDS);
    for (key, value) in &mut line.fields {
        shorten(key);
        shorten(value);
    }
    line
}

fn cost(line: &LogLine) -> u64 {
    let fields: usize = line
        .fields
        .iter()
        .map(|(key, value)| key.len() + value.len())
        .sum();
    (OVERHEAD + line.text.len() + fields) as u64
}

pub(super) fn log(behaviour: &str, line: &LogLine) {
    let fields: Vec<String> = line
        .fields
        .iter()
        .map(|(key, value)| format!("{key}={value}"))
        .collect();
    let text = [&[line.text.clone()][..], &fields].concat().join(" ");
    let at = line.line;
    match line.level {
        Level::Debug => tracing::debug!(target: "spykee::script", behaviour, line = at, "{text}"),
        Level::Info => tracing::info!(target: "spykee::script", behaviour, line = at, "{text}"),
        Level::Warn => tracing::warn!(target: "spykee::script", behaviour, line = at, "{text}"),
        Level::Error => tracing::error!(target: "spykee::script", behaviour, line = at, "{text}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::script::Level;

    fn line(text: String) -> LogLine {
        LogLine {
            level: Level::Info,
            text,
            fields: Vec::new(),
            line: None,
        }
    }

    fn written(log_limiter: &mut LogLimiter, now: Instant) -> bool {
        matches!(
            log_limiter.admit(line("x".into()), now),
            Admission::Written(_)
        )
    }

    #[test]
    fn a_flood_is_limited_per_second_and_reported_once_a_minute() {
        let mut log_limiter = LogLimiter::new(1 << 30);
        let mut now = Instant::now();
        let passed = std::iter::repeat_with(|| written(&mut log_limiter, now))
            .take(10_000)
            .filter(|written| *written)
            .count();
        assert_eq!(passed, MAX_LINES as usize);
        now += WINDOW;
        assert!(written(&mut log_limiter, now));
        now += REPORT_INTERVAL;
        let flood = (0..200).map(|_| log_limiter.admit(line("x".into()), now));
        let reported: Vec<_> = flood
            .filter(|admission| matches!(admission, Admission::Dropped(_)))
            .collect();
        assert_eq!(
            reported,
            [Admission::Dropped(10_000 - u64::from(MAX_LINES) - 1)]
        );
    }

    #[test]
    fn bytes_per_day_and_line_length_are_limited() {
        let mut log_limiter = LogLimiter::new(24 * 1000);
        let mut now = Instant::now();
        let mut passed = 0;
        for _ in 0..3600 {
            now += WINDOW;
            passed += usize::from(written(&mut log_limiter, now));
        }
        assert!((12..=25).contains(&passed), "{passed}");
        let mut log_limiter = LogLimiter::new(1 << 30);
        let long = LogLine {
            fields: vec![("k".repeat(9000), "v".repeat(9000)); 900],
            ..line("ä".repeat(100_000))
        };
        let Admission::Written(cut) = log_limiter.admit(long, now) else {
            panic!("dropped");
        };
        assert_eq!(cut.text.chars().count(), LONGEST);
        assert_eq!(
            (cut.fields.len(), cut.fields[0].1.len()),
            (MAX_FIELDS, LONGEST)
        );
    }
}
