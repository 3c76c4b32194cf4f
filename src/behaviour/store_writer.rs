//! Reads and writes the file of a script's store. A separate thread writes it, so that neither the
//! script nor a frame waits for the disk: atomically, by renaming a synced temporary file, and
//! again after a failure, unless there is newer content. A damaged file is kept as `.bad`.

use std::io;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use bytes::Bytes;
use tokio::time::Instant;

use crate::files::{Folder, Item};
use crate::rate_limit::TokenBucket;
use crate::script::Limits;

const NAME: &str = "store.json";
/// The name given to a damaged file.
const BAD: &str = "store.json.bad";
/// Maximum length of a file that is read: twice the maximum that is ever written.
const LONGEST: u64 = 2 << 20;
/// Interval between writes: including the write itself, the file is at most 1 s old.
const PACE: Duration = Duration::from_millis(900);
/// Interval between writes when the daily budget is used up.
const SLOW_PACE: Duration = Duration::from_secs(60);

/// Whether this is a store's file, or one that is unfinished or damaged.
pub(super) fn is_store(item: &Item) -> bool {
    let names = [NAME, BAD, ".unfinished-store.json"];
    names.contains(&item.name.as_str()) && item.bytes <= LONGEST
}

#[derive(Debug)]
pub(super) struct StoreWriter {
    folder: PathBuf,
    writing: Option<Writing>,
    start: fn(PathBuf, Bytes, u64) -> io::Result<Writing>,
    /// The last problem, until [`StoreWriter::take_error`] takes it.
    error: Option<String>,
    next: Option<Instant>,
    /// Content that is not being written yet, or could not be written.
    unsent: Option<Bytes>,
    last_error: Option<String>,
    /// Writes only at the end: see [`StoreWriter::new`].
    write_at_end: bool,
    day: TokenBucket,
    free: u64,
    /// `Some` if the daily budget was exceeded: whether that was reported.
    slow: Option<bool>,
}

/// A thread that writes one content, and returns it if that fails.
type Writing = JoinHandle<Result<(), (Bytes, io::Error)>>;

impl StoreWriter {
    /// `write_at_end`: for virtual time, in which a disk write would take a long and varying time, the
    /// file is written once, when the script ends or is ended.
    pub(super) fn new(folder: PathBuf, limits: &Limits, write_at_end: bool) -> StoreWriter {
        StoreWriter {
            folder,
            writing: None,
            start: start_writing,
            error: None,
            next: None,
            unsent: None,
            last_error: None,
            write_at_end,
            day: TokenBucket::a_day(limits.bytes_a_day),
            free: limits.free_bytes,
            slow: None,
        }
    }

