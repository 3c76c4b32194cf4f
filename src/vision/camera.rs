//! The camera model: where the camera is on the robot, and its lens. Converts between positions in
//! the picture, directions in the robot's level frame, and places on the floor.
//!
//! The lens follows Brown and Conrady, with the numbers that OpenCV's `calibrateCamera` gives for
//! pictures of 320x240; other sizes are scaled.

use nalgebra::{Matrix2, Vector2, Vector3};
use serde::{Deserialize, Serialize};

use super::Size;

/// The picture for which the lens's numbers hold.
const REFERENCE: Size = Size {
    width: 320,
    height: 240,
};
/// Largest slope, from the optical axis, of a direction that has a position in the picture.
const STEEPEST: f64 = 100.0;
/// The model of the lens is used up to the radius where its radial slope has fallen to this share
/// of the slope in the centre; from there it continues straight.
const LEAST_SLOPE: f64 = 0.25;
/// Most Newton steps when the distortion is inverted; three or four are usual.
const MAX_STEPS: usize = 40;
/// Newton's method stops after a step smaller than this, in focal lengths.
const CLOSE: f64 = 1e-10;
/// A lens is one-to-one if positions return to within this many pixels of themselves.
const RETURNS_WITHIN: f64 = 0.01;

/// Pose and lens of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Camera {
    /// Height of the lens above the floor, metres.
    pub height: f64,
    /// Degrees by which the camera looks up; negative down.
    pub pitch: f64,
    /// Degrees, positive when the horizon falls to the right in the picture.
    pub roll: f64,
    /// Focal lengths along the columns and the rows, in pixels of a picture of 320x240.
    pub focal: [f64; 2],
    /// Column and row of the optical axis in a picture of 320x240; the centre of the first pixel is
    /// 0, 0.
    pub centre: [f64; 2],
    /// `[k1, k2, p1, p2]`; all 0 is a lens without distortion. Negative `k1` makes straight lines
    /// bulge outwards.
    pub distortion: [f64; 4],
}

/// The direction in which something is seen, for a robot on a level floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Horizontal angle in radians, left positive, 0 straight ahead.
    pub bearing: f64,
    /// Radians above the horizon, negative below it.
    pub elevation: f64,
}

/// A place on the floor, from the point below the lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FloorPosition {
    /// Metres ahead.
    pub ahead: f64,
    /// Metres to the left.
    pub left: f64,
}

/// Where the picture shows what is level with the lens.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Horizon {
    /// Column of the direction straight ahead.
    pub x: f64,
    /// Its row.
    pub y: f64,
    /// Rows by which it falls from one column to the next.
    pub slope: f64,
}

impl Horizon {
    /// Rows by which it is lower in a column than straight ahead.
    pub(super) fn shift(self, column: f64) -> f64 {
        self.slope * (column - self.x)
    }

    /// Rows that it leaves free at both edges of a picture of this width.
    pub(super) fn tilt(self, width: f64) -> f64 {
        self.shift(0.0).abs().max(self.shift(width).abs()).ceil()
    }
}

/// A position in the plane one focal length ahead of the lens: to the right and down.
type Slopes = Vector2<f64>;

/// A direction in the robot's frame, of any length: ahead, to the right and up.
type Ray = Vector3<f64>;

impl Default for Camera {
    /// The robot's camera as genuine pictures show it, on a head that looks level.
    fn default() -> Self {
        Camera {
            height: 0.29,
            pitch: 0.0,
            roll: 0.0,
            focal: [381.03, 379.87],
            centre: [156.71, 115.91],
            distortion: [0.25296, -0.91742, -0.00530, -0.00879],
        }
    }
}

impl Camera {
    /// A camera in the usual pose, without distortion, with this horizontal field of view in
    /// radians.
    pub fn pinhole(hfov: f64) -> Camera {
        let focal = f64::from(REFERENCE.width) / 2.0 / (hfov / 2.0).tan();
        let middle = middle(REFERENCE);
        Camera {
            focal: [focal, focal],
            centre: [middle.0, middle.1],
            distortion: [0.0; 4],
            ..Camera::default()
        }
    }

