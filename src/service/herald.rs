//! Tells the system's manager how the service is: systemd, or what listens at `$NOTIFY_SOCKET`. A
//! thread of its own does the telling: a manager that does not read blocks nothing.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use sd_notify::NotifyState;
use tokio::sync::Notify;
use tokio::time::Instant;

/// News that may wait; more are dropped, and told anew with the next change.
const WAITING: usize = 16;

enum News {
    Ready,
    Status(String),
    Alive,
    Stopping,
}

/// See the module. Cheap to clone; without a manager it does nothing.
#[derive(Debug, Clone, Default)]
pub struct Herald {
    news: Option<SyncSender<News>>,
}

impl Herald {
    /// Tells the manager that the environment names.
    pub fn of_environment() -> Herald {
        if std::env::var_os("NOTIFY_SOCKET").is_none() {
            return Herald::default();
        }
        let (news, told) = sync_channel(WAITING);
        let thread = std::thread::Builder::new().name("herald".into());
        match thread.spawn(move || tell(&told)) {
            Ok(_) => Herald { news: Some(news) },
            Err(error) => {
                tracing::warn!("the system's manager is told nothing: no thread: {error}");
                Herald::default()
            }
        }
    }

    /// The service has begun.
    pub fn ready(&self) {
        self.say(News::Ready);
    }

    /// One line that says what it does.
    pub fn status(&self, text: impl Into<String>) {
        self.say(News::Status(text.into()));
    }

    /// It comes to its end.
    pub fn stopping(&self) {
        self.say(News::Stopping);
    }

    /// Passes the beats of the driving core on to the manager's watchdog, if it has one, as often as it
    /// wants to hear them. There is no timer: without beats nothing is passed on. Never returns.
    pub async fn pass_on(&self, beats: Arc<Notify>) -> std::convert::Infallible {
        let Some(patience) = sd_notify::watchdog_enabled() else {
            return std::future::pending().await;
        };
        let pace = patience / 4;
        let mut last: Option<Instant> = None;
        loop {
            beats.notified().await;
            let now = Instant::now();
            if last.is_none_or(|last| now.saturating_duration_since(last) >= pace) {
                last = Some(now);
                self.say(News::Alive);
            }
        }
    }

    fn say(&self, news: News) {
        if let Some(sender) = &self.news {
            let _ = sender.try_send(news);
        }
    }
}

fn tell(news: &Receiver<News>) {
    let mut failed = false;
    let mut send = |state: &[NotifyState<'_>]| {
        if let (Err(error), false) = (sd_notify::notify(state), failed) {
            tracing::warn!("the system's manager cannot be told: {error}");
            failed = true;
        }
    };
    while let Ok(news) = news.recv() {
        match news {
            News::Ready => send(&[NotifyState::Ready]),
            News::Status(text) => send(&[NotifyState::Status(&one_line(&text))]),
            News::Alive => send(&[NotifyState::Watchdog]),
            News::Stopping => send(&[NotifyState::Stopping]),
        }
    }
}

/// A line's end would begin another message.
fn one_line(text: &str) -> String {
    text.replace(['\n', '\r'], " ")
}
