//! Finds chessboard corners: points where two dark and two bright fields meet.

use image::GrayImage;

/// Radius of the sampling ring around each pixel.
const RING: i32 = 5;
/// The sampling points of the ring, one every 22.5 degrees.
const PLACES: [(i32, i32); 16] = [
    (0, -5),
    (2, -5),
    (4, -4),
    (5, -2),
    (5, 0),
    (5, 2),
    (4, 4),
    (2, 5),
    (0, 5),
    (-2, 5),
    (-4, 4),
    (-5, 2),
    (-5, 0),
    (-5, -2),
    (-4, -4),
    (-2, -5),
];
/// Least distance of two corners, pixels; of two closer ones only the stronger counts.
const APART: i32 = 4;
/// Least strength of a corner as a share of the strongest one.
const MIN_STRENGTH: f32 = 0.15;
/// Most corners; the strongest are kept.
const MAX_CORNERS: usize = 600;
/// Half the side of the window for the subpixel refinement, pixels.
const REACH: i32 = 4;
const MAX_STEPS: usize = 20;

/// A position in a picture, in pixels; the centre of the first pixel is 0, 0.
pub(super) type Place = [f64; 2];

/// Finds the corners of a picture, strongest first.
pub(super) fn corners(picture: &GrayImage) -> Vec<Place> {
    let smooth = Plane::smoothed(picture);
    let strength = smooth.strength();
    let mut found = peaks(&strength);
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let least = found.first().map_or(0.0, |(most, ..)| MIN_STRENGTH * most);
    let clear = found
        .iter()
        .take_while(|(clear, ..)| *clear > least)
        .take(MAX_CORNERS);
    clear
        .filter_map(|&(_, x, y)| smooth.refined(x, y))
        .collect()
}

/// A picture of grey levels.
struct Plane {
    width: i32,
    height: i32,
    levels: Vec<f32>,
}

impl Plane {
    /// The picture, smoothed by the binomial filter 1 2 1.
    fn smoothed(picture: &GrayImage) -> Plane {
        let (width, height) = (picture.width() as i32, picture.height() as i32);
        let levels = picture
            .as_raw()
            .iter()
            .map(|level| f32::from(*level))
            .collect();
        let raw = Plane {
            width,
            height,
            levels,
        };
        let across = raw
            .mapped(|x, y| 0.25 * raw.at(x - 1, y) + 0.5 * raw.at(x, y) + 0.25 * raw.at(x + 1, y));
        across.mapped(|x, y| {
            0.25 * across.at(x, y - 1) + 0.5 * across.at(x, y) + 0.25 * across.at(x, y + 1)
        })
    }

    fn mapped(&self, level: impl Fn(i32, i32) -> f32) -> Plane {
        let rows = (0..self.height).flat_map(|y| (0..self.width).map(move |x| (x, y)));
        Plane {
            width: self.width,
            height: self.height,
            levels: rows.map(|(x, y)| level(x, y)).collect(),
        }
    }

    /// The level of a pixel; outside the picture, that of the nearest border pixel.
    fn at(&self, x: i32, y: i32) -> f32 {
        let (x, y) = (x.clamp(0, self.width - 1), y.clamp(0, self.height - 1));
        self.levels[(y * self.width + x) as usize]
    }

    /// The bilinearly interpolated level between pixels.
    fn between(&self, x: f64, y: f64) -> f64 {
        let (left, top) = (x.floor(), y.floor());
        let (dx, dy) = (x - left, y - top);
        let at =
            |off_x: i32, off_y: i32| f64::from(self.at(left as i32 + off_x, top as i32 + off_y));
        let upper = at(0, 0) * (1.0 - dx) + at(1, 0) * dx;
        let lower = at(0, 1) * (1.0 - dx) + at(1, 1) * dx;
        upper * (1.0 - dy) + lower * dy
    }

