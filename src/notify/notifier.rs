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

use super::content::BrokerPublisher;
use super::notice::Notice;
use super::options::Options;
use super::queue::Queue;
use super::rules::{Notification, Rules};
use super::sender::Sender;
use crate::clock::until;
use crate::rate_limit::TokenBucket;
use crate::robot::{Bus, BusMessage, Listener};

/// How long [`Notifier::finish`] waits, after its limit, until the targets' programs are killed.
const KILL_LIMIT: Duration = Duration::from_secs(1);
/// The most messages per target and hour; further ones are dropped and counted.
const MESSAGES_PER_HOUR: f64 = 30.0;

/// Why notifications cannot be started.
#[derive(Debug, thiserror::Error)]
pub enum NotifyError {
    #[error("no thread for notifications: {0}")]
    Thread(io::Error),
}

/// The running notifications. Dropping it tells its threads to end; [`Notifier::finish`] waits for
/// that.
#[derive(Debug)]
pub struct Notifier {
    stop: CancellationToken,
    /// Ends the targets' programs.
    abort: CancellationToken,
    ended: mpsc::Receiver<()>,
}

impl Notifier {
    /// Notifies the targets of these options of events on the bus from now on. `tokens` holds the
    /// targets' tokens by name; `publisher` publishes to the broker for targets that are topics.
    /// Waiting messages are stored in this data folder. Does not wait for disk or network.
    pub fn start(
        bus: &Bus,
        data: &Path,
        options: &Options,
        tokens: &BTreeMap<String, String>,
        publisher: &BrokerPublisher,
    ) -> Result<Notifier, NotifyError> {
        let stop = CancellationToken::new();
        let abort = CancellationToken::new();
        let (alive, ended) = mpsc::sync_channel::<()>(1);
        let now = Instant::now();
        let mut queues = Vec::new();
        for (name, target) in &options.targets {
            let (wake, woken) = mpsc::sync_channel(1);
            let sender = Sender {
                name: name.clone(),
                target: target.clone(),
                token: tokens.get(name).cloned().unwrap_or_default(),
                publisher: publisher.clone(),
                data: data.to_owned(),
                abort: abort.clone(),
            };
            spawn("notify", &alive, move || sender.run(&woken))?;
            queues.push(TargetQueue {
                name: name.clone(),
                target: target.clone(),
                rate_limit: RateLimit::new(),
                wake,
            });
        }
        let runtime = Builder::new_current_thread().enable_time().build();
        let runtime = runtime.map_err(NotifyError::Thread)?;
        let dispatcher = Dispatcher {
            rules: Rules::new(options.unreachable_after.get(), now),
            data: data.to_owned(),
            queues,
        };
        let listener = bus.subscribe();
        let stopped = stop.clone();
        spawn("notify-rules", &alive, move || {
            runtime.block_on(dispatcher.run(listener, stopped));
        })?;
        Ok(Notifier { stop, abort, ended })
    }

    /// Waits at most this long until all waiting messages were tried once more; then kills the
    /// programs that have not ended. Messages not sent stay in the queue on the disk for the next
    /// agent. Returns whether all were tried.
    pub fn finish(self, limit: Duration) -> bool {
        self.stop.cancel();
        let done = self.wait(limit);
        if !done {
            self.abort.cancel();
            self.wait(KILL_LIMIT);
        }
        done
    }

    /// Waits at most this long until all threads have ended. Returns whether they have.
    fn wait(&self, limit: Duration) -> bool {
        // Returns when every thread has dropped its end; nothing is ever sent.
        let ended = self.ended.recv_timeout(limit);
        ended == Err(mpsc::RecvTimeoutError::Disconnected)
    }
}

/// Starts a thread that keeps a copy of `alive` until its end.
fn spawn(
    name: &str,
    alive: &mpsc::SyncSender<()>,
    life: impl FnOnce() + Send + 'static,
) -> Result<(), NotifyError> {
    let alive = alive.clone();
    let life = move || {
        life();
        drop(alive);
    };
    let thread = std::thread::Builder::new().name(name.to_owned());
    thread.spawn(life).map_err(NotifyError::Thread)?;
    Ok(())
}

impl Drop for Notifier {
    fn drop(&mut self) {
        self.stop.cancel();
    }
}

struct TargetQueue {
    name: String,
    target: super::Target,
    rate_limit: RateLimit,
    wake: mpsc::SyncSender<()>,
}

struct Dispatcher {
    rules: Rules,
    data: std::path::PathBuf,
    queues: Vec<TargetQueue>,
}

impl Dispatcher {
    async fn run(mut self, mut listener: Listener, stop: CancellationToken) {
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => break,
                () = until(self.rules.deadline()) => {
                    let now = Instant::now();
                    let notification = self.rules.poll(now);
                    self.enqueue(notification, now);
                }
                message = listener.next() => if !self.handle_event(&message) {
                    break;
                }
            }
        }
        while let Some(message) = listener.try_next() {
            if !self.handle_event(&message) {
                break;
            }
        }
    }

    /// Handles an event. Returns false if the bus is closed.
    fn handle_event(&mut self, message: &BusMessage) -> bool {
        match message {
            BusMessage::Event(one) => {
                let notification = self.rules.handle_event(&one.what, Instant::now());
                self.enqueue(notification, one.at);
            }
            BusMessage::Missed(missed) => {
                warn!(missed, "events were lost before a rule could see them")
            }
            BusMessage::Closed => return false,
        }
        true
    }

    fn enqueue(&mut self, notification: Option<Notification>, at: Instant) {
        let Some(Notification {
            rule,
            text,
            picture,
        }) = notification
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
        for queue in &mut self.queues {
            queue.accept(&self.data, &notice);
        }
    }
}

impl TargetQueue {
    fn accept(&mut self, data: &Path, notice: &Notice) {
        if !self.target.wants(notice.rule) {
            return;
        }
        let name = &self.name;
        let Some(before) = self.rate_limit.take(Instant::now()) else {
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

/// Limits the messages to a target: an hourly rate, with a burst of a third of it.
#[derive(Debug)]
struct RateLimit {
    bucket: TokenBucket,
    /// Messages dropped since the last one that was allowed.
    dropped: u64,
}

impl RateLimit {
    fn new() -> RateLimit {
        RateLimit {
            bucket: TokenBucket::new(MESSAGES_PER_HOUR / 3.0, MESSAGES_PER_HOUR / 3600.0),
            dropped: 0,
        }
    }

    /// Allows one message, and returns the number of messages dropped before it; `None` if this one
    /// must be dropped.
    fn take(&mut self, now: Instant) -> Option<u64> {
        if !self.bucket.take(1.0, now) {
            self.dropped += 1;
            return None;
        }
        Some(std::mem::take(&mut self.dropped))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_secs(3600);

    #[test]
    fn a_third_is_allowed_at_once_the_rest_evenly_and_drops_are_counted() {
        let mut now = Instant::now();
        let mut rate_limit = RateLimit::new();
        let burst = std::iter::repeat_with(|| rate_limit.take(now)).take(50);
        assert_eq!(burst.flatten().count(), 10);
        now += HOUR / 30;
        assert_eq!(rate_limit.take(now), Some(40));
        assert_eq!(rate_limit.take(now), None);
        now += HOUR;
        let burst = std::iter::repeat_with(|| rate_limit.take(now)).take(50);
        assert_eq!(burst.flatten().count(), 10);
    }
}
