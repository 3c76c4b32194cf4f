//! Limits which of a host's remarks reach the bus: a daily budget, short texts, and only files in
//! its own data folder. An honest host limits its script's entries, messages and pictures itself;
//! this limit also holds for a compromised host.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use crate::budget::{Budget, Repeats};
use crate::clean;
use crate::robot::{Occurrence, Remark};
use crate::script::{self, Limits, MAX_ENTRY, MAX_KIND, MAX_NOTICE};

/// Minimum interval between two reports of dropped remarks.
const SAID_EVERY: Duration = Duration::from_secs(60);
/// Bytes counted for each entry besides its text.
const OVERHEAD: usize = 100;

/// See the module.
#[derive(Debug)]
pub(super) struct Remarks {
    behaviour: String,
    folder: Option<PathBuf>,
    bytes: Budget,
    notices: Budget,
    said: Repeats<()>,
}

/// The outcome for a remark.
#[derive(Debug, PartialEq)]
pub(super) enum Fate {
    /// It is passed on to the bus.
    Passed(Occurrence),
    /// It is dropped, and this must be reported, with the number of remarks dropped since the last
    /// report.
    LeftOut(u64),
    /// It is dropped; a recent report already said so.
    Silent,
}

impl Remarks {
    /// Creates the limiter of a behaviour whose pictures are in this folder.
    pub(super) fn new(behaviour: String, folder: Option<PathBuf>, limits: &Limits) -> Remarks {
        Remarks {
            behaviour,
            folder,
            bytes: Budget::new(limits.journal_bytes_a_day),
            notices: Budget::new(limits.notices_a_day),
            said: Repeats::new(SAID_EVERY),
        }
    }

    pub(super) fn admit(&mut self, remark: Remark, now: Instant) -> Fate {
        match self.occurrence(remark, now) {
            Some(what) => Fate::Passed(what),
            None => self.said.note((), now).map_or(Fate::Silent, Fate::LeftOut),
        }
    }

    /// Converts a remark. `None` if no honest host would send it, or if today's budget is used up.
    fn occurrence(&mut self, remark: Remark, now: Instant) -> Option<Occurrence> {
        let behaviour = self.behaviour.clone();
        match remark {
            Remark::Picture { name } => {
                let path = self.file(&name)?;
                let has_room = self.bytes.take((OVERHEAD + name.len()) as u64, now);
                has_room.then_some(Occurrence::Picture { behaviour, path })
            }
            Remark::Entry { kind, json } => {
                let length = kind.len() + json.len();
                if kind.len() > MAX_KIND || json.len() > MAX_ENTRY {
                    return None;
                }
                let data = serde_json::from_str(&json).ok().filter(Value::is_object)?;
                let has_room = self.bytes.take((OVERHEAD + length) as u64, now);
                let kind = clean::line(&kind);
                has_room.then_some(Occurrence::Entry {
                    behaviour,
                    kind,
                    data,
                })
            }
            Remark::Notify { text, picture } => {
                let picture = match picture {
                    Some(name) => Some(self.file(&name)?),
                    None => None,
                };
                let has_room = text.len() <= MAX_NOTICE && self.notices.take(1, now);
                let text = clean::text(&text, false);
                has_room.then_some(Occurrence::Notify {
                    behaviour,
                    text,
                    picture,
                })
            }
        }
    }

    /// Returns the path of a picture in the behaviour's own folder; `None` if `name` is not a valid
    /// picture name.
    fn file(&self, name: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        (script::picture_name(name).as_deref() == Some(name)).then(|| folder.join(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn remarks() -> Remarks {
        let limits = Limits {
            journal_bytes_a_day: 24 * 1000,
            notices_a_day: 48,
            ..Limits::default()
        };
        Remarks::new("one".to_owned(), Some("data/one".into()), &limits)
    }

    fn picture(name: &str) -> Remark {
        let name = name.to_owned();
        Remark::Picture { name }
    }

    fn entry(kind: &str, json: &str) -> Remark {
        let (kind, json) = (kind.to_owned(), json.to_owned());
        Remark::Entry { kind, json }
    }

    fn notice(picture: Option<&str>) -> Remark {
        let (text, picture) = ("hello".to_owned(), picture.map(str::to_owned));
        Remark::Notify { text, picture }
    }

    #[test]
    fn a_compromised_host_cannot_name_files_of_others() {
        let now = Instant::now();
        let mut remarks = remarks();
        let told = |fate| matches!(fate, Fate::Passed(_));
        for name in [
            "../two/1.jpg",
            "/etc/passwd",
            "a/b.jpg",
            "",
            ".x.jpg",
            "passwd",
        ] {
            assert!(!told(remarks.admit(picture(name), now)), "{name}");
            assert!(!told(remarks.admit(notice(Some(name)), now)), "{name}");
        }
        let Fate::Passed(Occurrence::Picture { path, .. }) = remarks.admit(picture("1.jpg"), now)
        else {
            panic!("left out");
        };
        assert_eq!(path, PathBuf::from("data/one/1.jpg"));
    }

    #[test]
    fn entries_that_are_too_long_or_not_objects_are_dropped() {
        let now = Instant::now();
        let long = format!("{{\"a\":\"{}\"}}", "x".repeat(MAX_ENTRY));
        for json in ["", "1", "[1]", "{\"a\":", long.as_str()] {
            let fate = remarks().admit(entry("moved", json), now);
            assert!(matches!(fate, Fate::LeftOut(0)), "{fate:?}");
        }
        let kind = "k".repeat(MAX_KIND + 1);
        assert!(matches!(
            remarks().admit(entry(&kind, "{}"), now),
            Fate::LeftOut(_)
        ));
    }

    #[test]
    fn a_flood_is_limited_to_the_daily_budget_and_reported_once_a_minute() {
        let (mut remarks, now) = (remarks(), Instant::now());
        let fates: Vec<_> = (0..1000)
            .map(|_| remarks.admit(notice(None), now))
            .collect();
        let told = fates.iter().filter(|fate| matches!(fate, Fate::Passed(_)));
        assert_eq!(told.count(), 2);
        let said = fates.iter().filter(|fate| matches!(fate, Fate::LeftOut(_)));
        assert_eq!(said.count(), 1);
        let entries = (0..1000).map(|_| remarks.admit(entry("moved", "{}"), now));
        assert!(
            entries
                .filter(|fate| matches!(fate, Fate::Passed(_)))
                .count()
                < 10
        );
    }
}
