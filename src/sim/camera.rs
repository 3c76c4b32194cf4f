//! The camera: the world as the robot sees it from its pose, as a JPEG. Casts one ray for each
//! column of the picture and paints what it meets from far to near.

use bytes::Bytes;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use super::geometry::{Point, Pose};
use super::grain::Grain;
use super::ground::Ground;
use super::obstacles::Obstacles;
use super::scene::{Hit, Panel, Round, Scene, What};
use super::surface::{Place, Rgb, scaled};
use super::view::{Column, EYE, HORIZON, Row, View};
use super::world::World;

/// Width of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const WIDTH: usize = 320;
/// Height of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const HEIGHT: usize = 240;

const QUALITY: u8 = 75;
const CEILING: Rgb = [224.0, 223.0, 218.0];

/// Renders frames.
pub(super) struct Camera {
    scene: Scene,
    ground: Ground,
    focal: f32,
    light: f32,
    lamp: Lamp,
    rows: Vec<Row>,
    grain: Grain,
    pixels: Vec<[u8; 3]>,
    hits: Vec<Hit>,
}

/// The lamp that shades balls and posts.
#[derive(Debug, Clone, Copy)]
struct Lamp {
    at: Point,
    height: f32,
}

impl Camera {
    /// The camera of a robot in a world; `seed` gives the grain of its pictures.
    pub(super) fn new(world: &World, seed: u64) -> Camera {
        let room = &world.room;
        let hfov = world.camera.hfov_degrees.to_radians() as f32;
        let (focal, light) = (WIDTH as f32 / 2.0 / (hfov / 2.0).tan(), world.light as f32);
        let rows = (0..HEIGHT / 2).map(|row| Row::below_horizon(row, focal, light));
        Camera {
            scene: Scene::of(world),
            ground: Ground::of(world, &Obstacles::of(world)),
            focal,
            light,
            rows: rows.collect(),
            lamp: Lamp {
                at: Point::new(room.width * 0.45, room.depth * 0.6),
                height: room.height as f32,
            },
            grain: Grain::new(world.camera.noise, seed),
            pixels: vec![[0; 3]; WIDTH * HEIGHT],
            hits: Vec::new(),
        }
    }

