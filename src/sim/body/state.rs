//! The current state of the simulated robot, for status lines and tests.

use std::time::Duration;

use super::chassis::Tracks;
use crate::sim::geometry::Pose;
use crate::wire::{Led, Power, Sound, Stream};

/// Which lights are on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Leds {
    /// The headlight.
    pub flash: bool,
    /// The left light.
    pub left: bool,
    /// The right light.
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

/// Which streams are on.
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

/// The robot's state, as shown by handles and status lines.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Simulated time since the start.
    pub time: Duration,
    /// The robot's position and heading.
    pub pose: Pose,
    /// The battery's level, 0..=100, unrounded.
    pub battery: f64,
    /// The content of POWER.
    pub power: Power,
    /// Current flows into the battery.
    pub charging: bool,
    /// The robot is on the station; while it backs out, true until it has left.
    pub docked: bool,
    /// The robot is driving to the station or searching for it.
    pub searching: bool,
    /// The robot is backing out of the station.
    pub leaving: bool,
    /// The last MOVE that was not ignored, as received; 0 if since then the firmware stopped the
    /// tracks, or a manoeuvre was started or cancelled.
    pub commanded: Tracks<i8>,
    /// The actual speeds of the tracks, metres per second.
    pub speeds: Tracks<f64>,
    /// An obstacle blocks the robot.
    pub blocked: bool,
    /// Number of collisions.
    pub collisions: u64,
    /// Metres driven.
    pub distance: f64,
    /// The lights.
    pub leds: Leds,
    /// The sound that is playing.
    pub sound: Option<Sound>,
    /// The volume, 0..=100 percent.
    pub volume: u8,
    /// The streams that are on.
    pub streams: Streams,
    /// Commands that were received and wait to be executed.
    pub queued: usize,
    /// The connected user.
    pub user: Option<String>,
    /// Frames rendered so far.
    pub frames: u64,
    /// Frames and audio chunks dropped so far because the user read too slowly.
    pub dropped: u64,
}

impl State {
    /// Whether a track is moving.
    pub fn moving(&self) -> bool {
        self.speeds.left != 0.0 || self.speeds.right != 0.0
    }
}
