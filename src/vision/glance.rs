//! Coarse views of pictures: whether the robot moved between them, and whether forwards or
//! backwards, without knowing its power or its speed.

use super::camera::Camera;
use super::picture::{Image, Size};

const COLUMNS: usize = 40;
const ROWS: usize = 30;
/// Factors by which what is ahead grows from one view to the next, or shrinks.
const FACTORS: [f64; 6] = [1.02, 1.05, 1.09, 1.14, 1.2, 1.3];
/// What pitches the camera may have, in tiles.
const PITCHES: [f64; 5] = [-8.0, -4.0, 0.0, 4.0, 8.0];
/// The share of a view at each edge that is not looked at, as it may have come in.
const MARGIN: f64 = 0.1;
/// A view is compared with the one so many views later; the farther it is, the more has changed.
const APART: [usize; 4] = [2, 5, 9, 12];
/// A direction fits if it explains the views better than the other one by this factor, and than
/// standing still by another one: what a robot leaves backwards is close, and shrinks much.
const FITS: f64 = 0.95;
const FORWARDS_EXPLAINS: f64 = 0.93;
const BACKWARDS_EXPLAINS: f64 = 0.85;

/// The mean brightness of the tiles of a picture, relative to the whole.
#[derive(Debug, Clone)]
pub struct Glance {
    tiles: Vec<f32>,
    /// Column and row, in tiles, of what is straight ahead.
    middle: [f64; 2],
}

impl Glance {
    /// `None` if the picture is too small.
    pub fn new(image: &Image, camera: Camera) -> Option<Glance> {
        let Size { width, height } = image.size();
        let across = width as usize / COLUMNS;
        let down = height as usize / ROWS;
        if across == 0 || down == 0 {
            return None;
        }
        let mut tiles = vec![0.0; COLUMNS * ROWS];
        for y in 0..ROWS * down {
            let row = &image.luma_row(y as u32)[..COLUMNS * across];
            for (column, part) in row.chunks_exact(across).enumerate() {
                let sum: u32 = part.iter().map(|value| u32::from(*value)).sum();
                tiles[y / down * COLUMNS + column] += sum as f32;
            }
        }
        let pixels = (across * down) as f32;
        let mean = tiles.iter().sum::<f32>() / tiles.len() as f32;
        tiles
            .iter_mut()
            .for_each(|tile| *tile = (*tile - mean) / pixels);
        let horizon = camera.horizon(image.size());
        Some(Glance {
            tiles,
            middle: [
                horizon.x / across as f64 - 0.5,
                horizon.y / down as f64 - 0.5,
            ],
        })
    }

    /// By how much the brightness of a tile differs on average, of 255; a change of the whole
    /// picture does not count.
    pub fn difference(&self, other: &Glance) -> f64 {
        let pairs = self.tiles.iter().zip(&other.tiles);
        let sum: f32 = pairs.map(|(one, other)| (one - other).abs()).sum();
        f64::from(sum) / self.tiles.len() as f64
    }

    /// The same for a later view if everything has grown by this factor around a place that is this
    /// many tiles lower than straight ahead.
    fn difference_if_grown(&self, later: &Glance, factor: f64, lower: f64) -> f64 {
        let [x0, y0] = [self.middle[0], self.middle[1] + lower];
        let inner = |tiles: usize| {
            let margin = (tiles as f64 * MARGIN) as usize;
            margin..tiles - margin
        };
        let mut sum = 0.0;
        for row in inner(ROWS) {
            for column in inner(COLUMNS) {
                let x = x0 + (column as f64 - x0) / factor;
                let y = y0 + (row as f64 - y0) / factor;
                sum += (later.tiles[row * COLUMNS + column] - self.at(x, y)).abs();
            }
        }
        f64::from(sum) / (inner(ROWS).len() * inner(COLUMNS).len()) as f64
    }

    /// The brightness between tiles.
    fn at(&self, x: f64, y: f64) -> f32 {
        let x = x.clamp(0.0, (COLUMNS - 1) as f64);
        let y = y.clamp(0.0, (ROWS - 1) as f64);
        let left = (x as usize).min(COLUMNS - 2);
        let top = (y as usize).min(ROWS - 2);
        let right_share = (x - left as f64) as f32;
        let low_share = (y - top as f64) as f32;
        let along = |row: usize| {
            let tiles = &self.tiles[row * COLUMNS + left..][..2];
            tiles[0] + (tiles[1] - tiles[0]) * right_share
        };
        along(top) + (along(top + 1) - along(top)) * low_share
    }
}

/// Whether the robot drove forwards (`true`) or backwards, away from something close, while these
/// views were taken, each some centimetres after the one before; `None` if they do not tell. The
/// camera's pitch need not be known.
pub fn drove_forwards(views: &[&Glance]) -> Option<bool> {
    APART.iter().find_map(|apart| compare(views, *apart))
}

fn compare(views: &[&Glance], apart: usize) -> Option<bool> {
    let pairs = || {
        let later = views.iter().skip(apart);
        views.iter().zip(later)
    };
    let still = pairs().map(|(one, later)| one.difference_if_grown(later, 1.0, 0.0));
    let still: f64 = still.sum();
    let explained = |factors: [f64; FACTORS.len()]| {
        let around = |lower: f64| {
            let least = |(one, later): (&&Glance, &&Glance)| {
                let differences = factors.map(|by| one.difference_if_grown(later, by, lower));
                differences.into_iter().fold(f64::INFINITY, f64::min)
            };
            pairs().map(least).sum::<f64>()
        };
        PITCHES
            .map(around)
            .into_iter()
            .fold(f64::INFINITY, f64::min)
    };
    let forwards = explained(FACTORS);
    let backwards = explained(FACTORS.map(|factor| 1.0 / factor));
    if forwards < FITS * backwards && forwards < FORWARDS_EXPLAINS * still {
        Some(true)
    } else if backwards < FITS * forwards && backwards < BACKWARDS_EXPLAINS * still {
        Some(false)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};

    /// A wall with squares of side `size` at its middle, `brighter` than usual.
    fn view(size: f64, brighter: u8) -> Glance {
        let camera = Camera::pinhole(1.0);
        let pixels = RgbImage::from_fn(320, 240, |x, y| {
            let across = ((f64::from(x) - 159.5) / size).floor() as i32;
            let down = ((f64::from(y) - 119.5) / size).floor() as i32;
            Rgb([if (across + down) % 2 == 0 { 60 } else { 160 } + brighter; 3])
        });
        Glance::new(&Image::from_rgb(&pixels), camera).unwrap()
    }

    #[test]
    fn growing_things_mean_forwards_and_shrinking_ones_backwards() {
        let sizes = [40.0, 42.0, 44.0, 46.0];
        let mut views: Vec<Glance> = sizes.iter().map(|size| view(*size, 0)).collect();
        assert_eq!(
            drove_forwards(&views.iter().collect::<Vec<_>>()),
            Some(true)
        );
        views.reverse();
        assert_eq!(
            drove_forwards(&views.iter().collect::<Vec<_>>()),
            Some(false)
        );
    }

    #[test]
    fn views_that_stay_the_same_do_not_tell() {
        let view = [view(40.0, 0), view(40.0, 30)];
        assert!(view[0].difference(&view[1]) < 0.01);
        assert_eq!(drove_forwards(&[&view[0], &view[1], &view[0]]), None);
        assert_eq!(drove_forwards(&[]), None);
    }
}