    /// The corner strength of each pixel: on a ring around a corner, opposite samples are similar,
    /// samples a quarter turn apart differ, and the mean equals that of the centre (Bennett and
    /// Lasenby, 2014).
    fn strength(&self) -> Plane {
        self.mapped(|x, y| {
            let border = x.min(y).min(self.width - 1 - x).min(self.height - 1 - y);
            if border < RING {
                return 0.0;
            }
            let ring = PLACES.map(|(right, down)| self.at(x + right, y + down));
            let quarters: f32 = (0..4)
                .map(|i| (ring[i] + ring[i + 8] - ring[i + 4] - ring[i + 12]).abs())
                .sum();
            let halves: f32 = (0..8).map(|i| (ring[i] - ring[i + 8]).abs()).sum();
            let mean = ring.iter().sum::<f32>() / 16.0;
            let middle = [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]
                .map(|(right, down)| self.at(x + right, y + down));
            let middle = middle.iter().sum::<f32>() / 5.0;
            quarters - halves - 16.0 * (mean - middle).abs()
        })
    }

    /// The subpixel position of a corner: the point towards which all surrounding edges run, where
    /// their gradients are perpendicular to the offset from it. `None` if that is too far away or
    /// undefined.
    fn refined(&self, x: i32, y: i32) -> Option<Place> {
        let (start_x, start_y) = (f64::from(x), f64::from(y));
        let (mut at_x, mut at_y) = (start_x, start_y);
        for _ in 0..MAX_STEPS {
            let ([xx, xy, yy], [bx, by]) = self.gradients_around(at_x, at_y);
            let determinant = xx * yy - xy * xy;
            if determinant.abs() < 1e-6 {
                return None;
            }
            let off_x = (yy * bx - xy * by) / determinant;
            let off_y = (xx * by - xy * bx) / determinant;
            (at_x, at_y) = (at_x + off_x, at_y + off_y);
            let (away_x, away_y) = (at_x - start_x, at_y - start_y);
            if away_x.abs().max(away_y.abs()) > f64::from(APART) {
                return None;
            }
            if off_x.hypot(off_y) < 0.005 {
                break;
            }
        }
        Some([at_x, at_y])
    }

    /// The sums of the gradient products around a position, and of these products times the offset.
    fn gradients_around(&self, x: f64, y: f64) -> ([f64; 3], [f64; 2]) {
        let ([mut xx, mut xy, mut yy], [mut bx, mut by]) = ([0.0; 3], [0.0; 2]);
        for down in -REACH..=REACH {
            for right in -REACH..=REACH {
                let (dx, dy) = (f64::from(right), f64::from(down));
                let weight = (-(dx * dx + dy * dy) / f64::from(REACH * REACH)).exp();
                let (px, py) = (x + dx, y + dy);
                let slope_x = self.between(px + 1.0, py) - self.between(px - 1.0, py);
                let slope_y = self.between(px, py + 1.0) - self.between(px, py - 1.0);
                let (gxx, gxy, gyy) = (
                    weight * slope_x * slope_x,
                    weight * slope_x * slope_y,
                    weight * slope_y * slope_y,
                );
                (xx, xy, yy) = (xx + gxx, xy + gxy, yy + gyy);
                (bx, by) = (bx + gxx * dx + gxy * dy, by + gxy * dx + gyy * dy);
            }
        }
        ([xx, xy, yy], [bx, by])
    }
}

/// Local maxima of the corner strength.
fn peaks(strength: &Plane) -> Vec<(f32, i32, i32)> {
    let mut found = Vec::new();
    for y in RING..strength.height - RING {
        for x in RING..strength.width - RING {
            let here = strength.at(x, y);
            let round = (-APART..=APART).flat_map(|down| {
                (-APART..=APART)
                    .map(move |right| (right, down))
                    .filter(|off| *off != (0, 0))
            });
            let mut round =
                round.map(|(right, down)| (strength.at(x + right, y + down), (down, right)));
            let clearest =
                round.all(|(other, before)| here > other || (here == other && before > (0, 0)));
            if here > 0.0 && clearest {
                found.push((here, x, y));
            }
        }
    }
    found
}
