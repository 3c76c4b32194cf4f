//! Finds tiles with vertical edges in a picture: a moving camera changes most of them.

use super::sums::Size2;

/// Side of a tile of the half-size picture, pixels.
const TILE: usize = 10;
/// Moved pixels are also counted this far to the left and right of a tile.
const AROUND_A_TILE: usize = 3;
/// A vertical edge: a brightness difference of more than this between the pixels this far to each
/// side.
const EDGE: (i32, usize) = (25, 2);
/// Least number of edge pixels, or of moved pixels, for a tile to count.
const IN_A_TILE: u32 = 4;
/// Least number of tiles with edges needed to tell whether the camera moved.
const FEWEST_TILES: u32 = 8;

/// The share of the tiles with vertical edges of this half-size picture in which pixels have moved;
/// `None` if too few tiles have edges.
pub(super) fn share_of_changed(
    picture: &[u8],
    moved_cells: &[u8],
    Size2 { w, h }: Size2,
) -> Option<f64> {
    let (contrast, reach) = EDGE;
    let mut tiles = 0u32;
    let mut changed = 0u32;
    for top in (0..h).step_by(TILE) {
        for left in (0..w).step_by(TILE) {
            let mut edges = 0;
            let mut moved = 0;
            for y in top..(top + TILE).min(h) {
                let row = &picture[y * w..][..w];
                for x in left.max(reach)..(left + TILE).min(w.saturating_sub(reach)) {
                    let step = i32::from(row[x + reach]) - i32::from(row[x - reach]);
                    edges += u32::from(step.abs() > contrast);
                }
                // An edge on the border of a tile may have moved into the next tile.
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
