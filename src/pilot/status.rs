//! A summary of the state for people.

use std::collections::VecDeque;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;
use tracing::info;

use crate::link::Delays;
use crate::robot::{Battery, Percent, Setpoint, StopConfirmation, TrackPower};
use crate::safety::{DockState, WatchdogState};
use crate::wire::{Command, Led, Sound};

/// The state of the link.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// The first attempt is under way.
    #[default]
    Connecting,
    Up,
    /// Was up; reconnecting.
    Lost,
    /// Released, so that another program can log in.
    Released,
}

impl LinkState {
    /// A description for people, unless the link is up: then the watchdog's state says more.
    pub fn absence(self) -> Option<&'static str> {
        match self {
            LinkState::Connecting => Some("connecting"),
            LinkState::Up => None,
            LinkState::Lost => Some("link lost, reconnecting"),
            LinkState::Released => Some("disconnected, free for others"),
        }
    }
}

/// The newest state of robot and watchdog.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Status {
    pub link: LinkState,
    pub safety: WatchdogState,
    /// The battery, as far as its reports are believed.
    pub battery: Option<Battery>,
    /// When the robot last told its level. A change of this alone does not wake receivers.
    pub level_told: Option<Instant>,
    /// The battery counts as low, and the watchdog controls the robot.
    pub low: bool,
    /// A rescue behaviour should be running.
    pub rescue: bool,
    /// On the station, as far as known; without a link, the last known state.
    pub docked: bool,
    /// Where the robot is, as far as known.
    pub dock_state: DockState,
    /// The battery is nearly empty: scripts have neither lights nor sounds nor streams.
    pub shed: bool,
    /// Frames received so far, damaged ones included. A change of this count alone does not wake
    /// receivers.
    pub frames: u64,
    /// How many attempts to connect have failed before the first connection.
    pub attempts: u32,
    /// A person has stopped the robot and not released it yet.
    pub emergency_stop: bool,
    /// What is known of the last stop.
    pub stop: StopConfirmation,
    /// The robot may be moving: no stop was executed since it was last told to move.
    pub owes_stop: bool,
    /// How late the robot executes what it is sent, as last measured. A change of this alone does not
    /// wake receivers.
    pub delays: Option<Delays>,
    /// Last tracks, lights and sound commanded.
    pub actuators: ActuatorState,
}

impl Status {
    /// Takes over the newest state; returns whether anything has changed.
    pub(super) fn update(&mut self, newest: Status) -> bool {
        self.delays = newest.delays;
        self.level_told = newest.level_told;
        std::mem::replace(self, newest) != newest
    }

    /// Counts a frame, which does not count as a change, and returns its number.
    pub(super) fn count_frame(&mut self) -> u64 {
        self.frames += 1;
        self.frames
    }
}

/// The last commands that a person beside the robot would see and hear; also used to send only
/// changes. Lights and volume are unknown after a login, lights also after sounds that switch them.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ActuatorState {
    pub tracks: Setpoint,
    /// The headlight, the left and the right light.
    pub lights: [Option<bool>; 3],
    pub volume: Option<u8>,
    pub sound: Option<Sound>,
    /// The number of sounds so far: distinguishes repetitions of the same sound.
    pub sounds: u32,
}

impl ActuatorState {
    pub(super) fn forget_lights(&mut self) {
        self.lights = [None; 3];
        self.volume = None;
    }

    /// Whether a command changes the known state. Sounds always do.
    pub(super) fn is_news(&self, command: &Command) -> bool {
        match *command {
            Command::Led { led, on } => light(led).is_none_or(|at| self.lights[at] != Some(on)),
            Command::Volume(percent) => self.volume != Some(percent),
            _ => true,
        }
    }

    /// The commands that switch lights and sounds off, except for what the alarm needs if it
    /// sounds.
    pub(super) fn off(&self, alarm: bool) -> Vec<Command> {
        let mut off = Vec::new();
        for led in [Led::Left, Led::Right, Led::Flash] {
            let dark = Command::Led { led, on: false };
            if self.is_news(&dark) && !(alarm && led == Led::Flash) {
                off.push(dark);
            }
        }
        if !alarm {
            off.push(Command::StopSound);
        }
        off
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
    pub(super) fn record(&mut self, command: &Command) {
        match *command {
            Command::Move { left, right } => {
                let power = |power| TrackPower::new(power).unwrap_or_default();
                self.tracks = Setpoint {
                    left: power(left),
                    right: power(right),
                };
            }
            Command::Led { led, on } => {
                if let Some(at) = light(led) {
                    self.lights[at] = Some(on);
                }
            }
            Command::Volume(percent) => self.volume = Some(percent),
            Command::Play(sound) => {
                self.sound = Some(sound);
                self.sounds = self.sounds.wrapping_add(1);
                self.lights = [None; 3];
            }
            _ => {}
        }
    }
}

fn light(led: Led) -> Option<usize> {
    match led {
        Led::Flash => Some(0),
        Led::Left => Some(1),
        Led::Right => Some(2),
        Led::Unknown(_) => None,
    }
}

/// Estimates how many minutes the battery lasts at its recent drain, for people: no rule depends on
/// it. Levels come in whole percents, so time is counted from one fall of the level to the next.
#[derive(Debug, Default)]
pub(super) struct MinutesLeft {
    level: Option<u8>,
    falls: VecDeque<(u8, Instant)>,
}

impl MinutesLeft {
    /// The estimate uses the last ten percents (a level that falls by more at once says nothing) ...
    const MOST_PERCENT: u8 = 10;
    /// ... and at least two.
    const LEAST_PERCENT: u8 = 2;
    /// A level that rises by up to this many points is rounding noise.
    const FLICKER: u8 = 2;

