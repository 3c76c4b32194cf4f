//! One connection to a broker: everything that depends on rumqttc. A broken connection is not
//! resumed but replaced by a new one, so that messages queued on the old one are never sent later.

use std::time::Duration;

use bytes::Bytes;
use rumqttc::{
    AsyncClient, ConnectReturnCode, ConnectionError, Event, EventLoop, LastWill, MqttOptions,
    NetworkOptions, Packet, QoS, TlsConfiguration, Transport,
};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use crate::config;

/// Capacity of the queue to the broker.
const MOST_WAITING: usize = 64;
/// Capacity of the queue of received messages.
const MOST_COMING: usize = 64;
/// Maximum length of a received message (an order, a state, a birth message), in bytes.
const LONGEST_COMING: usize = 64 << 10;
/// Maximum length of a sent message (a picture), in bytes.
pub(super) const LONGEST_SENT: usize = 1 << 20;
/// Timeout for the connection, in seconds.
const CONNECTING: u64 = 10;

/// A broker and our account there; the secrets have already been read.
#[derive(Clone)]
pub struct Account {
    /// The `mqtt:` section of the config.
    pub options: config::Mqtt,
    /// The password of its user.
    pub password: Option<String>,
    /// The certificates of its `ca_file`.
    pub ca: Option<Vec<u8>>,
}

impl std::fmt::Debug for Account {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Account").field(&self.options).finish()
    }
}

/// A received message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Message {
    pub(super) topic: String,
    pub(super) payload: Bytes,
    /// Whether it was retained by the broker from before our subscription.
    pub(super) retained: bool,
}

/// An event on a connection.
#[derive(Debug)]
pub(super) enum Word {
    /// The broker has accepted the connection.
    Up,
    /// A message was received.
    Message(Message),
    /// The broker has confirmed a subscription.
    Subscribed,
    /// The broker has confirmed a message of ours.
    Acknowledged,
    /// The connection is lost, for this reason.
    Lost(String),
}

/// The message that the broker publishes if the connection breaks.
pub(super) struct Will {
    pub(super) topic: String,
    pub(super) payload: &'static str,
}

/// The queue is full: the broker is slower than we are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Full;

/// A connection in progress or established. Dropping it breaks it, and the broker publishes the
/// will.
#[derive(Debug)]
pub(super) struct Line {
    client: AsyncClient,
    words: mpsc::Receiver<Word>,
    pump: JoinHandle<()>,
}

impl Drop for Line {
    fn drop(&mut self) {
        self.pump.abort();
    }
}

impl Line {
    /// Starts to connect, with this client ID.
    pub(super) fn dial(account: &Account, client: &str, will: Option<Will>) -> Line {
        let (host, port) = account.options.address().unwrap_or(("localhost", 1883));
        let mut options = MqttOptions::new(client, host, port);
        options.set_clean_session(true);
        options.set_keep_alive(account.options.keep_alive.get());
        options.set_max_packet_size(LONGEST_COMING, LONGEST_SENT);
        if let Some(user) = &account.options.user {
            options.set_credentials(user, account.password.clone().unwrap_or_default());
        }
        if let Some(ca) = &account.ca {
            let tls = TlsConfiguration::Simple {
                ca: ca.clone(),
                alpn: None,
                client_auth: None,
            };
            options.set_transport(Transport::tls_with_config(tls));
        }
        if let Some(Will { topic, payload }) = will {
            options.set_last_will(LastWill::new(topic, payload, QoS::AtLeastOnce, true));
        }
        let (client, mut events) = AsyncClient::new(options, MOST_WAITING);
        let mut network = NetworkOptions::new();
        network.set_connection_timeout(CONNECTING);
        events.set_network_options(network);
        let (say, words) = mpsc::channel(MOST_COMING);
        let pump = tokio::spawn(pump(events, say));
        Line {
            client,
            words,
            pump,
        }
    }

    /// Waits for the next event; after [`Word::Lost`], returns [`Word::Lost`] each time.
    /// Cancel-safe.
    pub(super) async fn next(&mut self) -> Word {
        let lost = || Word::Lost("the connection is closed".to_owned());
        self.words.recv().await.unwrap_or_else(lost)
    }

    /// Subscribes to a topic.
    pub(super) fn subscribe(&self, topic: &str) -> Result<(), Full> {
        let asked = self.client.try_subscribe(topic, QoS::AtLeastOnce);
        asked.map_err(|_| Full)
    }

    /// Publishes a message to the current subscribers.
    pub(super) fn say(&self, topic: &str, payload: Vec<u8>) -> Result<(), Full> {
        self.publish(topic, false, payload)
    }

    /// Publishes a retained message, which later subscribers receive too.
    pub(super) fn keep(&self, topic: &str, payload: Vec<u8>) -> Result<(), Full> {
        self.publish(topic, true, payload)
    }

    fn publish(&self, topic: &str, retain: bool, payload: Vec<u8>) -> Result<(), Full> {
        // A message that exceeds the maximum packet size would break the connection.
        if payload.len() + topic.len() + 64 > LONGEST_SENT {
            tracing::warn!("a message for the broker is too long: {topic}");
            return Ok(());
        }
        let said = self
            .client
            .try_publish(topic, QoS::AtLeastOnce, retain, payload);
        said.map_err(|_| Full)
    }

    /// Disconnects after all queued messages are sent, and waits for that at most this long.
    pub(super) async fn close(mut self, limit: Duration) {
        if self.client.try_disconnect().is_err() {
            return;
        }
        let closed = async { while !matches!(self.next().await, Word::Lost(_)) {} };
        let _ = tokio::time::timeout(limit, closed).await;
    }
}

/// Drives the connection until it is lost or its receiver is dropped.
async fn pump(mut events: EventLoop, say: mpsc::Sender<Word>) {
    loop {
        let word = match events.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => Word::Up,
            Ok(Event::Incoming(Packet::Publish(message))) => Word::Message(Message {
                topic: message.topic,
                payload: message.payload,
                retained: message.retain,
            }),
            Ok(Event::Incoming(Packet::SubAck(_))) => Word::Subscribed,
            Ok(Event::Incoming(Packet::PubAck(_))) => Word::Acknowledged,
            Ok(_) => continue,
            Err(error) => {
                let _ = say.send(Word::Lost(in_words(&error))).await;
                return;
            }
        };
        if say.send(word).await.is_err() {
            return;
        }
    }
}

fn in_words(error: &ConnectionError) -> String {
    match error {
        ConnectionError::ConnectionRefused(
            ConnectReturnCode::BadUserNamePassword | ConnectReturnCode::NotAuthorized,
        ) => "the broker refuses user and password: mqtt.user, mqtt.password_file".to_owned(),
        ConnectionError::NetworkTimeout => {
            format!("the broker does not answer within {CONNECTING} s")
        }
        ConnectionError::Tls(error) => format!("no encrypted connection: {error}"),
        other => other.to_string(),
    }
}
