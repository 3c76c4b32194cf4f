//! What connects a login in progress with its caller.

use std::os::fd::OwnedFd;

use tokio::sync::watch;

use super::Writer;
use crate::wire::Command;

/// A caller's hold on a login in progress. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Supervision {
    last_words: watch::Receiver<Vec<Command>>,
    accepted: watch::Sender<Option<OwnedFd>>,
}

impl Supervision {
    /// With these last words: the newest ones count, also while a login is in progress.
    pub fn new(last_words: watch::Receiver<Vec<Command>>) -> Supervision {
        Supervision {
            last_words,
            accepted: watch::Sender::new(None),
        }
    }

    /// A duplicate of the socket from the robot's acceptance of the login on, for a process that
    /// sends the last words if this one cannot; `None` again when the login has failed.
    pub fn accepted(&self) -> watch::Receiver<Option<OwnedFd>> {
        self.accepted.subscribe()
    }

    pub(super) fn last_words(&self) -> watch::Receiver<Vec<Command>> {
        self.last_words.clone()
    }

    /// The robot has accepted the login of this link.
    pub(super) fn announce(&self, writer: &Writer) {
        let socket = writer.socket();
        if let Some(socket) = socket.and_then(|socket| socket.try_clone_to_owned().ok()) {
            self.accepted.send_replace(Some(socket));
        }
    }

    /// The link has ended, and its last words were sent.
    pub(super) fn withdraw(&self) {
        self.accepted
            .send_if_modified(|socket| socket.take().is_some());
    }
}

/// Last words that do not change during the login.
impl From<Vec<Command>> for Supervision {
    fn from(last_words: Vec<Command>) -> Supervision {
        Supervision::new(watch::Sender::new(last_words).subscribe())
    }
}
