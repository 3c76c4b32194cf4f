//! A message at the broker of MQTT that the config names. This room knows no broker: its owner
//! brings the way there.

use std::sync::Arc;
use std::time::Duration;

use super::content::content;
use super::delivery::Delivery;
use super::notice::Notice;
use super::options::Target;

/// What is to be published.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Letter {
    /// Where.
    pub topic: String,
    /// What.
    pub payload: Vec<u8>,
    /// How long it may take until the broker has it.
    pub limit: Duration,
}

/// Publishes a letter and waits until the broker has it; it may block. None: the config names no broker.
pub type Post = Option<Arc<dyn Fn(Letter) -> Delivery + Send + Sync>>;

/// Publishes it.
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
