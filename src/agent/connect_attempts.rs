//! Repeats the first attempt to connect until the robot answers, for callers that wait for a robot.
//! Later the pilot itself reconnects whenever a link is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use rand::SeedableRng as _;
use rand::rngs::StdRng;
use tokio::sync::Mutex;
use tokio::time::sleep;

use crate::link::{Backoff, LinkError, Options, Session, Supervision};
use crate::pilot::Connector;

/// Counts the failed attempts to reach a robot. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct ConnectAttempts(Arc<AtomicU32>);

impl ConnectAttempts {
    /// The number of failed attempts.
    pub fn count(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Returns a connector whose first call repeats `connector`, with growing pauses, until the robot
/// accepts the login; only a refused password ends that. Later calls make one attempt each.
pub fn retry_until_connected(
    connector: Connector,
    options: Options,
    seed: u64,
    attempts: ConnectAttempts,
) -> Connector {
    // The pilot makes one call after the other, so this lock is never contended.
    let connector = Arc::new(Mutex::new(connector));
    let mut first = true;
    Box::new(move |supervision| {
        let connector = connector.clone();
        let options = options.clone();
        let attempts = attempts.clone();
        let is_first = std::mem::take(&mut first);
        Box::pin(async move {
            let mut connector = connector.lock().await;
            if is_first {
                connect_with_retries(&mut connector, supervision, &options, seed, &attempts).await
            } else {
                (*connector)(supervision).await
            }
        })
    })
}

async fn connect_with_retries(
    connector: &mut Connector,
    supervision: Supervision,
    options: &Options,
    seed: u64,
    attempts: &ConnectAttempts,
) -> Result<Session, LinkError> {
    let mut backoff = Backoff::new(options);
    let mut rng = StdRng::seed_from_u64(seed);
    let mut logged = String::new();
    loop {
        let error = match connector(supervision.clone()).await {
            Err(error) if !error.is_final() => error.to_string(),
            answered => return answered,
        };
        attempts.0.fetch_add(1, Ordering::Relaxed);
        if error != logged {
            tracing::info!("{error}; trying until it answers, Ctrl-C ends");
            logged = error;
        }
        sleep(backoff.next(&mut rng)).await;
    }
}
