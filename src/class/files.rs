//! The learners' files: `FOLDER/ada/03-moving.lua`, written as a whole, with the newest fifty older
//! versions in `FOLDER/ada/.old`. A version is the digest of its text, so a change by another program
//! is noticed too. Blocks on the disk.

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use data_encoding::HEXLOWER;
use jiff::Timestamp;
use parking_lot::Mutex;
use serde::Serialize;
use sha2::{Digest as _, Sha256};
use tokio::time::Instant;

use super::members::{Record, TEACHER};
use crate::files::{Folder, ReadError};

/// The folder of the class itself: hidden, so that nothing takes it for a learner's.
const OWN: &str = ".class";
/// The folder of older versions, in a learner's folder.
const OLD: &str = ".old";
const RECORDS: &str = "class.json";
/// Maximum length of a script, in bytes, and of the records.
pub(super) const MAX_TEXT: usize = 256 << 10;
const MAX_RECORDS: u64 = 4 << 20;
/// Number of older versions of a file that are kept.
const KEPT: usize = 50;
/// While a learner types, a version is kept this often; each run and check keeps one too.
const KEEP_EVERY: Duration = Duration::from_secs(60);
/// Digits of a version.
const VERSION: usize = 16;

/// A text and its version; the version of a file that does not exist is empty.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Text {
    pub(super) text: String,
    pub(super) version: String,
}

/// How a write has ended.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Written {
    /// The new version.
    Done(String),
    /// Something else is there, which the writer did not know.
    Conflict(Text),
}

#[derive(Debug)]
pub(super) struct Files {
    folder: PathBuf,
    /// When a version of a file was last kept. Also the lock of all writes.
    kept: Mutex<HashMap<PathBuf, Instant>>,
}

impl Files {
    /// Opens the folder of the class; creates it if it does not exist.
    pub(super) fn open(folder: &Path) -> io::Result<Files> {
        let folder = std::path::absolute(folder)?;
        let files = Files {
            kept: Mutex::default(),
            folder,
        };
        Folder::make(&files.own())?;
        Ok(files)
    }

    /// The folder for what belongs to no learner.
    pub(super) fn own(&self) -> PathBuf {
        Files::own_of(&self.folder)
    }

    pub(super) fn own_of(folder: &Path) -> PathBuf {
        folder.join(OWN)
    }

    /// A learner's folder.
    pub(super) fn of(&self, name: &str) -> PathBuf {
        if name == TEACHER {
            self.own().join(TEACHER)
        } else {
            self.folder.join(name)
        }
    }

    /// Where a learner's scripts save.
    pub(super) fn data_of(&self, name: &str) -> PathBuf {
        self.own().join("data").join(name)
    }

    /// The names of the learners who have a folder.
    pub(super) fn learners(&self) -> io::Result<Vec<String>> {
        let mut names = Folder::open(&self.folder)?.names()?;
        names.retain(|name| !name.starts_with('.') && self.folder.join(name).is_dir());
        Ok(names.into_iter().collect())
    }

    /// Reads a file; `None` if there is none.
    pub(super) fn read(&self, name: &str, file: &str) -> io::Result<Option<Text>> {
        read(&Folder::make(&self.of(name))?, file)
    }

    /// Replaces a file whose version the writer knows. Otherwise the writer's text is kept beside it.
    pub(super) fn write(
        &self,
        name: &str,
        file: &str,
        text: &str,
        version: &str,
        now: Instant,
    ) -> io::Result<Written> {
        let path = self.of(name);
        let folder = Folder::make(&path)?;
        let mut kept = self.kept.lock();
        let old = read(&folder, file)?;
        let current = old.as_ref().map_or("", |old| &old.version);
        if current != version
            && let Some(newest) = old
        {
            keep(&folder, file, text)?;
            return Ok(Written::Conflict(newest));
        }
        if let Some(old) = old {
            let last = kept.entry(path.join(file)).or_insert(now);
            if now.duration_since(*last) >= KEEP_EVERY {
                *last = now;
                keep(&folder, file, &old.text)?;
            }
        }
        folder.replace(file, text.as_bytes())?;
        Ok(Written::Done(version_of(text)))
    }

    /// Keeps the present version of a file, which is run or checked. Returns its text.
    pub(super) fn keep(&self, name: &str, file: &str) -> io::Result<Option<String>> {
        let _lock = self.kept.lock();
        let folder = Folder::make(&self.of(name))?;
        let text = read(&folder, file)?.map(|one| one.text);
        if let Some(text) = &text {
            keep(&folder, file, text)?;
        }
        Ok(text)
    }

    pub(super) fn records(&self) -> io::Result<BTreeMap<String, Record>> {
        let read = Folder::open(&self.own())?.read(RECORDS, MAX_RECORDS);
        match read.map_err(error_of)? {
            Some(bytes) => Ok(serde_json::from_slice(&bytes)?),
            None => Ok(BTreeMap::new()),
        }
    }