    /// One frame, with or without the headlight.
    pub(super) fn frame(&mut self, pose: Pose, flash: bool) -> Bytes {
        self.render(pose, flash);
        let mut jpeg = Vec::with_capacity(16 * 1024);
        let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, QUALITY);
        let (width, height) = (WIDTH as u32, HEIGHT as u32);
        if let Err(error) = encoder.encode(
            self.pixels.as_flattened(),
            width,
            height,
            ExtendedColorType::Rgb8,
        ) {
            // Into memory and with a size that is right, it does not fail.
            tracing::error!(target: "spykee::sim", %error, "cannot encode a frame");
        }
        Bytes::from(jpeg)
    }

    fn render(&mut self, pose: Pose, flash: bool) {
        let view = View::of(pose, self.focal, self.light, flash);
        let mut hits = std::mem::take(&mut self.hits);
        for index in 0..WIDTH {
            let column = view.column(index);
            let (dx, dy) = view.direction(column);
            self.scene.hits(view.eye, dx, dy, &mut hits);
            self.paint_column(&view, column, &hits);
        }
        self.hits = hits;
        self.grain.add_to(self.pixels.as_flattened_mut());
    }

    fn paint_column(&mut self, view: &View, column: Column, hits: &[Hit]) {
        let far = hits.first().map_or(50.0, |hit| hit.depth);
        self.paint_ceiling(view, column, far);
        self.paint_ground(view, column, far);
        for hit in hits {
            match hit.what {
                What::Panel { index, share } => {
                    self.paint_panel(view, column, hit.depth, index, share);
                }
                What::Round { index, aside } => {
                    let round = &self.scene.rounds[index];
                    let middle = view.relative(round.middle);
                    match round.top {
                        Some(_) => self.paint_post(view, column, hit.depth, index, aside),
                        None => self.paint_ball(view, column, index, middle),
                    }
                }
            }
        }
    }

    fn paint_ceiling(&mut self, view: &View, column: Column, far: f32) {
        for row in 0..view.row(self.lamp.height, far) {
            let shade = 0.80 + 0.20 * (row as f32 / HORIZON);
            self.put(column.index, row, scaled(CEILING, shade * view.light));
        }
    }

    fn paint_ground(&mut self, view: &View, column: Column, far: f32) {
        let (dx, dy) = view.direction(column);
        let (x, y) = (view.eye.x as f32, view.eye.y as f32);
        let (dx, dy) = (dx as f32, dy as f32);
        let beam = view.beam(column);
        for row in view.row(0.0, far).max(HEIGHT / 2)..HEIGHT {
            let Row {
                depth,
                detail,
                lamps,
                flash,
            } = self.rows[row - HEIGHT / 2];
            let colour = self.ground.colour(x + dx * depth, y + dy * depth, detail);
            self.put(column.index, row, scaled(colour, lamps + flash * beam));
        }
    }

    fn paint_panel(&mut self, view: &View, column: Column, depth: f32, index: usize, share: f32) {
        let Panel {
            length,
            top,
            surface,
            light,
            ..
        } = self.scene.panels[index];
        let gain = view.gain(column, depth) * light;
        let strip = surface.strip(Place {
            along: share * length,
            length,
            top,
        });
        let scale = depth / view.focal;
        for row in view.row(top, depth)..view.row(0.0, depth) {
            let height = EYE - (row as f32 + 0.5 - HORIZON) * scale;
            self.put(column.index, row, scaled(strip.colour(height), gain));
        }
    }

    fn paint_post(&mut self, view: &View, column: Column, depth: f32, index: usize, aside: f32) {
        let Round {
            top, paint, middle, ..
        } = self.scene.rounds[index];
        let top = top.unwrap_or(0.0);
        let (ahead, right) = view.relative(self.lamp.at);
        let (post_ahead, post_right) = view.relative(middle);
        let lamp = (right - post_right).atan2(post_ahead - ahead);
        let facing = (aside.asin() - lamp).cos().max(0.0);
        let shine = ((aside.asin() - lamp) / 0.25).powi(2);
        let gain = view.gain(column, depth) * (0.62 + 0.38 * facing);
        let colour = scaled(paint, gain).map(|channel| channel + 40.0 * (-shine).exp());
        for row in view.row(top, depth)..view.row(0.0, depth) {
            let height = view.height(row, depth);
            let foot = 0.7 + 0.3 * (height / 0.06).clamp(0.0, 1.0);
            let cap = if top - height < 0.02 { 1.15 } else { 1.0 };
            self.put(column.index, row, scaled(colour, foot * cap));
        }
    }

    fn paint_ball(&mut self, view: &View, column: Column, index: usize, middle: (f32, f32)) {
        let Round { radius, paint, .. } = self.scene.rounds[index];
        let (ahead, right) = middle;
        let nearest = (ahead - radius).max(0.02);
        let lamp = self.lamp_from(view, middle, radius);
        let gain = view.gain(column, ahead);
        for row in view.row(2.0 * radius, nearest)..view.row(-radius, nearest) {
            let down = (row as f32 + 0.5 - HORIZON) / view.focal;
            let ray = [1.0, column.slope, down];
            let Some(normal) = sphere_normal(ray, [ahead, right, EYE - radius], radius) else {
                continue;
            };
            let facing = dot(normal, lamp);
            let shine = facing.max(0.0).powi(24) * 90.0;
            let body = scaled(
                paint,
                gain * (0.50 + 0.28 * (facing + 1.0) * 0.5 + 0.34 * facing.max(0.0)),
            );
            self.put(
                column.index,
                row,
                body.map(|channel| channel + shine * view.light),
            );
        }
    }

    /// The direction of the lamp from a ball, in the camera's ahead, right and down.
    fn lamp_from(&self, view: &View, (ahead, right): (f32, f32), radius: f32) -> Rgb {
        let (lamp_ahead, lamp_right) = view.relative(self.lamp.at);
        let way = [
            lamp_ahead - ahead,
            lamp_right - right,
            radius - self.lamp.height,
        ];
        scaled(way, 1.0 / dot(way, way).sqrt().max(1e-3))
    }

    fn put(&mut self, column: usize, row: usize, colour: Rgb) {
        // A float becomes a byte by cutting off what does not fit.
        let pixel = &mut self.pixels[row * WIDTH + column];
        pixel[0] = colour[0] as u8;
        pixel[1] = colour[1] as u8;
        pixel[2] = colour[2] as u8;
    }
}

