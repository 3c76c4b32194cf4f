//! Limits what a host may write to the log and which of its reports reach the bus: per second and
//! per day, with short texts, and only files in its own data folder. An honest host limits itself;
//! this also holds for a compromised one.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use crate::rate_limit::{Repeats, TokenBucket};
use crate::robot::{AgentEvent, HostReport};
use crate::sanitize;
use crate::script::{self, DailyLimits, Level, Limits, LogLine, MAX_ENTRY, MAX_KIND, MAX_NOTICE};

/// Maximum number of lines per second. An honest host sends at most 100, and a few of its own.
const MAX_LINES: u32 = 120;
const WINDOW: Duration = Duration::from_secs(1);
/// Minimum interval between two warnings about what was dropped.
const REPORT_INTERVAL: Duration = Duration::from_secs(60);
/// Maximum length of a text, a field name and a field value, in characters; an honest host cuts
/// them shorter.
const LONGEST: usize = 4096;
const MAX_FIELDS: usize = 64;
/// Bytes counted for each line besides its text: time, level, names.
const OVERHEAD: usize = 80;

/// What becomes of something that a host sends.
#[derive(Debug, PartialEq)]
pub(super) enum Admission<T> {
    Passed(T),
    /// Dropped, to be reported with the number dropped since the last report.
    Dropped(u64),
    /// Dropped; a recent report already said so.
    DroppedSilently,
}

impl<T> Admission<T> {
    fn dropped(reports: &mut Repeats<()>, now: Instant) -> Admission<T> {
        reports
            .record((), now)
            .map_or(Admission::DroppedSilently, Admission::Dropped)
    }
}

/// The limits of one behaviour, whatever its host.
#[derive(Debug)]
pub(super) struct HostLimiter {
    behaviour: String,
    folder: Option<PathBuf>,
    /// Of the bytes of its log.
    log_day: TokenBucket,
    window: Option<Instant>,
    lines: u32,
    dropped_lines: Repeats<()>,
    daily_limits: DailyLimits,
    dropped_reports: Repeats<()>,
}

impl HostLimiter {
    pub(super) fn new(behaviour: String, folder: Option<PathBuf>, limits: &Limits) -> HostLimiter {
        HostLimiter {
            behaviour,
            folder,
            log_day: TokenBucket::a_day(limits.log_bytes_a_day()),
            window: None,
            lines: 0,
            dropped_lines: Repeats::new(REPORT_INTERVAL),
            daily_limits: DailyLimits::new(limits),
            dropped_reports: Repeats::new(REPORT_INTERVAL),
        }
    }

    pub(super) fn admit_line(&mut self, line: LogLine, now: Instant) -> Admission<LogLine> {
        let line = cut(line);
        if self.has_room(now) && self.log_day.take(cost(&line) as f64, now) {
            return Admission::Passed(line);
        }
        Admission::dropped(&mut self.dropped_lines, now)
    }

    fn has_room(&mut self, now: Instant) -> bool {
        let fresh = |begun: Instant| now.saturating_duration_since(begun) < WINDOW;
        if !self.window.is_some_and(fresh) {
            (self.window, self.lines) = (Some(now), 0);
        }
        self.lines = self.lines.saturating_add(1);
        self.lines <= MAX_LINES
    }

    pub(super) fn admit_report(
        &mut self,
        report: HostReport,
        now: Instant,
    ) -> Admission<AgentEvent> {
        match self.event(report, now) {
            Some(what) => Admission::Passed(what),
            None => Admission::dropped(&mut self.dropped_reports, now),
        }
    }

    /// Converts a report. `None` if no honest host would send it, or if today's budget is used up.
    fn event(&mut self, report: HostReport, now: Instant) -> Option<AgentEvent> {
        let behaviour = self.behaviour.clone();
        match report {
            HostReport::Picture { name } => {
                let path = self.file(&name)?;
                if !self.daily_limits.take_entry(name.len(), now) {
                    return None;
                }
                Some(AgentEvent::Picture { behaviour, path })
            }
            HostReport::Entry { kind, json } => {
                let length = kind.len() + json.len();
                if kind.len() > MAX_KIND || json.len() > MAX_ENTRY {
                    return None;
                }
                let data = serde_json::from_str(&json).ok().filter(Value::is_object)?;
                if !self.daily_limits.take_entry(length, now) {
                    return None;
                }
                Some(AgentEvent::Entry {
                    behaviour,
                    kind: sanitize::line(&kind),
                    data,
                })
            }
            HostReport::Notify { text, picture } => {
                let picture = match picture {
                    Some(name) => Some(self.file(&name)?),
                    None => None,
                };
                if text.len() > MAX_NOTICE || !self.daily_limits.take_notice(now) {
                    return None;
                }
                Some(AgentEvent::Notify {
                    behaviour,
                    text: sanitize::text(&text, false),
                    picture,
                })
            }
        }
    }

