//! The camera: the world as seen from the robot's pose, as JPEGs with motion blur and noise.

pub(crate) mod floor;
mod lens;
mod light;
mod renderer;
mod scene;
mod sensor;
mod surface;
mod texture;
pub(crate) mod view;

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;
use rand::rngs::StdRng;
use rand::{Rng, RngExt, SeedableRng};
use vision::JpegEncoder;

use self::lens::Lens;
use self::renderer::Renderer;
use self::sensor::Sensor;
use self::texture::Pixel;
use self::view::{HEIGHT, WIDTH};
use crate::geometry::{Point, Pose};
use crate::world::World;
use crate::world::settings::CameraSettings;

pub(crate) struct Camera {
    settings: CameraSettings,
    lens: Lens,
    renderer: Renderer,
    sensor: Sensor,
    exposure: Exposure,
    /// Shot, at time zero, and exposure of the last rendered frame, unless it is outdated.
    last_inputs: Option<(Shot, f32)>,
    grain: Grain,
    grainy: Vec<Pixel>,
    /// Created for the first frame: most simulated robots never take one.
    encoder: Option<JpegEncoder>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shot {
    pub(crate) pose: Pose,
    pub(crate) flash: bool,
    /// The robot's turning speed, radians per second.
    pub(crate) turning: f64,
    pub(crate) time: Duration,
}

impl Camera {
    pub(crate) fn new(world: &World, seed: u64) -> Camera {
        let lens = Lens::new(&world.camera);
        Camera {
            settings: world.camera,
            renderer: Renderer::new(world, lens.canvas),
            lens,
            sensor: Sensor::new(&world.camera),
            exposure: Exposure::new(&world.camera),
            last_inputs: None,
            grain: Grain::new(world.camera.noise, seed),
            grainy: vec![[0; 4]; WIDTH * HEIGHT],
            encoder: None,
        }
    }

    pub(crate) fn set_light(&mut self, gain: f32) {
        self.renderer.lighting.set_gain(gain);
        self.last_inputs = None;
    }

    pub(crate) fn move_rounds(&mut self, places: impl Iterator<Item = Point>) {
        if self.renderer.scene.move_rounds(places) {
            self.last_inputs = None;
        }
    }

    pub(crate) fn frame(&mut self, shot: Shot) -> Bytes {
        self.render(shot);
        let frame = self.lens.frame.as_flattened();
        self.grain.add_to(frame, self.grainy.as_flattened_mut());
        let quality = self.settings.quality as u8;
        let subsampling = self.settings.subsampling;
        self.encoder
            .get_or_insert_with(|| {
                JpegEncoder::new(quality, subsampling, WIDTH as u16, HEIGHT as u16)
            })
            .encode(&self.grainy)
    }

    /// Renders the frame, unless nothing has changed since the last one; then only the grain
    /// differs.
    fn render(&mut self, shot: Shot) {
        let seconds = shot.time.as_secs_f64();
        let changed = self.renderer.lighting.advance_to(seconds);
        let exposure = self.exposure.gain;
        let time = Duration::ZERO;
        let inputs = Some((Shot { time, ..shot }, exposure));
        if changed || self.last_inputs != inputs {
            let turned = shot.turning.abs() * self.settings.shutter;
            self.renderer
                .render(shot.pose, shot.flash, exposure, turned);
            self.lens.take(&self.renderer.frame);
            self.sensor.apply(&mut self.lens.frame);
            self.last_inputs = inputs;
        }
        self.exposure.update(&self.lens.frame, shot.time);
    }
}

const GAINS: std::ops::RangeInclusive<f32> = 0.5..=2.5;
/// One in this many pixels is measured.
const SAMPLE_STEP: usize = 37;

/// The exposure control: amplifies the light of a frame.
#[derive(Debug)]
pub(super) struct Exposure {
    /// Time constant, seconds; 0 switches it off.
    slowness: f64,
    /// The mean brightness of a frame that it aims at, 0..=255.
    wanted: f32,
    /// 1 leaves the light unchanged.
    gain: f32,
    last: Option<Duration>,
}

impl Exposure {
    pub(super) fn new(settings: &CameraSettings) -> Exposure {
        Exposure {
            slowness: settings.exposure,
            wanted: (settings.brightness * 255.0) as f32,
            gain: 1.0,
            last: None,
        }
    }

