//! Sends a notification to the config's MQTT broker. This module does not depend on MQTT: the
//! caller supplies the function that publishes.

use std::sync::Arc;
use std::time::Duration;

use super::content::content;
use super::delivery::Delivery;
use super::notice::Notice;
use super::options::Target;

/// The message to publish.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Letter {
    /// The topic.
    pub topic: String,
    /// The payload.
    pub payload: Vec<u8>,
    /// Timeout for the broker's confirmation.
    pub limit: Duration,
}

/// Publishes a letter and waits for the broker's confirmation; may block. `None` if the config
/// names no broker.
pub type Post = Option<Arc<dyn Fn(Letter) -> Delivery + Send + Sync>>;

/// Publishes a notification to this topic.
pub(super) fn send(
    (target, topic): (&Target, &str),
    post: &Post,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Delivery {
    let Some(post) = post else {
        return Delivery::Refused("the config names no broker".to_owned());
    };
    post(Letter {
        topic: topic.to_owned(),
        payload: content(target, "", notice, picture).bytes,
        limit: target.timeout.get(),
    })
}
