//! Notifies the service manager of the service's state: systemd, or whatever listens at
//! `$NOTIFY_SOCKET`. A separate thread sends the notifications, so that a manager that does not
//! read blocks nothing.

use std::sync::Arc;

use sd_notify::NotifyState;
use tokio::sync::{Notify, mpsc};
use tokio::time::Instant;

use crate::side_thread::SideThread;

/// Capacity of the queue. Further messages are dropped; the next change sends the current state.
const WAITING: usize = 16;

/// Cheap to clone; without a manager it does nothing.
#[derive(Debug, Clone, Default)]
pub struct ManagerNotifier {
    /// Lines for the manager, such as `READY=1`.
    messages: Option<mpsc::Sender<String>>,
}

impl ManagerNotifier {
    pub fn of_environment() -> ManagerNotifier {
        if std::env::var_os("NOTIFY_SOCKET").is_none() {
            return ManagerNotifier::default();
        }
        let (messages, received) = mpsc::channel(WAITING);
        let started = SideThread::start("sd-notify", |_| forward(received));
        let messages = started
            .map_err(|error| tracing::warn!("the service manager cannot be notified: {error}"))
            .map(|_| messages);
        ManagerNotifier {
            messages: messages.ok(),
        }
    }

    pub fn ready(&self) {
        self.send("READY=1".to_owned());
    }

    /// Line breaks in the text would begin another message.
    pub fn status(&self, text: &str) {
        self.send(format!("STATUS={}", text.replace(['\n', '\r'], " ")));
    }

    pub fn stopping(&self) {
        self.send("STOPPING=1".to_owned());
    }

    /// Forwards the heartbeats of the driving core to the manager's watchdog, if it has one, four
    /// times per watchdog timeout. There is no timer: without heartbeats nothing is forwarded.
    /// Never returns.
    pub async fn pass_on(&self, beats: Arc<Notify>) -> std::convert::Infallible {
        let Some(timeout) = sd_notify::watchdog_enabled() else {
            return std::future::pending().await;
        };
        let pace = timeout / 4;
        let mut last: Option<Instant> = None;
        loop {
            beats.notified().await;
            let now = Instant::now();
            if last.is_none_or(|last| now.saturating_duration_since(last) >= pace) {
                last = Some(now);
                self.send("WATCHDOG=1".to_owned());
            }
        }
    }

    fn send(&self, message: String) {
        if let Some(sender) = &self.messages {
            let _ = sender.try_send(message);
        }
    }
}

async fn forward(mut messages: mpsc::Receiver<String>) {
    let mut failed = false;
    while let Some(message) = messages.recv().await {
        let sent = sd_notify::notify(&[NotifyState::Custom(&message)]);
        if let (Err(error), false) = (sent, failed) {
            tracing::warn!("the service manager cannot be notified: {error}");
            failed = true;
        }
    }
}
