//! The thread that listens to the bus and queues notifications.

use std::collections::BTreeMap;
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::Notify;
use tokio::task::JoinSet;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::{debug, warn};

use super::Notice;
use super::options::Options;
use super::queue::Queue;
use super::rules::Rules;
use super::sender::{BrokerPublisher, Sender};
use crate::clock::{Clock, Zone, until};
use crate::rate_limit::TokenBucket;
use crate::robot::{Bus, BusMessage, Listener};
use crate::side_thread::SideThread;

/// How long [`Notifier::finish`] waits, after its limit, until the targets' programs are killed.
const KILL_LIMIT: Duration = Duration::from_secs(1);
/// The most messages per target and hour; further ones are dropped and counted.
const MESSAGES_PER_HOUR: f64 = 30.0;

/// The running notifications. Dropping it tells its thread to end; [`Notifier::finish`] waits for
/// that.
#[derive(Debug)]
pub struct Notifier {
    thread: SideThread,
    /// Ends the targets' programs.
    abort: CancellationToken,
}

impl Notifier {
    /// Notifies the targets of these options of events on the bus from now on. `tokens` holds the
    /// targets' tokens by name; `publisher` publishes to the broker for targets that are topics.
    /// Waiting messages are stored in this data folder; their times are told in this zone. Does not wait
    /// for disk or network.
    pub fn start(
        bus: &Bus,
        data: &Path,
        zone: Zone,
        options: &Options,
        tokens: &BTreeMap<String, String>,
        publisher: &BrokerPublisher,
    ) -> io::Result<Notifier> {
        let abort = CancellationToken::new();
        let mut senders = Vec::new();
        let mut queues = Vec::new();
        for (name, target) in &options.targets {
            let sender = Arc::new(Sender {
                name: name.clone(),
                target: target.clone(),
                token: tokens.get(name).cloned().unwrap_or_default(),
                publisher: publisher.clone(),
                data: data.to_owned(),
                woken: Notify::new(),
                abort: abort.clone(),
            });
            senders.push(sender.clone());
            queues.push(TargetQueue {
                sender,
                rate_limit: rate_limit(),
            });
        }
        let dispatcher = Dispatcher {
            rules: Rules::new(options.unreachable_after.get(), Instant::now()),
            zone,
            queues,
        };
        let listener = bus.subscribe();
        let thread = SideThread::start("notify", |stop| async move {
            let last_try = CancellationToken::new();
            let sending = senders.into_iter().map(|one| one.run(last_try.clone()));
            let sending: JoinSet<()> = sending.collect();
            dispatcher.run(listener, stop).await;
            last_try.cancel();
            sending.join_all().await;
        })?;
        Ok(Notifier { thread, abort })
    }

    /// Waits at most this long until all waiting messages were tried once more; then kills the
    /// programs that have not ended. Messages not sent stay in the queue on the disk for the next
    /// agent. Returns whether all were tried.
    pub fn finish(self, limit: Duration) -> bool {
        let done = self.thread.finish(limit);
        if !done {
            self.abort.cancel();
            self.thread.finish(KILL_LIMIT);
        }
        done
    }
}

struct TargetQueue {
    sender: Arc<Sender>,
    rate_limit: TokenBucket,
}

struct Dispatcher {
    rules: Rules,
    zone: Zone,
    queues: Vec<TargetQueue>,
}

impl Dispatcher {
    async fn run(mut self, mut listener: Listener, stop: CancellationToken) {
        loop {
            tokio::select! {
                biased;
                () = until(self.rules.deadline()) => {
                    let now = Instant::now();
                    let notice = self.rules.poll(now);
                    self.enqueue(notice, now);
                }
                message = listener.next_until(&stop) => match message {
                    Some(message) => self.handle_event(&message),
                    None => break,
                }
            }
        }
    }

    fn handle_event(&mut self, message: &BusMessage) {
        match message {
            BusMessage::Event(one) => {
                let notice = self.rules.handle_event(&one.what, Instant::now());
                self.enqueue(notice, one.at);
            }
            BusMessage::Missed(missed) => {
                warn!(missed, "events were lost before a rule could see them")
            }
        }
    }

    fn enqueue(&mut self, notice: Option<Notice>, at: Instant) {
        let Some(notice) = notice else {
            return;
        };
        let notice = notice.at(Clock::default().time_of(at), &self.zone);
        for queue in &mut self.queues {
            queue.accept(&notice);
        }
    }
}

impl TargetQueue {
    fn accept(&mut self, notice: &Notice) {
        let sender = &self.sender;
        if !sender.target.wants(notice.rule) {
            return;
        }
        let name = &sender.name;
        let Some(before) = self.rate_limit.take_counted(1.0, Instant::now()) else {
            return debug!(
                target = name,
                "too many messages in an hour: one was dropped"
            );
        };
        let mut notice = notice.clone();
        if before > 0 {
            notice.text += &format!(" ({before} messages before this one were dropped)");
        }
        match Queue::open(&sender.data, name).and_then(|queue| queue.add(&notice)) {
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
        sender.woken.notify_one();
    }
}

/// Limits the messages to a target: an hourly rate, with a burst of a third of it.
fn rate_limit() -> TokenBucket {
    TokenBucket::new(MESSAGES_PER_HOUR / 3.0, MESSAGES_PER_HOUR / 3600.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_secs(3600);

    #[test]
    fn a_third_is_allowed_at_once_the_rest_evenly_and_drops_are_counted() {
        let mut now = Instant::now();
        let mut rate_limit = rate_limit();
        let burst = std::iter::repeat_with(|| rate_limit.take_counted(1.0, now)).take(50);
        assert_eq!(burst.flatten().count(), 10);
        now += HOUR / 30;
        assert_eq!(rate_limit.take_counted(1.0, now), Some(40));
        assert_eq!(rate_limit.take_counted(1.0, now), None);
        now += HOUR;
        let burst = std::iter::repeat_with(|| rate_limit.take_counted(1.0, now)).take(50);
        assert_eq!(burst.flatten().count(), 10);
    }
}
