//! Renders frames: upright things column by column from near to far, then the floor row by row, and
//! finally balls and signs on top.

use std::ops::Range;

use super::floor::Floor;
use super::light::{Light, Lighting, light};
use super::scene::{Hit, RoundKind, Scene, Thing};
use super::surface::{Rgb, Surface, scaled};
use super::texture::{Pixel, lit, motion_blur};
use super::view::{Canvas, Column, HEIGHT, View, lamps};
use crate::geometry::{Point, Pose};
use crate::world::World;

const CEILING: Pixel = [224, 223, 218, 0];
/// Maximum length of the motion blur, pixels.
const MAX_BLUR: usize = 24;

pub(super) struct Renderer {
    pub(super) scene: Scene,
    pub(super) lighting: Lighting,
    floor: Floor,
    canvas: Canvas,
    lamp: Lamp,
    exposure: f32,
    pub(super) frame: Vec<Pixel>,
    ceiling: Vec<Pixel>,
    sums: Vec<u64>,
    standing: Vec<Vec<Hit>>,
    overlays: Vec<Vec<Hit>>,
    /// The first row of the floor in each column.
    floor_tops: Vec<usize>,
}

/// The light source for the shading of balls and posts.
#[derive(Debug, Clone, Copy)]
struct Lamp {
    at: Point,
    height: f32,
}

impl Renderer {
    pub(super) fn new(world: &World, canvas: Canvas) -> Renderer {
        let room = &world.room;
        Renderer {
            scene: Scene::new(world),
            lighting: Lighting::new(world),
            floor: Floor::new(world),
            canvas,
            lamp: Lamp {
                at: Point::new(room.width * 0.45, room.depth * 0.6),
                height: room.height as f32,
            },
            exposure: 1.0,
            frame: vec![[0; 4]; canvas.width * canvas.height],
            ceiling: vec![[0; 4]; canvas.height],
            sums: Vec::new(),
            standing: vec![Vec::new(); canvas.width],
            overlays: vec![Vec::new(); canvas.width],
            floor_tops: vec![canvas.height; canvas.width],
        }
    }

    /// Renders the view from a pose; `turned` is the angle, in radians, by which the robot turns
    /// while the shutter is open.
    pub(super) fn render(&mut self, pose: Pose, flash: bool, exposure: f32, turned: f64) {
        self.exposure = exposure;
        let view = View::new(pose, self.canvas, flash);
        self.find_things(&view);
        self.light_ceiling();
        for index in 0..self.canvas.width {
            self.paint_column(&view, view.column(index));
        }
        let frame = &mut self.frame;
        let floor_tops = &self.floor_tops;
        self.floor
            .paint(frame, floor_tops, &view, &self.lighting, exposure);
        for index in 0..self.canvas.width {
            self.paint_overlays(&view, view.column(index));
        }
        let length = ((turned * f64::from(self.canvas.focal)).round() as usize).min(MAX_BLUR);
        if length > 1 {
            for row in self.frame.chunks_exact_mut(self.canvas.width) {
                motion_blur(row, length, &mut self.sums);
            }
        }
    }

    fn find_things(&mut self, view: &View) {
        let standing = &mut self.standing;
        let overlays = &mut self.overlays;
        standing
            .iter_mut()
            .chain(overlays.iter_mut())
            .for_each(Vec::clear);
        let scene = &self.scene;
        for (index, panel) in scene.panels.iter().enumerate() {
            let columns = match panel.surface {
                Surface::Sign(_) => &mut *overlays,
                _ => &mut *standing,
            };
            scene.columns_of_panel(index, view, |column, hit| columns[column].push(hit));
        }
        for (index, round) in scene.rounds.iter().enumerate() {
            let columns = match round.kind {
                RoundKind::Ball => &mut *overlays,
                _ => &mut *standing,
            };
            scene.columns_of_round(index, view, |column, hit| columns[column].push(hit));
        }
        for hits in standing.iter_mut().chain(overlays.iter_mut()) {
            hits.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        }
    }

