//! Threads beside the driving core, for work that waits for a disk, a network or another program.

use std::io;
use std::sync::mpsc;
use std::time::Duration;

use parking_lot::Mutex;
use tokio::runtime::Builder;
use tokio_util::sync::CancellationToken;

/// How long the lookup of a name may delay the end of a thread.
const LOOKUP: Duration = Duration::from_millis(100);

/// A thread with a runtime of its own. Dropping it asks the thread to end, without waiting.
#[derive(Debug)]
pub struct SideThread {
    stop: CancellationToken,
    /// Fails when the thread has dropped its end; nothing is ever sent.
    ended: Mutex<mpsc::Receiver<()>>,
}

impl SideThread {
    /// Runs `life` on a thread of this name. `life` may block, and ends soon after its token is
    /// cancelled.
    pub fn start<F: Future<Output = ()>>(
        name: &str,
        life: impl FnOnce(CancellationToken) -> F + Send + 'static,
    ) -> io::Result<SideThread> {
        let failed =
            |error| io::Error::other(format!("the thread `{name}` cannot be started: {error}"));
        let runtime = Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(failed)?;
        let stop = CancellationToken::new();
        let stopped = stop.clone();
        let (alive, ended) = mpsc::sync_channel(1);
        let thread = std::thread::Builder::new().name(name.to_owned());
        let run = move || {
            runtime.block_on(life(stopped));
            runtime.shutdown_timeout(LOOKUP);
            drop(alive);
        };
        thread.spawn(run).map_err(failed)?;
        let ended = Mutex::new(ended);
        Ok(SideThread { stop, ended })
    }

    /// Asks the thread to end, and waits for that at most this long. Returns whether it has ended.
    pub fn finish(&self, limit: Duration) -> bool {
        self.stop.cancel();
        let ended = self.ended.lock();
        ended.recv_timeout(limit) == Err(mpsc::RecvTimeoutError::Disconnected)
    }
}

impl Drop for SideThread {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finish_tells_whether_the_thread_has_ended_in_time() {
        let (release, held) = mpsc::channel::<()>();
        let thread = SideThread::start("test", |stop| async move {
            stop.cancelled().await;
            let _ = held.recv();
        });
        let thread = thread.unwrap();
        assert!(!thread.finish(Duration::from_millis(1)));
        drop(release);
        assert!(thread.finish(Duration::from_secs(60)));
    }
}
