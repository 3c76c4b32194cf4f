//! The last commands that a person beside the robot would see and hear.

use crate::robot::Setpoint;
use crate::robot::TrackPower;
use crate::wire::{Command, Led, Sound};

/// The last commanded state; see the module. Lights are unknown after a login and after sounds that
/// also switch them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Shown {
    /// The power of the tracks.
    pub tracks: Setpoint,
    /// The headlight, the left and the right light.
    pub lights: [Option<bool>; 3],
    /// The last sound.
    pub sound: Option<Sound>,
    /// The number of sounds so far: distinguishes repetitions of the same sound.
    pub sounds: u32,
}

impl Shown {
    /// Notes a command that is sent.
    pub(super) fn note(&mut self, command: &Command) {
        match *command {
            Command::Move { left, right } => {
                let power = |power| TrackPower::new(power).unwrap_or_default();
                self.tracks = Setpoint {
                    left: power(left),
                    right: power(right),
                };
            }
            Command::Led { led, on } => match led {
                Led::Flash => self.lights[0] = Some(on),
                Led::Left => self.lights[1] = Some(on),
                Led::Right => self.lights[2] = Some(on),
                Led::Unknown(_) => {}
            },
            Command::Play(sound) => {
                (self.sound, self.sounds) = (Some(sound), self.sounds.wrapping_add(1));
                self.lights = [None; 3];
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sent_commands_are_shown_and_a_sound_makes_lights_unknown() {
        let mut shown = Shown::default();
        shown.note(&Command::Move {
            left: 30,
            right: -20,
        });
        shown.note(&Command::Led {
            led: Led::Left,
            on: true,
        });
        assert_eq!(
            (shown.tracks.left.get(), shown.tracks.right.get()),
            (30, -20)
        );
        assert_eq!(shown.lights, [None, Some(true), None]);
        shown.note(&Command::Play(Sound::Laser));
        assert_eq!(
            (shown.lights, shown.sound, shown.sounds),
            ([None; 3], Some(Sound::Laser), 1)
        );
    }
}
