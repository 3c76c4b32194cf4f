//! The camera: the world as the robot sees it from its pose, as a JPEG. Upright things column by
//! column, the floor row by row; then smeared and with noise.

mod grain;
pub(crate) mod ground;
mod jpeg;
mod light;
mod scene;
pub(crate) mod sign;
mod surface;
mod texture;
pub(crate) mod view;

use std::time::Duration;

use bytes::Bytes;

use self::grain::Grain;
use self::ground;
use self::jpeg::Encoder;
use self::light::{Light, Lighting};
use self::scene::{Hit, Kind, Round, Scene, What};
use self::surface::{Rgb, Surface, scaled};
use self::texture::{Pixel, Texture, between, lit, smear};
use self::view::{CameraSettings, Column, EYE, HEIGHT, HORIZON, Row, View, WIDTH, lamps};
use crate::sim::geometry::{Point, Pose};
use crate::sim::world::document::World;

const CEILING: Pixel = [224, 223, 218, 0];
/// The number that stands for full light.
const FULL: f32 = 128.0;
/// Columns that share one look at the lamps' light on the floor.
const PATCH: usize = 16;
/// What the automatic exposure wants of the mean of a frame, 0..=255, and how far it goes.
const MIDDLE_GREY: f32 = 105.0;
const EXPOSURES: std::ops::RangeInclusive<f32> = 0.5..=2.5;
/// Longest smear, pixels.
const LONGEST_SMEAR: usize = 24;

/// Renders frames.
pub(crate) struct Camera {
    scene: Scene,
    settings: CameraSettings,
    /// Painted for the first frame: most robots of a test never look.
    floor: Option<Texture>,
    /// Likewise.
    encoder: Option<Encoder>,
    world: World,
    lighting: Lighting,
    focal: f32,
    lamp: Lamp,
    rows: Vec<Row>,
    grain: Grain,
    exposure: f32,
    exposed: Option<Duration>,
    frame: Vec<Pixel>,
    /// What `frame` shows, if nothing has changed since.
    sight: Option<Sight>,
    /// The same with its grain.
    grainy: Vec<Pixel>,
    ceiling: Vec<Pixel>,
    /// Room for smearing.
    sums: Vec<u64>,
    standing: Vec<Vec<Hit>>,
    hanging: Vec<Vec<Hit>>,
    /// The row at which each column's floor begins.
    shores: Vec<usize>,
}

/// The lamp that shades balls and posts.
#[derive(Debug, Clone, Copy)]
struct Lamp {
    at: Point,
    height: f32,
}

/// What one frame is taken of.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shot {
    pub(crate) pose: Pose,
    /// The headlight is on.
    pub(crate) flash: bool,
    /// How fast the robot turns, radians a second.
    pub(crate) turning: f64,
    /// Simulated time.
    pub(crate) time: Duration,
}

/// All that a picture depends on besides what stands and shines where.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sight {
    pose: Pose,
    flash: bool,
    turning: f64,
    exposure: f32,
}

impl Camera {
    /// Makes all light so many times as bright as the world says.
    pub(crate) fn set_light(&mut self, gain: f32) {
        self.lighting.set_gain(gain);
        self.sight = None;
    }

    /// The camera of a robot in a world; `seed` gives the grain of its pictures.
    pub(crate) fn new(world: &World, seed: u64) -> Camera {
        let room = &world.room;
        let hfov = world.camera.hfov_degrees.to_radians() as f32;
        let focal = WIDTH as f32 / 2.0 / (hfov / 2.0).tan();
        let rows = (0..HEIGHT / 2).map(|row| Row::below_horizon(row, focal));
        Camera {
            scene: Scene::of(world),
            settings: world.camera,
            floor: None,
            encoder: None,
            lighting: Lighting::of(world),
            focal,
            rows: rows.collect(),
            lamp: Lamp {
                at: Point::new(room.width * 0.45, room.depth * 0.6),
                height: room.height as f32,
            },
            grain: Grain::new(world.camera.noise, seed),
            exposure: 1.0,
            exposed: None,
            ceiling: vec![[0; 4]; HEIGHT],
            sums: Vec::new(),
            frame: vec![[0; 4]; WIDTH * HEIGHT],
            sight: None,
            grainy: vec![[0; 4]; WIDTH * HEIGHT],
            standing: vec![Vec::new(); WIDTH],
            hanging: vec![Vec::new(); WIDTH],
            shores: vec![HEIGHT; WIDTH],
            world: world.clone(),
        }
    }

