//! Measures where the camera is, from one picture of a sheet of paper on the floor: its four corners
//! determine height, pitch and roll, since the lens and the size of the sheet are known.

use nalgebra::{SMatrix, SVector};
use thiserror::Error;

use super::camera::{Camera, Direction, FloorPosition};
use super::picture::{Image, Size};

/// Sides of a sheet of A4 paper, metres, the longer one first.
pub const A4: [f64; 2] = [0.297, 0.210];

/// Levels of brightness, of 255, from which on a pixel may be paper.
const THRESHOLDS: std::ops::RangeInclusive<u8> = 70..=240;
const THRESHOLD_STEP: usize = 10;
/// Share of the picture that a sheet covers.
const AREA: std::ops::RangeInclusive<f64> = 0.004..=0.5;
/// The least share of a four-sided outline that its largest four-sided area covers, and its bright
/// pixels: a sheet may be printed.
const FOUR_SIDED: f64 = 0.9;
const BRIGHT: f64 = 0.35;
/// Points along each side at which its edge is measured, how far to both sides, and between which
/// shares of the side.
const POINTS: usize = 24;
const REACH: f64 = 4.0;
const ALONG: (f64, f64) = (0.12, 0.88);
/// Least step of the brightness at an edge.
const CONTRAST: f64 = 15.0;
/// The error of a corner, in pixels, above which what was found is no sheet of this size.
const MAX_ERROR: f64 = 1.5;
/// The error of a corner that is assumed at least, for the uncertainty of the result.
const LEAST_ERROR: f64 = 0.15;
const MAX_STEPS: usize = 60;
/// Pitches in degrees from which the search starts.
const STARTS: [f64; 5] = [-30.0, -18.0, -8.0, 0.0, 8.0];

/// Height, pitch and roll, measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SheetPose {
    /// The given camera in the pose that was found.
    pub camera: Camera,
    /// Standard errors of height (metres), pitch and roll (degrees).
    pub uncertainty: [f64; 3],
    /// Root of the mean square error of the corners, pixels.
    pub error: f64,
    /// Where the middle of the sheet is.
    pub middle: FloorPosition,
    /// Column and row of each corner.
    pub corners: [[f64; 2]; 4],
}

/// Why a picture gives no pose.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum SheetError {
    /// Nothing bright has four straight sides.
    #[error("there is no whole sheet of paper in the picture")]
    NoSheet,
    /// There is something with four sides that is no such sheet.
    #[error(
        "what looks like a sheet does not have its proportions: the corners are {error:.1} pixels \
         off"
    )]
    OtherShape {
        /// Of the corners, pixels.
        error: f64,
    },
}

/// Finds a bright sheet with these sides, in metres, on the floor, and computes the camera's pose
/// from it; the lens is that of `camera`.
pub fn pose_from_sheet(
    image: &Image,
    camera: Camera,
    sides: [f64; 2],
) -> Result<SheetPose, SheetError> {
    let mut best: Option<SheetPose> = None;
    let mut least = f64::INFINITY;
    for threshold in THRESHOLDS.step_by(THRESHOLD_STEP) {
        for outline in bright_outlines(image, threshold) {
            let Some(corners) = refined(image, camera, outline) else {
                continue;
            };
            let Some(found) = fit(corners, image.size(), camera, sides) else {
                continue;
            };
            least = least.min(found.error);
            if best.is_none_or(|best| found.error < best.error) {
                best = Some(found);
            }
        }
    }
    match best {
        Some(found) if found.error <= MAX_ERROR => Ok(found),
        _ if least.is_finite() => Err(SheetError::OtherShape { error: least }),
        _ => Err(SheetError::NoSheet),
    }
}

/// A position in the picture: column and row.
type Point = [f64; 2];

