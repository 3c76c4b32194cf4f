//! The last known state of the robot's lights and volume, so that only changes are sent.

use tracing::info;

use crate::wire::{Command, Led};

/// The last known state; unknown after a login.
#[derive(Debug, Default)]
pub(super) struct Lights {
    leds: Vec<(Led, bool)>,
    volume: Option<u8>,
}

impl Lights {
    /// Forgets the state, after a new login.
    pub(super) fn forget(&mut self) {
        *self = Lights::default();
    }

    /// Whether a command changes the known state. Sounds always do.
    pub(super) fn is_news(&self, command: &Command) -> bool {
        match *command {
            Command::Led { led, on } => !self.leds.contains(&(led, on)),
            Command::Volume(percent) => self.volume != Some(percent),
            _ => true,
        }
    }

    /// The commands that switch lights and sounds off, except for what the alarm needs if it
    /// sounds.
    pub(super) fn off(&self, alarm: bool) -> Vec<Command> {
        let sound = (!alarm).then_some(Command::StopSound);
        let lights = [Led::Left, Led::Right, Led::Flash].into_iter();
        lights
            .filter(|led| *led != Led::Flash || !alarm)
            .map(|led| Command::Led { led, on: false })
            .filter(|command| self.is_news(command))
            .chain(sound)
            .collect()
    }

    /// Logs the changes that a person beside the robot would see and hear.
    pub(super) fn log(&self, command: &Command) {
        match *command {
            Command::Led { led, on } if self.is_news(command) => {
                let state = if on { "on" } else { "off" };
                info!("{} light {state}", led.name());
            }
            Command::Play(sound) => info!("plays {}", sound.name()),
            Command::Volume(percent) if self.is_news(command) => info!("volume {percent} %"),
            _ => {}
        }
    }

    /// Notes a command that is sent. Some sounds also switch lights, so that the lights are unknown
    /// afterwards (`PROTOCOL.md`, PLAY).
    pub(super) fn note(&mut self, command: &Command) {
        match *command {
            Command::Led { led, on } => {
                self.leds.retain(|(other, _)| *other != led);
                self.leds.push((led, on));
            }
            Command::Volume(percent) => self.volume = Some(percent),
            Command::Play(_) => self.leds.clear(),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Sound;

    #[test]
    fn only_changes_count_and_a_sound_makes_lights_unknown() {
        let mut lights = Lights::default();
        let mut news = |command: Command| {
            let news = lights.is_news(&command);
            lights.note(&command);
            news
        };
        let flash = |on| Command::Led {
            led: Led::Flash,
            on,
        };
        assert!(news(flash(true)) && !news(flash(true)));
        assert!(news(flash(false)) && news(flash(true)));
        assert!(news(Command::Play(Sound::Alarm)));
        assert!(news(flash(true)));
        assert!(news(Command::Volume(3)) && !news(Command::Volume(3)));
        lights.forget();
        assert!(lights.is_news(&Command::Volume(3)));
    }

    #[test]
    fn switching_off_covers_all_lights_and_sounds_but_those_of_the_alarm() {
        let dark = |led| Command::Led { led, on: false };
        let mut lights = Lights::default();
        lights.note(&dark(Led::Left));
        let off = [dark(Led::Right), dark(Led::Flash), Command::StopSound];
        assert_eq!(lights.off(false), off);
        assert_eq!(lights.off(true), off[..1]);
    }

    #[test]
    fn an_unsent_command_still_counts_as_a_change() {
        let lights = Lights::default();
        assert!(lights.is_news(&Command::Volume(3)));
        assert!(lights.is_news(&Command::Volume(3)));
    }
}
