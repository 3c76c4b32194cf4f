//! Quiet hours: what the robot is not told while they last. Motion is no matter of this.

use crate::robot::channel::{Quiet, Role};
use crate::wire::{Command, Led};

/// What is kept from the robot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Hush(Quiet);

impl Hush {
    pub(super) fn new(quiet: Quiet) -> Hush {
        Hush(quiet)
    }

    /// Whether a command of a behaviour's may go out. A rescue behaviour may need the headlight to see
    /// the way home, and a person knows what time it is.
    pub(super) fn allows(self, role: Role, command: &Command) -> bool {
        self.0 == Quiet::Off || role != Role::Behaviour || !disturbs(command)
    }

    /// Whether a command of the watchdog's, or of the alarm, may go out.
    pub(super) fn allows_alarm(self, command: &Command) -> bool {
        self.0 != Quiet::WithAlarm || !disturbs(command)
    }

    /// What ends the noise when quiet hours begin; `alarm`: it sounds just now.
    pub(super) fn beginning(self, alarm: bool) -> &'static [Command] {
        const SILENCE: &[Command] = &[
            Command::StopSound,
            Command::Led {
                led: Led::Flash,
                on: false,
            },
        ];
        match self.0 {
            Quiet::Off => &[],
            Quiet::Scripts if alarm => &[],
            Quiet::Scripts | Quiet::WithAlarm => SILENCE,
        }
    }
}

/// Whether people wake up of it.
fn disturbs(command: &Command) -> bool {
    match command {
        Command::Play(_) | Command::Audio(_) => true,
        Command::Led { led, on } => *led == Led::Flash && *on,
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::ALARM;
    use crate::wire::{Engage, Sound};

    const NOISE: [Command; 3] = [
        Command::Play(Sound::Laser),
        Command::Audio(bytes::Bytes::new()),
        Command::Led {
            led: Led::Flash,
            on: true,
        },
    ];

    #[test]
    fn quiet_hours_keep_sounds_and_headlight_from_scripts_and_motion_from_nobody() {
        for quiet in [Quiet::Scripts, Quiet::WithAlarm] {
            let hush = Hush::new(quiet);
            let scripts = |command: &Command| hush.allows(Role::Behaviour, command);
            assert!(!NOISE.iter().any(scripts));
            assert!(NOISE.iter().all(|noise| hush.allows(Role::Person, noise)));
            for command in [Command::STOP, Command::Engine(Engage::Dock)] {
                assert!(scripts(&command) && hush.allows_alarm(&command));
            }
        }
        assert!(
            NOISE
                .iter()
                .all(|noise| Hush::default().allows(Role::Behaviour, noise))
        );
    }

    #[test]
    fn the_alarm_sounds_at_night_only_if_the_config_says_so() {
        let play = |command: &&Command| matches!(command, Command::Play(_));
        let sound = ALARM.iter().find(play).unwrap();
        assert!(Hush::new(Quiet::Scripts).allows_alarm(sound));
        assert!(!Hush::new(Quiet::WithAlarm).allows_alarm(sound));
    }
}
