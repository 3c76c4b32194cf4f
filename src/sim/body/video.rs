//! The video stream: frames at their rate, each sent when the camera's latency is over.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;

use crate::sim::camera::{Camera, Shot};
use crate::sim::world::document::World;

/// The camera with the frames that it owes.
pub(super) struct Video {
    pub(super) camera: Camera,
    fps: f64,
    latency: Duration,
    /// Part of the next frame's period that is over, 1 when it is due.
    due: f64,
    frames: u64,
    /// Frames that wait for their latency, with the time at which they are sent.
    waiting: VecDeque<(Duration, Bytes)>,
}

impl Video {
    /// `seed` draws the noise of the frames.
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

    /// Frames rendered so far.
    pub(super) fn frames(&self) -> u64 {
        self.frames
    }

    /// The next frame is due at once.
    pub(super) fn hurry(&mut self) {
        self.due = 1.0;
    }

    /// The stream is off: frames that wait are dropped.
    pub(super) fn stop(&mut self) {
        self.waiting.clear();
    }

    /// Lets `dt` pass and takes a frame if one is due; `prepare` says of what.
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

    /// The next frame whose latency is over.
    pub(super) fn take(&mut self, now: Duration) -> Option<Bytes> {
        let (sent_at, _) = self.waiting.front()?;
        if *sent_at > now {
            return None;
        }
        self.waiting.pop_front().map(|(_, jpeg)| jpeg)
    }
}
