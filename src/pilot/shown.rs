//! What the robot was told last that a person beside it would see and hear.

use crate::robot::Setpoint;
use crate::robot::TrackPower;
use crate::wire::{Command, Led, Sound};

/// See the module. Nothing is known of lights after a login, and after sounds that switch them too.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Shown {
    /// The power of the tracks.
    pub tracks: Setpoint,
    /// The headlight, the left and the right light.
    pub lights: [Option<bool>; 3],
    /// The last sound.
    pub sound: Option<Sound>,
    /// How many sounds there were: tells one from the same before.
    pub sounds: u32,
}

impl Shown {
    /// A command goes out.
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
    fn what_goes_out_is_shown_and_a_sound_makes_lights_unknown() {
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
