//! Repeats the first attempt to connect until the robot answers, for callers that wait for a robot.
//! Later the pilot itself reconnects whenever a link is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use rand::SeedableRng as _;
use rand::rngs::StdRng;
use tokio::sync::Mutex;
use tokio::time::sleep;

use crate::link::{Backoff, LinkError, Options, Session, Supervision};
use crate::pilot::Dial;

/// Counts the failed attempts to reach a robot. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Tries(Arc<AtomicU32>);

impl Tries {
    /// The number of failed attempts.
    pub fn count(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Returns a dial whose first call repeats `dial`, with growing pauses, until the robot accepts the
/// login; only a refused password ends that. Later calls make one attempt each.
pub fn until_answered(dial: Dial, options: Options, seed: u64, tries: Tries) -> Dial {
    // The pilot makes one call after the other, so this lock is never contended.
    let dial = Arc::new(Mutex::new(dial));
    let mut first = true;
    Box::new(move |supervision| {
        let (dial, options, tries) = (dial.clone(), options.clone(), tries.clone());
        let is_first = std::mem::take(&mut first);
        Box::pin(async move {
            let mut dial = dial.lock().await;
            if is_first {
                dial_until_answered(&mut dial, supervision, &options, seed, &tries).await
            } else {
                (*dial)(supervision).await
            }
        })
    })
}

async fn dial_until_answered(
    dial: &mut Dial,
    supervision: Supervision,
    options: &Options,
    seed: u64,
    tries: &Tries,
) -> Result<Session, LinkError> {
    let mut backoff = Backoff::new(options);
    let (mut rng, mut logged) = (StdRng::seed_from_u64(seed), String::new());
    loop {
        let error = match dial(supervision.clone()).await {
            Err(error) if !error.is_final() => error.to_string(),
            answered => return answered,
        };
        tries.0.fetch_add(1, Ordering::Relaxed);
        if error != logged {
            tracing::info!("{error}; dialling until it answers, Ctrl-C ends");
            logged = error;
        }
        sleep(backoff.next(&mut rng)).await;
    }
}
