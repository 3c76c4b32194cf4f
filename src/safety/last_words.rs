//! What the robot is to hear if the agent dies.

use crate::wire::{Command, Engage};

/// What is said when the link, the agent or the machine fails: the writer and the guardian hold the
/// newest that the watchdog has told them (see [`Watchdog::last_words`](super::Watchdog::last_words)).
/// The default, before anything is known, is a stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LastWords {
    /// Stop the tracks.
    #[default]
    Stop,
    /// End the search for the station, which a MOVE alone may not end, and stop the tracks.
    EndSearch,
    /// Stop the tracks and search the station: the battery is low.
    StopAndDock,
    /// Nothing: the robot does by itself what is best for it, and any MOVE would end that.
    Nothing,
}

impl LastWords {
    /// The messages, to be sent in one write.
    pub fn commands(self) -> Vec<Command> {
        match self {
            LastWords::Stop => vec![Command::STOP],
            LastWords::EndSearch => vec![
                Command::STOP,
                Command::Engine(Engage::CancelDock),
                Command::STOP,
            ],
            LastWords::StopAndDock => vec![Command::STOP, Command::Engine(Engage::Dock)],
            LastWords::Nothing => vec![],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_is_said_begins_with_a_stop() {
        assert_eq!(LastWords::default(), LastWords::Stop);
        let find = Command::Engine(Engage::Dock);
        assert_eq!(LastWords::Stop.commands(), [Command::STOP]);
        assert_eq!(LastWords::StopAndDock.commands(), [Command::STOP, find]);
        let end = Command::Engine(Engage::CancelDock);
        let ended = [Command::STOP, end, Command::STOP];
        assert_eq!(LastWords::EndSearch.commands(), ended);
        assert_eq!(LastWords::Nothing.commands(), []);
    }
}