    /// Returns the content that an earlier run saved; `None` if there is none.
    pub(super) fn read(&self) -> io::Result<Option<Vec<u8>>> {
        match Folder::open(&self.folder) {
            Ok(folder) => Ok(folder.read(NAME, LONGEST)?),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Renames a damaged file and returns a warning for the user.
    pub(super) fn set_aside(&self, why: &str) -> String {
        let file = self.folder.join(NAME);
        let renamed = Folder::open(&self.folder).and_then(|folder| folder.rename(NAME, BAD));
        let kept = match renamed {
            Ok(()) => format!("kept aside as {BAD}"),
            Err(error) => format!("it cannot be renamed either: {error}"),
        };
        let file = file.display();
        format!(
            "the store {file} is damaged ({why}): {kept}; the script begins with an empty store"
        )
    }

    /// Earliest time at which [`StoreWriter::offer`] may be called again; `None`: at any time.
    pub(super) fn next(&self) -> Option<Instant> {
        self.next
    }

    pub(super) fn is_behind(&self) -> bool {
        self.unsent.is_some() && !self.write_at_end
    }

    pub(super) fn is_due(&self, now: Instant) -> bool {
        self.next.is_none_or(|next| now >= next)
    }

    /// Begins to write the newest content, unless a write is in progress. Never waits.
    pub(super) fn offer(&mut self, newest: Option<Vec<u8>>, now: Instant) {
        self.collect_result();
        let retried = newest.is_none();
        let unsent = self.unsent.take();
        let Some(content) = newest.map(Bytes::from).or(unsent) else {
            return;
        };
        self.next = Some(now + PACE);
        self.unsent = Some(content.clone());
        if self.write_at_end {
            return;
        }
        // What could not be written has not used the day's bytes again.
        if !retried && !self.day.take(content.len() as f64, now) {
            self.next = Some(now + SLOW_PACE);
            self.slow.get_or_insert(false);
        }
        if self.writing.is_some() {
            return;
        }
        match (self.start)(self.folder.clone(), content, self.free) {
            Ok(writing) => {
                self.writing = Some(writing);
                self.unsent = None;
            }
            Err(error) => {
                let error = format!("the thread that writes it cannot be started: {error}");
                self.error = Some(error);
            }
        }
    }

    fn collect_result(&mut self) {
        if self.writing.as_ref().is_some_and(JoinHandle::is_finished) {
            self.await_result();
        }
    }

    /// Keeps content that could not be written, unless there is newer content.
    fn await_result(&mut self) {
        if let Some(writing) = self.writing.take()
            && let Ok(Err((content, error))) = writing.join()
        {
            self.error = Some(error.to_string());
            self.unsent.get_or_insert(content);
        }
    }

    /// Returns a problem to report, such as a failed write; not the same one twice in a row.
    pub(super) fn take_error(&mut self) -> Option<String> {
        if self.slow == Some(false) {
            self.slow = Some(true);
            return Some(format!(
                "the limit of {} bytes per day is used up: from now on the store is saved once per minute",
                self.day.per_day()
            ));
        }
        self.collect_result();
        let error = self.error.take()?;
        if self.last_error.as_ref() == Some(&error) {
            return None;
        }
        self.last_error = Some(error.clone());
        Some(error)
    }

    /// Waits for the thread, then writes the remaining content. Returns why that failed.
    pub(super) fn finish(&mut self, last: Option<Vec<u8>>) -> Option<String> {
        self.await_result();
        let unsent = self.unsent.take();
        let content = last.map(Bytes::from).or(unsent)?;
        let written = replace(&self.folder, &content, self.free);
        written.err().map(|error| error.to_string())
    }
}

/// Also writes the content if the host is ended by force in virtual time, as a host in its own
/// process would have done.
impl Drop for StoreWriter {
    fn drop(&mut self) {
        if let Some(content) = self.unsent.take()
            && self.write_at_end
        {
            let _ = replace(&self.folder, &content, self.free);
        }
    }
}

fn start_writing(folder: PathBuf, content: Bytes, free: u64) -> io::Result<Writing> {
    let thread = std::thread::Builder::new().name("store".into());
    thread.spawn(move || replace(&folder, &content, free).map_err(|error| (content, error)))
}

/// Afterwards the file holds either all of the new content or all of the old.
fn replace(folder: &Path, content: &[u8], free: u64) -> io::Result<()> {
    let folder = Folder::make(folder)?;
    if folder.free()? < free.saturating_add(content.len() as u64) {
        let words = format!("the disk has less than {free} bytes left");
        return Err(io::Error::other(words));
    }
    folder.sweep()?;
    folder.replace_durably(NAME, content)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    #[test]
    fn the_last_content_is_written_at_the_end_and_is_private() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("data");
        let mut writer = StoreWriter::new(folder.clone(), &Limits::default(), false);
        assert!(writer.read().unwrap().is_none());
        let now = Instant::now();
        for number in 0..20 {
            writer.offer(Some(format!("{number}").into_bytes()), now);
        }
        assert!(!writer.is_due(now) && writer.is_due(now + PACE));
        assert_eq!(writer.finish(None), None);
        assert_eq!(writer.read().unwrap().unwrap(), b"19");
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!((mode(&folder), mode(&folder.join(NAME))), (0o700, 0o600));
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
    }

    #[test]
    fn in_virtual_time_it_is_written_once_however_the_host_ends() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join(NAME);
        let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default(), true);
        writer.offer(Some(b"one".to_vec()), Instant::now());
        writer.offer(Some(b"two".to_vec()), Instant::now());
        assert!(!file.exists() && !writer.is_behind());
        drop(writer);
        assert_eq!(fs::read(&file).unwrap(), b"two");
        let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default(), true);
        writer.offer(Some(b"three".to_vec()), Instant::now());
        assert_eq!(writer.finish(None), None);
        assert_eq!(fs::read(&file).unwrap(), b"three");
        let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default(), true);
        writer.offer(Some(b"four".to_vec()), Instant::now());
        assert_eq!(writer.finish(Some(b"five".to_vec())), None);
        drop(writer);
        assert_eq!(fs::read(&file).unwrap(), b"five");
    }

    #[test]
    fn leftover_temporary_files_are_removed() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join(".unfinished-7.jpg"), "JP").unwrap();
        fs::write(root.path().join(NAME), "{}").unwrap();
        let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default(), false);
        assert_eq!(writer.read().unwrap().unwrap(), b"{}");
        assert_eq!(writer.finish(Some(b"new".to_vec())), None);
        assert_eq!(writer.read().unwrap().unwrap(), b"new");
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_damaged_file_is_kept_aside() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join(NAME), "{ torn").unwrap();
        let warning =
            StoreWriter::new(root.path().to_owned(), &Limits::default(), false).set_aside("torn");
        assert!(
            warning.contains("store.json.bad") && warning.contains("torn"),
            "{warning}"
        );
        assert_eq!(fs::read(root.path().join(BAD)).unwrap(), b"{ torn");
        assert!(!root.path().join(NAME).exists());
    }

    #[test]
    fn a_symbolic_link_as_folder_or_file_is_not_followed() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        fs::create_dir(path("elsewhere")).unwrap();
        fs::write(path("elsewhere/store.json"), "{}").unwrap();
        symlink(path("elsewhere"), path("data")).unwrap();
        let mut writer = StoreWriter::new(path("data"), &Limits::default(), false);
        assert!(writer.read().is_err());
        assert!(
            writer
                .finish(Some(b"1".to_vec()))
                .unwrap()
                .contains("symbolic link")
        );
        assert_eq!(fs::read(path("elsewhere/store.json")).unwrap(), b"{}");
        fs::create_dir(path("own")).unwrap();
        symlink(path("elsewhere/store.json"), path("own/store.json")).unwrap();
        let mut writer = StoreWriter::new(path("own"), &Limits::default(), false);
        assert!(writer.read().is_err());
        assert_eq!(writer.finish(Some(b"1".to_vec())), None);
        assert_eq!(fs::read(path("elsewhere/store.json")).unwrap(), b"{}");
        assert_eq!(fs::read(path("own/store.json")).unwrap(), b"1");
    }

    #[test]
    fn a_store_over_its_daily_budget_is_written_once_a_minute() {
        let root = tempfile::tempdir().unwrap();
        let limits = Limits {
            bytes_a_day: 48,
            ..Limits::default()
        };
        let mut writer = StoreWriter::new(root.path().to_owned(), &limits, false);
        let now = Instant::now();
        writer.offer(Some(b"12".to_vec()), now);
        assert!(writer.is_due(now + PACE) && writer.take_error().is_none());
        writer.offer(Some(b"34".to_vec()), now + PACE);
        assert!(!writer.is_due(now + PACE + PACE) && writer.is_due(now + PACE + SLOW_PACE));
        assert!(writer.take_error().unwrap().contains("once per minute"));
        assert!(writer.take_error().is_none());
        assert_eq!(writer.finish(Some(b"56".to_vec())), None);
        assert_eq!(writer.read().unwrap().unwrap(), b"56");
    }

    #[test]
    fn nothing_is_written_to_a_full_disk() {
        let root = tempfile::tempdir().unwrap();
        let limits = Limits {
            free_bytes: 1 << 50,
            ..Limits::default()
        };
        let mut writer = StoreWriter::new(root.path().to_owned(), &limits, false);
        let warning = writer.finish(Some(b"1".to_vec())).unwrap();
        assert!(warning.contains("disk"), "{warning}");
        assert!(!root.path().join(NAME).exists());
    }

    #[test]
    fn a_thread_that_cannot_be_started_is_reported_and_tried_again() {
        let root = tempfile::tempdir().unwrap();
        let mut writer = StoreWriter::new(root.path().to_owned(), &Limits::default(), false);
        writer.start = |_, _, _| Err(io::Error::other("no more threads"));
        let now = Instant::now();
        writer.offer(Some(b"1".to_vec()), now);
        let trouble = writer.take_error().unwrap();
        assert!(trouble.contains("no more threads"), "{trouble}");
        writer.offer(None, now + PACE);
        assert_eq!((writer.is_behind(), writer.take_error()), (true, None));
        writer.start = start_writing;
        assert_eq!(writer.finish(None), None);
        assert_eq!(writer.read().unwrap().unwrap(), b"1");
        writer.start = |_, _, _| Err(io::Error::other("no more threads"));
        assert_eq!(writer.finish(Some(b"2".to_vec())), None);
        assert_eq!(writer.read().unwrap().unwrap(), b"2");
    }

    /// A writer whose writes fail as long as the returned folder exists.
    fn obstructed(root: &Path) -> (StoreWriter, PathBuf) {
        let obstacle = root.join(".unfinished-store.json");
        fs::create_dir(&obstacle).unwrap();
        let writer = StoreWriter::new(root.to_owned(), &Limits::default(), false);
        (writer, obstacle)
    }

    fn wait_until(mut done: impl FnMut() -> bool) {
        for _ in 0..6000 {
            if done() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        panic!("it did not happen within a minute");
    }

    #[test]
    fn content_whose_write_failed_is_written_as_soon_as_that_is_possible() {
        let root = tempfile::tempdir().unwrap();
        let (mut writer, obstacle) = obstructed(root.path());
        let now = Instant::now();
        writer.offer(Some(b"1".to_vec()), now);
        wait_until(|| writer.take_error().is_some());
        assert!(writer.is_behind());
        fs::remove_dir(obstacle).unwrap();
        writer.offer(None, now + PACE);
        assert!(!writer.is_behind());
        wait_until(|| writer.read().unwrap().is_some());
        assert_eq!(writer.read().unwrap().unwrap(), b"1");
        assert_eq!((writer.take_error(), writer.finish(None)), (None, None));
    }

    #[test]
    fn content_whose_write_failed_is_written_at_the_end_unless_there_is_newer_content() {
        for offered in [&[b"1"][..], &[b"1", b"2"]] {
            let root = tempfile::tempdir().unwrap();
            let (mut writer, obstacle) = obstructed(root.path());
            let now = Instant::now();
            for content in offered {
                writer.offer(Some(content.to_vec()), now);
            }
            wait_until(|| writer.take_error().is_some());
            fs::remove_dir(obstacle).unwrap();
            assert_eq!(writer.finish(None), None);
            assert_eq!(writer.read().unwrap().unwrap(), offered[offered.len() - 1]);
        }
    }

    #[test]
    fn a_folder_that_cannot_be_written_is_reported() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        fs::write(&file, "").unwrap();
        let mut writer = StoreWriter::new(file.join("data"), &Limits::default(), false);
        assert!(writer.finish(Some(b"1".to_vec())).is_some());
    }
}
