//! Detects that a script's file, or a module that it has loaded, was saved. Polls four times a
//! second, which costs next to nothing and works on network folders and however an editor saves.

use std::collections::BTreeMap;
use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::spawn_blocking;
use tokio::time::{Instant, sleep};
use tracing::warn;

use super::library::Library;
use crate::files;
use crate::script::MAX_SOURCE;

const PERIOD: Duration = Duration::from_millis(250);
/// A save is complete when the file has not changed for this long.
const SETTLED: Duration = Duration::from_millis(200);

/// Reads a script: at most one byte more than it may have, so that a longer one can be reported.
/// Fails if it is not a regular file but, for example, a pipe.
pub fn read_source(file: &Path) -> io::Result<Vec<u8>> {
    Ok(files::read_beginning(file, MAX_SOURCE as u64 + 1)?)
}

#[derive(Debug)]
pub struct ScriptWatcher {
    file: PathBuf,
    detector: SaveDetector<FileState>,
    library: Library,
    modules: BTreeMap<PathBuf, SaveDetector<FileState>>,
}

impl ScriptWatcher {
    /// Starts from the file's current state. To be called before the file is first read, so that no
    /// save is missed.
    pub fn new(file: PathBuf) -> ScriptWatcher {
        let detector = SaveDetector::new(file_state(&file));
        ScriptWatcher {
            file,
            detector,
            library: Library::default(),
            modules: BTreeMap::new(),
        }
    }

    #[must_use]
    pub fn with_modules(self, library: Library) -> ScriptWatcher {
        ScriptWatcher { library, ..self }
    }

    /// Sends the text after every save, until the receiver is dropped. Saving an unchanged text
    /// counts too: this is how a script that has ended is started again.
    pub async fn run(mut self, reloads: mpsc::Sender<Vec<u8>>) {
        loop {
            tokio::select! {
                () = reloads.closed() => return,
                () = sleep(PERIOD) => {}
            }
            let file = self.file.clone();
            let modules = self.library.files();
            let poll = move || (file_state(&file), file_states(modules));
            let Ok((state, modules)) = spawn_blocking(poll).await else {
                return;
            };
            let now = Instant::now();
            let module = self.is_module_saved(modules, now);
            if (self.detector.is_complete(state, now) || module)
                && let Some(source) = self.read(state).await
                && reloads.send(source).await.is_err()
            {
                return;
            }
        }
    }

    /// Whether a module was saved; one that appears for the first time has just been read.
    fn is_module_saved(&mut self, states: Vec<(PathBuf, Option<FileState>)>, now: Instant) -> bool {
        let mut saved = false;
        for (file, state) in states {
            let detector = self
                .modules
                .entry(file)
                .or_insert_with(|| SaveDetector::new(state));
            if detector.is_complete(state, now) {
                detector.accept(state);
                saved = true;
            }
        }
        saved
    }

    /// Returns the text, unless the file changes while it is read: then the save was not complete.
    async fn read(&mut self, before: Option<FileState>) -> Option<Vec<u8>> {
        let file = self.file.clone();
        let read = spawn_blocking(move || (read_source(&file), file_state(&file)));
        let (source, after) = read.await.ok()?;
        if after != before {
            return None;
        }
        self.detector.accept(after);
        source
            .inspect_err(|error| {
                let file = self.file.display();
                warn!("{file} has changed and cannot be read: {error}");
            })
            .ok()
    }
}

/// File metadata that changes with every save, so that the file need not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FileState {
    inode: (u64, u64),
    length: u64,
    modified: (i64, i64),
}

impl From<Metadata> for FileState {
    fn from(data: Metadata) -> FileState {
        FileState {
            inode: (data.dev(), data.ino()),
            length: data.len(),
            modified: (data.mtime(), data.mtime_nsec()),
        }
    }
}

fn file_state(file: &Path) -> Option<FileState> {
    std::fs::metadata(file).ok().map(FileState::from)
}

