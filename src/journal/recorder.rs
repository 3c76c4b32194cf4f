//! The thread that listens to the bus and writes the journal.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::runtime::Builder;
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use super::error::JournalError;
use super::ledger::Ledger;
use super::options::{About, Options};
use super::pending::Pending;
use crate::budget::Repeats;
use crate::clock::{Clock, until};
use crate::robot::{Bus, Heard, Listener};

/// How often the journal is looked over for what is too old.
const FORGET_EVERY: Duration = Duration::from_secs(3600);
/// How often is said that it cannot be written.
const SAID_EVERY: Duration = Duration::from_secs(600);

/// A journal that is being written. Dropping it asks its thread to write what it has, and to end;
/// [`Journal::finish`] waits for that.
#[derive(Debug)]
pub struct Journal {
    stop: CancellationToken,
    ended: mpsc::Receiver<()>,
}

impl Journal {
    /// Remembers in this data folder all that is said on the bus from now on, with the time that this
    /// clock shows. Waits for no disk.
    ///
    /// # Errors
    /// If the system gives no thread. Whatever is wrong with the file is said in the log, and tried
    /// again.
    pub fn start(
        bus: &Bus,
        data: &Path,
        options: Options,
        about: About,
        clock: Clock,
    ) -> Result<Journal, JournalError> {
        let stop = CancellationToken::new();
        let (alive, ended) = mpsc::sync_channel::<()>(1);
        let (listener, stopped) = (bus.listen(), stop.clone());
        let runtime = Builder::new_current_thread().enable_time().build();
        let runtime = runtime.map_err(JournalError::Thread)?;
        let recorder = Recorder::new(data, options, about, clock);
        let life = move || {
            runtime.block_on(recorder.live(listener, stopped));
            drop(alive);
        };
        let thread = std::thread::Builder::new().name("journal".into());
        thread.spawn(life).map_err(JournalError::Thread)?;
        Ok(Journal { stop, ended })
    }

    /// Waits, at most so long, until all that was said on the bus is written and the file is closed.
    /// Whether it is.
    pub fn finish(self, limit: Duration) -> bool {
        self.stop.cancel();
        // Ends when the thread has dropped its end; nothing is ever sent.
        let ended = self.ended.recv_timeout(limit);
        let done = ended == Err(mpsc::RecvTimeoutError::Disconnected);
        if !done {
            warn!("the end of the journal is not written: its disk is too slow");
        }
        done
    }
}

impl Drop for Journal {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}

/// Hears what is said on the bus, and writes it.
pub(super) struct Recorder {
    data: PathBuf,
    options: Options,
    about: About,
    clock: Clock,
    ledger: Option<Ledger>,
    pending: Pending,
    said: Repeats<()>,
}

impl Recorder {
    pub(super) fn new(data: &Path, options: Options, about: About, clock: Clock) -> Recorder {
        Recorder {
            data: data.to_owned(),
            options,
            about,
            clock,
            ledger: None,
            pending: Pending::default(),
            said: Repeats::new(SAID_EVERY),
        }
    }

    /// The time of day of a moment that is not long ago. A clock that was put right in between counts as
    /// it is now.
    fn wall(&self, at: Instant) -> Timestamp {
        let ago = SignedDuration::try_from(at.elapsed()).unwrap_or_default();
        let now = self.clock.now();
        now.checked_sub(ago).unwrap_or(now)
    }

    /// Until `stop` is cancelled or all speakers are gone; then it writes what waits, and ends.
    pub(super) async fn live(mut self, mut listener: Listener, stop: CancellationToken) {
        let mut forgets = Instant::now();
        loop {
            let (due, samples) = (self.pending.due(), self.pending.samples_at());
            tokio::select! {
                biased;
                () = stop.cancelled() => break,
                () = until(due) => self.write(),
                () = until(samples) => self.sample(),
                () = sleep_until(forgets), if self.ledger.is_some() => {
                    self.forget();
                    forgets = Instant::now() + FORGET_EVERY;
                }
                heard = listener.next() => {
                    if !self.hear(heard) {
                        break;
                    }
                }
            }
        }
        while let Some(heard) = listener.try_next() {
            if !self.hear(heard) {
                break;
            }
        }
        self.end();
    }

    /// False: there will be no more.
    fn hear(&mut self, heard: Heard) -> bool {
        let now = Instant::now();
        match heard {
            Heard::Happening(one) => {
                let at = self.wall(one.at).as_millisecond();
                self.pending.hear(&one.what, at, now);
            }
            Heard::Missed(count) => self.pending.miss(count, now),
            Heard::Closed => return false,
        }
        true
    }

    fn sample(&mut self) {
        let now = Instant::now();
        self.pending.sample(self.wall(now).as_millisecond(), now);
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
                let (rows, lost) = self.pending.rows();
                let (waiting, said) = (rows.len(), self.said.note((), now));
                if said.is_some() {
                    warn!(waiting, lost, "the journal cannot be written: {error}");
                }
            }
        }
    }

    fn try_write(&mut self) -> Result<(), JournalError> {
        let now = self.clock.now();
        let ledger = match &mut self.ledger {
            Some(ledger) => ledger,
            None => {
                let opened = Ledger::open(&self.data, self.options, &self.about, now)?;
                self.ledger.insert(opened)
            }
        };
        let (rows, lost) = self.pending.rows();
        match ledger.write(rows, lost, now) {
            Err(error) if error.is_full() && ledger.forget(now)? > 0 => {
                ledger.write(rows, lost, now)
            }
            written => written,
        }
    }

    /// A file that is no journal makes room for a new one, and is kept.
    fn set_aside(&mut self, error: &JournalError) {
        self.ledger = None;
        match Ledger::set_aside(&self.data, self.clock.now()) {
            Ok(aside) => {
                warn!("the journal is damaged ({error}); it is kept as {aside}, a new one begins")
            }
            Err(why) => self.said_once(why),
        }
    }

    fn said_once(&mut self, why: io::Error) {
        if self.said.note((), Instant::now()).is_some() {
            warn!("the damaged journal cannot be set aside: {why}");
        }
    }

    fn forget(&mut self) {
        let now = self.clock.now();
        match self.ledger.as_mut().map(|ledger| ledger.forget(now)) {
            Some(Ok(gone)) if gone > 0 => info!(gone, "the journal has forgotten its oldest rows"),
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
        if let Some(Err(error)) = self.ledger.as_ref().map(|ledger| ledger.end(now)) {
            debug!("the journal's session has no end: {error}");
        }
    }
}