    /// Focal length in pixels along the columns of a picture of this width.
    pub fn focal_length(&self, width: u32) -> f64 {
        self.focal[0] * scale(width)
    }

    /// Whether each position in the picture has a direction of its own. Strong distortion folds the
    /// picture, and then directions are ambiguous.
    pub fn is_one_to_one(&self) -> bool {
        let returns = |x: u32, y: u32| {
            let there = self.undistorted(self.plane(f64::from(x), f64::from(y), REFERENCE));
            let back = self.distorted(there);
            let off = self.plane(f64::from(x), f64::from(y), REFERENCE);
            let close = RETURNS_WITHIN / self.focal[0];
            there.norm() <= self.limit()
                && (back.x - off.x).hypot(back.y - off.y) < close
                && self.is_increasing(there)
        };
        (0..=REFERENCE.width)
            .step_by(8)
            .all(|x| (0..=REFERENCE.height).step_by(8).all(|y| returns(x, y)))
    }

    /// Direction of column `x` and row `y`, which may be fractional.
    pub fn direction(&self, x: f64, y: f64, size: Size) -> Direction {
        let ray = self.ray(x, y, size);
        Direction {
            bearing: (-ray.y).atan2(ray.x),
            elevation: ray.z.atan2(ray.x.hypot(ray.y)),
        }
    }

    /// Horizontal direction of a position in radians, left positive, 0 straight ahead.
    pub fn bearing(&self, x: f64, y: f64, size: Size) -> f64 {
        let ray = self.ray(x, y, size);
        (-ray.y).atan2(ray.x)
    }

    /// Column and row where a direction is seen, possibly outside the picture; `None` if it is to
    /// the side of or behind the camera.
    pub fn pixel(&self, direction: Direction, size: Size) -> Option<(f64, f64)> {
        let Direction { bearing, elevation } = direction;
        if bearing.cos() <= 0.0 || elevation.cos() <= 0.0 {
            return None;
        }
        let level = elevation.cos();
        let ahead = level * bearing.cos();
        let aside = -level * bearing.sin();
        let up = elevation.sin();
        let (roll_sin, roll_cos) = self.roll.to_radians().sin_cos();
        let (pitch_sin, pitch_cos) = self.pitch.to_radians().sin_cos();
        let depth = pitch_cos * ahead + pitch_sin * up;
        let below = pitch_sin * ahead - pitch_cos * up;
        let right = (roll_cos * aside - roll_sin * below) / depth;
        let down = (roll_sin * aside + roll_cos * below) / depth;
        let slopes = Slopes::new(right, down);
        let is_ahead = depth > 0.0 && slopes.norm() <= STEEPEST;
        is_ahead.then(|| self.position(self.distorted(slopes), size))
    }

    /// The place on the floor that a position shows; `None` at the horizon and above it.
    pub fn floor_position(&self, x: f64, y: f64, size: Size) -> Option<FloorPosition> {
        let ray = self.ray(x, y, size);
        let times = -self.height / ray.z;
        (ray.z < 0.0 && times.is_finite()).then(|| FloorPosition {
            ahead: times * ray.x,
            left: -times * ray.y,
        })
    }

    /// Where a lens without distortion would show a position.
    pub(super) fn straighten(&self, x: f64, y: f64, size: Size) -> (f64, f64) {
        self.position(self.undistorted(self.plane(x, y, size)), size)
    }

    /// Where the picture shows what is level with the lens.
    pub(super) fn horizon(&self, size: Size) -> Horizon {
        let ahead = Direction {
            bearing: 0.0,
            elevation: 0.0,
        };
        let (x, y) = self.pixel(ahead, size).unwrap_or(middle(size));
        Horizon {
            x,
            y,
            slope: self.roll.to_radians().tan(),
        }
    }

    /// The direction of a position in the robot's frame.
    fn ray(&self, x: f64, y: f64, size: Size) -> Ray {
        let slopes = self.undistorted(self.plane(x, y, size));
        let (roll_sin, roll_cos) = self.roll.to_radians().sin_cos();
        let (pitch_sin, pitch_cos) = self.pitch.to_radians().sin_cos();
        let below = roll_cos * slopes.y - roll_sin * slopes.x;
        Ray::new(
            pitch_cos + pitch_sin * below,
            roll_cos * slopes.x + roll_sin * slopes.y,
            pitch_sin - pitch_cos * below,
        )
    }

