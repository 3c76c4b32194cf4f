//! The content sent to a webhook or broker: a text, JSON, a picture, or a form with text and
//! picture.

use std::borrow::Cow;
use std::sync::Arc;
use std::time::Duration;

use serde_json::Value;

use super::notice::{Delivery, Notice};
use super::options::{PictureMode, Target};
use super::sender::DELIVERY_TIMEOUT;
use super::template::{Slot, fill, fill_json};

#[derive(Debug, PartialEq)]
pub(super) struct Content {
    pub(super) kind: Cow<'static, str>,
    pub(super) bytes: Vec<u8>,
}

pub(super) fn content(
    target: &Target,
    token: &str,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Content {
    let json = target
        .json
        .as_ref()
        .map(|json| fill_json(json, notice, token));
    let body = target.body.as_deref().unwrap_or("{text}");
    let text = || fill(body, notice, token, Slot::Plain);
    match (picture, target.picture, json) {
        (Some(picture), PictureMode::Body, _) => Content {
            kind: "image/jpeg".into(),
            bytes: picture.to_vec(),
        },
        (Some(picture), PictureMode::Form, json) => {
            let name = notice.picture.as_ref().and_then(|path| path.file_name());
            let name = name.unwrap_or_default().to_string_lossy();
            let boundary = boundary();
            Content {
                kind: format!("multipart/form-data; boundary={boundary}").into(),
                bytes: form(&boundary, &fields(json, text), &name, picture),
            }
        }
        (_, _, Some(json)) => Content {
            kind: "application/json".into(),
            bytes: json.to_string().into_bytes(),
        },
        _ => Content {
            kind: "text/plain; charset=utf-8".into(),
            bytes: text().into_bytes(),
        },
    }
}

fn fields(json: Option<Value>, text: impl Fn() -> String) -> Vec<(String, String)> {
    let Some(Value::Object(map)) = json else {
        return vec![("body".to_owned(), text())];
    };
    let plain = |value: Value| match value {
        Value::String(text) => text,
        value => value.to_string(),
    };
    map.into_iter()
        .map(|(key, value)| (key, plain(value)))
        .collect()
}

/// Returns the separator of a form's parts. It is random, so that no text or picture of a script or
/// robot can contain it and add a part.
fn boundary() -> String {
    format!("spykee-{:032x}", rand::random::<u128>())
}

/// Encodes a form. The field names come from the config, their texts from any source.
fn form(boundary: &str, fields: &[(String, String)], name: &str, picture: &[u8]) -> Vec<u8> {
    let quoted = |text: &str| text.replace(['"', '\r', '\n', '\\'], "_");
    let mut bytes = Vec::new();
    for (key, value) in fields {
        let key = quoted(key);
        let part = format!(
            "--{boundary}\r\nContent-Disposition: form-data; name=\"{key}\"\r\n\
             Content-Type: text/plain; charset=utf-8\r\n\r\n{value}\r\n"
        );
        bytes.extend_from_slice(part.as_bytes());
    }
    let name = quoted(name);
    let head = format!(
        "--{boundary}\r\nContent-Disposition: form-data; name=\"attachment\"; filename=\"{name}\"\r\n\
         Content-Type: image/jpeg\r\n\r\n"
    );
    bytes.extend_from_slice(head.as_bytes());
    bytes.extend_from_slice(picture);
    bytes.extend_from_slice(format!("\r\n--{boundary}--\r\n").as_bytes());
    bytes
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BrokerMessage {
    pub topic: String,
    pub payload: Vec<u8>,
    /// Timeout for the broker's confirmation.
    pub limit: Duration,
}

/// Publishes a message and waits for the broker's confirmation; may block. `None` if the config
/// names no broker.
pub type BrokerPublisher = Option<Arc<dyn Fn(BrokerMessage) -> Delivery + Send + Sync>>;

pub(super) fn publish(
    target: &Target,
    topic: &str,
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
        limit: DELIVERY_TIMEOUT,
    })
}
