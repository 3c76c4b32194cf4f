//! The terminal's settings: however a session ends or is stopped, they are restored.

use std::time::Duration;

use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// Settings that were the same at so many looks stay, and no more looks are taken than that.
const ENOUGH_LOOKS: u32 = 3;
const MOST_LOOKS: u32 = 20;
/// From one look to the next.
const LOOK: Duration = Duration::from_millis(10);

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

    /// Gives the terminal these settings until they stay: an editor that was asked to stop by a key
    /// sets its own once more meanwhile. Returns the other settings that it had.
    pub(super) fn enforce(&self) -> Option<Terminal> {
        let (mut others, mut stays) = (None, 0);
        for _ in 0..MOST_LOOKS {
            let now = Terminal::remember();
            if now == *self {
                stays += 1;
            } else {
                (others, stays) = (Some(now), 0);
                self.restore();
            }
            if stays > ENOUGH_LOOKS {
                break;
            }
            std::thread::sleep(LOOK);
        }
        others
    }
}

impl PartialEq for Terminal {
    fn eq(&self, other: &Terminal) -> bool {
        let modes = |one: &Terminal| one.0.as_ref().map(|settings| settings.local_modes);
        modes(self) == modes(other)
    }
}