/// Returns the corners, in order, of the connected bright areas that have four sides and do not
/// touch the edge of the picture.
fn bright_outlines(image: &Image, threshold: u8) -> Vec<[Point; 4]> {
    let Size { width, height } = image.size();
    let w = width as usize;
    let h = height as usize;
    let mut bright: Vec<bool> = (0..height)
        .flat_map(|y| image.luma_row(y).iter().map(|value| *value >= threshold))
        .collect();
    let mut outlines = Vec::new();
    let mut pending = Vec::new();
    for start in 0..w * h {
        if !bright[start] {
            continue;
        }
        bright[start] = false;
        pending.push(start);
        let mut pixels = 0.0;
        let mut ends: Vec<[usize; 2]> = vec![[usize::MAX, 0]; h];
        let mut touches = false;
        while let Some(index) = pending.pop() {
            let x = index % w;
            let y = index / w;
            pixels += 1.0;
            ends[y] = [ends[y][0].min(x), ends[y][1].max(x)];
            if x == 0 || y == 0 || x + 1 == w || y + 1 == h {
                touches = true;
                continue;
            }
            for next in [index - 1, index + 1, index - w, index + w] {
                if bright[next] {
                    bright[next] = false;
                    pending.push(next);
                }
            }
        }
        if touches || !AREA.contains(&(pixels / (w * h) as f64)) {
            continue;
        }
        let points = ends.iter().enumerate().flat_map(|(y, [left, right])| {
            let row = y as f64;
            let sides = [[*left as f64, row], [*right as f64, row]];
            sides.into_iter().filter(move |_| left <= right)
        });
        let hull = convex_hull(points.collect());
        let Some(corners) = largest_four(&hull) else {
            continue;
        };
        if area(&corners) >= FOUR_SIDED * area(&hull) && pixels >= BRIGHT * area(&hull) {
            outlines.push(corners);
        }
    }
    outlines
}

/// The convex hull, in order; by the monotone chain.
fn convex_hull(mut points: Vec<Point>) -> Vec<Point> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut hull: Vec<Point> = Vec::new();
    for pass in 0..2 {
        let begin = hull.len();
        for point in &points {
            while hull.len() >= begin + 2
                && cross(hull[hull.len() - 2], hull[hull.len() - 1], *point) <= 0.0
            {
                hull.pop();
            }
            hull.push(*point);
        }
        hull.pop();
        if pass == 0 {
            points.reverse();
        }
    }
    hull
}

