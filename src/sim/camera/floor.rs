//! The floor of a frame, rendered row by row, and its texture: planks, tiles or concrete, rugs and
//! lines, and the soft shadows of the things on it.

use kurbo::{BezPath, PathEl};
use tiny_skia::{Path, PathBuilder, PixmapMut, Stroke, Transform};

use super::light::{Grid, Lighting, light};
use super::surface::{Rgb, rgb, scaled, scatter};
use super::texture::{Level, Pixel, Texture, between, lit};
use super::view::{View, flash, lamps};
use crate::geometry::Point;
use crate::world::World;
use crate::world::fixtures::Tape;
use crate::world::objects::{self, Rug};

/// Number of columns that share one sample of the light on the floor; a canvas is a multiple of it
/// wide.
pub(super) const PATCH: usize = 16;

pub(super) struct Floor {
    world: World,
    /// Created for the first frame: most simulated robots never take one.
    texture: Option<Texture>,
}

impl Floor {
    pub(super) fn new(world: &World) -> Floor {
        Floor {
            world: world.clone(),
            texture: None,
        }
    }

    /// Renders the rows below the horizon; `floor_tops` holds the row at which each column's floor
    /// begins.
    pub(super) fn paint(
        &mut self,
        frame: &mut [Pixel],
        floor_tops: &[usize],
        view: &View,
        lighting: &Lighting,
        exposure: f32,
    ) {
        let floor = self
            .texture
            .get_or_insert_with(|| floor_texture(&self.world));
        let glossy = self.world.room.floor == objects::Floor::GlossyTiles;
        let even = lighting.is_uniform() && !view.flash;
        let canvas = view.canvas;
        let width = canvas.width;
        for row in canvas.horizon..canvas.height {
            let depth = canvas.eye * canvas.focal / ((row - canvas.horizon) as f32 + 0.5);
            let reflected_lamps = lamps(depth);
            let reflected_flash = flash(depth);
            let texels = Texels::at_depth(floor, view, depth);
            let line = &mut frame[row * width..][..width];
            for (patch, floor_tops) in (0..width).step_by(PATCH).zip(floor_tops.chunks(PATCH)) {
                if floor_tops.iter().all(|floor_top| row < *floor_top) {
                    continue;
                }
                let middle = view.column(if even { canvas.left } else { patch + PATCH / 2 });
                let (px, py) = view.place(middle, depth);
                let room = lighting.at(px, py);
                let flash = reflected_flash * view.beam(middle);
                let light =
                    light(room.map(|channel| (channel * reflected_lamps + flash) * exposure));
                let visible = |column: usize| row >= floor_tops[column];
                texels.paint(&mut line[patch..][..PATCH], patch, light, visible);
            }
            if glossy {
                let share = reflected(canvas.eye, depth);
                reflect(&mut frame[..(row + 1) * width], floor_tops, row, share);
            }
        }
    }
}

/// Returns which share of the light from a depth is a reflection on a glossy floor, in 256ths.
fn reflected(eye: f32, depth: f32) -> u32 {
    let steepness = eye / eye.hypot(depth);
    (GLOSS * (1.0 - steepness).powi(5) * 256.0) as u32
}

/// Adds to a row, the last of these, what stands on the floor: each column mirrored at its foot.
fn reflect(rows: &mut [Pixel], floor_tops: &[usize], row: usize, share: u32) {
    let width = floor_tops.len();
    for (column, floor_top) in floor_tops.iter().enumerate() {
        if *floor_top <= row && share > 0 {
            let mirrored = rows[(2 * floor_top).saturating_sub(row + 1) * width + column];
            let pixel = &mut rows[row * width + column];
            *pixel = between(*pixel, mirrored, share);
        }
    }
}

/// The texels of the floor that one row of the frame shows.
struct Texels<'a> {
    level: &'a Level,
    /// The place of the first column, x and y in 256ths of a texel.
    start: [f32; 2],
    /// From one column to the next.
    step: [f32; 2],
    /// The number of columns that share one sample; those between samples are interpolated.
    stride: usize,
}

