//! What the floor looks like: planks, tiles or concrete, the rugs on it, and the soft shadows of
//! what stands there.

use super::geometry::Point;
use super::obstacles::Obstacles;
use super::surface::{Rgb, rgb, scaled, scatter};
use super::things::{Floor, Rug};
use super::world::World;

/// Side of a cell of the shadow map, metres.
const CELL: f32 = 0.05;
/// How far from a thing its shadow ends, metres.
const SHADOW: f32 = 0.16;

/// The floor of a room.
#[derive(Debug)]
pub(super) struct Ground {
    floor: Floor,
    rugs: Vec<Carpet>,
    shadows: Shadows,
}

#[derive(Debug)]
struct Carpet {
    middle: (f32, f32),
    half: (f32, f32),
    paint: Rgb,
}

impl Ground {
    /// The floor of a world.
    pub(super) fn of(world: &World, obstacles: &Obstacles) -> Ground {
        Ground {
            floor: world.room.floor,
            rugs: world.rugs.iter().map(Carpet::of).collect(),
            shadows: Shadows::of(world, obstacles),
        }
    }

    /// The colour at a place; `detail` fades fine lines, 1 near and 0 far.
    pub(super) fn colour(&self, x: f32, y: f32, detail: f32) -> Rgb {
        // Cutting a number off is its floor only above 0, and far cheaper.
        let (x, y) = (x.max(0.0), y.max(0.0));
        let rug = self.rugs.iter().rev().find_map(|rug| rug.colour(x, y));
        let colour = rug.unwrap_or_else(|| match self.floor {
            Floor::Wood => wood(x, y, detail),
            Floor::Tiles => tiles(x, y, detail),
            Floor::Concrete => concrete(x, y),
        });
        scaled(colour, self.shadows.at(x, y))
    }
}

impl Carpet {
    fn of(rug: &Rug) -> Carpet {
        let middle = rug.at.point();
        Carpet {
            middle: (middle.x as f32, middle.y as f32),
            half: (rug.width as f32 / 2.0, rug.depth as f32 / 2.0),
            paint: rgb(rug.colour),
        }
    }

    fn colour(&self, x: f32, y: f32) -> Option<Rgb> {
        let inside_x = self.half.0 - (x - self.middle.0).abs();
        let inside_y = self.half.1 - (y - self.middle.1).abs();
        let inside = inside_x.min(inside_y);
        let weave = 0.95 + 0.10 * scatter((x * 70.0) as i32, (y * 70.0) as i32);
        let border = if (0.08..0.14).contains(&inside) {
            1.25
        } else {
            1.0
        };
        (inside >= 0.0).then(|| scaled(self.paint, weave * border))
    }
}

fn wood(x: f32, y: f32, detail: f32) -> Rgb {
    const PLANK: (f32, f32) = (1.3, 0.13);
    let (row, across) = cut(y * (1.0 / PLANK.1));
    let (board, along) = cut(x * (1.0 / PLANK.0) + scatter(row, 11));
    let tone = 0.86 + 0.22 * scatter(row, board);
    let streak = scatter((x * 14.0) as i32, (y * 160.0) as i32);
    let grain = 1.0 + detail * 0.10 * (streak - 0.5);
    let seam = across < 0.035 || along < 0.004;
    let line = if seam { 1.0 - 0.38 * detail } else { 1.0 };
    scaled([154.0, 137.0, 118.0], tone * grain * line)
}

fn tiles(x: f32, y: f32, detail: f32) -> Rgb {
    const TILE: f32 = 0.25;
    let ((column, along), (row, across)) = (cut(x * (1.0 / TILE)), cut(y * (1.0 / TILE)));
    let joint = if along.min(across) < 0.02 {
        1.0 - 0.25 * detail
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

/// A positive number's whole part and what is left.
fn cut(number: f32) -> (i32, f32) {
    let whole = number as i32;
    (whole, number - whole as f32)
}

/// How much light gets to each place, on a coarse grid and smooth between its points.
#[derive(Debug)]
struct Shadows {
    columns: usize,
    rows: usize,
    light: Vec<f32>,
}

impl Shadows {
    fn of(world: &World, obstacles: &Obstacles) -> Shadows {
        let columns = (world.room.width as f32 / CELL).ceil() as usize + 2;
        let rows = (world.room.depth as f32 / CELL).ceil() as usize + 2;
        let light = |i: usize| {
            let (column, row) = ((i % columns) as f64, (i / columns) as f64);
            let point = Point::new(column * f64::from(CELL), row * f64::from(CELL));
            let clear = obstacles.clearance(point) as f32 / SHADOW;
            0.55 + 0.45 * clear.clamp(0.0, 1.0).sqrt()
        };
        Shadows {
            columns,
            rows,
            light: (0..columns * rows).map(light).collect(),
        }
    }

    fn at(&self, x: f32, y: f32) -> f32 {
        let x = (x * (1.0 / CELL)).clamp(0.0, (self.columns - 2) as f32);
        let y = (y * (1.0 / CELL)).clamp(0.0, (self.rows - 2) as f32);
        let (column, row) = (x as usize, y as usize);
        let (dx, dy) = (x - column as f32, y - row as f32);
        let near = row * self.columns + column;
        let far = near + self.columns;
        let front = self.light[near] * (1.0 - dx) + self.light[near + 1] * dx;
        let back = self.light[far] * (1.0 - dx) + self.light[far + 1] * dx;
        front * (1.0 - dy) + back * dy
    }
}
