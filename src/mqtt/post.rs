//! One message to a broker, on a connection of its own: for those who have something to say now and then,
//! and want to know that it has arrived.

use std::time::Duration;

use tokio::runtime::Builder;
use tokio::time::timeout;

use super::line::{Account, LONGEST_SENT, Line, Word};

/// How long a name lookup may still take when all else is done, and the goodbye.
const END: Duration = Duration::from_millis(200);

/// Why a message has not arrived.
#[derive(Debug, thiserror::Error)]
pub enum PostError {
    /// It never will.
    #[error("it is longer than {LONGEST_SENT} bytes, which no broker here takes")]
    TooLong,
    /// In the connection's words.
    #[error("no connection with the broker: {0}")]
    Line(String),
    /// The broker hangs.
    #[error("the broker did not confirm it within {} s", .0.as_secs_f64())]
    Silent(Duration),
}

/// Publishes a message that the broker does not keep, and waits until it has it: blocks, at most so long
/// and a little. A broker that lets this user not publish there takes the message all the same, and says
/// nothing (MQTT 3.1.1).
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
    let line = |error: std::io::Error| PostError::Line(error.to_string());
    let runtime = Builder::new_current_thread().enable_all().build();
    let runtime = runtime.map_err(line)?;
    let sent = runtime.block_on(async {
        let silent = |_| PostError::Silent(limit);
        let sending = send(account, topic, payload);
        timeout(limit, sending).await.map_err(silent)?
    });
    runtime.shutdown_timeout(END);
    sent
}

async fn send(account: &Account, topic: &str, payload: Vec<u8>) -> Result<(), PostError> {
    // A unique name: a second client of the same name would end the first.
    let client = format!("spykee-post-{:016x}", rand::random::<u64>());
    let mut line = Line::dial(account, &client, None);
    let mut waiting = Some(payload);
    loop {
        match line.next().await {
            Word::Up => {
                let Some(payload) = waiting.take() else {
                    continue;
                };
                let full = |_| PostError::Line("it takes nothing".to_owned());
                line.say(topic, payload).map_err(full)?;
            }
            Word::Acknowledged => break,
            Word::Lost(why) => return Err(PostError::Line(why)),
            Word::Message(_) | Word::Subscribed => {}
        }
    }
    line.close(END).await;
    Ok(())
}
