//! The thread that communicates with the broker.

use std::io;
use std::sync::mpsc;
use std::time::Duration;

use tokio::runtime::Builder;
use tokio_util::sync::CancellationToken;

use super::broker_client::BrokerClient;
use super::connection::Account;
use crate::control::Run;
use crate::robot::Bus;

/// Timeout for a name lookup still in progress at the end.
const LOOKUP: Duration = Duration::from_millis(100);

/// Why the connection to the broker cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum MqttError {
    /// The system cannot start a thread.
    #[error("no thread for the broker: {0}")]
    Thread(#[from] io::Error),
}

/// An agent at a broker. Dropping it tells its thread to disconnect; [`Mqtt::finish`] waits for
/// that.
#[derive(Debug)]
pub struct Mqtt {
    stop: CancellationToken,
    ended: mpsc::Receiver<()>,
}

impl Mqtt {
    /// Publishes the bus's events from now on at this broker, and passes commands from there to the
    /// run. Connects once the robot's uid is known, and reconnects whenever the connection is lost.
    /// Does not wait for the network.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub fn start(bus: &Bus, run: Run, account: Account) -> Result<Mqtt, MqttError> {
        let stop = CancellationToken::new();
        let (alive, ended) = mpsc::sync_channel::<()>(1);
        let runtime = Builder::new_current_thread().enable_all().build()?;
        let listener = bus.subscribe();
        let stopped = stop.clone();
        let life = move || {
            runtime.block_on(BrokerClient::new(account, run, listener).run(&stopped));
            runtime.shutdown_timeout(LOOKUP);
            drop(alive);
        };
        std::thread::Builder::new()
            .name("mqtt".into())
            .spawn(life)?;
        Ok(Mqtt { stop, ended })
    }

    /// Waits at most this long until the last messages are published. Returns whether the thread
    /// ended in time.
    pub fn finish(self, limit: Duration) -> bool {
        self.stop.cancel();
        // Returns when the thread has dropped its end; nothing is ever sent.
        let ended = self.ended.recv_timeout(limit);
        ended == Err(mpsc::RecvTimeoutError::Disconnected)
    }
}

impl Drop for Mqtt {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}
