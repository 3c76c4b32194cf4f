//! The video stream: frames at the frame rate, each sent after the camera's latency.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;

use crate::sim::camera::{Camera, Shot};
use crate::sim::world::document::World;

/// The camera, with the frames that wait to be sent.
pub(super) struct Video {
    pub(super) camera: Camera,
    fps: f64,
    latency: Duration,
    /// Elapsed share of the frame period; the next frame is due at 1.
    due: f64,
    frames: u64,
    /// Frames delayed by the latency, each with the time at which it is sent.
    waiting: VecDeque<(Duration, Bytes)>,
}

impl Video {
    /// Creates the stream; `seed` determines the noise of the frames.
    pub(super) fn new(world: &World, seed: u64) -> Video {
        Video {
            camera: Camera::new(world, seed),
            fps: world.camera.fps,
            latency: Duration::from_secs_f64(world.camera.latency),
            due: 0.0,
            frames: 0,
            waiting: VecDeque::new(),
        }
    }

    /// Returns the number of frames rendered so far.
    pub(super) fn frames(&self) -> u64 {
        self.frames
    }

    /// Makes the next frame due immediately.
    pub(super) fn trigger_frame(&mut self) {
        self.due = 1.0;
    }

    /// Stops the stream: drops all waiting frames.
    pub(super) fn stop(&mut self) {
        self.waiting.clear();
    }

    /// Advances by `dt` and renders a frame if one is due. `prepare` updates the camera and returns
    /// the shot.
    pub(super) fn step(&mut self, dt: Duration, prepare: impl FnOnce(&mut Camera) -> Shot) {
        self.due += dt.as_secs_f64() * self.fps;
        if self.due >= 1.0 {
            self.due = (self.due - 1.0).min(1.0);
            self.frames += 1;
            let shot = prepare(&mut self.camera);
            let sent_at = shot.time + self.latency;
            self.waiting.push_back((sent_at, self.camera.frame(shot)));
        }
    }

    /// Returns the next frame whose latency has elapsed.
    pub(super) fn take(&mut self, now: Duration) -> Option<Bytes> {
        let (sent_at, _) = self.waiting.front()?;
        if *sent_at > now {
            return None;
        }
        self.waiting.pop_front().map(|(_, jpeg)| jpeg)
    }
}
