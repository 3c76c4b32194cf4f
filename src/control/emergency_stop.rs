//! A person's STOP, and the file in the data folder that keeps it for the next program: whatever
//! ends this one, STOP holds until a person releases it. A separate thread writes the file; a slow
//! or full disk delays nothing, and STOP holds in this program all the same.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use tokio::sync::{mpsc, watch};
use tracing::warn;

use crate::files::Folder;
use crate::robot::channel::Request;

/// Name of the file. Its presence is the STOP; the text is for people.
const NAME: &str = ".stop";
const TEXT: &[u8] =
    b"A person has stopped the robot. To release it, use the page or `spykee robot reset-stop`.\n";
/// Time until a failed write is retried.
const AGAIN: Duration = Duration::from_secs(10);
/// How often to check at the end whether the file is written.
const RECHECK: Duration = Duration::from_millis(10);

/// A default one has no file, for simulations.
#[derive(Debug, Clone, Default)]
pub struct EmergencyStop {
    on: watch::Sender<bool>,
    /// The thread that writes the file.
    writer: Option<Writer>,
}

#[derive(Debug, Clone)]
struct Writer {
    /// Wakes it.
    changes: SyncSender<()>,
    /// Whether the file is there; unknown after an error.
    kept: watch::Receiver<Option<bool>>,
}

impl EmergencyStop {
    /// Reads the file in this data folder, and starts the thread that writes it. Blocks on the
    /// disk: must not be called on the driving core.
    pub fn open(data: &Path) -> EmergencyStop {
        let kept = EmergencyStop::is_kept(data);
        if kept {
            let path = data.join(NAME);
            warn!(
                "a person's STOP still holds ({}): nothing moves the robot until a person releases \
                 it, at the page or with `spykee robot reset-stop`",
                path.display()
            );
        }
        let on = watch::Sender::new(kept);
        let (changes, received) = sync_channel(1);
        let file = StopFile::new(data, &on, kept);
        let writer = Writer {
            changes,
            kept: file.kept.subscribe(),
        };
        let writing = std::thread::Builder::new().name("stop".into());
        let started = writing.spawn(move || file.follow(&received));
        if let Err(error) = &started {
            warn!("STOP will hold in this program only: cannot start its thread: {error}");
        }
        EmergencyStop {
            on,
            writer: started.is_ok().then_some(writer),
        }
    }

    /// Whether a program of this data folder has left a STOP behind that nobody has released. A
    /// file that cannot be examined counts as one.
    pub fn is_kept(data: &Path) -> bool {
        match data.join(NAME).symlink_metadata() {
            Ok(_) => true,
            Err(error) if is_absent(&error) => false,
            Err(error) => {
                let path = data.join(NAME);
                warn!("counts as STOP, cannot examine {}: {error}", path.display());
                true
            }
        }
    }

    /// Releases the STOP that a program of this data folder has left behind; returns whether there
    /// was one.
    ///
    /// # Errors
    /// Any error of the system; the STOP then still holds.
    pub fn remove(data: &Path) -> io::Result<bool> {
        match std::fs::remove_file(data.join(NAME)) {
            Ok(()) => Ok(true),
            Err(error) if is_absent(&error) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Gives a STOP that was left behind to the pilot. Call it for a pilot that is not launched
    /// yet: its queue is empty.
    pub fn restore(&self, requests: &mpsc::Sender<Request>) {
        if self.is_on() {
            let _ = requests.try_send(Request::EmergencyStop(true));
        }
    }

    /// Waits until the file is as wanted, at most this long. Blocks.
    pub fn finish(&self, limit: Duration) {
        let end = Instant::now() + limit;
        let behind = |writer: &Writer| *writer.kept.borrow() != Some(self.is_on());
        while self.writer.as_ref().is_some_and(behind) && Instant::now() < end {
            std::thread::sleep(RECHECK);
        }
    }

    /// Whether STOP holds.
    pub fn is_on(&self) -> bool {
        *self.on.borrow()
    }

    /// Whether STOP holds, now and later.
    pub fn watch(&self) -> watch::Receiver<bool> {
        self.on.subscribe()
    }

    /// Sets or releases it, and tells the pilot, under one lock: if two people want the opposite,
    /// the pilot and the file follow the same one last. Does not wait for the disk.
    pub(super) fn set(&self, on: bool, tell_pilot: impl FnOnce()) {
        let changed = self.on.send_if_modified(|was| {
            tell_pilot();
            std::mem::replace(was, on) != on
        });
        if let Some(writer) = &self.writer
            && changed
        {
            // If the queue is full, the thread will see this change too.
            let _ = writer.changes.try_send(());
        }
    }
}

/// Nothing of this name can be there.
fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
}

struct StopFile {
    data: PathBuf,
    wanted: watch::Receiver<bool>,
    /// Whether the file is there; unknown after an error.
    kept: watch::Sender<Option<bool>>,
}

impl StopFile {
    fn new(data: &Path, on: &watch::Sender<bool>, kept: bool) -> StopFile {
        StopFile {
            data: data.to_owned(),
            wanted: on.subscribe(),
            kept: watch::Sender::new(Some(kept)),
        }
    }

