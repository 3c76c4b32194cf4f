//! The end of a connection. What was written last has not arrived yet, and a socket that is closed
//! while something of the robot's is unread is reset, which throws away what the robot has not
//! acknowledged: so we read on until it has, and close then.

use std::convert::Infallible;
use std::fmt;
use std::time::Duration;

use tokio::time::timeout;

use super::{LinkError, Reader, Writer};

/// How long the robot may take to hang up too, once it has acknowledged everything.
const LINGER: Duration = Duration::from_millis(300);

/// What became of the last words of a connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// The robot's side has acknowledged all that was written. Whether its program has read it is not
    /// known. Where the transport tells nothing of it: all was written.
    Acknowledged,
    /// It has not.
    NotAcknowledged {
        /// How long it was waited for.
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

/// Ends a connection: waits up to `limit` until what was written is acknowledged, and forgets what
/// the robot says meanwhile; then closes our half, and waits for a moment until the robot has hung up
/// too. Speech that waits is dropped. Say the last words before; what else fails says them again.
pub async fn farewell(mut reader: Reader, mut writer: Writer, limit: Duration) -> Delivery {
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
    // A robot that does not hang up has heard us all the same.
    let _ = timeout(LINGER, hanging_up).await;
    Delivery::Acknowledged
}

/// Reads and forgets; returns when the connection breaks, but not when the robot has only ended its
/// half: it may still acknowledge ours.
async fn broken(reader: &mut Reader) -> Result<Infallible, LinkError> {
    reader.discard().await?;
    std::future::pending().await
}
