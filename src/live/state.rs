//! The state of the run for the page. Its words are keys of the page's table of texts.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::Instant;

use crate::control::{Next, Run, Start};
use crate::robot::{RobotInfo, StopConfirmation, Use};
use crate::safety::{DockState, WatchdogState};
use crate::wire::Stream;

/// Period over which frames are counted.
const RATE: Duration = Duration::from_secs(1);

/// The state of the run.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct State {
    /// `connecting`, `up`, `lost` or `released`.
    pub link: &'static str,
    /// The state of the watchdog: `offline`, `free`, `docked`, `docking`, `going_home` or `alarm`.
    pub safety: &'static str,
    /// The robot's dock state: `charging`, `contact`, `off` or `unknown`.
    pub dock_state: &'static str,
    /// Whether the robot is on the station, as far as is known.
    pub docked: bool,
    /// Whether the battery is low and the watchdog therefore controls the robot.
    pub low: bool,
    /// Whether a person has stopped the robot with STOP, and the stop still holds.
    pub emergency_stop: bool,
    /// What is known of that stop at the robot.
    pub stop_confirmation: StopConfirmation,
    /// The battery, if known.
    pub battery: Option<Level>,
    /// The power of the left and the right track, percent.
    pub tracks: [i8; 2],
    /// The headlight, the left and the right light; null: unknown.
    pub lights: [Option<bool>; 3],
    /// The last sound that the robot was told to play.
    pub sound: Option<&'static str>,
    /// The number of sounds so far.
    pub sounds: u32,
    /// Frames per second.
    pub fps: u32,
    /// The robot, if it was ever connected.
    pub robot: Option<Robot>,
    /// The robot's address as given to the run.
    pub target: String,
    /// Whether the robot is simulated in the run's own program.
    pub simulated: bool,
    /// Whole seconds since the start of the run.
    pub running: u64,
    /// The viewer that drives by hand.
    pub driver: Option<Person>,
    /// The number of viewers.
    pub viewers: usize,
    /// The next start of the timetable, if there is one.
    pub next: Option<Start>,
    /// Whether it is a quiet hour.
    pub quiet: bool,
}

/// The battery.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub(super) struct Level {
    /// 0..=100.
    pub percent: u8,
    /// Whether it is being charged.
    pub charging: bool,
    /// Estimated time until it is empty, at the recent consumption.
    pub minutes_left: Option<f32>,
}

/// The robot.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Robot {
    /// Its own name.
    pub name: String,
    /// Its ID, such as `SPYKEE0001`.
    pub uid: String,
    /// Its firmware version, such as `1.0.22`.
    pub firmware: String,
    /// Its network address.
    pub address: String,
}

/// A viewer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Person {
    /// The viewer's number.
    pub id: u32,
    /// The viewer's name.
    pub name: String,
}

impl From<&RobotInfo> for Robot {
    fn from(info: &RobotInfo) -> Robot {
        Robot {
            name: info.name.clone(),
            uid: info.uid.clone(),
            firmware: info.firmware.clone(),
            address: info.address.clone(),
        }
    }
}

#[derive(Debug)]
pub(super) struct Rate {
    since: Instant,
    frames: u64,
    rate: u32,
}

impl Rate {
    pub(super) fn new(now: Instant) -> Rate {
        Rate {
            since: now,
            frames: 0,
            rate: 0,
        }
    }

    fn count(&mut self, frames: u64, now: Instant) -> u32 {
        let passed = now.saturating_duration_since(self.since);
        if passed >= RATE {
            let new = frames.saturating_sub(self.frames);
            self.rate = (new as f64 / passed.as_secs_f64()).round() as u32;
            (self.since, self.frames) = (now, frames);
        }
        self.rate
    }
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct People {
    pub(super) driver: Option<Person>,
    pub(super) viewers: usize,
}

pub(super) fn state(
    run: &Run,
    robot: Option<&RobotInfo>,
    people: People,
    rate: &mut Rate,
    now: Instant,
) -> State {
    let status = *run.status.borrow();
    let view = run.view.borrow().clone();
    let percent = |power: i8| (f32::from(power) / 0.9).round() as i8;
    let tracks = status.actuators.tracks;
    State {
        link: status.link.name(),
        safety: safety(status.safety),
        dock_state: dock_state(status.dock_state),
        docked: status.docked,
        low: status.low,
        emergency_stop: status.emergency_stop,
        stop_confirmation: status.stop,
        battery: status.battery.map(|battery| Level {
            percent: battery.percent.get(),
            charging: battery.charging,
            minutes_left: battery.minutes_left.map(f32::round),
        }),
        tracks: [percent(tracks.left.get()), percent(tracks.right.get())],
        lights: status.actuators.lights,
        sound: status.actuators.sound.map(|sound| sound.name()),
        sounds: status.actuators.sounds,
        fps: rate.count(status.frames, now),
        robot: robot.map(Robot::from),
        target: run.target.clone(),
        simulated: run.simulated,
        running: now.saturating_duration_since(run.began).as_secs(),
        driver: people.driver,
        viewers: people.viewers,
        next: Next::from_view(&view).as_ref().map(Start::from),
        quiet: view.quiet,
    }
}

pub(super) fn has_camera(run: &Run) -> bool {
    run.streams.usage(Stream::Video) != Use::Off
}

fn safety(state: WatchdogState) -> &'static str {
    match state {
        WatchdogState::Offline => "offline",
        WatchdogState::Free => "free",
        WatchdogState::Docked => "docked",
        WatchdogState::Docking => "docking",
        WatchdogState::LowGoingHome => "going_home",
        WatchdogState::Alarm => "alarm",
    }
}

fn dock_state(dock_state: DockState) -> &'static str {
    match dock_state {
        DockState::Charging => "charging",
        DockState::ContactReported => "contact",
        DockState::Left(_) => "off",
        DockState::Unknown => "unknown",
    }
}
