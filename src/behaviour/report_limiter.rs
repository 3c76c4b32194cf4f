//! Limits which of a host's reports reach the bus: a daily budget, short texts, and only files in
//! its own data folder. An honest host limits itself; this also holds for a compromised one.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use crate::rate_limit::{Budget, Repeats};
use crate::robot::{AgentEvent, HostReport};
use crate::sanitize;
use crate::script::{self, Limits, MAX_ENTRY, MAX_KIND, MAX_NOTICE, NOTICES_A_DAY};

/// Minimum interval between two warnings about dropped reports.
const REPORT_INTERVAL: Duration = Duration::from_secs(60);
/// Bytes counted for each entry besides its text.
const OVERHEAD: usize = 100;

#[derive(Debug)]
pub(super) struct ReportLimiter {
    behaviour: String,
    folder: Option<PathBuf>,
    bytes: Budget,
    notices: Budget,
    reports: Repeats<()>,
}

#[derive(Debug, PartialEq)]
pub(super) enum Admission {
    Passed(AgentEvent),
    /// Dropped, to be reported with the number of reports dropped since the last one.
    Dropped(u64),
    /// It is dropped; a recent report already said so.
    DroppedSilently,
}

impl ReportLimiter {
    /// Creates the limiter of a behaviour whose pictures are in this folder.
    pub(super) fn new(
        behaviour: String,
        folder: Option<PathBuf>,
        limits: &Limits,
    ) -> ReportLimiter {
        ReportLimiter {
            behaviour,
            folder,
            bytes: Budget::new(limits.journal_bytes_a_day()),
            notices: Budget::new(NOTICES_A_DAY),
            reports: Repeats::new(REPORT_INTERVAL),
        }
    }

    pub(super) fn admit(&mut self, report: HostReport, now: Instant) -> Admission {
        match self.event(report, now) {
            Some(what) => Admission::Passed(what),
            None => self
                .reports
                .record((), now)
                .map_or(Admission::DroppedSilently, Admission::Dropped),
        }
    }

    /// Converts a report. `None` if no honest host would send it, or if today's budget is used up.
    fn event(&mut self, report: HostReport, now: Instant) -> Option<AgentEvent> {
        let behaviour = self.behaviour.clone();
        match report {
            HostReport::Picture { name } => {
                let path = self.file(&name)?;
                if !self.bytes.take((OVERHEAD + name.len()) as u64, now) {
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
                if !self.bytes.take((OVERHEAD + length) as u64, now) {
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
                if text.len() > MAX_NOTICE || !self.notices.take(1, now) {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn limiter() -> ReportLimiter {
        let limits = Limits {
            bytes_a_day: 64 * 24 * 1000,
            ..Limits::default()
        };
        ReportLimiter::new("one".to_owned(), Some("data/one".into()), &limits)
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
        let mut limiter = limiter();
        let passed = |admission| matches!(admission, Admission::Passed(_));
        for name in [
            "../two/1.jpg",
            "/etc/passwd",
            "a/b.jpg",
            "",
            ".x.jpg",
            "passwd",
        ] {
            assert!(!passed(limiter.admit(picture(name), now)), "{name}");
            assert!(!passed(limiter.admit(notice(Some(name)), now)), "{name}");
        }
        let Admission::Passed(AgentEvent::Picture { path, .. }) =
            limiter.admit(picture("1.jpg"), now)
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
            let admission = limiter().admit(entry("moved", json), now);
            assert!(matches!(admission, Admission::Dropped(0)), "{admission:?}");
        }
        let kind = "k".repeat(MAX_KIND + 1);
        assert!(matches!(
            limiter().admit(entry(&kind, "{}"), now),
            Admission::Dropped(_)
        ));
    }

    #[test]
    fn a_flood_is_limited_to_the_daily_budget_and_reported_once_a_minute() {
        let mut limiter = limiter();
        let now = Instant::now();
        let admissions: Vec<_> = (0..1000)
            .map(|_| limiter.admit(notice(None), now))
            .collect();
        let passed = admissions
            .iter()
            .filter(|admission| matches!(admission, Admission::Passed(_)));
        assert_eq!(passed.count() as u64, NOTICES_A_DAY / 24);
        let reported = admissions
            .iter()
            .filter(|admission| matches!(admission, Admission::Dropped(_)));
        assert_eq!(reported.count(), 1);
        let entries = (0..1000).map(|_| limiter.admit(entry("moved", "{}"), now));
        assert!(
            entries
                .filter(|admission| matches!(admission, Admission::Passed(_)))
                .count()
                < 10
        );
    }
}