    /// Forgets everything: the link is lost, and what the robot does meanwhile is not known.
    pub(super) fn forget(&mut self) {
        *self = MinutesLeft::default();
    }

    pub(super) fn level(&mut self, battery: Battery, now: Instant) {
        if battery.charging {
            return self.forget();
        }
        let Some(percent) = battery.percent.map(Percent::get) else {
            return;
        };
        let Some(before) = self.level else {
            self.level = Some(percent);
            return;
        };
        let rises = percent > before.saturating_add(MinutesLeft::FLICKER);
        let leaps = before > percent.saturating_add(MinutesLeft::MOST_PERCENT);
        if rises || leaps {
            self.forget();
            self.level = Some(percent);
        } else if percent < before {
            self.level = Some(percent);
            self.falls.push_back((percent, now));
            let oldest = percent.saturating_add(MinutesLeft::MOST_PERCENT);
            self.falls.retain(|(level, _)| *level <= oldest);
        }
    }

    /// The minutes until the battery is empty; `None` while it charges, and before its level has
    /// fallen far enough.
    pub(super) fn estimate(&self) -> Option<f32> {
        let (first, began) = *self.falls.front()?;
        let (last, ended) = *self.falls.back()?;
        let used = first - last;
        if used < MinutesLeft::LEAST_PERCENT {
            return None;
        }
        let minutes = ended.saturating_duration_since(began).as_secs_f32() / 60.0;
        let left = minutes / f32::from(used) * f32::from(last);
        Some((left * 10.0).round() / 10.0)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::robot::Percent;

    #[test]
    fn only_changes_count_and_a_sound_makes_lights_unknown() {
        let mut actuators = ActuatorState::default();
        assert!(actuators.is_news(&Command::Volume(3)));
        assert!(actuators.is_news(&Command::Volume(3)), "it was not sent");
        let mut news = |command: Command| {
            let news = actuators.is_news(&command);
            actuators.record(&command);
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
        actuators.forget_lights();
        assert!(actuators.is_news(&Command::Volume(3)));
    }

    #[test]
    fn switching_off_covers_all_lights_and_sounds_but_those_of_the_alarm() {
        let dark = |led| Command::Led { led, on: false };
        let mut actuators = ActuatorState::default();
        actuators.record(&dark(Led::Left));
        let off = [dark(Led::Right), dark(Led::Flash), Command::StopSound];
        assert_eq!(actuators.off(false), off);
        assert_eq!(actuators.off(true), off[..1]);
    }

    #[test]
    fn sent_commands_are_shown_and_a_sound_makes_lights_unknown() {
        let mut actuators = ActuatorState::default();
        actuators.record(&Command::Move {
            left: 30,
            right: -20,
        });
        actuators.record(&Command::Led {
            led: Led::Left,
            on: true,
        });
        assert_eq!(
            (actuators.tracks.left.get(), actuators.tracks.right.get()),
            (30, -20)
        );
        assert_eq!(actuators.lights, [None, Some(true), None]);
        actuators.record(&Command::Play(Sound::Laser));
        assert_eq!(
            (actuators.lights, actuators.sound, actuators.sounds),
            ([None; 3], Some(Sound::Laser), 1)
        );
    }

    /// The estimate after these levels, one a minute.
    fn after(levels: &[u8]) -> Option<f32> {
        let mut left = MinutesLeft::default();
        let start = Instant::now();
        for (minute, level) in (0..).zip(levels) {
            let battery = Battery {
                percent: Some(Percent::saturating(*level)),
                charging: false,
                minutes_left: None,
            };
            left.level(battery, start + Duration::from_secs(60 * minute));
        }
        left.estimate()
    }

    #[test]
    fn the_drain_is_measured_between_two_falls_of_the_level() {
        assert_eq!(after(&[60, 60, 59]), None);
        assert_eq!(after(&[60, 60, 59, 58]), None);
        assert_eq!(after(&[60, 59, 58, 57]), Some(57.0));
        assert_eq!(after(&[60, 60, 60, 59, 59, 58, 58, 57]), Some(114.0));
        assert_eq!(after(&[60, 59, 60, 58, 59, 57]), Some(114.0), "it flickers");
    }

    #[test]
    fn an_old_drain_is_forgotten() {
        let slow = [100, 100, 100, 100, 99, 99, 99, 99];
        let fast: Vec<u8> = (70..=98).rev().collect();
        assert_eq!(after(&[&slow[..], &fast].concat()), Some(70.0));
    }

    #[test]
    fn charging_and_another_battery_begin_anew() {
        assert_eq!(after(&[60, 59, 58, 57, 90]), None);
        assert_eq!(after(&[60, 59, 58, 57, 46]), None);
        let mut left = MinutesLeft::default();
        let now = Instant::now();
        let battery = |percent, charging| Battery {
            percent: Some(Percent::saturating(percent)),
            charging,
            minutes_left: None,
        };
        for percent in [60, 59, 58, 57] {
            left.level(battery(percent, false), now);
        }
        assert!(left.estimate().is_some());
        left.level(battery(57, true), now);
        assert_eq!(left.estimate(), None);
    }
}
