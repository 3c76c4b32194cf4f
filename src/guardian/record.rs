//! What the guardian tells people: it has no terminal, so it appends lines to a small file in the
//! data folder, which `spykee status` and the next run read.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use jiff::{SignedDuration, Timestamp};
use rustix::fs::{FileType, Mode, OFlags, fstat, open};

use crate::files;

const NAME: &str = "guardian.log";
/// A longer file begins anew.
const MAX_LEN: u64 = 64 * 1024;
/// An older line is no news.
const NEWS: SignedDuration = SignedDuration::from_hours(24);
/// Lines that say that a stop was delivered.
const PAID: &str = "the robot has ";

#[derive(Debug)]
pub(super) struct Record {
    /// `None`: there is no data folder.
    path: Option<PathBuf>,
}

impl Record {
    pub(super) fn new(path: Option<PathBuf>) -> Record {
        Record { path }
    }

    /// Appends a line with the time. Errors cannot be reported to anybody.
    pub(super) fn append(&self, text: &str) {
        let Some(path) = &self.path else {
            return;
        };
        let flags = OFlags::WRONLY
            | OFlags::CREATE
            | OFlags::APPEND
            | OFlags::NOFOLLOW
            | OFlags::NONBLOCK
            | OFlags::CLOEXEC;
        let Ok(file) = open(path, flags, Mode::from_raw_mode(0o600)) else {
            return;
        };
        let is_file = fstat(&file)
            .is_ok_and(|stat| FileType::from_raw_mode(stat.st_mode) == FileType::RegularFile);
        if !is_file {
            return;
        }
        let mut file = std::fs::File::from(file);
        let now = Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ");
        let line = format!("{now} {text}\n");
        let len = file.metadata().map_or(0, |metadata| metadata.len());
        if len + line.len() as u64 > MAX_LEN {
            let _ = file.set_len(0);
        }
        let _ = file.write_all(line.as_bytes());
    }
}

/// The path of the guardian's file in this data folder.
pub fn record_path(data: &Path) -> PathBuf {
    data.join(NAME)
}

/// The last line of the guardian's file in this data folder, if it is news and says that a stop is
/// still owed.
pub fn unpaid_stop(data: &Path, now: Timestamp) -> Option<String> {
    let bytes = files::read_beginning_unlinked(&record_path(data), MAX_LEN).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let line = text.lines().last()?;
    let (time, said) = line.split_once(' ')?;
    let at: Timestamp = time.parse().ok()?;
    let age = now.duration_since(at);
    let is_news = SignedDuration::ZERO <= age && age < NEWS;
    if is_news && !said.starts_with(PAID) {
        Some(crate::sanitize::line(line))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DIALS: &str = "the agent is gone and the robot may be driving: dialling 10.0.0.1:9000";

    fn last(folder: &Path) -> Option<String> {
        unpaid_stop(folder, Timestamp::now())
    }

    #[test]
    fn the_last_line_is_news_for_a_day_unless_the_stop_was_delivered() {
        let home = tempfile::tempdir().unwrap();
        assert_eq!(last(home.path()), None);
        let record = Record::new(Some(record_path(home.path())));
        record.append(DIALS);
        assert!(last(home.path()).unwrap().ends_with(DIALS));
        let tomorrow = Timestamp::now() + SignedDuration::from_hours(25);
        assert_eq!(unpaid_stop(home.path(), tomorrow), None);
        record.append("the robot has executed the stop after 12.3 s");
        assert_eq!(last(home.path()), None);
        record.append("gave up after 10 min");
        assert!(last(home.path()).unwrap().contains("gave up"));
    }

    #[test]
    fn the_file_is_bounded_and_only_a_file() {
        let home = tempfile::tempdir().unwrap();
        let path = record_path(home.path());
        let record = Record::new(Some(path.clone()));
        for _ in 0..2000 {
            record.append(DIALS);
        }
        assert!(path.metadata().unwrap().len() <= MAX_LEN);
        std::fs::remove_file(&path).unwrap();
        let other = home.path().join("other");
        std::fs::write(&other, "").unwrap();
        std::os::unix::fs::symlink(&other, &path).unwrap();
        record.append(DIALS);
        assert_eq!(std::fs::read(&other).unwrap(), b"");
        Record::new(None).append(DIALS);
        Record::new(Some(home.path().join("no/such"))).append(DIALS);
    }
}
