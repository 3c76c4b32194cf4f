//! The signals that end or stop a program, and what a program that drives a robot does about them.

use std::future::{Future, poll_fn};
use std::task::Poll;
use std::time::Duration;

use tokio::runtime::Handle;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::Failure;
use super::terminal::Terminal;
use crate::robot::channel::{Request, Sleep};

/// How long the signal that stops this program may take to do so.
const FALLING_ASLEEP: Duration = Duration::from_millis(50);

/// Signals whose usual effect is that a program ends at once: each ends a run in order here, the
/// tracks first. SIGKILL cannot be heard, and after SIGABRT and its like nothing of this program can
/// be trusted: then the guardian stops the robot.
const ENDING: [i32; 13] = [
    libc::SIGINT,
    libc::SIGTERM,
    libc::SIGHUP,
    libc::SIGQUIT,
    libc::SIGUSR1,
    libc::SIGUSR2,
    libc::SIGALRM,
    libc::SIGVTALRM,
    libc::SIGPROF,
    libc::SIGXCPU,
    libc::SIGXFSZ,
    libc::SIGIO,
    libc::SIGPWR,
];

/// Ends at the first signal from now on that would usually end a program.
///
/// # Errors
/// If the system does not let us hear them.
pub(super) fn interruption() -> Result<impl Future<Output = ()> + Send, Failure> {
    let mut signals = EndingSignals::but(&[])?;
    Ok(async move { signals.next().await })
}

/// The signals that would usually end this program.
pub(super) struct EndingSignals(Vec<Signal>);

impl EndingSignals {
    /// Hears all of them from now on but those that the caller hears by itself.
    ///
    /// # Errors
    /// If the system does not let us.
    pub(super) fn but(others: &[i32]) -> Result<EndingSignals, Failure> {
        let ours = ENDING.iter().filter(|number| !others.contains(number));
        let signals: Result<_, Failure> = ours.map(|&number| listen(number)).collect();
        signals.map(EndingSignals)
    }

    /// Waits for the next one.
    pub(super) async fn next(&mut self) {
        poll_fn(|context| {
            // All are asked, so that each of them wakes this task.
            let mut heard = Poll::Pending;
            for signal in &mut self.0 {
                if signal.poll_recv(context).is_ready() {
                    heard = Poll::Ready(());
                }
            }
            heard
        })
        .await;
    }
}

/// Hears a signal from now on, in place of its usual effect.
///
/// # Errors
/// If the system does not let us.
pub(super) fn listen(number: i32) -> Result<Signal, Failure> {
    signal(SignalKind::from_raw(number))
        .map_err(|error| Failure::usage(format_args!("cannot receive signals: {error}")))
}

/// From now on the first signal that would end this program cancels `stop`; and Ctrl-Z stops the robot
/// first, by a request to its pilot, then this program. The driving core hears the signals: any other
/// thread may be waiting for a disk.
///
/// # Errors
/// If the system does not let us hear them.
pub(super) fn obey(
    core: &Handle,
    requests: mpsc::Sender<Request>,
    stop: CancellationToken,
) -> Result<(), Failure> {
    hear(core, requests, stop, &[], None)
}

/// As [`obey`], of a service: SIGHUP is heard by the caller.
///
/// # Errors
/// If the system does not let us hear them.
pub(super) fn obey_as_service(
    core: &Handle,
    requests: mpsc::Sender<Request>,
    stop: CancellationToken,
) -> Result<(), Failure> {
    hear(core, requests, stop, &[libc::SIGHUP], None)
}

/// As [`obey`], while a person edits lines: an interruption is heard by the caller, and while this
/// program is stopped the terminal has its usual settings.
///
/// # Errors
/// If the system does not let us hear them.
pub(super) fn obey_at_prompt(
    core: &Handle,
    requests: mpsc::Sender<Request>,
    stop: CancellationToken,
    usual: Terminal,
) -> Result<(), Failure> {
    hear(core, requests, stop, &[libc::SIGINT], Some(usual))
}

fn hear(
    core: &Handle,
    requests: mpsc::Sender<Request>,
    stop: CancellationToken,
    others: &[i32],
    usual: Option<Terminal>,
) -> Result<(), Failure> {
    let _heard_by = core.enter();
    let mut ending = EndingSignals::but(others)?;
    let mut stopped = listen(libc::SIGTSTP)?;
    core.spawn(async move {
        ending.next().await;
        stop.cancel();
    });
    core.spawn(async move {
        while stopped.recv().await.is_some() {
            let usual = usual.clone();
            let sleep = Sleep(Box::new(move || sleep_here(usual)));
            if requests.send(Request::Sleep(sleep)).await.is_err() {
                return;
            }
        }
    });
    Ok(())
}

/// Stops this program as the terminal would have done; returns when it goes on.
fn sleep_here(usual: Option<Terminal>) {
    use rustix::process::{Signal, getpid, kill_process};
    tracing::info!("stopped by Ctrl-Z, and so is the robot");
    let edited = usual.and_then(|usual| usual.enforce());
    let _ = kill_process(getpid(), Signal::STOP);
    // The signal may reach another thread first: nothing may be done in the meantime.
    std::thread::sleep(FALLING_ASLEEP);
    if let Some(edited) = edited {
        edited.restore();
    }
}
