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

/// The most tiles by which two views that are compared may have moved.
const MOST_MOVED: isize = 20;
/// A view that has moved by more tiles is what the next ones are compared with.
const FAR: isize = 8;
/// Views are alike if their edges differ by less than this share of all edges in them.
const ALIKE: f64 = 0.7;

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

    /// By how many tiles to the right everything has moved since an earlier view; `None` if it is
    /// not seen again.
    pub fn moved_since(&self, earlier: &Glance) -> Option<isize> {
        (-MOST_MOVED..=MOST_MOVED)
            .map(|right| (right, self.edges_differ(earlier, right)))
            .min_by(|(_, one), (_, other)| one.total_cmp(other))
            .filter(|(_, share)| *share < ALIKE)
            .map(|(right, _)| right)
    }

    /// By which share the upright edges differ if everything has moved so far. Edges, because the
    /// shade of the lens does not move.
    fn edges_differ(&self, earlier: &Glance, right: isize) -> f64 {
        let (mut differ, mut all) = (0.0, 0.0);
        let rows = self
            .tiles
            .chunks(COLUMNS)
            .zip(earlier.tiles.chunks(COLUMNS));
        for (row, earlier) in rows {
            let earlier = &earlier[(-right).max(0) as usize..];
            let pairs = row[right.max(0) as usize..]
                .windows(2)
                .zip(earlier.windows(2));
            for (one, other) in pairs {
                let (one, other) = (one[1] - one[0], other[1] - other[0]);
                differ += (one - other).abs();
                all += one.abs() + other.abs();
            }
        }
        f64::from(differ / all)
    }

    /// The difference of a later view if everything has grown by this factor around a place that is this
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

/// By how many tiles to the right everything has moved while these views were taken, as when the
/// robot turns to the left; `None` if they do not tell, or there are not two.
pub fn moved_right<'a>(views: impl IntoIterator<Item = &'a Glance>) -> Option<isize> {
    let mut views = views.into_iter();
    let mut reference = views.next()?;
    let mut before = 0;
    let mut since = None;
    for view in views {
        since = view.moved_since(reference);
        if let Some(tiles) = since.filter(|tiles| tiles.abs() > FAR) {
            (reference, before, since) = (view, before + tiles, Some(0));
        }
    }
    since.map(|tiles| before + tiles)
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

    /// A wall with upright stripes of different widths, seen from `tiles` farther left.
    fn stripes(tiles: u32) -> Glance {
        let pixels = RgbImage::from_fn(320, 240, |x, _| {
            let place = (x + 800 - 8 * tiles) / 16;
            Rgb([(place * place * place % 127) as u8; 3])
        });
        Glance::new(&Image::from_rgb(&pixels), Camera::pinhole(1.0)).unwrap()
    }

    #[test]
    fn a_turn_by_more_than_a_view_is_followed() {
        let moved = |views: &[u32]| {
            let views: Vec<Glance> = views.iter().map(|tiles| stripes(*tiles)).collect();
            moved_right(&views)
        };
        assert_eq!(moved(&[0, 3, 9, 21, 33, 45, 44]), Some(44));
        assert_eq!(moved(&[45, 30, 15, 0]), Some(-45));
        assert_eq!(moved(&[20, 20]), Some(0));
        assert_eq!(moved(&[]), None);
    }

    #[test]
    fn views_that_stay_the_same_do_not_tell() {
        let view = [view(40.0, 0), view(40.0, 30)];
        assert!(view[0].difference(&view[1]) < 0.01);
        assert_eq!(drove_forwards(&[&view[0], &view[1], &view[0]]), None);
        assert_eq!(drove_forwards(&[]), None);
    }
}