    /// Adjusts the gain to the brightness of a frame taken at `time`.
    pub(super) fn update(&mut self, frame: &[Pixel], time: Duration) {
        if self.slowness <= 0.0 {
            return;
        }
        let some = frame.iter().step_by(SAMPLE_STEP);
        let sum: u32 = some.map(|pixel| u32::from(pixel[1])).sum();
        let mean = (sum as f32 * SAMPLE_STEP as f32 / frame.len() as f32).max(1.0);
        let wanted = (self.gain * self.wanted / mean).clamp(*GAINS.start(), *GAINS.end());
        let share = self.last.map_or(1.0, |before| {
            let passed = time.saturating_sub(before).as_secs_f64();
            passed / (passed + self.slowness)
        });
        self.gain += (wanted - self.gain) * share as f32;
        self.last = Some(time);
    }
}

/// Bytes of a frame before it is encoded.
const LEN: usize = WIDTH * HEIGHT * 4;
/// Number of possible offsets, in pixels, of the noise of a frame.
const SHIFTS: usize = 4096;
/// Range of the noise at strength 1, on the scale 0..=255.
const MAX_RANGE: f64 = 32.0;

/// Noise for frames: generated once, and added to each frame at a random offset.
pub(crate) struct Grain {
    /// 0..=`middle` * 2 for each byte of a frame, the same for all channels of a pixel.
    noise: Vec<u8>,
    middle: u8,
    random: StdRng,
}

impl Grain {
    /// Creates noise of this strength, 0..=1.
    pub(crate) fn new(strength: f64, seed: u64) -> Grain {
        let mut random = StdRng::seed_from_u64(seed);
        let middle = (strength.clamp(0.0, 1.0) * MAX_RANGE / 2.0).round() as u8;
        let mut bytes = vec![0; LEN / 4 + SHIFTS];
        random.fill_bytes(&mut bytes);
        let level = |byte: u8| (u16::from(byte) * (2 * u16::from(middle) + 1) / 256) as u8;
        let noise = bytes
            .into_iter()
            .flat_map(|byte| [level(byte); 4])
            .collect();
        Grain {
            noise,
            middle,
            random,
        }
    }

    pub(crate) fn add_to(&mut self, pixels: &[u8], grainy: &mut [u8]) {
        if self.middle == 0 {
            return grainy.copy_from_slice(pixels);
        }
        let noise = &self.noise[self.random.random_range(0..SHIFTS) * 4..];
        for ((grainy, channel), noise) in grainy.iter_mut().zip(pixels).zip(noise) {
            *grainy = channel.saturating_add(*noise).saturating_sub(self.middle);
        }
    }
}

/// The camera, with the frames that wait to be sent.
pub(super) struct Video {
    pub(super) camera: Camera,
    fps: f64,
    latency: Duration,
    /// Elapsed share of the frame period; the next frame is due at 1.
    due: f64,
    pub(super) frames: u64,
    /// Frames delayed by the latency, each with the time at which it is sent.
    waiting: VecDeque<(Duration, Bytes)>,
}

impl Video {
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

    /// Makes the next frame due immediately.
    pub(super) fn trigger_frame(&mut self) {
        self.due = 1.0;
    }

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

