//! The thread that listens to the bus and writes the journal.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;
use tracing::{debug, info, warn};

use super::JournalError;
use super::database::Database;
use super::pending::Pending;
use super::{Options, RunInfo};
use crate::clock::{Clock, until};
use crate::rate_limit::Repeats;
use crate::robot::{Bus, BusMessage, Listener};
use crate::side_thread::SideThread;

/// How often rows that are too old are deleted.
const CLEANUP_INTERVAL: Duration = Duration::from_secs(3600);
/// Minimum interval between two reports of failed writes.
const REPORT_INTERVAL: Duration = Duration::from_secs(600);

/// A journal that is being written. Dropping it tells its thread to write the waiting rows and to
/// end; [`Journal::finish`] waits for that.
#[derive(Debug)]
pub struct Journal(SideThread);

impl Journal {
    /// Records the bus's events from now on in this data folder, with the time of this clock. Does
    /// not wait for the disk.
    ///
    /// # Errors
    /// If the system cannot start a thread. Problems with the file are logged, and the write is
    /// retried.
    pub fn start(
        bus: &Bus,
        data: &Path,
        options: Options,
        about: RunInfo,
        clock: Clock,
    ) -> io::Result<Journal> {
        let listener = bus.subscribe();
        let recorder = Recorder::new(data, options, about, clock);
        SideThread::start("journal", |stop| recorder.run(listener, stop)).map(Journal)
    }

    /// Waits at most this long until all events on the bus are written and the file is closed.
    /// Returns whether that is done.
    pub fn finish(self, limit: Duration) -> bool {
        let done = self.0.finish(limit);
        if !done {
            warn!("the end of the journal was not written: its disk is too slow");
        }
        done
    }
}

pub(super) struct Recorder {
    data: PathBuf,
    options: Options,
    about: RunInfo,
    clock: Clock,
    database: Option<Database>,
    pending: Pending,
    reports: Repeats<()>,
}

impl Recorder {
    pub(super) fn new(data: &Path, options: Options, about: RunInfo, clock: Clock) -> Recorder {
        Recorder {
            data: data.to_owned(),
            options,
            about,
            clock,
            database: None,
            pending: Pending::default(),
            reports: Repeats::new(REPORT_INTERVAL),
        }
    }

    /// Runs until `stop` is cancelled or the bus is closed; then writes the waiting rows and ends.
    pub(super) async fn run(mut self, mut listener: Listener, stop: CancellationToken) {
        let mut next_cleanup = Instant::now();
        loop {
            let due = self.pending.due();
            let samples = self.pending.samples_at();
            tokio::select! {
                biased;
                () = until(due) => self.write(),
                () = until(samples) => self.sample(),
                () = sleep_until(next_cleanup), if self.database.is_some() => {
                    self.delete_old();
                    next_cleanup = Instant::now() + CLEANUP_INTERVAL;
                }
                message = listener.next_until(&stop) => match message {
                    Some(message) => self.handle_event(message),
                    None => break,
                }
            }
        }
        self.end();
    }

    fn handle_event(&mut self, message: BusMessage) {
        let now = Instant::now();
        match message {
            BusMessage::Event(one) => {
                let at = self.clock.time_of(one.at).as_millisecond();
                self.pending.add_event(&one.what, at, now);
            }
            BusMessage::Missed(count) => self.pending.add_lost(count, now),
        }
    }

    fn sample(&mut self) {
        let now = Instant::now();
        self.pending.sample(self.clock.now().as_millisecond(), now);
    }

    fn write(&mut self) {
        let written = self.try_write();
        let now = Instant::now();
        match written {
            Ok(()) => self.pending.written(),
            Err(error) => {
                if error.is_damage() {
                    self.set_aside(&error);
                }
                self.pending.failed(now);
                if self.reports.record((), now).is_some() {
                    let (rows, lost) = self.pending.rows();
                    let waiting = rows.len();
                    warn!(waiting, lost, "the journal cannot be written: {error}");
                }
            }
        }
    }

    fn try_write(&mut self) -> Result<(), JournalError> {
        let now = self.clock.now();
        let database = match &mut self.database {
            Some(database) => database,
            None => {
                let opened = Database::open(&self.data, self.options, &self.about, now)?;
                self.database.insert(opened)
            }
        };
        let (rows, lost) = self.pending.rows();
        match database.write(rows, lost, now) {
            Err(error) if error.is_full() && database.delete_old(now)? > 0 => {
                database.write(rows, lost, now)
            }
            written => written,
        }
    }

    /// Renames and keeps a file that is not a journal, so that a new journal can be created.
    fn set_aside(&mut self, error: &JournalError) {
        self.database = None;
        match Database::set_aside(&self.data, self.clock.now()) {
            Ok(aside) => {
                warn!(
                    "the journal is damaged ({error}); it is kept as {aside}, and a new one is created"
                )
            }
            Err(why) if self.reports.record((), Instant::now()).is_some() => {
                warn!("the damaged journal cannot be renamed: {why}");
            }
            Err(_) => {}
        }
    }

    fn delete_old(&mut self) {
        let now = self.clock.now();
        let database = self.database.as_mut();
        match database.map(|database| database.delete_old(now)) {
            Some(Ok(gone)) if gone > 0 => {
                info!(gone, "the oldest rows of the journal were deleted")
            }
            Some(Err(error)) => debug!("the journal cannot be cleaned up: {error}"),
            _ => {}
        }
    }

    fn end(&mut self) {
        let (rows, lost) = self.pending.rows();
        if !rows.is_empty() || lost > 0 {
            self.write();
        }
        let (rows, lost) = self.pending.rows();
        let unwritten = rows.len() as u64 + lost;
        if unwritten > 0 {
            warn!(unwritten, "the journal is incomplete");
        }
        let now = self.clock.now();
        if let Some(Err(error)) = self.database.as_ref().map(|database| database.end(now)) {
            debug!("the end of the journal's session cannot be written: {error}");
        }
    }
}

/// A journal that is written on the simulation's own thread, at the moment of virtual time at which
/// rows are due: that time stands still while the disk works. Dropping it simulates a power cut:
/// rows that are not written yet are lost, and the session has no end.
#[derive(Debug)]
pub struct SimulationJournal {
    stop: CancellationToken,
    task: AbortOnDropHandle<()>,
}

impl SimulationJournal {
    /// Records the bus's events from now on in this data folder. Must be called within a
    /// simulation. Problems with the file are logged, and the write is retried.
    pub fn start(bus: &Bus, data: &Path, options: Options, about: RunInfo) -> SimulationJournal {
        let stop = CancellationToken::new();
        let recorder = Recorder::new(data, options, about, Clock::default());
        let task = tokio::spawn(recorder.run(bus.subscribe(), stop.clone()));
        SimulationJournal {
            stop,
            task: AbortOnDropHandle::new(task),
        }
    }

    /// Waits until all events on the bus are written and the file is closed.
    pub async fn finish(self) {
        self.stop.cancel();
        // A panic of the task was already reported.
        let _ = self.task.await;
    }
}
