//! The thread that speaks with the broker.

use std::io;
use std::sync::mpsc;
use std::time::Duration;

use tokio::runtime::Builder;
use tokio_util::sync::CancellationToken;

use super::envoy::Envoy;
use super::line::Account;
use crate::control::Run;
use crate::robot::Bus;

/// The longest wait for a name lookup, when all else is done.
const LOOKUP: Duration = Duration::from_millis(100);

/// Why there is no broker.
#[derive(Debug, thiserror::Error)]
pub enum MqttError {
    /// The system gives no thread.
    #[error("no thread for the broker: {0}")]
    Thread(#[from] io::Error),
}

/// An agent at a broker. Dropping it asks its thread to say goodbye; [`Mqtt::finish`] waits for that.
#[derive(Debug)]
pub struct Mqtt {
    stop: CancellationToken,
    ended: mpsc::Receiver<()>,
}

impl Mqtt {
    /// Says at this broker what happens on the bus from now on, and brings what is asked there to the
    /// run. It connects once the robot has said who it is, and again and again. Waits for no network.
    ///
    /// # Errors
    /// If the system gives no thread.
    pub fn start(bus: &Bus, run: Run, account: Account) -> Result<Mqtt, MqttError> {
        let stop = CancellationToken::new();
        let (alive, ended) = mpsc::sync_channel::<()>(1);
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let (listener, stopped) = (bus.listen(), stop.clone());
        let life = move || {
            runtime.block_on(Envoy::new(account, run, listener).live(&stopped));
            runtime.shutdown_timeout(LOOKUP);
            drop(alive);
        };
        std::thread::Builder::new()
            .name("mqtt".into())
            .spawn(life)?;
        Ok(Mqtt { stop, ended })
    }

    /// Waits, at most so long, until the broker has the last words. Whether it ended in time.
    pub fn finish(self, limit: Duration) -> bool {
        self.stop.cancel();
        // Ends when the thread has dropped its end; nothing is ever sent.
        let ended = self.ended.recv_timeout(limit);
        ended == Err(mpsc::RecvTimeoutError::Disconnected)
    }
}

impl Drop for Mqtt {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}