    /// Balls and people are somewhere else now.
    pub(crate) fn move_rounds(&mut self, places: impl Iterator<Item = Point>) {
        if self.scene.move_rounds(places) {
            self.sight = None;
        }
    }

    /// One frame.
    pub(crate) fn frame(&mut self, shot: Shot) -> Bytes {
        self.look(shot);
        self.grain
            .lay_over(self.frame.as_flattened(), self.grainy.as_flattened_mut());
        let (quality, subsampling) = (self.settings.quality as u8, self.settings.subsampling);
        self.encoder
            .get_or_insert_with(|| Encoder::new(quality, subsampling))
            .encode(&self.grainy)
    }

    /// A robot that stands still sees the same again and again, but for the grain.
    fn look(&mut self, shot: Shot) {
        let changed = self.lighting.pass_to(shot.time.as_secs_f64());
        let sight = Some(Sight {
            pose: shot.pose,
            flash: shot.flash,
            turning: shot.turning,
            exposure: self.exposure,
        });
        if changed || self.sight != sight {
            self.render(shot);
            self.sight = sight;
        }
        self.expose(shot.time);
    }

    fn render(&mut self, shot: Shot) {
        let view = View::of(shot.pose, self.focal, shot.flash);
        self.survey(&view);
        self.light_ceiling();
        for index in 0..WIDTH {
            self.paint_column(&view, view.column(index));
        }
        self.paint_floor(&view);
        for index in 0..WIDTH {
            self.paint_hanging(&view, view.column(index));
        }
        let turned = shot.turning.abs() * self.settings.shutter * f64::from(self.focal);
        let length = (turned.round() as usize).min(LONGEST_SMEAR);
        if length > 1 {
            for row in self.frame.chunks_exact_mut(WIDTH) {
                smear(row, length, &mut self.sums);
            }
        }
    }

    /// Finds what is in each column, nearest first.
    fn survey(&mut self, view: &View) {
        let (standing, hanging) = (&mut self.standing, &mut self.hanging);
        standing
            .iter_mut()
            .chain(hanging.iter_mut())
            .for_each(Vec::clear);
        let scene = &self.scene;
        for (index, panel) in scene.panels.iter().enumerate() {
            let stands = !matches!(panel.surface, Surface::Sign(_));
            let columns = if stands {
                &mut *standing
            } else {
                &mut *hanging
            };
            scene.columns_of_panel(index, view, |column, hit| columns[column].push(hit));
        }
        for (index, round) in scene.rounds.iter().enumerate() {
            let stands = round.kind != Kind::Ball;
            let columns = if stands {
                &mut *standing
            } else {
                &mut *hanging
            };
            scene.columns_of_round(index, view, |column, hit| columns[column].push(hit));
        }
        for hits in standing.iter_mut().chain(hanging.iter_mut()) {
            hits.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        }
    }

    /// From near to far, each as far down as what stands before it lets it be seen.
    fn paint_column(&mut self, view: &View, column: Column) {
        let standing = std::mem::take(&mut self.standing[column.index]);
        let mut limit = HEIGHT;
        let mut shore = HEIGHT / 2;
        for (number, hit) in standing.iter().enumerate() {
            let top = view.row(self.top_of(hit.what), hit.depth);
            let foot = view.row(0.0, hit.depth).min(limit);
            if number == 0 {
                shore = foot;
            }
            if top < foot {
                self.paint_standing(view, column, *hit, top..foot);
            }
            limit = limit.min(top);
            if limit == 0 || self.is_wall(hit.what) {
                break;
            }
        }
        self.shores[column.index] = shore.max(HEIGHT / 2);
        self.paint_ceiling(
            column,
            if standing.is_empty() {
                HEIGHT / 2
            } else {
                limit
            },
        );
        self.standing[column.index] = standing;
    }