impl<'a> Texels<'a> {
    fn at_depth(floor: &'a Texture, view: &View, depth: f32) -> Texels<'a> {
        let level = floor.level(depth / view.canvas.focal);
        let [y, x] = level.scale.map(|scale| scale * 256.0);
        let start = view.place(view.column(0), depth);
        let next = view.place(view.column(1), depth);
        let stride = match depth / view.canvas.focal * level.scale[1] {
            pixels if pixels < 0.25 => 4,
            pixels if pixels < 0.6 => 2,
            _ => 1,
        };
        Texels {
            level,
            start: [start.0 * x - 128.0, start.1 * y - 128.0],
            step: [(next.0 - start.0) * x, (next.1 - start.1) * y],
            stride,
        }
    }

    fn colour(&self, column: usize, light: Pixel) -> Pixel {
        let right = column as f32;
        let x = self.start[0] + right * self.step[0];
        let y = self.start[1] + right * self.step[1];
        lit(self.level.smooth(y as i32, x as i32), light)
    }

    /// Paints the visible ones of these columns, the first of which is `patch`.
    fn paint(
        &self,
        line: &mut [Pixel],
        patch: usize,
        light: Pixel,
        visible: impl Fn(usize) -> bool,
    ) {
        let mut left = self.colour(patch, light);
        for part in (0..PATCH).step_by(self.stride) {
            let right = self.colour(patch + part + self.stride, light);
            for off in 0..self.stride {
                if visible(part + off) {
                    let share = (off * 256 / self.stride) as u32;
                    line[part + off] = between(left, right, share);
                }
            }
            left = right;
        }
    }
}

/// Side of a cell of the shadow map, metres.
const CELL: f32 = 0.05;
/// Distance from a thing at which its shadow ends, metres.
const SHADOW: f32 = 0.16;

/// Share of the light that a glossy floor reflects when seen from very far.
const GLOSS: f32 = 0.25;

/// Side of a texel of the floor, metres, in rooms of usual size; smaller where joints are narrow.
const PIXEL: f32 = 0.01;
const SMALL_PIXEL: f32 = 0.005;
/// Approximate maximum number of texels of the floor.
const MAX_PIXELS: f32 = 2e6;

/// Paints the texture of a room's floor, with rugs, lines and the soft shadows of the things on it.
/// Its first axis is y.
fn floor_texture(world: &World) -> Texture {
    let width = world.room.width as f32;
    let depth = world.room.depth as f32;
    let finest = match world.room.floor {
        objects::Floor::GlossyTiles => SMALL_PIXEL,
        _ => PIXEL,
    };
    let size = finest.max((width * depth / MAX_PIXELS).sqrt());
    let count = [depth, width].map(|side| ((side / size).ceil() as usize).max(1));
    let scale = [count[0] as f32 / depth, count[1] as f32 / width];
    let floor = |x: f32, y: f32| {
        let mut rugs = world.rugs.iter().rev();
        let rug = rugs.find_map(|rug| rug_colour(rug, x, y));
        rug.unwrap_or_else(|| match world.room.floor {
            objects::Floor::Wood => wood(x, y),
            objects::Floor::Tiles => tiles(x, y),
            objects::Floor::Concrete => concrete(x, y),
            objects::Floor::GlossyTiles => glossy_tiles(x, y, size),
        })
    };
    let mut pixels = Vec::with_capacity(count[0] * count[1]);
    for row in 0..count[0] {
        let y = (row as f32 + 0.5) / scale[0];
        let colours = (0..count[1]).map(|column| floor((column as f32 + 0.5) / scale[1], y));
        pixels.extend(colours.map(|[r, g, b]| [r as u8, g as u8, b as u8, 255]));
    }
    draw_tapes(&world.strips(), pixels.as_flattened_mut(), count, scale);
    let shadows = shadows(world);
    for (row, line) in pixels.chunks_mut(count[1]).enumerate() {
        let y = (row as f32 + 0.5) / scale[0];
        for (column, pixel) in line.iter_mut().enumerate() {
            let x = (column as f32 + 0.5) / scale[1];
            let [light] = shadows.at(x * (1.0 / CELL), y * (1.0 / CELL));
            *pixel = pixel.map(|channel| (f32::from(channel) * light) as u8);
        }
    }
    Texture::new(pixels, count, scale)
}

/// Draws tapes onto a floor texture with `count` rows and columns, at `scale` texels per metre.
fn draw_tapes(tapes: &[Tape], pixels: &mut [u8], count: [usize; 2], scale: [f32; 2]) {
    let size = (count[1] as u32, count[0] as u32);
    let Some(mut floor) = PixmapMut::from_bytes(pixels, size.0, size.1) else {
        return;
    };
    for tape in tapes {
        let Some(path) = drawing_path(&tape.path()) else {
            continue;
        };
        let mut paint = tiny_skia::Paint::default();
        let [r, g, b] = tape.colour.0;
        paint.set_color_rgba8(r, g, b, 255);
        let stroke = Stroke {
            width: tape.width as f32,
            ..Stroke::default()
        };
        let scaled = Transform::from_scale(scale[1], scale[0]);
        floor.stroke_path(&path, &paint, &stroke, scaled, None);
    }
}

pub(crate) fn drawing_path(path: &BezPath) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for element in path.elements() {
        let xy = |point: kurbo::Point| (point.x as f32, point.y as f32);
        match *element {
            PathEl::MoveTo(to) => builder.move_to(xy(to).0, xy(to).1),
            PathEl::LineTo(to) => builder.line_to(xy(to).0, xy(to).1),
            PathEl::QuadTo(a, to) => builder.quad_to(xy(a).0, xy(a).1, xy(to).0, xy(to).1),
            PathEl::CurveTo(a, b, to) => {
                builder.cubic_to(xy(a).0, xy(a).1, xy(b).0, xy(b).1, xy(to).0, xy(to).1);
            }
            PathEl::ClosePath => builder.close(),
        }
    }
    builder.finish()
}