    /// Column and row of a position that is given in focal lengths from the optical axis.
    fn position(&self, place: Slopes, size: Size) -> (f64, f64) {
        let (x, y) = self.axis(size);
        let scale = scale(size.width);
        (
            x + self.focal[0] * scale * place.x,
            y + self.focal[1] * scale * place.y,
        )
    }

    /// A position in focal lengths from the optical axis, as the lens shows it.
    fn plane(&self, x: f64, y: f64, size: Size) -> Slopes {
        let axis = self.axis(size);
        let scale = scale(size.width);
        Slopes::new(
            (x - axis.0) / (self.focal[0] * scale),
            (y - axis.1) / (self.focal[1] * scale),
        )
    }

    /// Column and row of the optical axis.
    fn axis(&self, size: Size) -> (f64, f64) {
        let (x, y) = middle(size);
        let (reference_x, reference_y) = middle(REFERENCE);
        let scale = scale(size.width);
        (
            x + (self.centre[0] - reference_x) * scale,
            y + (self.centre[1] - reference_y) * scale,
        )
    }

    /// Where the lens shows what a lens without distortion would show here.
    fn distorted(&self, place: Slopes) -> Slopes {
        let radius = place.norm();
        let limit = self.limit();
        if radius <= limit {
            return self.brown_conrady(place);
        }
        // Straight on along the ray from the axis, with the speed that the model has at the limit.
        let [k1, k2, ..] = self.distortion;
        let edge = place * (limit / radius);
        let shown = self.brown_conrady(edge);
        let square = limit * limit;
        let radial = edge * (1.0 + square * (k1 + k2 * square));
        let slope = 1.0 + square * (3.0 * k1 + 5.0 * k2 * square);
        let beyond = (radius - limit) / limit;
        shown + beyond * (slope * edge + 2.0 * (shown - radial))
    }

    fn brown_conrady(&self, place: Slopes) -> Slopes {
        let [k1, k2, p1, p2] = self.distortion;
        let [right, down] = place.into();
        let square = right * right + down * down;
        let factor = 1.0 + square * (k1 + k2 * square);
        let product = 2.0 * right * down;
        Slopes::new(
            factor * right + p1 * product + p2 * (square + 2.0 * right * right),
            factor * down + p1 * (square + 2.0 * down * down) + p2 * product,
        )
    }

    /// The inverse of [`Camera::distorted`], by Newton's method.
    fn undistorted(&self, shown: Slopes) -> Slopes {
        if self.distortion == [0.0; 4] {
            return shown;
        }
        let limit = self.limit();
        let mut place = shown;
        for _ in 0..MAX_STEPS {
            let off = shown - self.distorted(place);
            let slope = self.jacobian(place * (limit / place.norm()).min(1.0));
            let determinant = slope.determinant();
            if determinant <= 0.0 || determinant.is_nan() {
                return place;
            }
            let step = Slopes::new(
                slope.m22 * off.x - slope.m12 * off.y,
                slope.m11 * off.y - slope.m12 * off.x,
            ) / determinant;
            place += step;
            if step.norm() < CLOSE || !place.norm().is_finite() {
                break;
            }
        }
        place
    }

    /// The derivative of the distortion, which is symmetric.
    fn jacobian(&self, place: Slopes) -> Matrix2<f64> {
        let [k1, k2, p1, p2] = self.distortion;
        let [right, down] = place.into();
        let square = right * right + down * down;
        let factor = 1.0 + square * (k1 + k2 * square);
        let growth = 2.0 * k1 + 4.0 * k2 * square;
        let across = right * down * growth + 2.0 * p1 * right + 2.0 * p2 * down;
        Matrix2::new(
            factor + right * right * growth + 2.0 * p1 * down + 6.0 * p2 * right,
            across,
            across,
            factor + down * down * growth + 6.0 * p1 * down + 2.0 * p2 * right,
        )
    }

