//! The map of a world: drawn to scale, with names.

mod canvas;
mod driven_path;

use std::f64::consts::PI;

use image::RgbImage;

use self::canvas::{Ink, MapCanvas, Pixel, TextStyle};
use crate::camera::floor::drawing_path;
use crate::geometry::{Point, Pose, RADIUS};
use crate::world::objects::{Paint, Route};
use crate::world::{World, name_or};

/// Approximate length of the longer side of the room, pixels.
const SIDE: f64 = 1000.0;
/// White margins at the sides, above and below the room, pixels.
const MARGIN: f32 = 56.0;
const HEAD: f32 = 64.0;
const FOOT: f32 = 84.0;

const DARK: Ink = [40, 42, 48, 255];
const PALE: Ink = [120, 122, 128, 255];
const WALL: Ink = [70, 72, 78, 255];
const FLOOR: Ink = [246, 243, 236, 255];
const GRID: Ink = [0, 0, 0, 16];
const BEACON: Ink = [220, 40, 60, 34];
const LAMP: Ink = [250, 190, 20, 255];
const GLOW: Ink = [255, 210, 60, 40];
const SOUND: Ink = [130, 60, 170, 255];
const SIGN: Ink = [20, 90, 150, 255];
const ROBOT: Ink = [30, 120, 200, 255];
pub(crate) const NAME: TextStyle = TextStyle::small(DARK);

impl World {
    /// Draws the map: walls, furniture, lines, the station with its infrared cone, balls and people
    /// with their paths, lamps, signs, sounds and the robot's start, with names and a scale.
    pub fn draw(&self) -> RgbImage {
        let Some(mut canvas) = blank_canvas(self, 0) else {
            return RgbImage::new(1, 1);
        };
        draw_onto(self, &mut canvas);
        robot(&mut canvas, self.start_pose(), ROBOT);
        let start = self.start_pose().point();
        let style = TextStyle::small(ROBOT);
        canvas.label(start, 0.2 * canvas.scale, "start", style);
        canvas.finish()
    }
}

/// Creates a white canvas for the map of a world, with `beside` more pixels on the right.
pub(crate) fn blank_canvas(world: &World, beside: u32) -> Option<MapCanvas> {
    let width = world.room.width;
    let depth = world.room.depth;
    let scale = SIDE / width.max(depth);
    let pixels = |side: f64| (side * scale) as f32;
    let right = MARGIN * 2.0 + pixels(width);
    let down = HEAD + FOOT + pixels(depth);
    let origin = Pixel::from_xy(MARGIN, HEAD + pixels(depth));
    MapCanvas::new(right as u32 + beside, down as u32, scale as f32, origin)
}

pub(crate) fn draw_onto(world: &World, canvas: &mut MapCanvas) {
    floor(world, canvas);
    station(world, canvas);
    walls(world, canvas);
    lamps_and_sounds(world, canvas);
    moving_objects(world, canvas);
    frame(world, canvas);
    names(world, canvas);
}

fn floor(world: &World, canvas: &mut MapCanvas) {
    canvas.fill(&world.room.footprint().corners(), FLOOR);
    for rug in &world.rugs {
        canvas.fill(&rug.footprint().corners(), ink(rug.colour, 90));
    }
    let width = world.room.width;
    let depth = world.room.depth;
    for metre in 1..width.max(depth).ceil() as u32 {
        let along = f64::from(metre);
        let low = Point::new(along, 0.0);
        let high = Point::new(along, depth);
        if along < width {
            canvas.line(&[low, high], 1.0, None, GRID);
        }
        let left = Point::new(0.0, along);
        let right = Point::new(width, along);
        if along < depth {
            canvas.line(&[left, right], 1.0, None, GRID);
        }
    }
    for line in world.strips() {
        if let Some(path) = drawing_path(&line.path()) {
            let least = 2.0 / f64::from(canvas.scale);
            canvas.tape(&path, line.width.max(least) as f32, ink(line.colour, 255));
        }
    }
}

impl World {
    /// Returns the outline of the area that the station's beacon reaches, in which the robot's own
    /// search can find the station.
    pub fn beacon_cone(&self) -> Vec<Point> {
        let station = &self.station;
        let obstacles = self.fixed_obstacles();
        let beacon = station.beacon();
        let half = station.beacon_degrees.abs().min(180.0).to_radians();
        const RAYS: i32 = 180;
        let mut cone = vec![beacon];
        for ray in 0..=RAYS {
            let angle = station.heading() + half * (2.0 * f64::from(ray) / f64::from(RAYS) - 1.0);
            let end = beacon.ahead(angle, station.range());
            let share = obstacles.first_side(beacon, end).unwrap_or(1.0);
            cone.push(beacon.towards(end, share));
        }
        cone
    }
}

