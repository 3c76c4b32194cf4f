//! The task of one target: sends the messages in its queue, with growing pauses after failures.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::Notify;
use tokio::task::spawn_blocking;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::command;
use super::options::{PictureMode, Target};
use super::queue::Queue;
use super::webhook;
use super::{Delivery, Notice};
use crate::files;
use crate::rate_limit::Backoff;

/// The first pause after a failure; each further one is twice as long ...
const FIRST_PAUSE: Duration = Duration::from_secs(5);
/// ... up to this maximum.
const LONGEST_PAUSE: Duration = Duration::from_secs(900);
/// Polling interval of the queue: another program may have left messages there.
const POLL_INTERVAL: Duration = Duration::from_secs(30);
/// Maximum size of a picture, in bytes; a larger one is not sent.
const LARGEST_PICTURE: u64 = 8 << 20;
pub const DELIVERY_TIMEOUT: Duration = Duration::from_secs(15);

/// Publishes a payload under a topic and waits for the broker's confirmation, at most for
/// [`DELIVERY_TIMEOUT`]; blocks. `None` if the config names no broker.
pub type BrokerPublisher = Option<Arc<dyn Fn(&str, Vec<u8>) -> Delivery + Send + Sync>>;

/// Sends one message now; `publisher` publishes to the broker, and `abort` ends a program that the
/// target starts.
pub fn deliver(
    target: &Target,
    token: &str,
    publisher: &BrokerPublisher,
    notice: &Notice,
    abort: &CancellationToken,
) -> Delivery {
    let picture = || {
        if target.picture == PictureMode::None {
            return None;
        }
        let path = notice.picture.as_deref();
        path.and_then(|path| files::read_jpeg(path, LARGEST_PICTURE))
    };
    match (&target.url, &target.topic) {
        (Some(url), _) => webhook::send(target, url, token, notice, picture().as_deref()),
        (None, Some(topic)) => match publisher {
            Some(publish) => {
                let content = webhook::content(target, "", notice, picture().as_deref());
                publish(topic, content.bytes)
            }
            None => Delivery::Refused("the config names no broker".to_owned()),
        },
        (None, None) => {
            let picture = notice.picture.as_deref();
            command::send(target, notice, picture, DELIVERY_TIMEOUT, abort)
        }
    }
}

pub(super) struct Sender {
    pub(super) name: String,
    pub(super) target: Target,
    pub(super) token: String,
    pub(super) publisher: BrokerPublisher,
    pub(super) data: PathBuf,
    /// Told of each new message in the queue.
    pub(super) woken: Notify,
    /// Ends the delivery that is under way, if it is by a program; no further one begins.
    pub(super) abort: CancellationToken,
}

impl Sender {
    /// Sends the messages as they come, and tries the waiting ones once more at the last try.
    /// Returns early if it is aborted.
    pub(super) async fn run(self: Arc<Sender>, last_try: CancellationToken) {
        let mut backoff = Backoff::new(FIRST_PAUSE, LONGEST_PAUSE);
        loop {
            let is_last = last_try.is_cancelled();
            let sender = self.clone();
            let sent = spawn_blocking(move || sender.send_all()).await;
            let sent = sent.unwrap_or(false);
            if is_last || self.abort.is_cancelled() {
                return;
            }
            let pause = if sent {
                backoff.reset();
                POLL_INTERVAL
            } else {
                backoff.step()
            };
            tokio::select! {
                () = last_try.cancelled() => {}
                // A new message does not shorten the pause after a failure.
                () = self.woken.notified(), if sent => {}
                () = sleep(pause) => {}
            }
        }
    }

    /// Sends the waiting messages. Returns false at the first one that cannot be sent now.
    fn send_all(&self) -> bool {
        let mut queue = match Queue::open(&self.data, &self.name) {
            Ok(queue) => queue,
            Err(error) => {
                warn!(target = self.name, "its messages cannot be read: {error}");
                return false;
            }
        };
        while !self.abort.is_cancelled() && queue.len() > 0 && queue.is_ours() {
            let now = Timestamp::now().as_millisecond();
            let (name, notice) = match queue.oldest(now) {
                Ok(Some(oldest)) => oldest,
                Ok(None) => return true,
                Err(_) => return false,
            };
            let delivery = deliver(
                &self.target,
                &self.token,
                &self.publisher,
                &notice,
                &self.abort,
            );
            match delivery {
                Delivery::Done => {
                    let event = notice.rule.name();
                    info!(target = self.name, event, "notification sent");
                    queue.remove(&name);
                }
                Delivery::Refused(why) => {
                    warn!(target = self.name, "a message was dropped: {why}");
                    queue.remove(&name);
                }
                Delivery::Later(why) => {
                    let waiting = queue.len();
                    warn!(
                        target = self.name,
                        waiting, "notification not sent yet: {why}"
                    );
                    return false;
                }
            }
        }
        true
    }
}
