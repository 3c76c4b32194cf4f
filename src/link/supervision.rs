//! What connects a login in progress with its caller.

use tokio::sync::watch;

use crate::wire::Command;

/// A caller's hold on a login in progress. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Supervision {
    last_words: watch::Receiver<Vec<Command>>,
}

impl Supervision {
    /// With these last words: the newest ones count, also while a login is in progress.
    pub fn new(last_words: watch::Receiver<Vec<Command>>) -> Supervision {
        Supervision { last_words }
    }

    pub(super) fn last_words(&self) -> watch::Receiver<Vec<Command>> {
        self.last_words.clone()
    }
}

/// Last words that do not change during the login.
impl From<Vec<Command>> for Supervision {
    fn from(last_words: Vec<Command>) -> Supervision {
        Supervision::new(watch::Sender::new(last_words).subscribe())
    }
}