    /// Writes or removes the file after each change, until the stop is dropped. Retries what has
    /// failed, and restores a file that another robot's run or tool has removed from a shared
    /// folder.
    fn follow(self, changes: &Receiver<()>) {
        loop {
            let kept = *self.kept.borrow();
            let woken = match kept {
                Some(false) => changes.recv().map_err(RecvTimeoutError::from),
                _ => changes.recv_timeout(AGAIN),
            };
            if woken == Err(RecvTimeoutError::Disconnected) {
                return;
            }
            self.write();
        }
    }

    fn write(&self) {
        let wanted = *self.wanted.borrow();
        let kept = *self.kept.borrow();
        if kept == Some(wanted) && (!wanted || EmergencyStop::is_kept(&self.data)) {
            return;
        }
        let written = if wanted {
            Folder::make(&self.data).and_then(|folder| folder.replace_durably(NAME, TEXT))
        } else {
            EmergencyStop::remove(&self.data).map(|_| ())
        };
        self.kept.send_replace(written.is_ok().then_some(wanted));
        if let (Err(error), Some(_)) = (written, kept) {
            let path = self.data.join(NAME);
            let path = path.display();
            let what = if wanted { "write" } else { "remove" };
            let until = if wanted {
                "STOP holds, but only until this program ends"
            } else {
                "STOP is released, but would hold again in the next program"
            };
            warn!("{until}: cannot {what} {path}: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Waits until the file is there, or is not.
    fn becomes(stop: &EmergencyStop, data: &Path, kept: bool) {
        stop.finish(Duration::from_secs(60));
        assert_eq!(EmergencyStop::is_kept(data), kept);
    }

    #[test]
    fn a_stop_holds_in_the_next_program_until_it_is_released() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("data");
        let stop = EmergencyStop::open(&data);
        assert!(!stop.is_on() && !data.exists());
        stop.set(true, || ());
        becomes(&stop, &data, true);
        drop(stop);
        let next = EmergencyStop::open(&data);
        let (requests, mut received) = mpsc::channel(1);
        next.restore(&requests);
        assert!(matches!(
            received.try_recv(),
            Ok(Request::EmergencyStop(true))
        ));
        assert!(next.is_on());
        next.set(false, || ());
        becomes(&next, &data, false);
        let third = EmergencyStop::open(&data);
        third.restore(&requests);
        assert!(!third.is_on() && received.try_recv().is_err());
    }

    #[test]
    fn whatever_is_in_the_place_of_the_file_counts_as_stop() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join(NAME);
        std::fs::create_dir(&path).unwrap();
        assert!(EmergencyStop::open(home.path()).is_on());
        assert!(EmergencyStop::remove(home.path()).is_err());
        std::fs::remove_dir(&path).unwrap();
        std::os::unix::fs::symlink("nowhere", &path).unwrap();
        assert!(EmergencyStop::open(home.path()).is_on());
        assert!(EmergencyStop::remove(home.path()).unwrap());
        assert!(!EmergencyStop::remove(home.path()).unwrap());
        // A data folder below a file cannot contain one.
        std::fs::write(&path, "").unwrap();
        assert!(!EmergencyStop::is_kept(&path));
    }

    #[test]
    fn a_stop_that_cannot_be_written_holds_and_the_file_is_written_later() {
        let home = tempfile::tempdir().unwrap();
        // A file in the place of the data folder takes no file.
        let data = home.path().join("data");
        std::fs::write(&data, "").unwrap();
        let on = watch::Sender::new(true);
        let file = StopFile::new(&data, &on, false);
        file.write();
        assert_eq!(*file.kept.borrow(), None);
        assert!(*on.borrow());
        std::fs::remove_file(&data).unwrap();
        file.write();
        assert!(EmergencyStop::is_kept(&data));
        // Another robot's tool removes it.
        assert!(EmergencyStop::remove(&data).unwrap());
        file.write();
        assert!(EmergencyStop::is_kept(&data));
        on.send_replace(false);
        file.write();
        assert!(!EmergencyStop::is_kept(&data));
    }

    #[test]
    fn without_a_file_a_stop_ends_with_its_program() {
        let stop = EmergencyStop::default();
        let mut seen = stop.watch();
        stop.set(true, || ());
        assert!(stop.is_on() && *seen.borrow_and_update());
        stop.set(false, || ());
        assert!(!stop.is_on() && !*seen.borrow_and_update());
    }
}
