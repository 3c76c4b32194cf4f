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
pub struct BrokerMessage {
    /// The topic.
    pub topic: String,
    /// The payload.
    pub payload: Vec<u8>,
    /// Timeout for the broker's confirmation.
    pub limit: Duration,
}

/// Publishes a message and waits for the broker's confirmation; may block. `None` if the config
/// names no broker.
pub type BrokerPublisher = Option<Arc<dyn Fn(BrokerMessage) -> Delivery + Send + Sync>>;

/// Publishes a notification to this topic.
pub(super) fn send(
    (target, topic): (&Target, &str),
    publisher: &BrokerPublisher,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Delivery {
    let Some(publisher) = publisher else {
        return Delivery::Refused("the config names no broker".to_owned());
    };
    publisher(BrokerMessage {
        topic: topic.to_owned(),
        payload: content(target, "", notice, picture).bytes,
        limit: target.timeout.get(),
    })
}