    /// Draws the standing things of a column from near to far, each down to where a nearer one
    /// hides it.
    fn paint_column(&mut self, view: &View, column: Column) {
        let standing = std::mem::take(&mut self.standing[column.index]);
        let horizon = self.canvas.horizon;
        let mut limit = self.canvas.height;
        let mut floor_top = horizon;
        for (number, hit) in standing.iter().enumerate() {
            let top = view.row(self.top_of(hit.thing), hit.depth);
            let foot = view.row(0.0, hit.depth).min(limit);
            if number == 0 {
                floor_top = foot;
            }
            if top < foot {
                self.paint_standing(view, column, *hit, top..foot);
            }
            limit = limit.min(top);
            if limit == 0 || self.is_wall(hit.thing) {
                break;
            }
        }
        self.floor_tops[column.index] = floor_top.max(horizon);
        let ceiling_rows = if standing.is_empty() { horizon } else { limit };
        for (row, colour) in self.ceiling[..ceiling_rows].iter().enumerate() {
            self.frame[row * self.canvas.width + column.index] = *colour;
        }
        self.standing[column.index] = standing;
    }

    fn top_of(&self, thing: Thing) -> f32 {
        match thing {
            Thing::Panel { index, .. } => self.scene.panels[index].top,
            Thing::Round { index, .. } => match self.scene.rounds[index].kind {
                RoundKind::Post { top } | RoundKind::Person { top } => top,
                RoundKind::Ball => 2.0 * self.scene.rounds[index].radius,
            },
        }
    }

    fn is_wall(&self, thing: Thing) -> bool {
        match thing {
            Thing::Panel { index, .. } => {
                matches!(self.scene.panels[index].surface, Surface::Wall { .. })
            }
            Thing::Round { .. } => false,
        }
    }

    fn light_ceiling(&mut self) {
        let x = self.lamp.at.x as f32;
        let y = self.lamp.at.y as f32;
        let room = self.lighting.at(x, y);
        let horizon = self.canvas.horizon as f32;
        for (row, colour) in self.ceiling.iter_mut().enumerate() {
            let down = (row as f32 - horizon) / (HEIGHT as f32 / 2.0);
            let shade = (1.0 + 0.20 * down.clamp(-2.0, 0.0)) * self.exposure;
            *colour = lit(CEILING, light(room.map(|channel| channel * shade)));
        }
    }

    fn paint_standing(&mut self, view: &View, column: Column, hit: Hit, rows: Range<usize>) {
        match hit.thing {
            Thing::Panel { index, share } => {
                self.paint_panel(view, column, hit.depth, index, share, rows);
            }
            Thing::Round { index, aside } => {
                self.paint_pillar(view, column, hit.depth, index, aside, rows);
            }
        }
    }

    /// Returns the light reflected from a depth in a column, including the exposure.
    fn light_on(&self, view: &View, column: Column, depth: f32) -> Light {
        let (x, y) = view.place(column, depth);
        let fade = lamps(depth);
        let flash = view.headlight(column, depth);
        let room = self.lighting.at(x, y);
        room.map(|channel| (channel * fade + flash) * self.exposure)
    }

    fn paint_panel(
        &mut self,
        view: &View,
        column: Column,
        depth: f32,
        index: usize,
        share: f32,
        rows: Range<usize>,
    ) {
        let room = self.light_on(view, column, depth);
        let panel = &self.scene.panels[index];
        let length = panel.length;
        let bottom = panel.bottom;
        let light = light(room.map(|channel| channel * panel.light));
        let size = depth / view.canvas.focal;
        let level = self.scene.picture(index).level(size);
        let strip = level.strip(share * length);
        // Fixed point: 65,536ths of the strip's texels.
        let fixed = level.scale[1] * 65_536.0;
        let step = (size * fixed) as i64;
        let mut place = ((view.height(rows.start, depth) - bottom) * fixed) as i64 + step;
        let last = strip.len() - 1;
        for row in rows {
            place -= step;
            let place = (place.max(0) >> 16) as usize;
            let index = row * view.canvas.width + column.index;
            self.frame[index] = lit(strip[place.min(last)], light);
        }
    }

    fn paint_pillar(
        &mut self,
        view: &View,
        column: Column,
        depth: f32,
        index: usize,
        aside: f32,
        rows: Range<usize>,
    ) {
        let room = self.light_on(view, column, depth);
        let round = self.scene.rounds[index];
        let (ahead, right) = view.relative(self.lamp.at);
        let (own_ahead, own_right) = view.relative(round.middle);
        let lamp = (right - own_right).atan2(own_ahead - ahead);
        let off = aside.asin() - lamp;
        let facing = off.cos().max(0.0);
        let light = light(room.map(|channel| channel * (0.62 + 0.38 * facing)));
        let shine = 40.0 * (-(off / 0.25) * (off / 0.25)).exp();
        for row in rows {
            let height = view.height(row, depth);
            let colour = pillar_colour(round.kind, round.paint, height, aside, shine);
            self.put(column.index, row, colour, light);
        }
    }

