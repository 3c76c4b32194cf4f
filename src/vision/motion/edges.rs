//! Upright edges of a picture, in tiles: a camera that moves changes most of them.

use super::sums::Size2;

/// Side of a tile of the half-size picture, in which upright edges are looked for.
const TILE: usize = 10;
/// What moved is looked for so far beside a tile, too.
const AROUND_A_TILE: usize = 3;
/// An upright edge: so much brighter or darker within this many pixels to each side.
const EDGE: (i32, usize) = (25, 2);
/// A tile with so many pixels on edges, or with so many that moved, counts.
const IN_A_TILE: u32 = 4;
/// In fewer tiles with edges than this it cannot be told whether the camera moved.
const FEWEST_TILES: u32 = 8;

/// The share of the tiles with upright edges of this half-size picture in which a cell has moved;
/// `None` if too few tiles have edges.
pub(super) fn share_of_changed(
    picture: &[u8],
    moved_cells: &[u8],
    Size2 { w, h }: Size2,
) -> Option<f64> {
    let (contrast, reach) = EDGE;
    let (mut tiles, mut changed) = (0u32, 0u32);
    for top in (0..h).step_by(TILE) {
        for left in (0..w).step_by(TILE) {
            let (mut edges, mut moved) = (0, 0);
            for y in top..(top + TILE).min(h) {
                let row = &picture[y * w..][..w];
                for x in left.max(reach)..(left + TILE).min(w.saturating_sub(reach)) {
                    let step = i32::from(row[x + reach]) - i32::from(row[x - reach]);
                    edges += u32::from(step.abs() > contrast);
                }
                // An edge on the border of a tile may have moved into the next one.
                let right = (left + TILE + AROUND_A_TILE).min(w);
                let cells = &moved_cells[y * w..][left.saturating_sub(AROUND_A_TILE)..right];
                moved += cells.iter().map(|cell| u32::from(*cell)).sum::<u32>();
            }
            if edges >= IN_A_TILE {
                tiles += 1;
                changed += u32::from(moved >= IN_A_TILE);
            }
        }
    }
    (tiles >= FEWEST_TILES).then(|| f64::from(changed) / f64::from(tiles))
}