    pub(super) fn write_records(&self, records: &[u8]) -> io::Result<()> {
        let _lock = self.kept.lock();
        Folder::open(&self.own())?.replace_durably(RECORDS, records)
    }
}

fn read(folder: &Folder, file: &str) -> io::Result<Option<Text>> {
    let bytes = folder.read(file, MAX_TEXT as u64).map_err(error_of)?;
    Ok(bytes.map(|bytes| {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let version = version_of(&text);
        Text { text, version }
    }))
}

fn error_of(error: ReadError) -> io::Error {
    io::Error::other(error.to_string())
}

fn version_of(text: &str) -> String {
    let mut digits = HEXLOWER.encode(&Sha256::digest(text.as_bytes()));
    digits.truncate(VERSION);
    digits
}

/// Keeps a text as an older version of a file, unless the newest one is the same, and deletes the
/// oldest ones. Names sort by time.
fn keep(folder: &Folder, file: &str, text: &str) -> io::Result<()> {
    let old = match folder.folder(OLD) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            rustix::fs::mkdirat(folder, OLD, rustix::fs::Mode::RWXU)?;
            folder.folder(OLD)?
        }
        opened => opened?,
    };
    let (stem, ending) = file.split_once('.').unwrap_or((file, ""));
    let mut names = old.names()?;
    names.retain(|name| name.starts_with(&format!("{stem}.")) && name.ends_with(ending));
    let newest = names
        .last()
        .and_then(|name| read(&old, name).ok().flatten());
    if newest.is_some_and(|newest| newest.text == text) {
        return Ok(());
    }
    let time = Timestamp::now().strftime("%Y-%m-%d.%H%M%S%.3f");
    let name = format!("{stem}.{time}.{ending}");
    old.replace(&name, text.as_bytes())?;
    names.insert(name);
    let surplus = names.len().saturating_sub(KEPT);
    for name in names.iter().take(surplus) {
        old.remove(name)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "03-moving.lua";

    fn write(files: &Files, text: &str, version: &str, now: Instant) -> Written {
        files.write("ada", FILE, text, version, now).unwrap()
    }

    fn old(files: &Files) -> Vec<String> {
        let folder = Folder::open(&files.of("ada").join(OLD)).unwrap();
        let items = folder.items().unwrap().into_iter();
        items
            .map(|item| read(&folder, &item.name).unwrap().unwrap().text)
            .collect()
    }

    #[test]
    fn a_text_is_replaced_only_by_who_knows_it_and_nothing_is_lost() {
        let outside = tempfile::tempdir().unwrap();
        let files = Files::open(&outside.path().join("class")).unwrap();
        let now = Instant::now();
        assert_eq!(files.read("ada", FILE).unwrap(), None);
        let Written::Done(first) = write(&files, "one", "", now) else {
            panic!()
        };
        let Written::Done(second) = write(&files, "two", &first, now) else {
            panic!()
        };
        for wrong in ["", "-1", "0", &first] {
            let Written::Conflict(newest) = write(&files, "mine", wrong, now) else {
                panic!()
            };
            assert_eq!(
                newest,
                Text {
                    text: "two".to_owned(),
                    version: second.clone()
                }
            );
        }
        assert_eq!(old(&files), ["mine"]);
        // The teacher's editor has written it meanwhile.
        std::fs::write(files.of("ada").join(FILE), "theirs").unwrap();
        assert!(matches!(
            write(&files, "three", &second, now),
            Written::Conflict(_)
        ));
    }

    #[test]
    fn the_newest_fifty_versions_are_kept() {
        let outside = tempfile::tempdir().unwrap();
        let files = Files::open(outside.path()).unwrap();
        let mut version = String::new();
        let now = Instant::now();
        for number in 0..60 {
            let text = number.to_string();
            let Written::Done(next) = write(&files, &text, &version, now) else {
                panic!()
            };
            version = next;
            assert_eq!(files.keep("ada", FILE).unwrap(), Some(text));
            std::thread::sleep(Duration::from_millis(2));
        }
        let kept = old(&files);
        assert_eq!(kept.len(), KEPT);
        assert_eq!(kept.last().unwrap(), "59");
        let later = now + KEEP_EVERY;
        write(&files, "typed", &version, later);
        assert_eq!(
            old(&files).last().unwrap(),
            "59",
            "the same text is kept once"
        );
    }

    #[test]
    fn links_are_not_followed() {
        let outside = tempfile::tempdir().unwrap();
        let files = Files::open(&outside.path().join("class")).unwrap();
        let secret = outside.path().join("secret");
        std::fs::write(&secret, "secret").unwrap();
        std::fs::create_dir(files.of("ada")).unwrap();
        std::os::unix::fs::symlink(&secret, files.of("ada").join(FILE)).unwrap();
        std::os::unix::fs::symlink(outside.path(), files.of("bo")).unwrap();
        assert!(files.read("ada", FILE).is_err());
        assert!(files.write("ada", FILE, "x", "", Instant::now()).is_err());
        assert!(files.read("bo", "secret").is_err());
        assert_eq!(std::fs::read_to_string(secret).unwrap(), "secret");
    }
}
