//! The driving core: one thread with its own runtime, on which the pilot, the reader and writer of
//! the robot's socket and the agent's side of the hosts' pipes run. Nothing on it waits for a disk,
//! a new process or a name lookup: code that needs one of these runs elsewhere and sends the result
//! over a bounded channel.

use std::io;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::{Builder, Handle};
use tokio::sync::Notify;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::clock::or_never;
use crate::guardian::{Guardian, GuardianAct, HEARTBEAT_INTERVAL, HEARTBEAT_TIMEOUT};
use crate::safety::Fact;

const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(500);
/// The runtime's helper thread is never ended, so that a later use does not have to start a thread.
const HELPER_KEPT: Duration = Duration::from_secs(366 * 86_400);

/// A running driving core. Dropping it drops all tasks on it, including the pilot, whose writer
/// sends its last words.
#[derive(Debug)]
pub struct DrivingCore {
    handle: Handle,
    stop: CancellationToken,
    ended: Receiver<()>,
}

impl DrivingCore {
    pub fn start() -> io::Result<DrivingCore> {
        let runtime = Builder::new_current_thread()
            .enable_all()
            .max_blocking_threads(1)
            .thread_keep_alive(HELPER_KEPT)
            .build()?;
        let handle = runtime.handle().clone();
        let stop = CancellationToken::new();
        let (alive, ended) = sync_channel::<()>(1);
        // Starts the helper thread now; otherwise a name lookup or the like would start it while
        // driving.
        handle.spawn_blocking(|| {});
        let stopped = stop.clone();
        std::thread::Builder::new()
            .name("core".into())
            .spawn(move || {
                runtime.block_on(stopped.cancelled());
                runtime.shutdown_timeout(SHUTDOWN_TIMEOUT / 2);
                drop(alive);
            })?;
        Ok(DrivingCore {
            handle,
            stop,
            ended,
        })
    }

    pub fn handle(&self) -> &Handle {
        &self.handle
    }
}

impl Drop for DrivingCore {
    fn drop(&mut self) {
        self.stop.cancel();
        // Returns when the thread has dropped its end of the channel; nothing is ever sent.
        let _ = self.ended.recv_timeout(SHUTDOWN_TIMEOUT);
    }
}

/// A longer gap is a suspension, after which nothing old is repeated; a shorter one, of more than
/// [`HEARTBEAT_TIMEOUT`], is a stall of a busy or virtual machine.
const LONGEST_STALL: Duration = Duration::from_secs(3);

#[derive(Debug, PartialEq)]
pub(super) struct Interruption {
    pub(super) what: String,
    pub(super) fact: Fact,
}

/// The heartbeat of the core, which the guardian monitors. A beat that comes too late shows that
/// this program was stopped, or that the whole machine stalled or was suspended.
#[derive(Debug)]
pub struct Heartbeat {
    guardian: Option<Guardian>,
    beats: Option<Arc<Notify>>,
    due: Instant,
    /// When the pilot was last seen awake, by a clock that also runs while the machine is
    /// suspended; `None` before the first beat, since a run may take a while to begin.
    awake: Option<Duration>,
}

impl Heartbeat {
    /// The heartbeat of a pilot in real time; `None`: this run has no guardian.
    pub fn new(guardian: Option<Guardian>) -> Heartbeat {
        Heartbeat {
            guardian,
            beats: None,
            due: Instant::now(),
            awake: None,
        }
    }

    /// Also notifies `beats` of each beat, for supervisors of the driving core.
    #[must_use]
    pub fn notify_beats(mut self, beats: Arc<Notify>) -> Heartbeat {
        self.beats = Some(beats);
        self
    }

    /// The guardian: the process that stops the robot when this one cannot.
    pub(super) fn guardian(&mut self) -> Option<&mut Guardian> {
        self.guardian.as_mut()
    }

    pub(super) fn due(&self) -> Instant {
        self.due
    }

    /// Beats if it is time, and returns whether the core was interrupted.
    pub(super) fn beat(&mut self, now: Instant) -> Option<Interruption> {
        let mut acted = None;
        if self.due <= now {
            self.due = now + HEARTBEAT_INTERVAL;
            if let Some(guardian) = &mut self.guardian {
                acted = guardian.heartbeat(now);
            }
            if let Some(beats) = &self.beats {
                beats.notify_one();
            }
        }
        self.interruption(acted)
    }