    fn top_of(&self, what: What) -> f32 {
        match what {
            What::Panel { index, .. } => self.scene.panels[index].top,
            What::Round { index, .. } => match self.scene.rounds[index].kind {
                Kind::Post { top } | Kind::Person { top } => top,
                Kind::Ball => 2.0 * self.scene.rounds[index].radius,
            },
        }
    }

    fn is_wall(&self, what: What) -> bool {
        let panel = match what {
            What::Panel { index, .. } => self.scene.panels.get(index),
            What::Round { .. } => None,
        };
        panel.is_some_and(|panel| matches!(panel.surface, Surface::Wall { .. }))
    }

    /// What the ceiling looks like in each row.
    fn light_ceiling(&mut self) {
        let (x, y) = (self.lamp.at.x as f32, self.lamp.at.y as f32);
        let room = self.lighting.at(x, y);
        for (row, colour) in self.ceiling.iter_mut().enumerate() {
            let shade = (0.80 + 0.20 * (row as f32 / HORIZON)) * self.exposure;
            *colour = lit(CEILING, light(room.map(|channel| channel * shade)));
        }
    }

    fn paint_ceiling(&mut self, column: Column, rows: usize) {
        for (row, colour) in self.ceiling[..rows].iter().enumerate() {
            self.frame[row * WIDTH + column.index] = *colour;
        }
    }

    fn paint_standing(
        &mut self,
        view: &View,
        column: Column,
        hit: Hit,
        rows: std::ops::Range<usize>,
    ) {
        let light = self.light_on(view, column, hit.depth);
        match hit.what {
            What::Panel { index, share } => {
                self.paint_panel(view, column, (hit.depth, light), (index, share), rows);
            }
            What::Round { index, aside } => {
                self.paint_pillar(view, column, (hit.depth, light), (index, aside), rows);
            }
        }
    }

    /// The light that comes back from a depth in a column, exposure included.
    fn light_on(&self, view: &View, column: Column, depth: f32) -> Light {
        let (x, y) = view.place(column, depth);
        let (fade, flash) = (lamps(depth), view.headlight(column, depth));
        let room = self.lighting.at(x, y);
        room.map(|channel| (channel * fade + flash) * self.exposure)
    }

    fn paint_panel(
        &mut self,
        view: &View,
        column: Column,
        (depth, room): (f32, Light),
        (index, share): (usize, f32),
        rows: std::ops::Range<usize>,
    ) {
        let panel = &self.scene.panels[index];
        let (length, bottom) = (panel.length, panel.bottom);
        let light = light(room.map(|channel| channel * panel.light));
        let size = depth / view.focal;
        let level = self.scene.picture(index).level(size);
        let strip = level.strip(share * length);
        // In 65,536ths of the strip's pixels.
        let fixed = level.scale[1] * 65_536.0;
        let step = (size * fixed) as i64;
        let mut place = ((view.height(rows.start, depth) - bottom) * fixed) as i64 + step;
        let last = strip.len() - 1;
        for row in rows {
            place -= step;
            let place = (place.max(0) >> 16) as usize;
            let index = row * WIDTH + column.index;
            self.frame[index] = lit(strip[place.min(last)], light);
        }
    }

    fn paint_pillar(
        &mut self,
        view: &View,
        column: Column,
        (depth, room): (f32, Light),
        (index, aside): (usize, f32),
        rows: std::ops::Range<usize>,
    ) {
        let Round {
            kind,
            paint,
            middle,
            ..
        } = self.scene.rounds[index];
        let (ahead, right) = view.relative(self.lamp.at);
        let (own_ahead, own_right) = view.relative(middle);
        let lamp = (right - own_right).atan2(own_ahead - ahead);
        let off = aside.asin() - lamp;
        let facing = off.cos().max(0.0);
        let light = light(room.map(|channel| channel * (0.62 + 0.38 * facing)));
        let shine = (off / 0.25) * (off / 0.25);
        let shine = 40.0 * (-shine).exp();
        for row in rows {
            let height = view.height(row, depth);
            let colour = match kind {
                Kind::Person { top } => clothes(paint, height / top, aside),
                Kind::Post { top } => {
                    let foot = 0.7 + 0.3 * (height / 0.06).clamp(0.0, 1.0);
                    let cap = if top - height < 0.02 { 1.15 } else { 1.0 };
                    scaled(paint, foot * cap).map(|channel| channel + shine)
                }
                Kind::Ball => paint,
            };
            self.put(column.index, row, colour, light);
        }
    }