fn file_states(files: Vec<PathBuf>) -> Vec<(PathBuf, Option<FileState>)> {
    let with_state = |file: PathBuf| (file.clone(), file_state(&file));
    files.into_iter().map(with_state).collect()
}

/// Debounces changes to detect when a save is complete. Pure: the time is an argument.
#[derive(Debug)]
struct SaveDetector<M> {
    taken: Option<M>,
    seen: Option<(M, Instant)>,
}

impl<M: Copy + PartialEq> SaveDetector<M> {
    fn new(taken: Option<M>) -> SaveDetector<M> {
        SaveDetector { taken, seen: None }
    }

    /// Whether the file differs from the one taken last and has not changed for a while.
    fn is_complete(&mut self, state: Option<M>, now: Instant) -> bool {
        let Some(state) = state.filter(|state| Some(*state) != self.taken) else {
            self.seen = None;
            return false;
        };
        let since = match self.seen {
            Some((seen, since)) if seen == state => since,
            _ => now,
        };
        self.seen = Some((state, since));
        now >= since + SETTLED
    }

    fn accept(&mut self, state: Option<M>) {
        (self.taken, self.seen) = (state, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_save_in_several_writes_counts_once() {
        let mut detector = SaveDetector::new(Some(1));
        let now = Instant::now();
        assert!(!detector.is_complete(Some(1), now), "as it was");
        assert!(
            !detector.is_complete(Some(2), now + 250 * MS),
            "just written"
        );
        assert!(!detector.is_complete(None, now + 500 * MS), "renamed away");
        assert!(
            !detector.is_complete(Some(3), now + 750 * MS),
            "written again"
        );
        assert!(detector.is_complete(Some(3), now + 1000 * MS));
        detector.accept(Some(3));
        assert!(!detector.is_complete(Some(3), now + 1250 * MS), "taken");
    }

    #[test]
    fn a_file_that_appears_later_counts_as_a_save() {
        let mut detector = SaveDetector::new(None);
        let now = Instant::now();
        assert!(!detector.is_complete(None, now));
        assert!(!detector.is_complete(Some(1), now));
        assert!(detector.is_complete(Some(1), now + SETTLED));
    }

    proptest! {
            #[test]
            fn only_new_and_settled_states_are_taken_and_always_the_last(
                looks in prop::collection::vec((prop::option::of(0u8..4), 1u32..400), 0..100),
                last in 0u8..4,
            ) {
                let mut now = Instant::now();
    let mut taken = Some(0);
    let mut since = None;
                let mut detector = SaveDetector::new(taken);
                let ends = [(Some(last), 1), (Some(last), 300), (Some(last), 300)];
                for (state, pause) in looks.into_iter().chain(ends) {
                    now += pause * MS;
                    since = match since {
                        Some((same, since)) if same == state => Some((same, since)),
                        _ => Some((state, now)),
                    };
                    if detector.is_complete(state, now) {
                        prop_assert!(state.is_some() && state != taken);
                        prop_assert!(since.is_some_and(|(_, since)| now >= since + SETTLED));
                        detector.accept(state);
                        taken = state;
                    }
                }
                prop_assert_eq!(taken, Some(last));
            }
        }

    #[tokio::test]
    async fn a_file_is_read_after_a_save_and_after_a_rename() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("script.lua");
        std::fs::write(&file, "one").unwrap();
        let watched = ScriptWatcher::new(file.clone());
        let (reloads, mut received) = mpsc::channel(1);
        let watching = tokio::spawn(watched.run(reloads));
        std::fs::write(&file, "two, longer").unwrap();
        assert_eq!(received.recv().await.unwrap(), b"two, longer");
        let other = folder.path().join("script.lua~");
        std::fs::write(&other, "three").unwrap();
        std::fs::rename(&other, &file).unwrap();
        assert_eq!(received.recv().await.unwrap(), b"three");
        drop(received);
        watching.await.unwrap();
    }
}
