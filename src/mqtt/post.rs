//! Publishes a single message to a broker on a separate connection: for callers that publish
//! occasionally and need a confirmation.

use std::time::Duration;

use tokio::runtime::Builder;
use tokio::time::timeout;

use super::connection::{Account, Connection, ConnectionEvent, LONGEST_SENT};

/// Timeout for the disconnection, and for a name lookup still in progress at the end.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(200);

/// Why a message was not published.
#[derive(Debug, thiserror::Error)]
pub enum PostError {
    /// The message is too long to be sent.
    #[error("it is longer than {LONGEST_SENT} bytes, the maximum for a message")]
    TooLong,
    /// The connection failed.
    #[error("no connection with the broker: {0}")]
    Connection(String),
    /// The broker did not confirm the message in time.
    #[error("the broker did not confirm it within {} s", .0.as_secs_f64())]
    TimedOut(Duration),
}

/// Publishes a message that is not retained, and waits until the broker confirms it. Blocks
/// slightly longer than `limit` at most. If this user may not publish there, the broker still
/// confirms the message without an error (MQTT 3.1.1).
///
/// # Errors
/// See [`PostError`].
pub fn publish(
    account: &Account,
    topic: &str,
    payload: Vec<u8>,
    limit: Duration,
) -> Result<(), PostError> {
    if payload.len() > LONGEST_SENT - 1024 {
        return Err(PostError::TooLong);
    }
    let failed = |error: std::io::Error| PostError::Connection(error.to_string());
    let runtime = Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(failed)?;
    let sent = runtime.block_on(async {
        let timed_out = |_| PostError::TimedOut(limit);
        let sending = send(account, topic, payload);
        timeout(limit, sending).await.map_err(timed_out)?
    });
    runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
    sent
}

async fn send(account: &Account, topic: &str, payload: Vec<u8>) -> Result<(), PostError> {
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
                let full = |_| PostError::Connection("its queue is full".to_owned());
                connection.publish(topic, payload).map_err(full)?;
            }
            ConnectionEvent::Acknowledged => break,
            ConnectionEvent::Lost(why) => return Err(PostError::Connection(why)),
            ConnectionEvent::Message(_) | ConnectionEvent::Subscribed => {}
        }
    }
    connection.close(SHUTDOWN_TIMEOUT).await;
    Ok(())
}