    /// Balls and signs from far to near, no lower than where something nearer stands.
    fn paint_hanging(&mut self, view: &View, column: Column) {
        let hanging = std::mem::take(&mut self.hanging[column.index]);
        for hit in hanging.iter().rev() {
            let standing = self.standing[column.index].iter();
            let nearer = standing.take_while(|other| other.depth < hit.depth);
            let limit = nearer.map(|other| view.row(self.top_of(other.what), other.depth));
            let limit = limit.min().unwrap_or(HEIGHT);
            match hit.what {
                What::Panel { index, share } => {
                    let panel = &self.scene.panels[index];
                    let (top, bottom) = (panel.top, panel.bottom);
                    let rows = view.row(top, hit.depth)..view.row(bottom, hit.depth).min(limit);
                    let light = self.light_on(view, column, hit.depth);
                    self.paint_panel(view, column, (hit.depth, light), (index, share), rows);
                }
                What::Round { index, .. } => self.paint_ball(view, column, index, limit),
            }
        }
        self.hanging[column.index] = hanging;
    }

    fn paint_ball(&mut self, view: &View, column: Column, index: usize, limit: usize) {
        let Round {
            radius,
            paint,
            middle,
            ..
        } = self.scene.rounds[index];
        let (ahead, right) = view.relative(middle);
        let nearest = ahead - radius;
        if nearest < 0.02 {
            return;
        }
        let lamp = self.lamp_from(view, (ahead, right), radius);
        let room = light(self.light_on(view, column, ahead));
        for row in view.row(2.0 * radius, nearest)..view.row(-radius, nearest).min(limit) {
            let down = (row as f32 + 0.5 - HORIZON) / view.focal;
            let ray = [1.0, column.slope, down];
            let Some(normal) = sphere_normal(ray, [ahead, right, EYE - radius], radius) else {
                continue;
            };
            let facing = dot(normal, lamp);
            let lit = facing.max(0.0);
            let (lit4, lit8) = (
                lit * lit * lit * lit,
                lit * lit * lit * lit * lit * lit * lit * lit,
            );
            let shine = lit4 * lit4 * lit8 * lit8 * 90.0;
            let body = scaled(paint, 0.50 + 0.28 * (facing + 1.0) * 0.5 + 0.34 * lit);
            self.put(column.index, row, body.map(|channel| channel + shine), room);
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

    fn paint_floor(&mut self, view: &View) {
        let floor = self
            .floor
            .get_or_insert_with(|| ground::picture(&self.world));
        let even = self.lighting.even() && !view.flash;
        let edges = [view.column(0), view.column(1)];
        for row in HEIGHT / 2..HEIGHT {
            let Row {
                depth,
                lamps,
                flash,
            } = self.rows[row - HEIGHT / 2];
            let level = floor.level(depth / view.focal);
            let [x, y] = level.scale.map(|scale| scale * 256.0);
            let (x, y) = (y, x);
            let (start, next) = (view.place(edges[0], depth), view.place(edges[1], depth));
            let step = ((next.0 - start.0) * x, (next.1 - start.1) * y);
            let start = (start.0 * x - 128.0, start.1 * y - 128.0);
            let line = &mut self.frame[row * WIDTH..][..WIDTH];
            let stride = stride(depth / view.focal * level.scale[1]);
            for (patch, shores) in (0..WIDTH).step_by(PATCH).zip(self.shores.chunks(PATCH)) {
                if shores.iter().all(|shore| row < *shore) {
                    continue;
                }
                let middle = view.column(if even { WIDTH / 2 } else { patch + PATCH / 2 });
                let (px, py) = view.place(middle, depth);
                let (room, flash) = (self.lighting.at(px, py), flash * view.beam(middle));
                let light = light(room.map(|channel| (channel * lamps + flash) * self.exposure));
                let colour = |column: usize| {
                    let right = column as f32;
                    let (x, y) = (start.0 + right * step.0, start.1 + right * step.1);
                    lit(level.smooth(y as i32, x as i32), light)
                };
                let mut left = colour(patch);
                for part in (0..PATCH).step_by(stride) {
                    let right = colour(patch + part + stride);
                    for off in 0..stride {
                        if row >= shores[part + off] {
                            let share = (off * 256 / stride) as u32;
                            line[patch + part + off] = between(left, right, share);
                        }
                    }
                    left = right;
                }
            }
        }
    }

    fn put(&mut self, column: usize, row: usize, [r, g, b]: Rgb, light: Pixel) {
        // A float becomes a byte by cutting off what does not fit.
        let index = row * WIDTH + column;
        self.frame[index] = lit([r as u8, g as u8, b as u8, 0], light);
    }

    /// Lets the automatic exposure follow the light.
    fn expose(&mut self, time: Duration) {
        if self.settings.exposure <= 0.0 {
            return;
        }
        const EVERY: usize = 37;
        let some = self.frame.iter().step_by(EVERY);
        let sum: u32 = some.map(|pixel| u32::from(pixel[1])).sum();
        let mean = (sum as f32 * EVERY as f32 / (WIDTH * HEIGHT) as f32).max(1.0);
        let wanted = self.exposure * MIDDLE_GREY / mean;
        let wanted = wanted.clamp(*EXPOSURES.start(), *EXPOSURES.end());
        let passed = self
            .exposed
            .map(|before| time.saturating_sub(before).as_secs_f64());
        let share = passed.map_or(1.0, |passed| passed / (passed + self.settings.exposure));
        self.exposure += (wanted - self.exposure) * share as f32;
        self.exposed = Some(time);
    }
}

/// How many columns may share one look at the floor, when one of them is so many of the floor's
/// pixels wide: what is between looks is smooth.
fn stride(pixels: f32) -> usize {
    match pixels {
        _ if pixels < 0.25 => 4,
        _ if pixels < 0.6 => 2,
        _ => 1,
    }
}

/// Light as it is kept for a pixel.
fn light(light: Light) -> Pixel {
    let [r, g, b] = light.map(|channel| (channel * FULL) as u8);
    [r, g, b, 0]
}

/// What a person wears at a share of their height.
fn clothes(paint: Rgb, share: f32, aside: f32) -> Rgb {
    match share {
        _ if share < 0.05 => [40.0, 36.0, 34.0],
        _ if share < 0.45 && aside.abs() < 0.08 => [38.0, 40.0, 46.0],
        _ if share < 0.45 => scaled(paint, 0.62),
        _ if share < 0.82 => paint,
        _ if share > 0.95 => [70.0, 56.0, 44.0],
        _ => [186.0, 158.0, 140.0],
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
        let frame = |seed| Camera::new(&world, seed).frame(still(world.start_pose(), false));
        assert_eq!(frame(1), frame(1));
        assert_ne!(frame(1), frame(2));
        assert!(
            (4_000..25_000).contains(&frame(1).len()),
            "{}",
            frame(1).len()
        );
    }

    #[test]
    fn what_changes_before_a_robot_that_stands_still_is_seen() {
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

    #[test]
    fn every_pose_has_a_picture_even_inside_of_things() {
        let world = World::default_world();
        let mut camera = Camera::new(&world, 1);
        for i in 0..120 {
            let (x, y) = (f64::from(i % 12) * 0.7 - 0.5, f64::from(i / 12) * 0.6 - 0.3);
            let jpeg = camera.frame(still(Pose::new(x, y, f64::from(i)), i % 2 == 0));
            assert!(jpeg.starts_with(&[0xFF, 0xD8]) && jpeg.ends_with(&[0xFF, 0xD9]));
        }
    }
}
