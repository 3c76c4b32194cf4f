//! The signals that end a program.

use std::future::{Future, poll_fn};
use std::task::Poll;

use tokio::signal::unix::{Signal, SignalKind, signal};

use super::Failure;

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
        .map_err(|error| Failure::usage(format_args!("cannot hear signals: {error}")))
}
