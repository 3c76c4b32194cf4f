//! The queue of messages for a target, one file each, so that they survive a restart. Bounded: the
//! oldest are deleted to make room, and messages older than a day are not sent.

use std::io;
use std::path::Path;

use rustix::fs::{FlockOperation, flock};

use super::Notice;
use crate::files::{Folder, Item};

pub(super) const MAX_QUEUED: usize = 100;
/// Maximum age of a message, in milliseconds.
const LONGEST: i64 = 86_400_000;
const FOLDER: &str = ".notify";
/// Maximum length of a message as JSON, in bytes.
const MAX_LEN: u64 = 64 * 1024;

#[derive(Debug)]
pub(super) struct Queue {
    folder: Folder,
    /// The open folder on which this process takes its lock.
    lock: std::fs::File,
    holds: bool,
}

impl Queue {
    pub(super) fn open(data: &Path, target: &str) -> io::Result<Queue> {
        Folder::make(data)?;
        Folder::make(&data.join(FOLDER))?;
        let path = data.join(FOLDER).join(target);
        let folder = Folder::make(&path)?;
        let lock = std::fs::File::open(&path)?;
        Ok(Queue {
            folder,
            lock,
            holds: false,
        })
    }

    /// Adds a message. Returns how many old messages were deleted to make room.
    pub(super) fn add(&self, notice: &Notice) -> io::Result<usize> {
        let names = self.names()?;
        let last = names.last().and_then(|name| number(name)).unwrap_or(0);
        let gone = (names.len() + 1).saturating_sub(MAX_QUEUED);
        names.iter().take(gone).for_each(|name| self.remove(name));
        let text = serde_json::to_vec(notice).map_err(io::Error::other)?;
        let name = format!("{:016}.json", last + 1);
        self.folder.replace_durably(&name, &text)?;
        Ok(gone)
    }

    /// Takes the lock, or returns false if another process holds it: of several processes with the
    /// same data folder, only one sends.
    pub(super) fn is_ours(&mut self) -> bool {
        if !self.holds {
            let exclusive = FlockOperation::NonBlockingLockExclusive;
            self.holds = flock(&self.lock, exclusive).is_ok();
        }
        self.holds
    }

    /// The oldest message, and the name of its file, that is not too old at this time, in milliseconds
    /// since the epoch.
    pub(super) fn oldest(&self, now: i64) -> io::Result<Option<(String, Notice)>> {
        for name in self.names()? {
            let read = self.folder.read(&name, MAX_LEN);
            let notice = read
                .ok()
                .flatten()
                .and_then(|text| serde_json::from_slice(&text).ok());
            match notice {
                Some(notice) if is_fresh(&notice, now) => {
                    return Ok(Some((name, notice)));
                }
                // Too old, or not a valid message.
                _ => self.remove(&name),
            }
        }
        Ok(None)
    }

    pub(super) fn len(&self) -> usize {
        self.names().map_or(0, |names| names.len())
    }

    pub(super) fn remove(&self, name: &str) {
        if let Err(error) = self.folder.remove(name) {
            tracing::debug!("the file of a message cannot be removed: {error}");
        }
    }

    /// Oldest first.
    fn names(&self) -> io::Result<Vec<String>> {
        let items = self.folder.items()?.into_iter();
        let names = items.map(|Item { name, .. }| name);
        let mut names: Vec<String> = names.filter(|name| number(name).is_some()).collect();
        names.sort();
        Ok(names)
    }
}

/// Whether a message is less than a day old. One from the future, after a change of the clock,
/// counts as new.
fn is_fresh(notice: &Notice, now: i64) -> bool {
    now.saturating_sub(notice.at) < LONGEST
}

fn number(name: &str) -> Option<u64> {
    name.strip_suffix(".json")?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::notify::Rule;

    fn notice(text: &str, at: i64) -> Notice {
        Notice {
            rule: Rule::Low,
            text: text.to_owned(),
            robot: "Rover".to_owned(),
            at,
            time: String::new(),
            picture: None,
        }
    }

    #[test]
    fn the_oldest_is_sent_first_and_a_new_program_continues() {
        let data = tempfile::tempdir().unwrap();
        let queue = Queue::open(data.path(), "phone").unwrap();
        queue.add(&notice("one", 5)).unwrap();
        queue.add(&notice("two", 6)).unwrap();
        drop(queue);
        let queue = Queue::open(data.path(), "phone").unwrap();
        let (name, first) = queue.oldest(10).unwrap().unwrap();
        assert_eq!(first.text, "one");
        queue.remove(&name);
        queue.add(&notice("three", 7)).unwrap();
        assert_eq!(queue.oldest(10).unwrap().unwrap().1.text, "two");
        assert_eq!(queue.len(), 2);
    }

    #[test]
    fn it_is_bounded_and_old_or_invalid_messages_are_deleted() {
        let data = tempfile::tempdir().unwrap();
        let queue = Queue::open(data.path(), "phone").unwrap();
        let gone: usize = (0..MAX_QUEUED as i64 + 7)
            .map(|at| queue.add(&notice("x", at)).unwrap())
            .sum();
        assert_eq!((gone, queue.len()), (7, MAX_QUEUED));
        assert!(queue.oldest(LONGEST * 2).unwrap().is_none());
        assert_eq!(queue.len(), 0);
        queue
            .folder
            .replace("0000000000000001.json", b"garbage")
            .unwrap();
        assert!(queue.oldest(0).unwrap().is_none());
        assert_eq!(queue.len(), 0);
    }

    #[test]
    fn only_one_of_two_programs_sends() {
        let data = tempfile::tempdir().unwrap();
        let mut one = Queue::open(data.path(), "phone").unwrap();
        let mut two = Queue::open(data.path(), "phone").unwrap();
        assert!(one.is_ours() && !two.is_ours() && one.is_ours());
        drop(one);
        assert!(two.is_ours());
    }
}
