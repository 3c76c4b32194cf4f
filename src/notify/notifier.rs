//! The thread that listens to the bus and queues notifications.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::mpsc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::runtime::Builder;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::{debug, warn};

use super::broker::Post;
use super::notice::Notice;
use super::options::Options;
use super::queue::Queue;
use super::rules::{Rules, Said};
use super::sender::Sender;
use super::share::Share;
use crate::clock::until;
use crate::robot::{Bus, Heard, Listener};

/// Why notifications cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum NotifyError {
    /// The system cannot start a thread.
    #[error("no thread for notifications: {0}")]
    Thread(io::Error),
}

/// The running notifications. Dropping it tells its threads to end; [`Notifier::finish`] waits for
/// that.
#[derive(Debug)]
pub struct Notifier {
    stop: CancellationToken,
    ended: mpsc::Receiver<()>,
}

impl Notifier {
    /// Notifies the targets of these options of events on the bus from now on. `tokens` holds the
    /// targets' tokens by name; `post` publishes to the broker for targets that are topics. Waiting
    /// messages are stored in this data folder. Does not wait for disk or network.
    ///
    /// # Errors
    /// If the system cannot start the threads.
    pub fn start(
        bus: &Bus,
        data: &Path,
        options: &Options,
        tokens: &BTreeMap<String, String>,
        post: &Post,
    ) -> Result<Notifier, NotifyError> {
        let stop = CancellationToken::new();
        let (alive, ended) = mpsc::sync_channel::<()>(1);
        let now = Instant::now();
        let mut desks = Vec::new();
        for (name, target) in &options.targets {
            let (wake, woken) = mpsc::sync_channel(1);
            let sender = Sender {
                name: name.clone(),
                target: target.clone(),
                token: tokens.get(name).cloned().unwrap_or_default(),
                post: post.clone(),
                data: data.to_owned(),
            };
            let alive = alive.clone();
            let life = move || {
                sender.live(&woken);
                drop(alive);
            };
            let thread = std::thread::Builder::new().name("notify".into());
            thread.spawn(life).map_err(NotifyError::Thread)?;
            desks.push(Desk {
                name: name.clone(),
                target: target.clone(),
                share: Share::new(options.per_hour, now),
                wake,
            });
        }
        let runtime = Builder::new_current_thread().enable_time().build();
        let runtime = runtime.map_err(NotifyError::Thread)?;
        let voice = Voice {
            rules: Rules::new(options.unreachable_after.get(), now),
            data: data.to_owned(),
            desks,
        };
        let (listener, stopped) = (bus.listen(), stop.clone());
        let life = move || {
            runtime.block_on(voice.live(listener, stopped));
            drop(alive);
        };
        let thread = std::thread::Builder::new().name("voice".into());
        thread.spawn(life).map_err(NotifyError::Thread)?;
        Ok(Notifier { stop, ended })
    }

    /// Waits at most this long until all waiting messages were tried once more. Messages not sent
    /// stay in the queue on the disk for the next program. Returns whether all were tried.
    pub fn finish(self, limit: Duration) -> bool {
        self.stop.cancel();
        // Returns when every thread has dropped its end; nothing is ever sent.
        let ended = self.ended.recv_timeout(limit);
        ended == Err(mpsc::RecvTimeoutError::Disconnected)
    }
}

impl Drop for Notifier {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}

/// Accepts messages for one target.
struct Desk {
    name: String,
    target: super::Target,
    share: Share,
    wake: mpsc::SyncSender<()>,
}

struct Voice {
    rules: Rules,
    data: std::path::PathBuf,
    desks: Vec<Desk>,
}

impl Voice {
    async fn live(mut self, mut listener: Listener, stop: CancellationToken) {
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => break,
                () = until(self.rules.deadline()) => {
                    let now = Instant::now();
                    let said = self.rules.poll(now);
                    self.tell(said, now);
                }
                heard = listener.next() => if !self.hear(&heard) {
                    break;
                }
            }
        }
        while let Some(heard) = listener.try_next() {
            if !self.hear(&heard) {
                break;
            }
        }
    }

    /// Handles an event. Returns false if the bus is closed.
    fn hear(&mut self, heard: &Heard) -> bool {
        match heard {
            Heard::Happening(one) => {
                let said = self.rules.hear(&one.what, Instant::now());
                self.tell(said, one.at);
            }
            Heard::Missed(missed) => warn!(missed, "events were lost before a rule could see them"),
            Heard::Closed => return false,
        }
        true
    }

    fn tell(&mut self, said: Option<Said>, at: Instant) {
        let Some(Said {
            rule,
            text,
            picture,
        }) = said
        else {
            return;
        };
        let ago = SignedDuration::try_from(at.elapsed()).unwrap_or_default();
        let now = Timestamp::now();
        let notice = Notice {
            rule,
            text,
            robot: self.rules.robot().to_owned(),
            at: now.checked_sub(ago).unwrap_or(now).as_millisecond(),
            picture,
        };
        for desk in &mut self.desks {
            desk.take(&self.data, &notice);
        }
    }
}

impl Desk {
    fn take(&mut self, data: &Path, notice: &Notice) {
        if !self.target.wants(notice.rule) {
            return;
        }
        let name = &self.name;
        let Some(before) = self.share.take(Instant::now()) else {
            return debug!(
                target = name,
                "too many messages in an hour: one was dropped"
            );
        };
        let mut notice = notice.clone();
        if before > 0 {
            notice.text += &format!(" ({before} messages before this one were dropped)");
        }
        match Queue::open(data, name).and_then(|queue| queue.add(&notice)) {
            Ok(0) => {}
            Ok(gone) => warn!(
                target = name,
                gone, "too many messages are waiting: the oldest were deleted"
            ),
            Err(error) => warn!(
                target = name,
                "a message is lost, because it cannot be stored: {error}"
            ),
        }
        // If the channel is full, the sender is already awake.
        let _ = self.wake.try_send(());
    }
}
