//! A person's STOP: the robot stands until a person releases it, in this program and in the next one
//! of its data folder.
//!
//! A spare file, made at the start, is renamed to `.stop`: that needs no free block and takes
//! microseconds, so a STOP is kept before it is answered. A thread of its own does this, since a
//! disk may hang; the answer waits for it at most [`KEEP_LIMIT`], the robot not at all.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use rustix::process::{Pid, test_kill_process};
use tokio::sync::{mpsc, oneshot, watch};
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;
use tracing::warn;

use crate::files::Folder;
use crate::robot::channel::Request;
use crate::robot::{AgentEvent, Bus, StopKept};
use crate::side_thread::SideThread;

/// Name of the file. Its presence is the STOP; the text is for people.
const NAME: &str = ".stop";
const TEXT: &[u8] =
    b"A person has stopped the robot. To release it, use the page or `spykee robot reset-stop`.\n";
/// Beginning of the spare files' names; the process ID follows.
const SPARE: &str = ".stop-spare-";
/// Longest wait for the disk before an answer.
const KEEP_LIMIT: Duration = Duration::from_secs(1);
/// Time until a failed write is retried, and between two checks whether the file is still there.
const AGAIN: Duration = Duration::from_secs(10);
/// The same while no STOP holds and nothing has failed.
const IDLE: Duration = Duration::from_secs(3600);
/// Maximum number of waiting jobs. If the disk hangs, more would not help.
const MAX_JOBS: usize = 8;

/// A person's STOP. All clones are one.
#[derive(Debug, Clone, Default)]
pub struct EmergencyStop {
    /// Since when it holds.
    on: watch::Sender<Option<Instant>>,
    /// Learns who pressed and who released.
    bus: Bus,
    /// Without one, as in simulations, STOP ends with its program.
    file: Option<StopFileHandle>,
}

#[derive(Debug, Clone)]
struct StopFileHandle {
    /// Where the thread is asked to make the file as wanted.
    jobs: mpsc::Sender<oneshot::Sender<io::Result<()>>>,
    /// Whether the file is there; unknown after an error.
    kept: watch::Receiver<Option<bool>>,
    thread: Option<Arc<SideThread>>,
}

impl EmergencyStop {
    /// The STOP of a robot that is simulated in this program.
    pub fn simulated(bus: &Bus) -> EmergencyStop {
        EmergencyStop {
            bus: bus.clone(),
            ..EmergencyStop::default()
        }
    }