    /// Whether the core was interrupted, and the guardian has done this in its place.
    fn interruption(&mut self, acted: Option<GuardianAct>) -> Option<Interruption> {
        let gap = self.see_awake(boot_time());
        let seconds = gap.as_secs_f64();
        let guardian_wrote = acted == Some(GuardianAct::Wrote);
        let stalled = Fact::Stalled {
            gap,
            guardian_wrote,
        };
        let (what, fact) = match acted {
            _ if gap > LONGEST_STALL => (format!("suspended for {seconds:.1} s"), Fact::Suspended),
            Some(GuardianAct::Stopped) => {
                let what = "this program hung, and a person had the guardian stop the robot";
                (what.to_owned(), Fact::Suspended)
            }
            // The robot does not do what it was told before.
            Some(GuardianAct::Wrote) => {
                let what = format!(
                    "this program hung, or the machine was too busy to run it ({seconds:.1} s), and \
                     the guardian took its place"
                );
                (what, stalled)
            }
            None if gap > HEARTBEAT_TIMEOUT => {
                (format!("the machine stalled for {seconds:.1} s"), stalled)
            }
            None => return None,
        };
        Some(Interruption { what, fact })
    }

    /// Returns for how long the pilot was not awake.
    fn see_awake(&mut self, now: Duration) -> Duration {
        let before = self.awake.replace(now).unwrap_or(now);
        now.saturating_sub(before)
    }

    /// Whether a guardian answers, or none is wanted. Nothing may drive otherwise.
    pub(super) fn is_guarded(&self) -> bool {
        self.guardian.as_ref().is_none_or(Guardian::is_answering)
    }

    /// Waits until [`Heartbeat::check_guardian`] has something to check: the guardian answers, has
    /// died, or another one has started. Cancel-safe.
    pub(super) async fn guardian_changed(&mut self) {
        or_never(self.guardian.as_mut().map(Guardian::changed)).await;
    }

    pub(super) fn check_guardian(&mut self) -> Option<Interruption> {
        let acted = self.guardian.as_mut().and_then(Guardian::check);
        self.interruption(acted)
    }
}

/// The time since the machine was started, including suspension.
fn boot_time() -> Duration {
    let time = clock_gettime(ClockId::Boottime);
    Duration::try_from(time).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    struct Noted(Arc<AtomicBool>);

    impl Drop for Noted {
        fn drop(&mut self) {
            self.0.store(true, Ordering::SeqCst);
        }
    }

    #[test]
    fn a_core_that_ends_has_dropped_what_ran_on_it() {
        let dropped = Arc::new(AtomicBool::new(false));
        let noted = Noted(dropped.clone());
        let core = DrivingCore::start().unwrap();
        core.handle().spawn(async move {
            let _noted = noted;
            std::future::pending::<()>().await;
        });
        drop(core);
        assert!(dropped.load(Ordering::SeqCst));
    }

    #[test]
    fn the_core_continues_while_the_thread_that_started_it_blocks() {
        let core = DrivingCore::start().unwrap();
        let (done, finished) = sync_channel(1);
        core.handle().spawn(async move {
            tokio::time::sleep(Duration::from_millis(10)).await;
            let _ = done.send(());
        });
        assert!(finished.recv().is_ok());
    }

    #[test]
    fn a_slow_start_is_not_a_sleep() {
        let mut heartbeat = Heartbeat::new(None);
        let loaded = boot_time() + Duration::from_secs(5);
        assert_eq!(heartbeat.see_awake(loaded), Duration::ZERO);
    }

    #[test]
    fn a_late_beat_shows_a_stall_and_a_much_later_one_a_suspension() {
        let mut heartbeat = Heartbeat::new(None);
        let mut beat_after = |gap: Duration| {
            heartbeat.awake = Some(boot_time().checked_sub(gap).unwrap());
            heartbeat.beat(Instant::now())
        };
        assert_eq!(beat_after(HEARTBEAT_INTERVAL), None);
        let stalled = beat_after(HEARTBEAT_TIMEOUT);
        assert!(matches!(stalled.unwrap().fact, Fact::Stalled { .. }));
        let suspended = beat_after(LONGEST_STALL);
        assert_eq!(suspended.unwrap().fact, Fact::Suspended);
    }

    #[test]
    fn a_clock_that_goes_back_is_no_gap() {
        let mut heartbeat = Heartbeat::new(None);
        heartbeat.see_awake(Duration::from_secs(2));
        assert_eq!(heartbeat.see_awake(Duration::from_secs(1)), Duration::ZERO);
    }
}