    /// Whether the distortion's derivative is positive definite here. Where it is in a convex area,
    /// the lens maps that area one-to-one.
    fn is_increasing(&self, place: Slopes) -> bool {
        let slope = self.jacobian(place);
        slope.m11 > 0.0 && slope.determinant() > 0.0
    }

    /// The undistorted radius up to which the model of the lens is used: where the radial slope
    /// 1 + 3 k1 r² + 5 k2 r⁴ falls to [`LEAST_SLOPE`].
    fn limit(&self) -> f64 {
        let [k1, k2, ..] = self.distortion;
        let a = 5.0 * k2;
        let b = 3.0 * k1;
        let c = 1.0 - LEAST_SLOPE;
        let square = if a == 0.0 {
            -c / b
        } else {
            let discriminant = b * b - 4.0 * a * c;
            if discriminant < 0.0 {
                return STEEPEST;
            }
            let roots = [1.0, -1.0].map(|sign| (-b + sign * discriminant.sqrt()) / (2.0 * a));
            let ahead = roots.into_iter().filter(|square| *square > 0.0);
            ahead.fold(f64::INFINITY, f64::min)
        };
        if square > 0.0 {
            square.sqrt().min(STEEPEST)
        } else {
            STEEPEST
        }
    }
}

fn scale(width: u32) -> f64 {
    f64::from(width) / f64::from(REFERENCE.width)
}