fn cross(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

fn area(outline: &[Point]) -> f64 {
    let after = outline.iter().cycle().skip(1);
    let double: f64 = outline
        .iter()
        .zip(after)
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum();
    double.abs() / 2.0
}

/// The four points of a hull that enclose the largest area: on both sides of each diagonal, the
/// point farthest from it.
fn largest_four(hull: &[Point]) -> Option<[Point; 4]> {
    let mut best = None;
    let mut largest = 0.0;
    for first in 0..hull.len() {
        for third in first + 2..hull.len() {
            let aside = |index: &usize| cross(hull[first], hull[third], hull[*index]).abs();
            let farthest = |range: &mut dyn Iterator<Item = usize>| {
                range.max_by(|one, other| aside(one).total_cmp(&aside(other)))
            };
            let between = farthest(&mut (first + 1..third));
            let beyond = farthest(&mut (third + 1..hull.len()).chain(0..first));
            let (Some(second), Some(fourth)) = (between, beyond) else {
                continue;
            };
            let found = [hull[first], hull[second], hull[third], hull[fourth]];
            let size = area(&found);
            if size > largest {
                largest = size;
                best = Some(found);
            }
        }
    }
    best
}

/// Measures the corners to fractions of a pixel: fits a line to each side, in the picture without
/// distortion, and intersects them.
fn refined(image: &Image, camera: Camera, corners: [Point; 4]) -> Option<[Point; 4]> {
    let level = Camera {
        pitch: 0.0,
        roll: 0.0,
        ..camera
    };
    let size = image.size();
    let mut lines = [[0.0; 3]; 4];
    for (index, line) in lines.iter_mut().enumerate() {
        let points: Vec<Point> = edge_points(image, corners[index], corners[(index + 1) % 4])
            .into_iter()
            .map(|[x, y]| {
                let Direction { bearing, elevation } = level.direction(x, y, size);
                let right = -bearing.tan();
                [right, -elevation.tan() * right.hypot(1.0)]
            })
            .collect();
        *line = line_through(&points)?;
    }
    let mut refined = [[0.0; 2]; 4];
    for (index, corner) in refined.iter_mut().enumerate() {
        let [right, down] = intersection(lines[(index + 3) % 4], lines[index])?;
        let direction = Direction {
            bearing: (-right).atan(),
            elevation: (-down / right.hypot(1.0)).atan(),
        };
        let (x, y) = level.pixel(direction, size)?;
        let [coarse_x, coarse_y] = corners[index];
        if (x - coarse_x).hypot(y - coarse_y) > 2.0 * REACH {
            return None;
        }
        *corner = [x, y];
    }
    Some(refined)
}

/// Where the brightness passes the middle between paper and floor, along a side.
fn edge_points(image: &Image, from: Point, to: Point) -> Vec<Point> {
    let dx = to[0] - from[0];
    let dy = to[1] - from[1];
    let length = dx.hypot(dy).max(1e-9);
    let across = [-dy / length, dx / length];
    let mut points = Vec::new();
    for number in 0..POINTS {
        let share = ALONG.0 + (ALONG.1 - ALONG.0) * number as f64 / (POINTS - 1) as f64;
        let middle = [from[0] + share * dx, from[1] + share * dy];
        let at = |off: f64| {
            let point = [middle[0] + off * across[0], middle[1] + off * across[1]];
            Some((point, brightness(image, point)?))
        };
        let steps = (-8..=8).map(|step| at(f64::from(step) * REACH / 8.0));
        let Some(profile) = steps.collect::<Option<Vec<(Point, f64)>>>() else {
            continue;
        };
        let values = profile.iter().map(|(_, value)| *value);
        let low = values.clone().fold(f64::INFINITY, f64::min);
        let high = values.fold(0.0, f64::max);
        let level = (low + high) / 2.0;
        let crossings = profile
            .windows(2)
            .filter(|pair| (pair[0].1 < level) != (pair[1].1 < level));
        if high - low < CONTRAST || crossings.clone().count() != 1 {
            continue;
        }
        for pair in crossings {
            let part = (level - pair[0].1) / (pair[1].1 - pair[0].1);
            let between =
                |axis: usize| pair[0].0[axis] + part * (pair[1].0[axis] - pair[0].0[axis]);
            points.push([between(0), between(1)]);
        }
    }
    points
}

/// The brightness between the pixels; `None` outside the picture.
fn brightness(image: &Image, [x, y]: Point) -> Option<f64> {
    let Size { width, height } = image.size();
    let fits = x >= 0.0 && y >= 0.0 && x < f64::from(width - 1) && y < f64::from(height - 1);
    if !fits {
        return None;
    }
    let column = x as usize;
    let upper = image.luma_row(y as u32);
    let lower = image.luma_row(y as u32 + 1);
    let along = |row: &[u8]| {
        let left = f64::from(row[column]);
        left + (f64::from(row[column + 1]) - left) * x.fract()
    };
    Some(along(upper) + (along(lower) - along(upper)) * y.fract())
}

/// The line a x + b y = c, with a² + b² = 1, that fits these points best, apart from the third of
/// them that fits worst; `None` for too few points.
fn line_through(points: &[Point]) -> Option<[f64; 3]> {
    let mut kept = points.to_vec();
    let mut line = None;
    for _ in 0..2 {
        if kept.len() < POINTS / 3 {
            return None;
        }
        let count = kept.len() as f64;
        let x = kept.iter().map(|point| point[0]).sum::<f64>() / count;
        let y = kept.iter().map(|point| point[1]).sum::<f64>() / count;
        let mut xx = 0.0;
        let mut xy = 0.0;
        let mut yy = 0.0;
        for point in &kept {
            xx += (point[0] - x).powi(2);
            xy += (point[0] - x) * (point[1] - y);
            yy += (point[1] - y).powi(2);
        }
        let along = 0.5 * (2.0 * xy).atan2(xx - yy);
        let a = -along.sin();
        let b = along.cos();
        line = Some([a, b, a * x + b * y]);
        let off = |point: &Point| (a * point[0] + b * point[1] - a * x - b * y).abs();
        kept.sort_by(|one, other| off(one).total_cmp(&off(other)));
        kept.truncate((2 * points.len()).div_ceil(3));
    }
    line
}

fn intersection([a, b, c]: [f64; 3], [d, e, f]: [f64; 3]) -> Option<Point> {
    let determinant = a * e - b * d;
    (determinant.abs() > 0.02)
        .then(|| [(c * e - b * f) / determinant, (a * f - c * d) / determinant])
}

/// Height, pitch, roll, and the sheet's place and direction.
type Unknowns = SVector<f64, 6>;

/// Finds the pose that explains the corners best; `None` if there is no plausible one.
fn fit(corners: [Point; 4], size: Size, camera: Camera, sides: [f64; 2]) -> Option<SheetPose> {
    let mut best: Option<(Unknowns, f64)> = None;
    for sides in [sides, [sides[1], sides[0]]] {
        let fitting = Fitting {
            corners,
            size,
            camera,
            sides,
        };
        for pitch in STARTS {
            let found = fitting.start(pitch).and_then(|start| fitting.solve(start));
            if let Some(found) = found
                && best.is_none_or(|best| found.1 < best.1)
            {
                best = Some(found);
            }
        }
    }
    let (unknowns, square) = best?;
    let fitting = Fitting {
        corners,
        size,
        camera,
        sides,
    };
    let camera = fitting.camera_at(&unknowns);
    let error = (square / 4.0).sqrt();
    let plausible = (0.05..1.0).contains(&camera.height)
        && camera.pitch.abs() < 60.0
        && camera.roll.abs() < 45.0;
    plausible.then(|| SheetPose {
        camera,
        uncertainty: fitting.uncertainty(&unknowns, error),
        error,
        middle: FloorPosition {
            ahead: unknowns[3],
            left: unknowns[4],
        },
        corners,
    })
}

/// The corners to explain.
struct Fitting {
    corners: [Point; 4],
    size: Size,
    camera: Camera,
    sides: [f64; 2],
}

impl Fitting {
    fn camera_at(&self, unknowns: &Unknowns) -> Camera {
        Camera {
            height: unknowns[0],
            pitch: unknowns[1].to_degrees(),
            roll: unknowns[2].to_degrees(),
            ..self.camera
        }
    }

    /// The first guess with this pitch: where that camera sees the corners on the floor.
    fn start(&self, pitch: f64) -> Option<Unknowns> {
        let guess: Unknowns = SVector::from([0.29, pitch.to_radians(), 0.0, 0.0, 0.0, 0.0]);
        let camera = self.camera_at(&guess);
        let places: Vec<FloorPosition> = self
            .corners
            .iter()
            .map(|[x, y]| camera.floor_position(*x, *y, self.size))
            .collect::<Option<_>>()?;
        let ahead = places.iter().map(|place| place.ahead).sum::<f64>() / 4.0;
        let left = places.iter().map(|place| place.left).sum::<f64>() / 4.0;
        let along = (places[1].left - places[0].left).atan2(places[1].ahead - places[0].ahead);
        let height = 0.29;
        (ahead < 10.0).then(|| SVector::from([height, guess[1], 0.0, ahead, left, along]))
    }

    /// The errors of the corners, right and down; `None` if a corner is not in front of the camera.
    fn errors(&self, unknowns: &Unknowns) -> Option<SVector<f64, 8>> {
        let camera = self.camera_at(unknowns);
        let (sin, cos) = unknowns[5].sin_cos();
        let mut errors = SVector::<f64, 8>::zeros();
        // Seen from above the corners of the picture turn clockwise or the other way: `turn` is the
        // direction of the sheet's second side.
        let turn = if cross(self.corners[0], self.corners[1], self.corners[2]) > 0.0 {
            -1.0
        } else {
            1.0
        };
        let halves = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        for (index, [along, across]) in halves.into_iter().enumerate() {
            let first = along * self.sides[0] / 2.0;
            let second = turn * across * self.sides[1] / 2.0;
            let place = FloorPosition {
                ahead: unknowns[3] + cos * first - sin * second,
                left: unknowns[4] + sin * first + cos * second,
            };
            let (x, y) = camera.pixel_of_floor(place, self.size)?;
            errors[2 * index] = x - self.corners[index][0];
            errors[2 * index + 1] = y - self.corners[index][1];
        }
        Some(errors)
    }

    fn jacobian(&self, unknowns: &Unknowns) -> Option<SMatrix<f64, 8, 6>> {
        const STEP: f64 = 1e-6;
        let mut jacobian = SMatrix::<f64, 8, 6>::zeros();
        for index in 0..6 {
            let mut more = *unknowns;
            let mut less = *unknowns;
            more[index] += STEP;
            less[index] -= STEP;
            let slope = (self.errors(&more)? - self.errors(&less)?) / (2.0 * STEP);
            jacobian.set_column(index, &slope);
        }
        Some(jacobian)
    }

    /// Levenberg and Marquardt's method; returns the sum of the squared errors too.
    fn solve(&self, start: Unknowns) -> Option<(Unknowns, f64)> {
        let mut unknowns = start;
        let mut errors = self.errors(&unknowns)?;
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let jacobian = self.jacobian(&unknowns)?;
            let mut normal = jacobian.transpose() * jacobian;
            for index in 0..6 {
                normal[(index, index)] *= 1.0 + damping;
            }
            let gradient = jacobian.transpose() * errors;
            let step = normal.cholesky()?.solve(&gradient);
            let next = unknowns - step;
            match self.errors(&next) {
                Some(better) if better.norm_squared() < errors.norm_squared() && next[0] > 0.0 => {
                    unknowns = next;
                    errors = better;
                    damping = f64::max(damping / 10.0, 1e-12);
                    if step.norm() < 1e-10 {
                        break;
                    }
                }
                _ if damping > 1e9 => break,
                _ => damping *= 10.0,
            }
        }
        Some((unknowns, errors.norm_squared()))
    }

    /// Standard errors of height, pitch and roll if each corner has this error.
    fn uncertainty(&self, unknowns: &Unknowns, error: f64) -> [f64; 3] {
        let sigma = error.max(LEAST_ERROR) / f64::sqrt(2.0);
        let covariance = self
            .jacobian(unknowns)
            .and_then(|jacobian| (jacobian.transpose() * jacobian).try_inverse());
        let Some(covariance) = covariance else {
            return [f64::INFINITY; 3];
        };
        let of = |index: usize| sigma * covariance[(index, index)].max(0.0).sqrt();
        [of(0), of(1).to_degrees(), of(2).to_degrees()]
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    const SIZE: Size = Size {
        width: 320,
        height: 240,
    };

    /// What this camera sees of a sheet on a darker floor, with 4x4 samples a pixel; no code of
    /// the module is used but the camera's.
    fn picture(camera: Camera, middle: FloorPosition, turned: f64, sides: [f64; 2]) -> Image {
        let (sin, cos) = turned.sin_cos();
        let is_paper = |x: f64, y: f64| {
            camera.floor_position(x, y, SIZE).is_some_and(|place| {
                let ahead = place.ahead - middle.ahead;
                let left = place.left - middle.left;
                let along = cos * ahead + sin * left;
                let across = cos * left - sin * ahead;
                along.abs() < sides[0] / 2.0 && across.abs() < sides[1] / 2.0
            })
        };
        let picture = RgbImage::from_fn(320, 240, |column, row| {
            let samples = (0..16).filter(|number| {
                let x = f64::from(column) + f64::from(number % 4) / 4.0 - 0.375;
                let y = f64::from(row) + f64::from(number / 4) / 4.0 - 0.375;
                is_paper(x, y)
            });
            let share = samples.count() as f64 / 16.0;
            let noise = f64::from((column * 37 + row * 101).wrapping_mul(0x2C1B_3C6D) >> 29);
            // A bright wall is in the picture too.
            let floor = if row < 30 { 235.0 } else { 110.0 };
            Rgb([(floor + noise + (220.0 - floor) * share) as u8; 3])
        });
        Image::from_rgb(&picture)
    }

    #[test]
    fn a_sheet_on_the_floor_tells_height_pitch_and_roll() {
        for (height, pitch, roll, ahead, turned) in [
            (0.29, 0.0, 0.0, 1.15, 0.3),
            (0.27, -10.0, -4.0, 0.8, 0.1),
            (0.30, -20.0, 8.0, 0.6, 1.1),
            (0.29, 2.0, 7.5, 1.4, -0.4),
            (0.20, -5.0, 0.0, 0.7, 0.8),
        ] {
            let camera = Camera {
                height,
                pitch,
                roll,
                ..Camera::default()
            };
            let middle = FloorPosition { ahead, left: 0.05 };
            let image = picture(camera, middle, turned, A4);
            let found = pose_from_sheet(&image, Camera::default(), A4).unwrap();
            let words = format!("{pitch} {roll}: {found:?}");
            assert!((found.camera.height - height).abs() < 0.01, "{words}");
            assert!((found.camera.pitch - pitch).abs() < 0.6, "{words}");
            assert!((found.camera.roll - roll).abs() < 0.6, "{words}");
            assert!((found.middle.ahead - ahead).abs() < 0.03 * ahead, "{words}");
            assert!(found.error < 0.5 && found.uncertainty[1] < 1.0, "{words}");
        }
    }

    #[test]
    fn pictures_without_a_sheet_and_other_shapes_are_refused() {
        let plain = Image::from_rgb(&RgbImage::from_pixel(320, 240, Rgb([120; 3])));
        assert_eq!(
            pose_from_sheet(&plain, Camera::default(), A4),
            Err(SheetError::NoSheet)
        );
        let camera = Camera {
            pitch: -15.0,
            ..Camera::default()
        };
        let middle = FloorPosition {
            ahead: 0.7,
            left: 0.0,
        };
        // Too long for A4, and cut off by the edge of the picture.
        let strip = picture(camera, middle, 0.3, [0.5, 0.07]);
        let refused = pose_from_sheet(&strip, Camera::default(), A4);
        assert!(
            matches!(refused, Err(SheetError::OtherShape { .. })),
            "{refused:?}"
        );
        let near = FloorPosition {
            ahead: 0.4,
            left: 0.0,
        };
        let cut = picture(camera, near, 0.0, A4);
        assert!(pose_from_sheet(&cut, Camera::default(), A4).is_err());
        for side in [1, 2, 3, 9] {
            let tiny = Image::from_rgb(&RgbImage::from_pixel(side, side, Rgb([250; 3])));
            assert!(pose_from_sheet(&tiny, Camera::default(), A4).is_err());
        }
    }
}
