//! What the robot was told about its lights and volume, so that only changes are sent.

use crate::wire::{Command, Led};

/// The last known state; unknown after a login.
#[derive(Debug, Default)]
pub(super) struct Lights {
    leds: Vec<(Led, bool)>,
    volume: Option<u8>,
}

impl Lights {
    /// Another login: nothing is known.
    pub(super) fn forget(&mut self) {
        *self = Lights::default();
    }

    /// Whether a command changes anything, and remembers it. Sounds always do; some of them switch
    /// lights too, so that the lights are unknown afterwards (`PROTOCOL.md`, *sound id*).
    pub(super) fn is_news(&mut self, command: &Command) -> bool {
        match *command {
            Command::Led { led, on } => {
                let known = self.leds.contains(&(led, on));
                self.leds.retain(|(other, _)| *other != led);
                self.leds.push((led, on));
                !known
            }
            Command::Volume(percent) => self.volume.replace(percent) != Some(percent),
            Command::Play(_) => {
                self.leds.clear();
                true
            }
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Sound;

    #[test]
    fn only_changes_are_news_and_a_sound_makes_lights_unknown() {
        let mut lights = Lights::default();
        let flash = Command::Led {
            led: Led::Flash,
            on: true,
        };
        assert!(lights.is_news(&flash));
        assert!(!lights.is_news(&flash));
        assert!(lights.is_news(&Command::Led {
            led: Led::Flash,
            on: false
        }));
        assert!(lights.is_news(&flash));
        assert!(lights.is_news(&Command::Play(Sound::Alarm)));
        assert!(lights.is_news(&flash));
        assert!(lights.is_news(&Command::Volume(3)));
        assert!(!lights.is_news(&Command::Volume(3)));
        lights.forget();
        assert!(lights.is_news(&Command::Volume(3)));
    }
}
