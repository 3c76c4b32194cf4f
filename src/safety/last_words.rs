//! The commands that the robot is sent if the agent dies.

use crate::wire::{Command, Engage};

/// What is sent when the link, the agent or the machine fails: the writer and the guardian hold the
/// latest ones from the watchdog (see [`Watchdog::last_words`](super::Watchdog::last_words)). The
/// default, before anything is known, is a stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LastWords {
    /// Stop the tracks, end a search for the station, which a MOVE alone may not end, and stop the
    /// tracks again.
    #[default]
    Stop,
    /// Stop the tracks and search for the station: the battery is low.
    StopAndDock,
    /// Nothing: what the robot does on its own is best, and any MOVE would end that.
    Nothing,
}

impl LastWords {
    /// The commands, to be sent in one write.
    pub fn commands(self) -> Vec<Command> {
        match self {
            LastWords::Stop => vec![
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
    fn all_last_words_begin_with_a_stop() {
        assert_eq!(LastWords::default(), LastWords::Stop);
        let find = Command::Engine(Engage::Dock);
        let end = Command::Engine(Engage::CancelDock);
        let stop = [Command::STOP, end, Command::STOP];
        assert_eq!(LastWords::Stop.commands(), stop);
        assert_eq!(LastWords::StopAndDock.commands(), [Command::STOP, find]);
        assert_eq!(LastWords::Nothing.commands(), []);
    }
}