fn rug_colour(rug: &Rug, x: f32, y: f32) -> Option<Rgb> {
    let middle = rug.at.point();
    let inside_x = rug.width as f32 / 2.0 - (x - middle.x as f32).abs();
    let inside_y = rug.depth as f32 / 2.0 - (y - middle.y as f32).abs();
    let inside = inside_x.min(inside_y);
    if inside < 0.0 {
        return None;
    }
    let weave = 0.95 + 0.10 * scatter((x * 70.0) as i32, (y * 70.0) as i32);
    let border = if (0.08..0.14).contains(&inside) {
        1.25
    } else {
        1.0
    };
    Some(scaled(rgb(rug.colour), weave * border))
}

fn wood(x: f32, y: f32) -> Rgb {
    const PLANK: (f32, f32) = (1.3, 0.13);
    let (row, across) = split_number(y * (1.0 / PLANK.1));
    let (board, along) = split_number(x * (1.0 / PLANK.0) + scatter(row, 11));
    let tone = 0.86 + 0.22 * scatter(row, board);
    let streak = scatter((x * 14.0) as i32, (y * 160.0) as i32);
    let grain = 1.0 + 0.10 * (streak - 0.5);
    let seam = across < 0.035 || along < 0.004;
    let line = if seam { 1.0 - 0.38 } else { 1.0 };
    scaled([154.0, 137.0, 118.0], tone * grain * line)
}

fn tiles(x: f32, y: f32) -> Rgb {
    const TILE: f32 = 0.25;
    let (column, along) = split_number(x * (1.0 / TILE));
    let (row, across) = split_number(y * (1.0 / TILE));
    let joint = if along.min(across) < 0.02 {
        1.0 - 0.25
    } else {
        1.0
    };
    let tone = 0.96 + 0.06 * scatter(column, row);
    let dark = (column + row) % 2 != 0;
    let paint = if dark {
        [138.0, 140.0, 142.0]
    } else {
        [204.0, 203.0, 198.0]
    };
    scaled(paint, joint * tone)
}

fn concrete(x: f32, y: f32) -> Rgb {
    let coarse = scatter((x * 5.0) as i32, (y * 5.0) as i32);
    let fine = scatter((x * 60.0) as i32, (y * 60.0) as i32);
    scaled([150.0, 150.0, 147.0], 0.93 + 0.05 * coarse + 0.08 * fine)
}

/// Tiles with dark joints of 5 mm, each shown by the share of a texel of this size that it covers.
fn glossy_tiles(x: f32, y: f32, size: f32) -> Rgb {
    const TILE: f32 = 0.3;
    const JOINT: f32 = 0.005;
    let (column, along) = split_number(x * (1.0 / TILE));
    let (row, across) = split_number(y * (1.0 / TILE));
    let covered = |place: f32| {
        let middle = place.min(1.0 - place) * TILE;
        ((size + JOINT) / 2.0 - middle).clamp(0.0, JOINT.min(size)) / size
    };
    let joint = 1.0 - 0.45 * covered(along).max(covered(across));
    let tone = 0.97 + 0.04 * scatter(column, row);
    let cloud = 0.985 + 0.03 * scatter((x * 9.0) as i32, (y * 9.0) as i32);
    scaled([180.0, 163.0, 151.0], joint * tone * cloud)
}

/// Splits a positive number into its integer and fractional parts.
fn split_number(number: f32) -> (i32, f32) {
    let whole = number as i32;
    (whole, number - whole as f32)
}

/// The share of light that reaches each place, on a grid of cells.
fn shadows(world: &World) -> Grid<1> {
    let obstacles = world.fixed_obstacles();
    let points = |side: f64| (side as f32 / CELL).ceil() as usize + 2;
    let light = |column: usize, row: usize| {
        let cell = f64::from(CELL);
        let point = Point::new(column as f64 * cell, row as f64 * cell);
        let clear = obstacles.clearance(point) as f32 / SHADOW;
        [0.55 + 0.45 * clear.clamp(0.0, 1.0).sqrt()]
    };
    let room = &world.room;
    Grid::new(points(room.width), points(room.depth), light)
}
