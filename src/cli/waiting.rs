//! `run --wait`: the first connection is tried until the robot answers. What comes later is the
//! pilot's: it dials anew whenever a link is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use rand::SeedableRng as _;
use rand::rngs::StdRng;
use tokio::time::sleep;

use crate::link::{self, Backoff, LinkError, Options, Session, Target};
use crate::pilot::Dial;
use crate::wire::{Command, Login};

/// Tries to reach a robot that have failed so far. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub(super) struct Tries(Arc<AtomicU32>);

impl Tries {
    /// How many.
    pub(super) fn count(&self) -> u32 {
        self.0.load(Ordering::Relaxed)
    }
}

/// What is dialled, and who counts.
#[derive(Clone)]
struct Number {
    target: Target,
    login: Login,
    options: Options,
    seed: u64,
    tries: Tries,
}

/// Dials once each time but the first: then again and again, with growing pauses, until the robot lets
/// us in. Only a password that it refuses ends that.
pub(super) fn until_answered(
    target: Target,
    login: Login,
    options: Options,
    seed: u64,
    tries: Tries,
) -> Dial {
    let number = Number {
        target,
        login,
        options,
        seed,
        tries,
    };
    let mut first = true;
    Box::new(move |last_words| {
        let number = number.clone();
        if std::mem::take(&mut first) {
            Box::pin(async move { number.insist(last_words).await })
        } else {
            Box::pin(async move { number.dial(last_words).await })
        }
    })
}

impl Number {
    async fn dial(&self, last_words: Vec<Command>) -> Result<Session, LinkError> {
        link::connect(&self.target, &self.login, last_words, &self.options).await
    }

    async fn insist(&self, last_words: Vec<Command>) -> Result<Session, LinkError> {
        let mut backoff = Backoff::new(&self.options);
        let (mut rng, mut told) = (StdRng::seed_from_u64(self.seed), String::new());
        loop {
            let error = match self.dial(last_words.clone()).await {
                Err(error) if !error.is_final() => error.to_string(),
                answered => return answered,
            };
            self.tries.0.fetch_add(1, Ordering::Relaxed);
            if error != told {
                tracing::info!("{error}; dialling until it answers, Ctrl-C ends");
                told = error;
            }
            sleep(backoff.next(&mut rng)).await;
        }
    }
}