    /// Reads the file in this data folder, and starts the thread that keeps it. Blocks on the disk:
    /// must not be called on the driving core.
    pub fn open(data: &Path, bus: &Bus) -> EmergencyStop {
        let kept = EmergencyStop::is_kept(data);
        if kept {
            let path = data.join(NAME);
            warn!(
                "a person's STOP still holds ({}): nothing moves the robot until a person releases \
                 it, with *Let it move again* at the page or with `spykee robot reset-stop`",
                path.display()
            );
        }
        let on = watch::Sender::new(kept.then(Instant::now));
        let (jobs, received) = mpsc::channel(MAX_JOBS);
        let file = StopFile {
            data: data.to_owned(),
            wanted: on.subscribe(),
            kept: watch::Sender::new(Some(kept)),
            spare: format!("{SPARE}{}", std::process::id()),
            new: !data.exists(),
        };
        let kept = file.kept.subscribe();
        let thread = SideThread::start("stop", |stop| file.follow(received, stop))
            .map_err(|error| warn!("STOP will hold in this program only: {error}"));
        let thread = thread.ok().map(Arc::new);
        EmergencyStop {
            on,
            bus: bus.clone(),
            file: Some(StopFileHandle { jobs, kept, thread }),
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
    /// If it fails, the STOP still holds.
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

    pub fn is_on(&self) -> bool {
        self.on.borrow().is_some()
    }

    /// Since when STOP holds, now and later.
    pub fn watch(&self) -> watch::Receiver<Option<Instant>> {
        self.on.subscribe()
    }

    /// Whether it holds, but a program that starts now may not hold it yet: the disk has not
    /// answered. False again when its time is over.
    pub fn is_being_kept(&self) -> bool {
        let since = *self.on.borrow();
        let waits = |since: Instant| since.elapsed() < KEEP_LIMIT;
        let file = self.file.as_ref();
        since.is_some_and(waits) && file.is_some_and(|file| *file.kept.borrow() == Some(false))
    }

    /// Engages it, in the name of `by`: latches and tells the pilot at once, then waits until the
    /// next program would hold it too, for a limited time.
    pub async fn engage(&self, by: &str, tell_pilot: impl FnOnce()) -> StopKept {
        if self.set(true, tell_pilot) {
            self.bus
                .publish(AgentEvent::StopEngaged { by: by.to_owned() });
        }
        let Some(file) = &self.file else {
            return StopKept::WithProgram;
        };
        match file.sync().await {
            Some(Ok(())) => StopKept::Yes,
            Some(Err(error)) => StopKept::No {
                why: error.to_string(),
            },
            // It is kept already, and only the disk's answer to something else is missing.
            None if *file.kept.borrow() == Some(true) => StopKept::Yes,
            None => StopKept::NotYet,
        }
    }

    /// Releases it, in the name of `by`: tells the pilot at once, then waits until the next program
    /// would not hold it either, for a limited time.
    /// The error says why the next program may hold the robot again.
    pub async fn reset(&self, by: &str, tell_pilot: impl FnOnce()) -> Result<(), String> {
        if self.set(false, tell_pilot) {
            self.bus
                .publish(AgentEvent::StopReset { by: by.to_owned() });
        }
        let Some(file) = &self.file else {
            return Ok(());
        };
        let why = match file.sync().await {
            Some(Ok(())) => return Ok(()),
            Some(Err(error)) => error.to_string(),
            None if *file.kept.borrow() == Some(false) => return Ok(()),
            None => "the disk does not answer".to_owned(),
        };
        Err(format!(
            "the robot may move again, but STOP may hold in the next program: {why}"
        ))
    }

    /// Repeats to a pilot that was too busy what holds now.
    pub(super) fn repeat(&self, place: mpsc::Permit<'_, Request>) {
        self.on.send_if_modified(|on| {
            place.send(Request::EmergencyStop(on.is_some()));
            false
        });
    }

    /// Sets or releases it, and tells the pilot, under one lock: if two people want the opposite,
    /// the pilot and the file follow the same one last. Returns whether that changed anything.
    fn set(&self, on: bool, tell_pilot: impl FnOnce()) -> bool {
        self.on.send_if_modified(|was| {
            tell_pilot();
            let changes = was.is_some() != on;
            if changes {
                *was = on.then(Instant::now);
            }
            changes
        })
    }

    /// Waits until the file is as wanted and the spare one is gone, at most this long. Blocks. Call
    /// it when nobody can press STOP any more.
    pub fn finish(&self, limit: Duration) {
        if let Some(thread) = self.file.as_ref().and_then(|file| file.thread.as_ref()) {
            thread.finish(limit);
        }
    }
}

impl StopFileHandle {
    /// Has the thread make the file as wanted. `None`: the disk does not answer in time.
    async fn sync(&self) -> Option<io::Result<()>> {
        let (reply, done) = oneshot::channel();
        match self.jobs.try_send(reply) {
            Ok(()) => {}
            Err(mpsc::error::TrySendError::Full(_)) => return None,
            Err(mpsc::error::TrySendError::Closed(_)) => return Some(Err(no_thread())),
        }
        let done = timeout(KEEP_LIMIT, done).await.ok()?;
        Some(done.unwrap_or_else(|_| Err(no_thread())))
    }
}

fn no_thread() -> io::Error {
    io::Error::other("the thread that keeps it has ended")
}

/// Nothing of this name can be there.
fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory)
}

struct StopFile {
    data: PathBuf,
    wanted: watch::Receiver<Option<Instant>>,
    /// Whether the file is there; unknown after an error.
    kept: watch::Sender<Option<bool>>,
    /// Name of this process's spare file.
    spare: String,
    /// Whether the data folder was created for it.
    new: bool,
}

impl StopFile {
    /// Does the jobs until the program ends. Retries what has failed, and restores a file that
    /// another robot's run or tool has removed from a shared folder.
    async fn follow(
        self,
        mut jobs: mpsc::Receiver<oneshot::Sender<io::Result<()>>>,
        stop: CancellationToken,
    ) {
        self.prepare();
        loop {
            let pause = match *self.kept.borrow() {
                Some(false) => IDLE,
                _ => AGAIN,
            };
            tokio::select! {
                biased;
                job = jobs.recv() => {
                    let Some(reply) = job else { break };
                    let _ = reply.send(self.sync());
                    self.prepare();
                }
                () = stop.cancelled() => {
                    let _ = self.sync();
                    break;
                }
                () = sleep(pause) => {
                    // It was logged when it failed first.
                    let _ = self.sync();
                    if self.wanted.borrow().is_none() {
                        self.prepare();
                    }
                }
            }
        }
        self.tidy();
    }