fn station(world: &World, canvas: &mut MapCanvas) {
    canvas.fill(&world.beacon_cone(), BEACON);
    canvas.fill(&world.station.outline(), [200, 30, 50, 255]);
}

fn walls(world: &World, canvas: &mut MapCanvas) {
    for wall in &world.walls {
        canvas.fill(&wall.footprint().corners(), WALL);
    }
    for item in &world.furniture {
        canvas.fill(&item.footprint().corners(), ink(item.colour, 210));
        for side in item.footprint().sides() {
            canvas.line(&[side.from, side.to], 1.5, None, PALE);
        }
    }
    for post in &world.posts {
        let radius = post.radius as f32 * canvas.scale;
        canvas.dot(post.at.point(), radius, ink(post.colour, 255));
        canvas.ring(post.at.point(), radius, 2.0, DARK);
    }
    for sign in &world.signs {
        let at = sign.at.point();
        let heading = sign.heading_degrees.to_radians();
        let left = heading + PI / 2.0;
        let right = heading - PI / 2.0;
        let ends = [
            at.ahead(left, sign.side / 2.0),
            at.ahead(right, sign.side / 2.0),
        ];
        canvas.line(&ends, 6.0, None, SIGN);
        canvas.line(&[at, at.ahead(heading, 0.18)], 2.0, None, SIGN);
    }
    for side in world.room.footprint().sides() {
        canvas.line(&[side.from, side.to], 5.0, None, WALL);
    }
}

fn lamps_and_sounds(world: &World, canvas: &mut MapCanvas) {
    for lamp in &world.lamps {
        let at = lamp.at.point();
        let scale = canvas.scale;
        canvas.dot(at, (lamp.reach as f32 * scale / 2.0).min(90.0), GLOW);
        for ray in 0..8 {
            let angle = f64::from(ray) * PI / 4.0;
            let pixel = 1.0 / f64::from(scale);
            let ends = [at.ahead(angle, 9.0 * pixel), at.ahead(angle, 14.0 * pixel)];
            canvas.line(&ends, 2.0, None, LAMP);
        }
        canvas.dot(at, 7.0, LAMP);
    }
    for sound in &world.sounds {
        let at = sound.at.point();
        canvas.dot(at, 5.0, SOUND);
        canvas.ring(at, 10.0, 2.0, SOUND);
        canvas.ring(at, 15.0, 1.5, SOUND);
    }
}

fn moving_objects(world: &World, canvas: &mut MapCanvas) {
    for ball in &world.balls {
        let route_ink = ink(ball.colour, 200);
        draw_route(canvas, ball.at.point(), ball.path.as_ref(), route_ink);
        let radius = ball.radius as f32 * canvas.scale;
        canvas.dot(ball.at.point(), radius, ink(ball.colour, 255));
        canvas.ring(ball.at.point(), radius, 1.0, PALE);
    }
    for walker in &world.walkers {
        draw_route(canvas, walker.at.point(), walker.path.as_ref(), PALE);
        let radius = walker.radius as f32 * canvas.scale;
        canvas.dot(walker.at.point(), radius, ink(walker.colour, 255));
        canvas.dot(walker.at.point(), radius * 0.5, [224, 190, 164, 255]);
    }
}

fn draw_route(canvas: &mut MapCanvas, from: Point, route: Option<&Route>, ink: Ink) {
    let Some(route) = route else {
        return;
    };
    let mut corners: Vec<Point> = route.through.iter().map(|spot| spot.point()).collect();
    for corner in &corners {
        canvas.dot(*corner, 3.5, ink);
    }
    if route.closed {
        corners.extend(corners.first().copied());
    }
    if let Some(first) = corners.first() {
        canvas.line(&[from, *first], 1.5, Some(3.0), ink);
    }
    canvas.line(&corners, 2.0, Some(8.0), ink);
}

