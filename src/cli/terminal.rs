//! The terminal's settings, which are restored however a session ends or is suspended.

use std::time::Duration;

use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// Settings that more than this many successive checks find unchanged count as stable.
const STABLE_CHECKS: u32 = 3;
/// Maximum number of checks.
const MAX_CHECKS: u32 = 20;
/// Pause between two checks.
const CHECK_PAUSE: Duration = Duration::from_millis(10);

/// The settings of standard input, if it is a terminal.
#[derive(Clone)]
pub(super) struct Terminal(Option<Termios>);

impl Terminal {
    /// The current settings.
    pub(super) fn current() -> Terminal {
        Terminal(tcgetattr(rustix::stdio::stdin()).ok())
    }

    /// Restores these settings. An editor that is still reading cannot do this itself.
    pub(super) fn restore(&self) {
        if let Some(settings) = &self.0 {
            let _ = tcsetattr(rustix::stdio::stdin(), OptionalActions::Now, settings);
        }
    }

    /// Sets these settings repeatedly until they are stable: an editor that was suspended by a key
    /// may set its own once more meanwhile. Returns the settings that it replaced, if any.
    pub(super) fn enforce(&self) -> Option<Terminal> {
        let (mut others, mut unchanged) = (None, 0);
        for _ in 0..MAX_CHECKS {
            let now = Terminal::current();
            if now == *self {
                unchanged += 1;
            } else {
                (others, unchanged) = (Some(now), 0);
                self.restore();
            }
            if unchanged > STABLE_CHECKS {
                break;
            }
            std::thread::sleep(CHECK_PAUSE);
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