    /// Makes the file as wanted.
    fn sync(&self) -> io::Result<()> {
        let wanted = self.wanted.borrow().is_some();
        let synced = if !wanted {
            EmergencyStop::remove(&self.data).map(|_| ())
        } else if EmergencyStop::is_kept(&self.data) {
            Ok(())
        } else {
            self.keep()
        };
        let kept = synced.is_ok().then_some(wanted);
        let before = self.kept.send_replace(kept);
        if let (Err(error), Some(_)) = (&synced, before) {
            let path = self.data.join(NAME);
            let path = path.display();
            if wanted {
                warn!("STOP holds, but only until this program ends: cannot write {path}: {error}");
            } else {
                warn!(
                    "STOP is released, but would hold again in the next program: cannot remove \
                     {path}: {error}"
                );
            }
        }
        synced
    }

    fn keep(&self) -> io::Result<()> {
        let folder = Folder::make(&self.data)?;
        match folder.rename(&self.spare, NAME) {
            Ok(()) => Ok(()),
            // The spare file is gone, or could not be made. An empty one rarely needs a block.
            Err(_) => folder.create(NAME),
        }
    }

    /// Has the disk store what was changed, and makes the next spare file. Best effort.
    fn prepare(&self) {
        let prepared = Folder::make(&self.data).and_then(|folder| {
            folder.sync()?;
            if *self.kept.borrow() == Some(false) && folder.item(&self.spare)?.is_none() {
                sweep(&folder)?;
                folder.replace_durably(&self.spare, TEXT)?;
            }
            Ok(())
        });
        if let Err(error) = prepared {
            warn!(
                "a later STOP may not be kept for the next program: {}: {error}",
                self.data.display()
            );
        }
    }

    /// Removes the spare file, and the data folder if it is empty and was made for it.
    fn tidy(&self) {
        let _ = std::fs::remove_file(self.data.join(&self.spare));
        if self.new {
            let _ = std::fs::remove_dir(&self.data);
        }
    }
}

