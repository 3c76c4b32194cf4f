//! One connection to a broker: everything that depends on rumqttc. A broken connection is not
//! resumed but replaced by a new one, so that messages queued on the old one are never sent later.

use std::time::Duration;

use rumqttc::{
    AsyncClient, ConnectReturnCode, ConnectionError, Event, EventLoop, LastWill, MqttOptions,
    NetworkOptions, Packet, Publish, QoS, TlsConfiguration, Transport,
};
use tokio::runtime::Builder;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::topics::Presence;
use crate::config;
use crate::notify::{DELIVERY_TIMEOUT, Delivery};

const MAX_WAITING: usize = 64;
const MAX_RECEIVED: usize = 64;
/// Maximum length of a received message (a command, a state, a birth message), in bytes.
const LONGEST_RECEIVED: usize = 64 << 10;
/// Maximum length of a sent message (a picture), in bytes.
pub(super) const LONGEST_SENT: usize = 1 << 20;
/// The broker declares the connection broken after one and a half times this without a message.
const KEEP_ALIVE: Duration = Duration::from_secs(20);
const CONNECTING: u64 = 10;

/// A broker and our account there; the secrets have already been read.
#[derive(Clone)]
pub struct Account {
    pub options: config::Mqtt,
    pub password: Option<String>,
    pub ca: Option<Vec<u8>>,
    /// The address of the run's page, if other computers can open it.
    pub page: Option<String>,
}

impl std::fmt::Debug for Account {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Account").field(&self.options).finish()
    }
}

#[derive(Debug)]
pub(super) enum ConnectionEvent {
    Up,
    Message(Publish),
    Subscribed,
    /// The broker has confirmed a message of ours.
    Acknowledged,
    Lost(String),
}

/// The queue is full: the broker is slower than we are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("its queue is full")]
pub(super) struct QueueFull;

/// A connection in progress or established. Dropping it breaks it, and the broker publishes the
/// will.
#[derive(Debug)]
pub(super) struct Connection {
    client: AsyncClient,
    received: mpsc::Receiver<ConnectionEvent>,
    pump: JoinHandle<()>,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.pump.abort();
    }
}

impl Connection {
    pub(super) fn connect(
        account: &Account,
        client: &str,
        will_topic: Option<String>,
    ) -> Connection {
        let (host, port) = account.options.address().unwrap_or(("localhost", 1883));
        let mut options = MqttOptions::new(client, host, port);
        options.set_clean_session(true);
        options.set_keep_alive(KEEP_ALIVE);
        options.set_max_packet_size(LONGEST_RECEIVED, LONGEST_SENT);
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
        if let Some(topic) = will_topic {
            let payload = Presence::ConnectionBroken.name();
            options.set_last_will(LastWill::new(topic, payload, QoS::AtLeastOnce, true));
        }
        let (client, mut events) = AsyncClient::new(options, MAX_WAITING);
        let mut network = NetworkOptions::new();
        network.set_connection_timeout(CONNECTING);
        events.set_network_options(network);
        let (sender, received) = mpsc::channel(MAX_RECEIVED);
        let pump = tokio::spawn(pump(events, sender));
        Connection {
            client,
            received,
            pump,
        }
    }

    /// Waits for the next event; after [`ConnectionEvent::Lost`], returns that each time.
    /// Cancel-safe.
    pub(super) async fn next(&mut self) -> ConnectionEvent {
        let lost = || ConnectionEvent::Lost("the connection is closed".to_owned());
        self.received.recv().await.unwrap_or_else(lost)
    }

    pub(super) fn subscribe(&self, topic: &str) -> Result<(), QueueFull> {
        let asked = self.client.try_subscribe(topic, QoS::AtLeastOnce);
        asked.map_err(|_| QueueFull)
    }

    /// Publishes a message to the current subscribers.
    pub(super) fn publish(&self, topic: &str, payload: Vec<u8>) -> Result<(), QueueFull> {
        self.enqueue(topic, false, payload)
    }

