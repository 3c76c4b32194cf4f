//! Quiet hours: which commands are withheld from the robot meanwhile. Motion is not affected.

use crate::robot::channel::{Quiet, Role};
use crate::wire::{Command, Led};

/// The rule for quiet hours.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct QuietHours(Quiet);

impl QuietHours {
    pub(super) fn new(quiet: Quiet) -> QuietHours {
        QuietHours(quiet)
    }

    /// Whether a behaviour's command may be sent. A rescue behaviour may need the headlight to see
    /// the way home, and a person who sends commands knows what time it is.
    pub(super) fn allows(self, role: Role, command: &Command) -> bool {
        self.0 == Quiet::Off || role != Role::Behaviour || !disturbs(command)
    }

    /// Whether a command of the watchdog, or of the alarm, may be sent.
    pub(super) fn allows_alarm(self, command: &Command) -> bool {
        self.0 != Quiet::WithAlarm || !disturbs(command)
    }

    /// The commands that end the noise when quiet hours begin; `alarm`: the alarm sounds at
    /// present.
    pub(super) fn commands_at_start(self, alarm: bool) -> &'static [Command] {
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

/// Whether a command could wake people.
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
    fn quiet_hours_withhold_sounds_and_headlight_from_scripts_but_no_motion() {
        for quiet in [Quiet::Scripts, Quiet::WithAlarm] {
            let quiet_hours = QuietHours::new(quiet);
            let scripts = |command: &Command| quiet_hours.allows(Role::Behaviour, command);
            assert!(!NOISE.iter().any(scripts));
            assert!(
                NOISE
                    .iter()
                    .all(|noise| quiet_hours.allows(Role::Person, noise))
            );
            for command in [Command::STOP, Command::Engine(Engage::Dock)] {
                assert!(scripts(&command) && quiet_hours.allows_alarm(&command));
            }
        }
        assert!(
            NOISE
                .iter()
                .all(|noise| QuietHours::default().allows(Role::Behaviour, noise))
        );
    }

    #[test]
    fn the_alarm_sounds_at_night_only_if_the_config_says_so() {
        let play = |command: &&Command| matches!(command, Command::Play(_));
        let sound = ALARM.iter().find(play).unwrap();
        assert!(QuietHours::new(Quiet::Scripts).allows_alarm(sound));
        assert!(!QuietHours::new(Quiet::WithAlarm).allows_alarm(sound));
    }
}