fn middle(size: Size) -> (f64, f64) {
    let half = |length: u32| f64::from(length) / 2.0 - 0.5;
    (half(size.width), half(size.height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: Size = REFERENCE;

    fn posed(height: f64, pitch: f64, roll: f64) -> Camera {
        Camera {
            height,
            pitch,
            roll,
            ..Camera::default()
        }
    }

    #[test]
    fn without_distortion_bearings_match_the_field_of_view() {
        let camera = Camera::pinhole(1.0);
        for (x, bearing) in [(159.5, 0.0), (-0.5, 0.5), (319.5, -0.5)] {
            let found = camera.direction(x, 119.5, SIZE);
            assert!((found.bearing - bearing).abs() < 1e-12 && found.elevation.abs() < 1e-12);
        }
        // A vertical object has the same bearing from top to bottom.
        let head = camera.bearing(20.0, 10.0, SIZE);
        let foot = camera.bearing(20.0, 200.0, SIZE);
        assert!((head - foot).abs() < 1e-12);
    }

    /// Numbers from the model as OpenCV's `projectPoints` documents it, computed by hand.
    #[test]
    fn the_published_lens_shows_points_where_brown_and_conrady_say() {
        let camera = Camera::default();
        for (right, down) in [(0.0, 0.0), (0.3, 0.2), (-0.4, 0.3), (0.25, -0.3)] {
            let square: f64 = right * right + down * down;
            let radial = 1.0 + 0.25296 * square - 0.91742 * square * square;
            let x = right * radial
                - 2.0 * 0.00530 * right * down
                - 0.00879 * (square + 2.0 * right * right);
            let y = down * radial
                - 0.00530 * (square + 2.0 * down * down)
                - 2.0 * 0.00879 * right * down;
            let direction = Direction {
                bearing: f64::atan(-right),
                elevation: f64::atan(-down / right.hypot(1.0)),
            };
            let seen = camera.pixel(direction, SIZE).unwrap();
            let wanted = (156.71 + 381.03 * x, 115.91 + 379.87 * y);
            assert!(
                (seen.0 - wanted.0).hypot(seen.1 - wanted.1) < 1e-9,
                "{seen:?} {wanted:?}"
            );
        }
    }

    /// Straight joints between floor tiles are straight within 1 pixel in genuine pictures.
    #[test]
    fn the_published_lens_hardly_bends_straight_lines() {
        let camera = Camera::default();
        for (from, to) in [
            ((10.0, 230.0), (60.0, 20.0)),
            ((15.0, 200.0), (300.0, 215.0)),
        ] {
            let [a, b] = [from, to].map(|(x, y)| camera.undistorted(camera.plane(x, y, SIZE)));
            let ends = [from, to];
            let most = (0..=20).map(|step| {
                let share = f64::from(step) / 20.0;
                let shown = camera.distorted(a.lerp(&b, share));
                let x = 156.71 + 381.03 * shown.x - ends[0].0;
                let y = 115.91 + 379.87 * shown.y - ends[0].1;
                let dx: f64 = ends[1].0 - ends[0].0;
                let dy: f64 = ends[1].1 - ends[0].1;
                ((x * dy - y * dx) / dx.hypot(dy)).abs()
            });
            assert!(most.fold(0.0, f64::max) < 2.0);
        }
    }

    /// The derivative is symmetric, so where it is positive definite all over a disc the lens is
    /// one-to-one in it. The disc reaches beyond the corners of the picture, up to the limit of the
    /// model.
    #[test]
    fn the_published_lens_is_one_to_one_beyond_the_corners() {
        let camera = Camera::default();
        assert!(camera.is_one_to_one());
        let limit = camera.limit();
        let corners = [(0.0, 0.0), (319.0, 0.0), (0.0, 239.0), (319.0, 239.0)];
        for (x, y) in corners {
            let radius = camera.undistorted(camera.plane(x, y, SIZE)).norm();
            assert!(radius < 0.8 * limit, "{radius} {limit}");
        }
        for angle in 0..360 {
            let (sin, cos) = f64::from(angle).to_radians().sin_cos();
            for step in 0..=100 {
                let radius = limit * f64::from(step) / 100.0;
                let slope = camera.jacobian(Slopes::new(radius * cos, radius * sin));
                assert!(slope.trace() > 0.0 && slope.determinant() > 0.1);
            }
        }
    }

    /// Beyond its limit the polynomial would fold the picture; directions there lie ever farther
    /// outside instead, and return.
    #[test]
    fn directions_far_outside_the_picture_stay_outside_and_in_order() {
        let camera = Camera::default();
        let mut last = f64::INFINITY;
        for degrees in -80..=80 {
            let direction = Direction {
                bearing: f64::from(degrees).to_radians(),
                elevation: -0.1,
            };
            let (x, y) = camera.pixel(direction, SIZE).unwrap();
            assert!(x < last, "{degrees} {x}");
            assert!(f64::from(degrees).abs() < 24.0 || !(0.0..320.0).contains(&x));
            last = x;
            let back = camera.direction(x, y, SIZE);
            assert!((back.bearing - direction.bearing).abs() < 1e-6, "{back:?}");
            assert!((back.elevation - direction.elevation).abs() < 1e-6);
        }
    }

    #[test]
    fn pitch_moves_the_horizon_and_roll_tilts_it() {
        let level = posed(0.29, 0.0, 0.0).horizon(SIZE);
        assert!((level.x - 156.71).abs() < 1e-9 && (level.y - 115.91).abs() < 1e-9);
        // Looking down moves the horizon up.
        let down = posed(0.29, -10.0, 0.0).horizon(SIZE);
        let rows = 379.87 * 10.0_f64.to_radians().tan();
        assert!((115.91 - down.y - rows).abs() < 1.0, "{down:?}");
        assert!(posed(0.29, 5.0, 0.0).horizon(SIZE).y > 140.0);
        let rolled = posed(0.29, 0.0, 8.0);
        let row = |bearing: f64| {
            let direction = Direction {
                bearing,
                elevation: 0.0,
            };
            rolled.pixel(direction, SIZE).unwrap()
        };
        let left = row(0.2);
        let right = row(-0.2);
        assert!(left.1 < right.1 - 20.0, "the horizon falls to the right");
        let slope = (right.1 - left.1) / (right.0 - left.0);
        assert!((slope - rolled.horizon(SIZE).slope).abs() < 0.01, "{slope}");
    }

    #[test]
    fn the_nearest_floor_in_the_picture_depends_on_height_and_pitch() {
        let nearest = |camera: Camera| camera.floor_position(156.71, 239.0, SIZE).unwrap().ahead;
        for (height, pitch) in [(0.2, 0.0), (0.29, 0.0), (0.29, -10.0), (0.29, 10.0)] {
            let camera = Camera {
                distortion: [0.0; 4],
                ..posed(height, pitch, 0.0)
            };
            let below = f64::atan((239.0 - 115.91) / 379.87) - f64::to_radians(pitch);
            let wanted = height / below.tan();
            assert!((nearest(camera) - wanted).abs() < 1e-9, "{height} {pitch}");
        }
        let above = posed(0.29, 0.0, 0.0).floor_position(160.0, 100.0, SIZE);
        assert_eq!(above, None);
    }

    #[test]
    fn pictures_of_other_sizes_show_the_same_directions() {
        let camera = posed(0.29, -4.0, 3.0);
        let twice = Size {
            width: 640,
            height: 480,
        };
        for (x, y) in [(0.0, 0.0), (100.0, 200.0), (300.0, 130.0)] {
            let one = camera.direction(x, y, SIZE);
            let other = camera.direction(2.0 * x + 0.5, 2.0 * y + 0.5, twice);
            assert!((one.bearing - other.bearing).abs() < 1e-9);
            assert!((one.elevation - other.elevation).abs() < 1e-9);
        }
    }

    #[test]
    fn lenses_that_fold_the_picture_are_detected() {
        assert!(Camera::default().is_one_to_one());
        assert!(Camera::pinhole(3.0).is_one_to_one());
        for [k1, k2, p1] in [
            [-2.0, 0.0, 0.0],
            [0.0, -9.0, 0.0],
            [-2.0, 0.5, 0.0],
            [0.0, 0.0, 1.0],
        ] {
            let camera = Camera {
                distortion: [k1, k2, p1, 0.0],
                ..Camera::default()
            };
            assert!(!camera.is_one_to_one(), "{k1} {k2} {p1}");
            assert!(camera.bearing(0.0, 0.0, SIZE).is_finite());
        }
    }

    proptest! {
        #[test]
        fn a_position_survives_the_round_trip_through_its_direction(
            x in 0.0..320.0, y in 0.0..240.0, k1 in -0.4..0.4, k2 in -1.0..0.3,
            p1 in -0.02..0.02, p2 in -0.02..0.02, pitch in -30.0..30.0, roll in -20.0..20.0,
        ) {
            let camera = Camera {
                distortion: [k1, k2, p1, p2],
                ..posed(0.29, pitch, roll)
            };
            prop_assume!(camera.is_one_to_one());
            let (back_x, back_y) = camera.pixel(camera.direction(x, y, SIZE), SIZE).unwrap();
            prop_assert!((back_x - x).abs() < 1e-6 && (back_y - y).abs() < 1e-6);
        }

        #[test]
        fn a_place_on_the_floor_survives_the_round_trip_through_the_picture(
            ahead in 0.3..6.0_f64, left in -2.0..2.0_f64, height in 0.1..0.5_f64,
            pitch in -20.0..15.0, roll in -10.0..10.0,
        ) {
            let camera = posed(height, pitch, roll);
            let direction = Direction {
                bearing: left.atan2(ahead),
                elevation: (-height).atan2(ahead.hypot(left)),
            };
            let (x, y) = camera.pixel(direction, SIZE).unwrap();
            let back = camera.floor_position(x, y, SIZE).unwrap();
            prop_assert!((back.ahead - ahead).hypot(back.left - left) < 1e-6, "{back:?}");
        }

        #[test]
        fn any_numbers_are_accepted_without_panic(
            x in any::<f64>(), y in any::<f64>(), k1 in any::<f64>(), k2 in any::<f64>(),
            p1 in any::<f64>(), pitch in any::<f64>(), roll in any::<f64>(), height in any::<f64>(),
        ) {
            let camera = Camera {
                distortion: [k1, k2, p1, 0.0],
                ..posed(height, pitch, roll)
            };
            let direction = camera.direction(x, y, SIZE);
            let _ = (camera.is_one_to_one(), camera.pixel(direction, SIZE));
            let _ = (camera.floor_position(x, y, SIZE), camera.horizon(SIZE));
        }
    }
}