/// Draws the title, the numbers along the walls and the scale.
fn frame(world: &World, canvas: &mut MapCanvas) {
    let room = &world.room;
    let title = TextStyle::title(DARK);
    let name = name_or(&world.name, "a world");
    canvas.write(Pixel::from_xy(MARGIN, 14.0), name, title);
    let after = MARGIN + title.size(name).0 + 20.0;
    let size = format!("{} m x {} m", room.width, room.depth);
    let at = Pixel::from_xy(after, 17.0);
    canvas.write(at, &size, TextStyle::small(PALE));
    let is_large = room.width.max(room.depth) > 15.0;
    let every = if is_large { 5 } else { 1 };
    for metre in (0..=room.width as u32).step_by(every) {
        let Pixel { x, y } = canvas.at(Point::new(f64::from(metre), 0.0));
        let text = metre.to_string();
        let width = TextStyle::small(PALE).size(&text).0;
        let at = Pixel::from_xy(x - width / 2.0, y + 8.0);
        canvas.write(at, &text, TextStyle::small(PALE));
    }
    for metre in (0..=room.depth as u32).step_by(every) {
        let Pixel { x, y } = canvas.at(Point::new(0.0, f64::from(metre)));
        let text = metre.to_string();
        let (width, height) = TextStyle::small(PALE).size(&text);
        let at = Pixel::from_xy(x - width - 10.0, y - height / 2.0);
        canvas.write(at, &text, TextStyle::small(PALE));
    }
    let corner = canvas.at(Point::new(0.0, 0.0));
    let y = corner.y + 54.0;
    let start = corner.x;
    let end = start + canvas.scale;
    let at = Pixel::from_xy;
    canvas.rule(at(start, y), at(end, y), 3.0, DARK);
    canvas.rule(at(start, y - 6.0), at(start, y + 6.0), 3.0, DARK);
    canvas.rule(at(end, y - 6.0), at(end, y + 6.0), 3.0, DARK);
    canvas.write(at(end + 10.0, y - 8.0), "1 m", NAME);
    draw_beacon_key(canvas, end + 60.0, y);
}

/// Draws the key for the beacon's area at a pixel.
fn draw_beacon_key(canvas: &mut MapCanvas, x: f32, y: f32) {
    let corners = [
        (x, y - 7.0),
        (x + 22.0, y - 7.0),
        (x + 22.0, y + 7.0),
        (x, y + 7.0),
    ];
    // More opaque than on the map, where the floor's colour is below it.
    canvas.fill_pixels(
        &corners.map(Pixel::from),
        [BEACON[0], BEACON[1], BEACON[2], 60],
    );
    canvas.write(
        Pixel::from_xy(x + 30.0, y - 8.0),
        "the station's beacon",
        NAME,
    );
}

fn names(world: &World, canvas: &mut MapCanvas) {
    let scale = canvas.scale;
    let away = |metres: f64| metres as f32 * scale + 4.0;
    let station = &world.station;
    let at = station.at.point().ahead(station.heading(), 0.05);
    let style = TextStyle::small([170, 20, 40, 255]);
    canvas.label(at, away(0.19), "station", style);
    for sign in &world.signs {
        let text = format!("\"{}\"", short(&sign.text));
        canvas.label(sign.at.point(), 12.0, &text, TextStyle::small(SIGN));
    }
    for item in &world.furniture {
        canvas.label(item.at.point(), -8.0, &item.name, NAME);
    }
    for walker in &world.walkers {
        let name = name_or(&walker.name, "walker");
        canvas.label(walker.at.point(), away(walker.radius), name, NAME);
    }
    for lamp in &world.lamps {
        let name = name_or(&lamp.name, "lamp");
        let style = TextStyle::small([140, 96, 0, 255]);
        canvas.label(lamp.at.point(), 16.0, name, style);
    }
    for sound in &world.sounds {
        let name = name_or(&sound.name, "sound");
        canvas.label(sound.at.point(), 18.0, name, TextStyle::small(SOUND));
    }
}

/// Draws the robot from above, with an arrow for its heading.
pub(crate) fn robot(canvas: &mut MapCanvas, pose: Pose, ink: Ink) {
    let radius = RADIUS as f32 * canvas.scale;
    canvas.dot(pose.point(), radius, [ink[0], ink[1], ink[2], 70]);
    canvas.ring(pose.point(), radius, 2.0, ink);
    let tip = pose.point().ahead(pose.heading, RADIUS * 1.25);
    let side = |angle: f64| pose.point().ahead(pose.heading + angle, RADIUS * 0.7);
    canvas.fill(&[tip, side(2.4), side(-2.4)], ink);
}

fn ink(paint: Paint, opaque: u8) -> Ink {
    let [r, g, b] = paint.0;
    [r, g, b, opaque]
}

/// Shortens a long text and replaces control characters.
fn short(text: &str) -> String {
    const MAX_CHARS: usize = 28;
    let printable = |letter: char| if letter.is_control() { ' ' } else { letter };
    let mut short: String = text.chars().take(MAX_CHARS).map(printable).collect();
    if text.chars().count() > MAX_CHARS {
        short.push_str("...");
    }
    short
}
