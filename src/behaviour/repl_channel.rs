//! The messages between a user at a prompt and a behaviour. The queues are bounded in both
//! directions, and neither side ever waits for the other.

use tokio::sync::mpsc;

use super::message::ToHost;
use crate::script::{Evaluated, LogLine, ScriptExit};

/// Capacity of the queue of commands to the behaviour.
const MAX_COMMANDS: usize = 16;
/// Capacity of the queue to the user; its last slot is reserved for answers.
const MAX_MESSAGES: usize = 512;

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PromptCommand {
    /// Run this text; answered by [`PromptMessage::Evaluated`].
    Evaluate {
        text: String,
        /// Whether further lines may follow.
        more: bool,
    },
    /// Stop the tracks, the tasks and the handlers.
    Interrupt,
}

impl From<PromptCommand> for ToHost {
    fn from(command: PromptCommand) -> ToHost {
        match command {
            PromptCommand::Evaluate { text, more } => ToHost::Evaluate { text, more },
            PromptCommand::Interrupt => ToHost::Interrupt,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PromptMessage {
    /// The behaviour accepts commands from now on.
    Ready,
    Line(LogLine),
    /// The outcome of the last [`PromptCommand::Evaluate`].
    Evaluated(Evaluated),
    /// The behaviour has ended, and a new one starts.
    Ended(ScriptExit),
}

/// The behaviour's end of the two queues.
#[derive(Debug)]
pub struct ReplChannel {
    commands: mpsc::Receiver<PromptCommand>,
    messages: mpsc::Sender<PromptMessage>,
}

impl ReplChannel {
    /// Creates the queues; also returns the user's ends of them.
    pub fn new() -> (
        mpsc::Sender<PromptCommand>,
        mpsc::Receiver<PromptMessage>,
        ReplChannel,
    ) {
        let (commands_sender, commands) = mpsc::channel(MAX_COMMANDS);
        let (messages, received) = mpsc::channel(MAX_MESSAGES);
        (
            commands_sender,
            received,
            ReplChannel { commands, messages },
        )
    }

    /// Sends a message to the user. A log line is dropped if the user's side does not keep up.
    pub(super) fn send(&self, message: PromptMessage) {
        let room = self.messages.capacity() > 1 || !matches!(message, PromptMessage::Line(_));
        if room {
            let _ = self.messages.try_send(message);
        }
    }
}

/// Returns the next command. Without a prompt, or once it is closed, it never completes.
pub(super) async fn next(repl_channel: &mut Option<ReplChannel>) -> PromptCommand {
    if let Some(repl_channel) = repl_channel
        && let Some(command) = repl_channel.commands.recv().await
    {
        return command;
    }
    std::future::pending().await
}