    /// Publishes a retained message, which later subscribers receive too.
    pub(super) fn retain(&self, topic: &str, payload: Vec<u8>) -> Result<(), QueueFull> {
        self.enqueue(topic, true, payload)
    }

    fn enqueue(&self, topic: &str, retain: bool, payload: Vec<u8>) -> Result<(), QueueFull> {
        // A message that exceeds the maximum packet size would break the connection.
        if payload.len() + topic.len() + 64 > LONGEST_SENT {
            tracing::warn!("a message for the broker is too long: {topic}");
            return Ok(());
        }
        let queued = self
            .client
            .try_publish(topic, QoS::AtLeastOnce, retain, payload);
        queued.map_err(|_| QueueFull)
    }

    /// Disconnects after all queued messages are sent, and waits for that at most this long.
    pub(super) async fn close(mut self, limit: Duration) {
        if self.client.try_disconnect().is_err() {
            return;
        }
        let closed = async { while !matches!(self.next().await, ConnectionEvent::Lost(_)) {} };
        let _ = tokio::time::timeout(limit, closed).await;
    }
}

/// Drives the connection until it is lost or its receiver is dropped.
async fn pump(mut events: EventLoop, sender: mpsc::Sender<ConnectionEvent>) {
    loop {
        let event = match events.poll().await {
            Ok(Event::Incoming(Packet::ConnAck(_))) => ConnectionEvent::Up,
            Ok(Event::Incoming(Packet::Publish(message))) => ConnectionEvent::Message(message),
            Ok(Event::Incoming(Packet::SubAck(_))) => ConnectionEvent::Subscribed,
            Ok(Event::Incoming(Packet::PubAck(_))) => ConnectionEvent::Acknowledged,
            Ok(_) => continue,
            Err(error) => {
                let _ = sender.send(ConnectionEvent::Lost(to_message(&error))).await;
                return;
            }
        };
        if sender.send(event).await.is_err() {
            return;
        }
    }
}

fn to_message(error: &ConnectionError) -> String {
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

/// Timeout for the disconnection, and for a name lookup still in progress at the end.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(200);

/// Publishes a message that is not retained, and waits until the broker confirms it. Blocks
/// slightly longer than [`DELIVERY_TIMEOUT`] at most. If this user may not publish there, the broker
/// still confirms the message without an error (MQTT 3.1.1).
pub fn publish(account: &Account, topic: &str, payload: Vec<u8>) -> Delivery {
    if payload.len() > LONGEST_SENT - 1024 {
        return Delivery::Refused(format!(
            "it is longer than {LONGEST_SENT} bytes, the maximum for a message"
        ));
    }
    let failed = |why: String| Delivery::Later(format!("no connection with the broker: {why}"));
    let runtime = match Builder::new_current_thread().enable_all().build() {
        Ok(runtime) => runtime,
        Err(error) => return failed(error.to_string()),
    };
    let sent =
        runtime.block_on(async { timeout(DELIVERY_TIMEOUT, send(account, topic, payload)).await });
    runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
    match sent {
        Ok(Ok(())) => Delivery::Done,
        Ok(Err(why)) => failed(why),
        Err(_) => Delivery::Later(format!(
            "the broker did not confirm it within {} s",
            DELIVERY_TIMEOUT.as_secs()
        )),
    }
}

async fn send(account: &Account, topic: &str, payload: Vec<u8>) -> Result<(), String> {
    // A unique client ID: a second client with the same ID would disconnect the first.
    let client = format!("spykee-post-{:016x}", rand::random::<u64>());
    let mut connection = Connection::connect(account, &client, None);
    let mut waiting = Some(payload);
    loop {
        match connection.next().await {
            ConnectionEvent::Up => {
                let Some(payload) = waiting.take() else {
                    continue;
                };
                let sent = connection.publish(topic, payload);
                sent.map_err(|error| error.to_string())?;
            }
            ConnectionEvent::Acknowledged => break,
            ConnectionEvent::Lost(why) => return Err(why),
            ConnectionEvent::Message(_) | ConnectionEvent::Subscribed => {}
        }
    }
    connection.close(SHUTDOWN_TIMEOUT).await;
    Ok(())
}