/// Removes the spare files of programs that were killed.
fn sweep(folder: &Folder) -> io::Result<()> {
    for name in folder.names()? {
        let pid = name.strip_prefix(SPARE).and_then(|pid| pid.parse().ok());
        let pid = pid.and_then(Pid::from_raw);
        if pid.is_some_and(|pid| test_kill_process(pid) == Err(rustix::io::Errno::SRCH)) {
            folder.remove(&name)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn engage(stop: &EmergencyStop) -> StopKept {
        stop.engage("a test", || ()).await
    }

    #[tokio::test]
    async fn a_stop_is_kept_before_it_is_answered_and_holds_until_it_is_released() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("data");
        let bus = Bus::default();
        let mut heard = bus.subscribe();
        let stop = EmergencyStop::open(&data, &bus);
        assert!(!stop.is_on() && !EmergencyStop::is_kept(&data));
        assert_eq!(engage(&stop).await, StopKept::Yes);
        assert!(EmergencyStop::is_kept(&data));
        assert_eq!(engage(&stop).await, StopKept::Yes);
        drop(stop);
        let next = EmergencyStop::open(&data, &bus);
        let (requests, mut received) = mpsc::channel(1);
        next.restore(&requests);
        assert!(matches!(
            received.try_recv(),
            Ok(Request::EmergencyStop(true))
        ));
        assert!(next.is_on());
        next.reset("another", || ()).await.unwrap();
        assert!(!EmergencyStop::is_kept(&data));
        let third = EmergencyStop::open(&data, &bus);
        third.restore(&requests);
        assert!(!third.is_on() && received.try_recv().is_err());
        let heard: Vec<AgentEvent> = std::iter::from_fn(|| match heard.try_next() {
            Some(crate::robot::BusMessage::Event(one)) => Some(one.what.clone()),
            _ => None,
        })
        .collect();
        let by = |by: &str| by.to_owned();
        let engaged = AgentEvent::StopEngaged { by: by("a test") };
        let reset = AgentEvent::StopReset { by: by("another") };
        assert_eq!(heard, [engaged, reset], "each is recorded once");
    }

    #[tokio::test]
    async fn nothing_is_left_of_a_program_in_which_nobody_pressed_stop() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("data");
        let stop = EmergencyStop::open(&data, &Bus::default());
        stop.reset("a test", || ()).await.unwrap();
        stop.finish(Duration::from_secs(60));
        assert!(!data.exists());
        let kept = EmergencyStop::open(&data, &Bus::default());
        assert_eq!(engage(&kept).await, StopKept::Yes);
        kept.finish(Duration::from_secs(60));
        let names = std::fs::read_dir(&data).unwrap();
        let names: Vec<_> = names.map(|name| name.unwrap().file_name()).collect();
        assert_eq!(names, [NAME]);
    }

    #[test]
    fn whatever_is_in_the_place_of_the_file_counts_as_stop() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join(NAME);
        let bus = Bus::default();
        std::fs::create_dir(&path).unwrap();
        assert!(EmergencyStop::open(home.path(), &bus).is_on());
        assert!(EmergencyStop::remove(home.path()).is_err());
        std::fs::remove_dir(&path).unwrap();
        std::os::unix::fs::symlink("nowhere", &path).unwrap();
        assert!(EmergencyStop::open(home.path(), &bus).is_on());
        assert!(EmergencyStop::remove(home.path()).unwrap());
        assert!(!EmergencyStop::remove(home.path()).unwrap());
        // A data folder below a file cannot contain one.
        std::fs::write(&path, "").unwrap();
        assert!(!EmergencyStop::is_kept(&path));
    }

    #[tokio::test]
    async fn a_data_folder_that_was_removed_is_made_again_and_one_that_cannot_be_is_told() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("data");
        let stop = EmergencyStop::open(&data, &Bus::default());
        stop.reset("a test", || ()).await.unwrap();
        while !data.exists() {
            std::thread::yield_now();
        }
        // The spare file may be made meanwhile.
        while std::fs::remove_dir_all(&data).is_err() && data.exists() {}
        assert_eq!(engage(&stop).await, StopKept::Yes);
        assert!(EmergencyStop::is_kept(&data));
        stop.reset("a test", || ()).await.unwrap();
        // A file in the place of the data folder takes no file.
        let _ = std::fs::remove_dir_all(&data);
        while std::fs::write(&data, "").is_err() {
            let _ = std::fs::remove_dir_all(&data);
        }
        let kept = engage(&stop).await;
        assert!(matches!(&kept, StopKept::No { .. }), "{kept:?}");
        assert!(kept.warning().unwrap().contains("NOT in the next one"));
        assert!(stop.is_on());
        std::fs::remove_file(&data).unwrap();
        assert_eq!(engage(&stop).await, StopKept::Yes);
        assert!(EmergencyStop::is_kept(&data));
    }

    #[test]
    fn the_spare_files_of_killed_programs_are_removed() {
        let home = tempfile::tempdir().unwrap();
        let folder = Folder::open(home.path()).unwrap();
        // No process has this number; the last has this one's.
        for name in [".stop-spare-2147483646", ".stop-spare-x", ".stop-spare-1"] {
            folder.create(name).unwrap();
        }
        sweep(&folder).unwrap();
        let left: Vec<String> = folder.names().unwrap().into_iter().collect();
        assert!(left.contains(&".stop-spare-1".to_owned()), "{left:?}");
        assert!(!left.contains(&".stop-spare-2147483646".to_owned()));
    }

    #[tokio::test]
    async fn without_a_file_a_stop_ends_with_its_program() {
        let stop = EmergencyStop::default();
        let mut seen = stop.watch();
        assert_eq!(engage(&stop).await, StopKept::WithProgram);
        assert!(stop.is_on() && seen.borrow_and_update().is_some());
        assert!(!stop.is_being_kept(), "nothing keeps it");
        stop.reset("a test", || ()).await.unwrap();
        assert!(!stop.is_on() && seen.borrow_and_update().is_none());
    }

    #[tokio::test]
    async fn a_stop_that_holds_but_is_not_kept_yet_is_known_as_such() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("data");
        for _ in 0..20 {
            let stop = EmergencyStop::open(&data, &Bus::default());
            let engaged = engage(&stop);
            let seen = async {
                while !stop.is_on() || stop.is_being_kept() {
                    tokio::task::yield_now().await;
                }
                EmergencyStop::is_kept(&data)
            };
            let (kept, is_kept) = tokio::join!(engaged, seen);
            assert_eq!((kept, is_kept), (StopKept::Yes, true));
            stop.reset("a test", || ()).await.unwrap();
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_disk_that_never_answers_does_not_delay_what_is_told_of_a_stop() {
        let (jobs, _hangs) = mpsc::channel(MAX_JOBS);
        let (_unknown, kept) = watch::channel(Some(false));
        let thread = None;
        let stop = EmergencyStop {
            file: Some(StopFileHandle { jobs, kept, thread }),
            ..EmergencyStop::default()
        };
        assert!(!stop.is_being_kept());
        let engaged = engage(&stop);
        let early = async {
            while !stop.is_on() {
                tokio::task::yield_now().await;
            }
            stop.is_being_kept()
        };
        assert_eq!(tokio::join!(engaged, early), (StopKept::NotYet, true));
        assert!(!stop.is_being_kept());
    }
}