    /// Draws balls and signs from far to near, down to where a nearer standing thing hides them.
    fn paint_overlays(&mut self, view: &View, column: Column) {
        let overlays = std::mem::take(&mut self.overlays[column.index]);
        for hit in overlays.iter().rev() {
            let standing = self.standing[column.index].iter();
            let nearer = standing.take_while(|other| other.depth < hit.depth);
            let limit = nearer.map(|other| view.row(self.top_of(other.thing), other.depth));
            let limit = limit.min().unwrap_or(view.canvas.height);
            match hit.thing {
                Thing::Panel { index, share } => {
                    let panel = &self.scene.panels[index];
                    let top = view.row(panel.top, hit.depth);
                    let rows = top..view.row(panel.bottom, hit.depth).min(limit);
                    self.paint_panel(view, column, hit.depth, index, share, rows);
                }
                Thing::Round { index, .. } => self.paint_ball(view, column, index, limit),
            }
        }
        self.overlays[column.index] = overlays;
    }

    fn paint_ball(&mut self, view: &View, column: Column, index: usize, limit: usize) {
        let round = self.scene.rounds[index];
        let radius = round.radius;
        let (ahead, right) = view.relative(round.middle);
        let nearest = ahead - radius;
        if nearest < 0.02 {
            return;
        }
        let (lamp_ahead, lamp_right) = view.relative(self.lamp.at);
        let way = [
            lamp_ahead - ahead,
            lamp_right - right,
            radius - self.lamp.height,
        ];
        let lamp = scaled(way, 1.0 / dot(way, way).sqrt().max(1e-3));
        let room = light(self.light_on(view, column, ahead));
        for row in view.row(2.0 * radius, nearest)..view.row(-radius, nearest).min(limit) {
            let ray = [1.0, column.slope, view.down(row)];
            let Some(normal) = sphere_normal(ray, [ahead, right, view.canvas.eye - radius], radius)
            else {
                continue;
            };
            self.put(
                column.index,
                row,
                ball_colour(round.paint, normal, lamp),
                room,
            );
        }
    }

    fn put(&mut self, column: usize, row: usize, [r, g, b]: Rgb, light: Pixel) {
        // The conversion from float to byte saturates.
        let index = row * self.canvas.width + column;
        self.frame[index] = lit([r as u8, g as u8, b as u8, 0], light);
    }
}

/// `aside` is the offset from the middle as a share of the radius, `shine` the lamp's reflection.
fn pillar_colour(kind: RoundKind, paint: Rgb, height: f32, aside: f32, shine: f32) -> Rgb {
    match kind {
        RoundKind::Person { top } => clothes(paint, height / top, aside),
        RoundKind::Post { top } => {
            let foot = 0.7 + 0.3 * (height / 0.06).clamp(0.0, 1.0);
            let cap = if top - height < 0.02 { 1.15 } else { 1.0 };
            scaled(paint, foot * cap).map(|channel| channel + shine)
        }
        RoundKind::Ball => paint,
    }
}

/// Returns the colour of a ball at a surface normal; `lamp` is the direction of the lamp.
fn ball_colour(paint: Rgb, normal: Rgb, lamp: Rgb) -> Rgb {
    let facing = dot(normal, lamp);
    let lit = facing.max(0.0);
    let lit4 = lit * lit * lit * lit;
    let lit8 = lit * lit * lit * lit * lit * lit * lit * lit;
    let shine = lit4 * lit4 * lit8 * lit8 * 90.0;
    let body = scaled(paint, 0.50 + 0.28 * (facing + 1.0) * 0.5 + 0.34 * lit);
    body.map(|channel| channel + shine)
}

/// Returns the colour of a person, clothes included, at a share of their height.
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

/// Returns the surface normal of a sphere where a ray from the origin hits it; `None` if it misses.
fn sphere_normal(ray: Rgb, middle: Rgb, radius: f32) -> Option<Rgb> {
    let a = dot(ray, ray);
    let b = dot(ray, middle);
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
