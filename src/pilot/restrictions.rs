//! What behaviours may still use of the robot while its battery is nearly empty, or the watchdog's
//! alarm sounds. Motion is not affected: the watchdog decides on it.

use crate::robot::channel::Role;
use crate::safety::Watchdog;
use crate::wire::{Command, Led, Stream};

/// The restrictions in force.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Restrictions {
    /// Everything that the way home does not need is off: see [`Watchdog::shed`].
    pub(super) shed: bool,
    /// The alarm controls sounds, volume and headlight: see [`Watchdog::alarm_sounds`].
    pub(super) alarm: bool,
}

impl Restrictions {
    /// The restrictions that the watchdog demands.
    pub(super) fn demanded_by(watchdog: &Watchdog) -> Restrictions {
        Restrictions {
            shed: watchdog.shed(),
            alarm: watchdog.alarm_sounds(),
        }
    }

    /// Whether a behaviour's command that is not a motion may be sent. A rescue behaviour may need
    /// the headlight to see. A new sound replaces the one that plays, so none is allowed while the
    /// alarm sounds.
    pub(super) fn allows(self, role: Role, command: &Command) -> bool {
        match command {
            Command::Led {
                led: Led::Flash, ..
            } => role == Role::Rescuer || !(self.shed || self.alarm),
            Command::Led { .. } => !self.shed,
            Command::StopSound => !self.alarm,
            Command::Play(_) | Command::Volume(_) | Command::Audio(_) => !(self.shed || self.alarm),
            _ => true,
        }
    }

    /// Whether a stream that a behaviour wants may be on.
    pub(super) fn allows_stream(self, role: Role, stream: Stream) -> bool {
        let sees = role == Role::Rescuer && stream == Stream::Video;
        sees || !self.shed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Sound;

    const EMPTY: Restrictions = Restrictions {
        shed: true,
        alarm: false,
    };
    const ALARM: Restrictions = Restrictions {
        shed: false,
        alarm: true,
    };

    fn led(led: Led) -> Command {
        Command::Led { led, on: true }
    }

    fn sounds() -> [Command; 3] {
        [
            Command::Play(Sound::Laser),
            Command::Volume(0),
            Command::Audio(vec![0; 4].into()),
        ]
    }

    #[test]
    fn without_restrictions_everything_is_allowed() {
        let usual = Restrictions::default();
        let lights = [led(Led::Flash), led(Led::Left), Command::StopSound];
        for command in sounds().iter().chain(&lights) {
            assert!(usual.allows(Role::Behaviour, command), "{command:?}");
        }
        assert!(usual.allows_stream(Role::Behaviour, Stream::AudioIn));
    }

    #[test]
    fn no_role_can_silence_the_alarm() {
        for role in [Role::Behaviour, Role::Rescuer] {
            for command in sounds().iter().chain(&[Command::StopSound]) {
                assert!(!ALARM.allows(role, command), "{command:?}");
            }
            assert!(ALARM.allows(role, &led(Led::Left)));
            assert!(ALARM.allows_stream(role, Stream::AudioIn));
        }
        assert!(!ALARM.allows(Role::Behaviour, &led(Led::Flash)));
    }

    #[test]
    fn with_a_nearly_empty_battery_lights_and_sounds_are_refused() {
        for role in [Role::Behaviour, Role::Rescuer] {
            for command in sounds().iter().chain(&[led(Led::Left), led(Led::Right)]) {
                assert!(!EMPTY.allows(role, command), "{command:?}");
            }
            assert!(EMPTY.allows(role, &Command::StopSound));
            assert!(!EMPTY.allows_stream(role, Stream::AudioIn));
            assert!(!EMPTY.allows_stream(role, Stream::AudioOut));
        }
    }

    #[test]
    fn only_the_rescuer_keeps_the_camera() {
        for restrictions in [EMPTY, ALARM] {
            assert!(restrictions.allows_stream(Role::Rescuer, Stream::Video));
            assert!(restrictions.allows(Role::Rescuer, &led(Led::Flash)));
        }
        assert!(!EMPTY.allows_stream(Role::Behaviour, Stream::Video));
        assert!(!EMPTY.allows(Role::Behaviour, &led(Led::Flash)));
    }
}
