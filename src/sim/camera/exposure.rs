//! The automatic exposure.

use std::time::Duration;

use super::texture::Pixel;

/// Target for the mean brightness of a frame, 0..=255.
const MIDDLE_GREY: f32 = 105.0;
/// Range of the gain.
const GAINS: std::ops::RangeInclusive<f32> = 0.5..=2.5;
/// One in this many pixels is measured.
const SAMPLE_STEP: usize = 37;

/// The exposure control: amplifies the light of a frame.
#[derive(Debug)]
pub(super) struct Exposure {
    /// Time constant, seconds; 0 switches it off.
    slowness: f64,
    gain: f32,
    last: Option<Duration>,
}

impl Exposure {
    /// Creates an exposure control; see
    /// [`CameraSettings::exposure`](crate::sim::CameraSettings::exposure).
    pub(super) fn new(slowness: f64) -> Exposure {
        Exposure {
            slowness,
            gain: 1.0,
            last: None,
        }
    }

    /// Returns the gain; 1 leaves the light unchanged.
    pub(super) fn gain(&self) -> f32 {
        self.gain
    }

    /// Adjusts the gain to the brightness of a frame taken at `time`.
    pub(super) fn update(&mut self, frame: &[Pixel], time: Duration) {
        if self.slowness <= 0.0 {
            return;
        }
        let some = frame.iter().step_by(SAMPLE_STEP);
        let sum: u32 = some.map(|pixel| u32::from(pixel[1])).sum();
        let mean = (sum as f32 * SAMPLE_STEP as f32 / frame.len() as f32).max(1.0);
        let wanted = self.gain * MIDDLE_GREY / mean;
        let wanted = wanted.clamp(*GAINS.start(), *GAINS.end());
        let passed = self
            .last
            .map(|before| time.saturating_sub(before).as_secs_f64());
        let share = passed.map_or(1.0, |passed| passed / (passed + self.slowness));
        self.gain += (wanted - self.gain) * share as f32;
        self.last = Some(time);
    }
}
