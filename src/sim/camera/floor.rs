//! Renders the floor of a frame, row by row.

use super::ground;
use super::light::Lighting;
use super::shading::light;
use super::texture::{Pixel, Texture, between, lit};
use super::view::{HEIGHT, Row, View, WIDTH};
use crate::sim::world::document::World;

/// Number of columns that share one sample of the light on the floor.
const PATCH: usize = 16;

/// The floor of a world.
pub(super) struct Floor {
    world: World,
    /// Created for the first frame: most simulated robots never take one.
    texture: Option<Texture>,
    rows: Vec<Row>,
}

impl Floor {
    /// Creates the floor for a camera with this focal length, in pixels.
    pub(super) fn new(world: &World, focal: f32) -> Floor {
        let rows = (0..HEIGHT / 2).map(|row| Row::below_horizon(row, focal));
        Floor {
            world: world.clone(),
            texture: None,
            rows: rows.collect(),
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
            .get_or_insert_with(|| ground::picture(&self.world));
        let even = lighting.is_uniform() && !view.flash;
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
            let start = view.place(edges[0], depth);
            let next = view.place(edges[1], depth);
            let step = ((next.0 - start.0) * x, (next.1 - start.1) * y);
            let start = (start.0 * x - 128.0, start.1 * y - 128.0);
            let line = &mut frame[row * WIDTH..][..WIDTH];
            let stride = stride(depth / view.focal * level.scale[1]);
            for (patch, floor_tops) in (0..WIDTH).step_by(PATCH).zip(floor_tops.chunks(PATCH)) {
                if floor_tops.iter().all(|floor_top| row < *floor_top) {
                    continue;
                }
                let middle = view.column(if even { WIDTH / 2 } else { patch + PATCH / 2 });
                let (px, py) = view.place(middle, depth);
                let room = lighting.at(px, py);
                let flash = flash * view.beam(middle);
                let light = light(room.map(|channel| (channel * lamps + flash) * exposure));
                let colour = |column: usize| {
                    let right = column as f32;
                    let x = start.0 + right * step.0;
                    let y = start.1 + right * step.1;
                    lit(level.smooth(y as i32, x as i32), light)
                };
                let mut left = colour(patch);
                for part in (0..PATCH).step_by(stride) {
                    let right = colour(patch + part + stride);
                    for off in 0..stride {
                        if row >= floor_tops[part + off] {
                            let share = (off * 256 / stride) as u32;
                            line[patch + part + off] = between(left, right, share);
                        }
                    }
                    left = right;
                }
            }
        }
    }
}

/// Returns the number of columns that may share one texture sample when one column is `pixels`
/// texels wide. Columns between samples are interpolated.
fn stride(pixels: f32) -> usize {
    match pixels {
        _ if pixels < 0.25 => 4,
        _ if pixels < 0.6 => 2,
        _ => 1,
    }
}
