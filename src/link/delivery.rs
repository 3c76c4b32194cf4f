//! The end of a connection. The last written data has not arrived yet, and closing a socket with
//! unread received data resets the connection, which discards what the robot has not acknowledged:
//! so keep reading until it has, and close then.

use std::convert::Infallible;
use std::fmt;
use std::time::Duration;

use tokio::time::timeout;

use super::{LinkError, Reader, Writer};

/// How long the robot may take to close its half, once it has acknowledged everything.
const LINGER: Duration = Duration::from_millis(300);

/// Whether the last data of a connection was delivered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// The robot's side has acknowledged everything written. Whether its program has read it is not
    /// known. If the transport does not report acknowledgements: everything was written.
    Acknowledged,
    /// The robot's side has not acknowledged everything.
    NotAcknowledged {
        /// How long the wait was.
        after: Duration,
    },
    /// There was no connection at the end.
    Offline,
}

impl fmt::Display for Delivery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Delivery::Acknowledged => f.write_str("the robot's side has acknowledged the stop"),
            Delivery::NotAcknowledged { after } => write!(
                f,
                "the robot's side has not acknowledged the last stop within {:.1} s",
                after.as_secs_f64()
            ),
            Delivery::Offline => {
                f.write_str("the robot was out of reach at the end: no stop was sent")
            }
        }
    }
}

/// Ends a connection: waits up to `limit` until the written data is acknowledged, discarding what
/// the robot sends meanwhile; then closes the write half, and waits briefly until the robot has
/// closed its half. Queued speech is dropped. Send the last words before; on failure, the writer's
/// drop sends them again.
pub async fn close_gracefully(mut reader: Reader, mut writer: Writer, limit: Duration) -> Delivery {
    writer.drop_audio();
    let acknowledged = tokio::select! {
        biased;
        _ = broken(&mut reader) => false,
        acknowledged = timeout(limit, writer.acknowledged()) => matches!(acknowledged, Ok(Ok(()))),
    };
    if !acknowledged {
        return Delivery::NotAcknowledged { after: limit };
    }
    let hanging_up = async {
        writer.shut_down().await;
        reader.discard().await
    };
    // A robot that does not close its half has received everything all the same.
    let _ = timeout(LINGER, hanging_up).await;
    Delivery::Acknowledged
}

/// Reads and discards; returns when the connection breaks, but not when the robot has only closed
/// its half: it may still acknowledge ours.
async fn broken(reader: &mut Reader) -> Result<Infallible, LinkError> {
    reader.discard().await?;
    std::future::pending().await
}