/// Which way a ball's surface looks where a ray from the origin meets it.
fn sphere_normal(ray: Rgb, middle: Rgb, radius: f32) -> Option<Rgb> {
    let (a, b) = (dot(ray, ray), dot(ray, middle));
    let under = b * b - a * (dot(middle, middle) - radius * radius);
    if under < 0.0 {
        return None;
    }
    let depth = (b - under.sqrt()) / a;
    Some(std::array::from_fn(|i| {
        (depth * ray[i] - middle[i]) / radius
    }))
}

fn dot(a: Rgb, b: Rgb) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    const RED: fn([u8; 3]) -> bool = |[r, g, b]| r > 110 && g < 80 && b < 80;

    fn shot(world: &World, pose: Pose, flash: bool) -> image::RgbImage {
        let jpeg = Camera::new(world, 1).frame(pose, flash);
        image::load_from_memory(&jpeg).unwrap().to_rgb8()
    }

    /// Number and mean place of the pixels of a colour.
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
        // A radius of 0.1 m at 1 m, focal length 277 pixels: a disc of about 2,400 pixels.
        assert!((1900..2900).contains(&count), "{count}");
        assert!((x - 159.5).abs() < 3.0, "{x}");
        assert!((y - 147.0).abs() < 6.0, "{y}");
    }

    #[test]
    fn what_stands_to_the_left_is_seen_to_the_left() {
        let world = pen("balls: [{at: [3, 2.3], colour: red}]");
        let (count, x, _) = find(&shot(&world, Pose::new(1.9, 2.0, 0.0), false), RED);
        assert!(count > 1000 && x < 100.0, "{count} at {x}");
    }

    #[test]
    fn posts_are_upright_and_what_is_behind_is_hidden() {
        let world = pen(
            "balls: [{at: [3, 2], colour: red}]\nposts: [{at: [2.6, 2], radius: 0.15, colour: blue}]",
        );
        let image = shot(&world, Pose::new(1.9, 2.0, 0.0), false);
        let (blue, x, y) = find(&image, |[r, g, b]| b > 110 && r < 80 && g < 120);
        assert!(
            blue > 8000 && (x - 159.5).abs() < 4.0 && y < 160.0,
            "{blue} at {x}, {y}"
        );
        assert_eq!(find(&image, RED).0, 0);
    }

    #[test]
    fn low_furniture_hides_the_ball_and_not_the_post_behind_it() {
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
    fn the_headlight_brightens_what_is_near_and_the_lamps_everything() {
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
        let frame = |seed| Camera::new(&world, seed).frame(world.start_pose(), false);
        assert_eq!(frame(1), frame(1));
        assert_ne!(frame(1), frame(2));
        assert!(
            (4_000..25_000).contains(&frame(1).len()),
            "{}",
            frame(1).len()
        );
    }

    #[test]
    fn every_pose_has_a_picture_even_inside_of_things() {
        let world = World::default_world();
        let mut camera = Camera::new(&world, 1);
        for i in 0..120 {
            let (x, y) = (f64::from(i % 12) * 0.7 - 0.5, f64::from(i / 12) * 0.6 - 0.3);
            let jpeg = camera.frame(Pose::new(x, y, f64::from(i)), i % 2 == 0);
            assert!(jpeg.starts_with(&[0xFF, 0xD8]) && jpeg.ends_with(&[0xFF, 0xD9]));
        }
    }
}
