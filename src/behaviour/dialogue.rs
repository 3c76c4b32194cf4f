//! What a person at a prompt and a behaviour say to each other. Bounded in both directions: neither
//! ever waits for the other.

use tokio::sync::mpsc;

use super::message::ToHost;
use crate::script::{Ending, Evaluated, LogLine};

/// Orders that may wait for the behaviour.
const MAX_COMMANDS: usize = 16;
/// What may wait for the person; the last place is kept for answers.
const MAX_SAID: usize = 512;

/// What the person wants.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PromptCommand {
    /// Run this; answered by [`Said::Evaluated`].
    Evaluate {
        /// Luau.
        text: String,
        /// Whether further lines may follow.
        more: bool,
    },
    /// Tracks, tasks and handlers come to rest.
    Interrupt,
}

impl From<PromptCommand> for ToHost {
    fn from(order: PromptCommand) -> ToHost {
        match order {
            PromptCommand::Evaluate { text, more } => ToHost::Evaluate { text, more },
            PromptCommand::Interrupt => ToHost::Interrupt,
        }
    }
}

/// What the behaviour answers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Said {
    /// It may be spoken to from now on.
    Ready,
    /// A log line of it.
    Line(LogLine),
    /// What became of the last [`PromptCommand::Evaluate`].
    Evaluated(Evaluated),
    /// It has ended, and a new one begins.
    Ended(Ending),
}

/// The behaviour's side.
#[derive(Debug)]
pub struct Dialogue {
    orders: mpsc::Receiver<PromptCommand>,
    said: mpsc::Sender<Said>,
}

impl Dialogue {
    /// With the ends of the person's side.
    pub fn new() -> (mpsc::Sender<PromptCommand>, mpsc::Receiver<Said>, Dialogue) {
        let (order, orders) = mpsc::channel(MAX_COMMANDS);
        let (said, hear) = mpsc::channel(MAX_SAID);
        (order, hear, Dialogue { orders, said })
    }

    /// A line is dropped when the person's side does not keep up.
    pub(super) fn say(&self, said: Said) {
        let room = self.said.capacity() > 1 || !matches!(said, Said::Line(_));
        if room {
            let _ = self.said.try_send(said);
        }
    }
}

/// The next command; pending for ever without a prompt.
pub(super) async fn next(dialogue: &mut Option<Dialogue>) -> PromptCommand {
    if let Some(dialogue) = dialogue
        && let Some(order) = dialogue.orders.recv().await
    {
        return order;
    }
    std::future::pending().await
}