    pub(super) fn take(&mut self, now: Duration) -> Option<Bytes> {
        let (sent_at, _) = self.waiting.front()?;
        if *sent_at > now {
            return None;
        }
        self.waiting.pop_front().map(|(_, jpeg)| jpeg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn grain_is_weak_and_has_no_bias() {
        let mut pixels = vec![0; LEN];
        Grain::new(0.25, 5).add_to(&vec![100; LEN], &mut pixels);
        assert!(pixels.iter().all(|channel| (96..=104).contains(channel)));
        let mean = pixels
            .iter()
            .map(|channel| f64::from(*channel))
            .sum::<f64>()
            / LEN as f64;
        assert!((mean - 100.0).abs() < 0.5, "{mean}");
    }

    #[test]
    fn strength_zero_adds_no_grain() {
        let mut pixels = vec![0; LEN];
        Grain::new(0.0, 5).add_to(&vec![100; LEN], &mut pixels);
        assert!(pixels.iter().all(|channel| *channel == 100));
    }

    const RED: fn([u8; 3]) -> bool = |[r, g, b]| r > 110 && g < 80 && b < 80;

    fn still(pose: Pose, flash: bool) -> Shot {
        Shot {
            pose,
            flash,
            turning: 0.0,
            time: Duration::ZERO,
        }
    }

    fn shot(world: &World, pose: Pose, flash: bool) -> image::RgbImage {
        let jpeg = Camera::new(world, 1).frame(still(pose, flash));
        image::load_from_memory(&jpeg).unwrap().to_rgb8()
    }

    /// Returns the number and mean position of the pixels of a colour.
    fn find(image: &image::RgbImage, wanted: fn([u8; 3]) -> bool) -> (usize, f64, f64) {
        let found: Vec<_> = image
            .enumerate_pixels()
            .filter(|(.., p)| wanted(p.0))
            .collect();
        let count = found.len().max(1) as f64;
        let x = found.iter().map(|(x, ..)| f64::from(*x)).sum::<f64>() / count;
        let y = found.iter().map(|(_, y, _)| f64::from(*y)).sum::<f64>() / count;
        (found.len(), x, y)
    }

    fn pen(thing: &str) -> World {
        let text = format!(
            "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0}}\n{thing}\n"
        );
        World::from_yaml(&text, "pen").unwrap()
    }

    #[test]
    fn a_red_ball_ahead_is_red_pixels_near_the_centre() {
        let world = pen("balls: [{at: [3, 2], colour: red}]");
        let image = shot(&world, Pose::new(1.9, 2.0, 0.0), false);
        assert_eq!(image.dimensions(), (320, 240));
        let (count, x, y) = find(&image, RED);
        // A radius of 0.1 m at 1 m, focal length 381 pixels: a disc of about 4,500 pixels, whose
        // middle is 0.19 m below the lens.
        assert!((3600..5000).contains(&count), "{count}");
        assert!((x - 156.7).abs() < 3.0, "{x}");
        assert!((y - 115.9 - 380.0 * 0.19).abs() < 6.0, "{y}");
    }

    #[test]
    fn a_thing_on_the_left_appears_on_the_left() {
        let world = pen("balls: [{at: [3, 2.3], colour: red}]");
        let (count, x, _) = find(&shot(&world, Pose::new(1.9, 2.0, 0.0), false), RED);
        assert!(count > 1000 && x < 100.0, "{count} at {x}");
    }

    #[test]
    fn posts_are_upright_and_hide_things_behind_them() {
        let world = pen(
            "balls: [{at: [3, 2], colour: red}]\nposts: [{at: [2.6, 2], radius: 0.15, colour: blue}]",
        );
        let image = shot(&world, Pose::new(1.9, 2.0, 0.0), false);
        let (blue, x, y) = find(&image, |[r, g, b]| b > 110 && r < 80 && g < 120);
        assert!(
            blue > 8000 && (x - 156.7).abs() < 4.0 && y < 160.0,
            "{blue} at {x}, {y}"
        );
        assert_eq!(find(&image, RED).0, 0);
    }

    #[test]
    fn low_furniture_hides_the_ball_but_not_the_post_behind_it() {
        let world = pen(
            "furniture: [{at: [3, 2], length: 0.4, width: 1, height: 0.3, colour: grey}]\n\
         balls: [{at: [3.5, 2], colour: green}]\nposts: [{at: [3.5, 2], height: 1, colour: red}]",
        );
        let image = shot(&world, Pose::new(1.5, 2.0, 0.0), false);
        let (red, _, y) = find(&image, RED);
        assert!(red > 300 && y < 115.0, "{red} at row {y}");
        assert_eq!(find(&image, |[r, g, _]| g > 110 && r < 80).0, 0);
    }

    #[test]
    fn the_headlight_brightens_near_things_and_the_lamps_everything() {
        let brightness = |light: f64, flash: bool| {
            let image = shot(
                &pen(&format!("light: {light}")),
                Pose::new(1.0, 2.0, PI),
                flash,
            );
            image
                .as_raw()
                .iter()
                .map(|channel| u64::from(*channel))
                .sum::<u64>()
        };
        assert!(brightness(0.2, true) > brightness(0.2, false) * 5 / 4);
        assert!(brightness(1.0, false) > brightness(0.2, false) * 3);
    }

    #[test]
    fn frames_are_small_and_the_same_for_the_same_seed() {
        let world = World::default_world();
        let frame = |seed| Camera::new(&world, seed).frame(still(world.start_pose(), false));
        assert_eq!(frame(1), frame(1));
        assert_ne!(frame(1), frame(2));
        assert!(
            (3_500..7_000).contains(&frame(1).len()),
            "{}",
            frame(1).len()
        );
    }

    #[test]
    fn a_robot_at_rest_sees_changes() {
        let world = pen("balls: [{at: [3, 2], colour: red}]");
        let mut camera = Camera::new(&world, 1);
        let look = |camera: &mut Camera, flash| {
            let jpeg = camera.frame(still(Pose::new(1.9, 2.0, 0.0), flash));
            image::load_from_memory(&jpeg).unwrap().to_rgb8()
        };
        let bright = |image: &image::RgbImage| {
            let channels = image.as_raw().iter();
            channels.map(|channel| u64::from(*channel)).sum::<u64>()
        };
        let (_, middle, _) = find(&look(&mut camera, false), RED);
        camera.move_rounds([Point::new(3.0, 2.3)].into_iter());
        let moved = look(&mut camera, false);
        let (_, left, _) = find(&moved, RED);
        assert!(left < middle - 30.0, "{left} from {middle}");
        let lit = look(&mut camera, true);
        assert!(bright(&lit) > bright(&moved));
        camera.set_light(0.3);
        let dim = look(&mut camera, true);
        assert!(bright(&dim) < bright(&lit) * 9 / 10);
        assert_eq!(
            find(&look(&mut camera, true), RED).0 > 0,
            find(&dim, RED).0 > 0
        );
    }

    /// The mean red, green and blue of 10x10 pixels.
    fn colour_at(image: &image::RgbImage, left: u32, top: u32) -> [f64; 3] {
        let places = (0..100).map(|i| (left + i % 10, top + i / 10));
        let sum = places.fold([0.0; 3], |sum, (x, y)| {
            let pixel = image.get_pixel(x, y).0;
            std::array::from_fn(|i| sum[i] + f64::from(pixel[i]))
        });
        sum.map(|channel| channel / 100.0)
    }

    #[test]
    fn a_vignette_darkens_the_corners_of_the_frame() {
        let seen = |camera: &str| {
            let image = shot(&pen(camera), Pose::new(1.0, 2.0, 0.0), false);
            [colour_at(&image, 2, 2), colour_at(&image, 155, 20)]
        };
        let [corner, middle] = seen("camera: {noise: 0}");
        let [dark, same] = seen("camera: {noise: 0, vignette: [0.7, 0.6, 0.5]}");
        for channel in 0..3 {
            assert!((same[channel] / middle[channel] - 0.9).abs() < 0.1);
            let left = dark[channel] / corner[channel];
            let wanted = [0.41, 0.49, 0.58][channel];
            assert!((left - wanted).abs() < 0.05, "{channel}: {left}");
        }
    }

    #[test]
    fn saturation_and_softness_reach_the_frame() {
        let seen = |camera: &str| {
            let world = pen(&format!("balls: [{{at: [3, 2], colour: red}}]\n{camera}"));
            shot(&world, Pose::new(1.9, 2.0, 0.0), false)
        };
        let steepest = |image: &image::RgbImage| {
            let steps = (80..240).map(|x| {
                let [before, after] = [x, x + 1].map(|x| image.get_pixel(x, 190).0[1]);
                u32::from(before.abs_diff(after))
            });
            steps.max().unwrap()
        };
        let usual = seen("camera: {noise: 0}");
        let soft = seen("camera: {noise: 0, softness: 1.5}");
        assert!(steepest(&soft) < steepest(&usual) * 6 / 10);
        let colour = |image: &image::RgbImage| {
            let [red, green, _] = colour_at(image, 152, 185);
            red - green
        };
        let pale = seen("camera: {noise: 0, saturation: 0.4}");
        let ratio = colour(&pale) / colour(&usual);
        assert!((ratio - 0.4).abs() < 0.05, "{ratio}");
        assert!(colour(&seen("camera: {saturation: 0}")).abs() < 4.0);
    }

    #[test]
    fn the_automatic_exposure_reaches_the_brightness() {
        for (brightness, least, most) in [(0.3, 70.0, 83.0), (0.55, 132.0, 148.0)] {
            let world = pen(&format!(
                "camera: {{exposure: 0.2, brightness: {brightness}}}"
            ));
            let mut camera = Camera::new(&world, 1);
            let mut jpeg = Bytes::new();
            for i in 0..30 {
                jpeg = camera.frame(Shot {
                    time: Duration::from_millis(100 * i),
                    ..still(Pose::new(1.9, 2.0, 0.0), false)
                });
            }
            let image = image::load_from_memory(&jpeg).unwrap().to_rgb8();
            let greens = image.pixels().map(|pixel| f64::from(pixel.0[1]));
            let mean = greens.sum::<f64>() / f64::from(image.width() * image.height());
            assert!((least..most).contains(&mean), "{brightness}: {mean}");
        }
    }

    #[test]
    fn a_glossy_floor_has_dark_joints_and_reflects_what_stands_on_it() {
        let seen = |floor: &str| {
            let text = format!(
                "room: {{width: 6, depth: 4, floor: {floor}}}\ncamera: {{noise: 0}}\n\
                 station: {{at: [0, 2], heading_degrees: 0}}\n\
                 posts: [{{at: [4, 2], radius: 0.2, height: 1, colour: red}}]\n"
            );
            let world = World::from_yaml(&text, "floor").unwrap();
            shot(&world, Pose::new(1.9, 2.0, 0.0), false)
        };
        let glossy = seen("glossy_tiles");
        // 0.4 m nearer than the post, whose foot is 2 m from the lens.
        let below = |image: &image::RgbImage| {
            let [red, green, _] = colour_at(image, 152, 180);
            red - green
        };
        let more = below(&glossy) - below(&seen("concrete"));
        assert!((10.0..60.0).contains(&more), "{more}");
        // 1 m from the lens, 0.3 m are 114 pixels; joints at 1.8 and 2.1 m.
        let bright = |x: u32| f64::from(glossy.get_pixel(x, 226).0[1]);
        let around = |x: u32| (x - 6..=x + 6).map(bright).fold(255.0, f64::min);
        let joints = [156 - 38, 156 + 76];
        let tiles = [156 - 38 - 57, 156 + 19];
        for (joint, tile) in joints.into_iter().zip(tiles) {
            let [joint, tile] = [around(joint), around(tile)];
            assert!(joint < 0.9 * tile, "{joint} {tile}");
        }
    }

    #[test]
    fn every_pose_gives_a_frame_even_inside_things() {
        let world = World::default_world();
        let mut camera = Camera::new(&world, 1);
        for i in 0..120 {
            let x = f64::from(i % 12) * 0.7 - 0.5;
            let y = f64::from(i / 12) * 0.6 - 0.3;
            let jpeg = camera.frame(still(Pose::new(x, y, f64::from(i)), i % 2 == 0));
            assert!(jpeg.starts_with(&[0xFF, 0xD8]) && jpeg.ends_with(&[0xFF, 0xD9]));
        }
    }
}
