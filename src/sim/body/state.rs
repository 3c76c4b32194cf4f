//! The simulated robot as it is right now, for status lines and tests.

use std::time::Duration;

use crate::wire::{Led, Power, Sound, Stream};

use super::chassis::Tracks;
use crate::sim::geometry::Pose;

/// One value for each light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Leds {
    /// The headlight.
    pub flash: bool,
    /// On the left.
    pub left: bool,
    /// On the right.
    pub right: bool,
}

impl Leds {
    /// Switches a light; false if there is no such light.
    pub(crate) fn switch(&mut self, led: Led, on: bool) -> bool {
        match led {
            Led::Flash => self.flash = on,
            Led::Left => self.left = on,
            Led::Right => self.right = on,
            Led::Unknown(_) => return false,
        }
        true
    }
}

/// One value for each stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Streams {
    /// The camera.
    pub video: bool,
    /// The microphone.
    pub audio_in: bool,
    /// The speaker.
    pub audio_out: bool,
}

impl Streams {
    /// Switches a stream; false if there is no such stream.
    pub(crate) fn switch(&mut self, stream: Stream, on: bool) -> bool {
        match stream {
            Stream::Video => self.video = on,
            Stream::AudioIn => self.audio_in = on,
            Stream::AudioOut => self.audio_out = on,
            Stream::Unknown(_) => return false,
        }
        true
    }
}

/// The robot's state, as handles and status lines show it.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Simulated time since the start.
    pub time: Duration,
    /// Where it stands and which way it looks.
    pub pose: Pose,
    /// The battery's level, 0..=100, unrounded.
    pub battery: f64,
    /// The content of POWER.
    pub power: Power,
    /// Current flows into the battery.
    pub charging: bool,
    /// On the station; while it backs out, until it has left.
    pub docked: bool,
    /// On its way to the station, searching included.
    pub searching: bool,
    /// Backing out of the station.
    pub leaving: bool,
    /// The last MOVE, as it came; 0 while the robot drives by itself.
    pub commanded: Tracks<i8>,
    /// What the tracks really do, metres a second.
    pub speeds: Tracks<f64>,
    /// Something is in the way.
    pub blocked: bool,
    /// How often it ran into something.
    pub collisions: u64,
    /// Metres driven.
    pub distance: f64,
    /// The lights.
    pub leds: Leds,
    /// What plays now.
    pub sound: Option<Sound>,
    /// 0..=100 percent.
    pub volume: u8,
    /// The streams that are on.
    pub streams: Streams,
    /// Who is connected.
    pub user: Option<String>,
    /// Frames rendered so far.
    pub frames: u64,
    /// Frames and audio chunks dropped so far because the user read too slowly.
    pub dropped: u64,
}

impl State {
    /// Whether a track turns.
    pub fn moving(&self) -> bool {
        self.speeds.left != 0.0 || self.speeds.right != 0.0
    }
}