    /// The path of a picture in the own folder; `None` if `name` is not a picture's name.
    fn file(&self, name: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        (script::picture_name(name).as_deref() == Some(name)).then(|| folder.join(name))
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
    use crate::script::NOTICES_A_DAY;

    fn line(text: String) -> LogLine {
        LogLine {
            level: Level::Info,
            text,
            fields: Vec::new(),
            line: None,
        }
    }

    fn passed<T>(admission: &Admission<T>) -> bool {
        matches!(admission, Admission::Passed(_))
    }

    fn written(limiter: &mut HostLimiter, now: Instant) -> bool {
        passed(&limiter.admit_line(line("x".into()), now))
    }

    #[test]
    fn a_flood_is_limited_per_second_and_reported_once_a_minute() {
        let mut limiter = limiter(1 << 30);
        let mut now = Instant::now();
        let passed = std::iter::repeat_with(|| written(&mut limiter, now))
            .take(10_000)
            .filter(|written| *written)
            .count();
        assert_eq!(passed, MAX_LINES as usize);
        now += WINDOW;
        assert!(written(&mut limiter, now));
        now += REPORT_INTERVAL;
        let flood = (0..200).map(|_| limiter.admit_line(line("x".into()), now));
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
        let mut poor = limiter(24 * 1000);
        let mut now = Instant::now();
        let mut passed = 0;
        for _ in 0..3600 {
            now += WINDOW;
            passed += usize::from(written(&mut poor, now));
        }
        assert!((12..=25).contains(&passed), "{passed}");
        let mut limiter = limiter(1 << 30);
        let long = LogLine {
            fields: vec![("k".repeat(9000), "v".repeat(9000)); 900],
            ..line("ä".repeat(100_000))
        };
        let Admission::Passed(cut) = limiter.admit_line(long, now) else {
            panic!("dropped");
        };
        assert_eq!(cut.text.chars().count(), LONGEST);
        assert_eq!(
            (cut.fields.len(), cut.fields[0].1.len()),
            (MAX_FIELDS, LONGEST)
        );
    }

    /// A limiter of which the log has this many bytes a day.
    fn limiter(log_bytes_a_day: u64) -> HostLimiter {
        let limits = Limits {
            bytes_a_day: 4 * log_bytes_a_day,
            ..Limits::default()
        };
        HostLimiter::new("one".to_owned(), Some("data/one".into()), &limits)
    }

    fn picture(name: &str) -> HostReport {
        let name = name.to_owned();
        HostReport::Picture { name }
    }

    fn entry(kind: &str, json: &str) -> HostReport {
        let kind = kind.to_owned();
        let json = json.to_owned();
        HostReport::Entry { kind, json }
    }

    fn notice(picture: Option<&str>) -> HostReport {
        let text = "hello".to_owned();
        let picture = picture.map(str::to_owned);
        HostReport::Notify { text, picture }
    }

    #[test]
    fn a_compromised_host_cannot_name_files_of_others() {
        let now = Instant::now();
        let mut limiter = limiter(16 * 24 * 1000);
        for name in [
            "../two/1.jpg",
            "/etc/passwd",
            "a/b.jpg",
            "",
            ".x.jpg",
            "passwd",
        ] {
            assert!(!passed(&limiter.admit_report(picture(name), now)), "{name}");
            assert!(
                !passed(&limiter.admit_report(notice(Some(name)), now)),
                "{name}"
            );
        }
        let Admission::Passed(AgentEvent::Picture { path, .. }) =
            limiter.admit_report(picture("1.jpg"), now)
        else {
            panic!("dropped");
        };
        assert_eq!(path, PathBuf::from("data/one/1.jpg"));
    }

    #[test]
    fn entries_that_are_too_long_or_not_objects_are_dropped() {
        let now = Instant::now();
        let long = format!("{{\"a\":\"{}\"}}", "x".repeat(MAX_ENTRY));
        for json in ["", "1", "[1]", "{\"a\":", long.as_str()] {
            let admission = limiter(16 * 24 * 1000).admit_report(entry("moved", json), now);
            assert!(matches!(admission, Admission::Dropped(0)), "{admission:?}");
        }
        let kind = "k".repeat(MAX_KIND + 1);
        assert!(!passed(
            &limiter(16 * 24 * 1000).admit_report(entry(&kind, "{}"), now)
        ));
    }

    #[test]
    fn a_flood_is_limited_to_the_daily_budget_and_reported_once_a_minute() {
        let mut limiter = limiter(16 * 24 * 1000);
        let now = Instant::now();
        let admissions: Vec<_> = (0..1000)
            .map(|_| limiter.admit_report(notice(None), now))
            .collect();
        let count = admissions.iter().filter(|one| passed(one)).count();
        assert_eq!(count as u64, NOTICES_A_DAY / 24);
        let reported = admissions
            .iter()
            .filter(|admission| matches!(admission, Admission::Dropped(_)));
        assert_eq!(reported.count(), 1);
        let entries = (0..1000).map(|_| limiter.admit_report(entry("moved", "{}"), now));
        assert!(entries.filter(passed).count() < 10);
    }
}
