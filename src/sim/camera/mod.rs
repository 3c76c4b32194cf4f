//! The camera: the world as seen from the robot's pose, as a JPEG with motion blur and noise.

mod exposure;
mod floor;
mod grain;
pub(crate) mod ground;
mod lens;
mod light;
mod renderer;
mod scene;
mod shading;
mod sign;
mod surface;
#[cfg(test)]
mod tests;
mod texture;
pub(crate) mod view;

use std::time::Duration;

use bytes::Bytes;

use self::exposure::Exposure;
use self::grain::Grain;
use self::lens::Lens;
use self::renderer::Renderer;
use self::texture::Pixel;
use self::view::{HEIGHT, WIDTH};
use crate::sim::geometry::{Point, Pose};
use crate::sim::world::document::World;
use crate::sim::world::settings::CameraSettings;
use crate::vision::JpegEncoder;

/// A camera that takes frames.
pub(crate) struct Camera {
    settings: CameraSettings,
    lens: Lens,
    renderer: Renderer,
    exposure: Exposure,
    /// Inputs of the last rendered frame, unless it is outdated.
    last_inputs: Option<FrameInputs>,
    grain: Grain,
    /// The frame with grain.
    grainy: Vec<Pixel>,
    /// Created for the first frame: most simulated robots never take one.
    encoder: Option<JpegEncoder>,
}

/// The parameters of one frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shot {
    pub(crate) pose: Pose,
    /// The headlight is on.
    pub(crate) flash: bool,
    /// The robot's turning speed, radians per second.
    pub(crate) turning: f64,
    /// Simulated time.
    pub(crate) time: Duration,
}

/// All inputs of a frame except the scene and its lights.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FrameInputs {
    pose: Pose,
    flash: bool,
    turning: f64,
    exposure: f32,
}

impl Camera {
    /// Creates the camera of a robot in a world; `seed` determines the grain of its frames.
    pub(crate) fn new(world: &World, seed: u64) -> Camera {
        let lens = Lens::new(&world.camera);
        Camera {
            settings: world.camera,
            renderer: Renderer::new(world, lens.focal),
            lens,
            exposure: Exposure::new(world.camera.exposure),
            last_inputs: None,
            grain: Grain::new(world.camera.noise, seed),
            grainy: vec![[0; 4]; WIDTH * HEIGHT],
            encoder: None,
        }
    }

    /// Multiplies all light of the world by `gain`.
    pub(crate) fn set_light(&mut self, gain: f32) {
        self.renderer.lighting.set_gain(gain);
        self.last_inputs = None;
    }

    /// Moves balls and people.
    pub(crate) fn move_rounds(&mut self, places: impl Iterator<Item = Point>) {
        if self.renderer.scene.move_rounds(places) {
            self.last_inputs = None;
        }
    }

    /// Takes one frame and returns it as a JPEG.
    pub(crate) fn frame(&mut self, shot: Shot) -> Bytes {
        self.render(shot);
        let frame = self.lens.output(self.renderer.frame());
        let grainy = &mut self.grainy;
        self.grain
            .add_to(frame.as_flattened(), grainy.as_flattened_mut());
        let quality = self.settings.quality as u8;
        let subsampling = self.settings.subsampling;
        self.encoder
            .get_or_insert_with(|| {
                JpegEncoder::new(quality, subsampling, (WIDTH as u16, HEIGHT as u16))
            })
            .encode(&self.grainy)
    }

    /// Renders the frame, unless nothing has changed since the last one; then only the grain
    /// differs.
    fn render(&mut self, shot: Shot) {
        let Shot {
            pose,
            flash,
            turning,
            time,
        } = shot;
        let changed = self.renderer.lighting.advance_to(time.as_secs_f64());
        let exposure = self.exposure.gain();
        let inputs = Some(FrameInputs {
            pose,
            flash,
            turning,
            exposure,
        });
        if changed || self.last_inputs != inputs {
            let turned = turning.abs() * self.settings.shutter;
            self.renderer.render(pose, flash, exposure, turned);
            self.lens.distort(self.renderer.frame());
            self.last_inputs = inputs;
        }
        self.exposure
            .update(self.lens.output(self.renderer.frame()), time);
    }
}
