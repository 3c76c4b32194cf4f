//! The terminal's settings: however a session ends or is stopped, they are restored.

use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// The settings of standard input, if it is a terminal.
#[derive(Clone)]
pub(super) struct Terminal(Option<Termios>);

impl Terminal {
    /// As they are now.
    pub(super) fn remember() -> Terminal {
        Terminal(tcgetattr(rustix::stdio::stdin()).ok())
    }

    /// As they were; an editor that still reads cannot be asked to do it.
    pub(super) fn restore(&self) {
        if let Some(settings) = &self.0 {
            let _ = tcsetattr(rustix::stdio::stdin(), OptionalActions::Now, settings);
        }
    }
}
