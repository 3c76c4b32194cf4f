//! The driving core: one thread with its own runtime, on which the pilot, the reader and writer of
//! the robot's socket and the agent's side of the hosts' pipes run. Nothing on it waits for a disk,
//! a new process or a name lookup: code that needs one of these runs elsewhere and sends the result
//! over a bounded channel.

use std::io;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

use tokio::runtime::{Builder, Handle};
use tokio_util::sync::CancellationToken;

/// How long the core may take to drop its tasks.
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
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system cannot create the thread or its runtime.
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

    /// The handle that spawns tasks on the core.
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicBool, Ordering};

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
}
