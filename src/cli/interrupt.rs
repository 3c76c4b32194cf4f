//! Handles the signals that end or suspend a program, for programs that drive a robot.

use std::future::Future;
use std::time::Duration;

use futures_util::future::select_all;
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};
use tokio::runtime::Handle;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::Failure;
use crate::robot::channel::{Request, Suspend};

/// Time for SIGSTOP to suspend this program.
const SUSPEND_DELAY: Duration = Duration::from_millis(50);

/// Signals that terminate a program by default. Here each ends the run in an orderly way and stops
/// the tracks first. SIGKILL cannot be handled, and after SIGABRT and similar signals the program's
/// state cannot be trusted: then the guardian stops the robot.
const TERMINATING: [i32; 13] = [
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

/// Returns a future that completes at the first terminating signal from now on.
pub(super) fn interruption() -> Result<impl Future<Output = ()> + Send, Failure> {
    let mut signals = TerminatingSignals::except(&[])?;
    Ok(async move { signals.next().await })
}

/// The result of the work; `None`: a terminating signal came first.
pub(super) async fn unless_interrupted<T>(
    work: impl Future<Output = T>,
) -> Result<Option<T>, Failure> {
    let interrupted = interruption()?;
    Ok(tokio::select! {
        biased;
        () = interrupted => None,
        done = work => Some(done),
    })
}

/// A listener for the signals that terminate a program by default.
pub(super) struct TerminatingSignals(Vec<Signal>);

impl TerminatingSignals {
    /// Listens from now on to all of them except those that the caller handles itself.
    pub(super) fn except(others: &[i32]) -> Result<TerminatingSignals, Failure> {
        let ours = TERMINATING.iter().filter(|number| !others.contains(number));
        let signals: Result<_, Failure> = ours.map(|&number| listen(number)).collect();
        signals.map(TerminatingSignals)
    }

    pub(super) async fn next(&mut self) {
        select_all(self.0.iter_mut().map(|signal| Box::pin(signal.recv()))).await;
    }
}

/// Listens to a signal from now on, which replaces its default action.
pub(super) fn listen(number: i32) -> Result<Signal, Failure> {
    signal(SignalKind::from_raw(number)).map_err(|error| Failure::io("receive signals", error))
}

/// From now on the first terminating signal cancels `stop`, and Ctrl-Z first stops the robot, by a
/// request to its pilot, then suspends this program. The driving core handles the signals: any
/// other thread may be blocked on the disk. The caller handles `others` itself. While this program
/// is suspended the terminal has its `original` settings, if any.
pub(super) fn handle_signals(
    core: &Handle,
    requests: mpsc::Sender<Request>,
    stop: CancellationToken,
    others: &[i32],
    original: Option<Terminal>,
) -> Result<(), Failure> {
    let _guard = core.enter();
    let mut ending = TerminatingSignals::except(others)?;
    let mut stopped = listen(libc::SIGTSTP)?;
    core.spawn(async move {
        ending.next().await;
        stop.cancel();
    });
    core.spawn(async move {
        while stopped.recv().await.is_some() {
            let original = original.clone();
            let suspend = Suspend(Box::new(move || suspend(original)));
            if requests.send(Request::Suspend(suspend)).await.is_err() {
                return;
            }
        }
    });
    Ok(())
}

/// Suspends this program as the terminal would have done; returns when it is resumed.
fn suspend(original: Option<Terminal>) {
    use rustix::process::{Signal, getpid, kill_process};
    tracing::info!("suspended by Ctrl-Z; the robot is stopped");
    let edited = original.and_then(|original| original.enforce());
    let _ = kill_process(getpid(), Signal::STOP);
    // The signal may reach another thread first: do nothing until it has taken effect.
    std::thread::sleep(SUSPEND_DELAY);
    if let Some(edited) = edited {
        edited.restore();
    }
}

/// Settings that more than this many successive checks find unchanged count as stable.
const STABLE_CHECKS: u32 = 3;
const MAX_CHECKS: u32 = 20;
const CHECK_PAUSE: Duration = Duration::from_millis(10);

#[derive(Clone)]
pub(super) struct Terminal(Option<Termios>);

impl Terminal {
    pub(super) fn current() -> Terminal {
        Terminal(tcgetattr(rustix::stdio::stdin()).ok())
    }

    /// Restores these settings. An editor that is still reading cannot do this itself.
    pub(super) fn restore(&self) {
        if let Some(settings) = &self.0 {
            let _ = tcsetattr(rustix::stdio::stdin(), OptionalActions::Now, settings);
        }
    }

    /// Sets these settings repeatedly until they are stable: an editor that was suspended by a key
    /// may set its own once more meanwhile. Returns the settings that it replaced, if any.
    pub(super) fn enforce(&self) -> Option<Terminal> {
        let mut others = None;
        let mut unchanged = 0;
        for _ in 0..MAX_CHECKS {
            let now = Terminal::current();
            if now == *self {
                unchanged += 1;
            } else {
                (others, unchanged) = (Some(now), 0);
                self.restore();
            }
            if unchanged > STABLE_CHECKS {
                break;
            }
            std::thread::sleep(CHECK_PAUSE);
        }
        others
    }
}

impl PartialEq for Terminal {
    fn eq(&self, other: &Terminal) -> bool {
        let modes = |one: &Terminal| one.0.as_ref().map(|settings| settings.local_modes);
        modes(self) == modes(other)
    }
}
