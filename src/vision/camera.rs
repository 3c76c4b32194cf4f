//! The camera model: converts between positions in the picture and directions, given the field of
//! view and the distortion of the lens. Radial distortion follows Brown and Conrady: a point that a
//! lens without distortion would show at the distance r from the centre, in focal lengths, is shown
//! at r (1 + k1 r² + k2 r⁴).

use serde::{Deserialize, Serialize};

use super::Size;

/// Largest distance from the centre that any lens shows, in focal lengths.
const FARTHEST: f64 = 100.0;
/// Most Newton steps when the distortion is inverted; four are usual.
const MAX_STEPS: usize = 12;
/// Newton's method stops after a step smaller than this, in focal lengths.
const CLOSE: f64 = 1e-9;
const HALVINGS: usize = 60;

/// Field of view and distortion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Horizontal field of view without distortion, in radians: twice the arc tangent of half the
    /// picture's width over the focal length, both in pixels.
    pub hfov: f64,
    /// `[k1, k2]`; `[0, 0]` is a lens without distortion. Negative values make straight lines bulge
    /// outwards.
    pub distortion: [f64; 2],
}

/// The direction in which something is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Horizontal angle in radians, left positive, 0 straight ahead.
    pub bearing: f64,
    /// Radians above the horizon, negative below it.
    pub elevation: f64,
}

impl Default for Camera {
    /// The robot's camera: the focal length of 381 pixels was measured; the distortion is typical
    /// of such lenses.
    fn default() -> Self {
        Camera {
            hfov: 45.6_f64.to_radians(),
            distortion: [-0.25, 0.08],
        }
    }
}

impl Camera {
    /// A camera without distortion.
    pub fn pinhole(hfov: f64) -> Camera {
        Camera {
            hfov,
            distortion: [0.0, 0.0],
        }
    }

    /// Focal length in pixels for a picture of this width.
    pub fn focal_length(&self, width: u32) -> f64 {
        f64::from(width) / 2.0 / (self.hfov / 2.0).tan()
    }

    /// Whether each position in a 4:3 picture has a different direction. Strong distortion folds
    /// the picture, and then directions are ambiguous.
    pub fn is_one_to_one(&self) -> bool {
        let half = (self.hfov / 2.0).tan();
        let corner = half.hypot(half * 0.75);
        let limit = self.limit();
        limit > 0.0 && self.distorted(limit) > corner
    }

    /// Direction of column `x` and row `y`, which may be fractional.
    pub fn direction(&self, x: f64, y: f64, size: Size) -> Direction {
        let (right, down) = self.slopes(x, y, size);
        Direction {
            bearing: (-right).atan(),
            elevation: (-down / right.hypot(1.0)).atan(),
        }
    }

    /// Horizontal direction of a position in radians, left positive, 0 straight ahead.
    pub fn bearing(&self, x: f64, y: f64, size: Size) -> f64 {
        self.direction(x, y, size).bearing
    }

    /// Column and row where a direction is seen, possibly outside the picture; `None` if it is to
    /// the side of or behind the camera.
    pub fn pixel(&self, direction: Direction, size: Size) -> Option<(f64, f64)> {
        let Direction { bearing, elevation } = direction;
        if bearing.cos() <= 0.0 || elevation.cos() <= 0.0 {
            return None;
        }
        let right = -bearing.tan();
        let down = -elevation.tan() * right.hypot(1.0);
        let r = right.hypot(down);
        let factor = if r > self.limit() {
            return None;
        } else {
            self.distortion_factor(r)
        };
        let focal = self.focal_length(size.width);
        let (middle_x, middle_y) = middle(size);
        Some((
            middle_x + focal * factor * right,
            middle_y + focal * factor * down,
        ))
    }

    /// Slopes to the right and down per unit of length ahead, with the distortion removed.
    fn slopes(&self, x: f64, y: f64, size: Size) -> (f64, f64) {
        let focal = self.focal_length(size.width);
        let (middle_x, middle_y) = middle(size);
        let right = (x - middle_x) / focal;
        let down = (y - middle_y) / focal;
        let distorted = right.hypot(down);
        if distorted == 0.0 || self.distortion == [0.0, 0.0] {
            return (right, down);
        }
        let scale = self.undistorted(distorted) / distorted;
        (right * scale, down * scale)
    }

    fn distortion_factor(&self, r: f64) -> f64 {
        let [k1, k2] = self.distortion;
        1.0 + r * r * (k1 + k2 * r * r)
    }

    /// The distance from the centre at which the lens shows a point at the undistorted distance
    /// `r`, both in focal lengths.
    fn distorted(&self, r: f64) -> f64 {
        r * self.distortion_factor(r)
    }

    /// The inverse of [`Camera::distorted`]; where the lens folds the picture, the largest distance
    /// before that.
    fn undistorted(&self, distorted: f64) -> f64 {
        let limit = self.limit();
        if self.distorted(limit) <= distorted {
            return limit;
        }
        let mut r = distorted.min(limit);
        for _ in 0..MAX_STEPS {
            let step = (self.distorted(r) - distorted) / self.slope(r);
            r = (r - step).clamp(0.0, limit);
            if step.abs() < CLOSE {
                return r;
            }
        }
        self.bisected(distorted, limit)
    }

    fn bisected(&self, distorted: f64, limit: f64) -> f64 {
        let mut near = 0.0;
        let mut far = limit;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            if self.distorted(middle) < distorted {
                near = middle
            } else {
                far = middle
            }
        }
        0.5 * (near + far)
    }

    fn slope(&self, r: f64) -> f64 {
        let [k1, k2] = self.distortion;
        1.0 + r * r * (3.0 * k1 + 5.0 * k2 * r * r)
    }

    /// The distance from the centre up to which the lens does not fold the picture: where the slope
    /// 1 + 3 k1 r² + 5 k2 r⁴ becomes 0.
    fn limit(&self) -> f64 {
        let [k1, k2] = self.distortion;
        let a = 5.0 * k2;
        let b = 3.0 * k1;
        let root = if a == 0.0 {
            -1.0 / b
        } else {
            let discriminant = b * b - 4.0 * a;
            if discriminant < 0.0 {
                return FARTHEST;
            }
            let roots = [1.0, -1.0].map(|sign| (-b + sign * discriminant.sqrt()) / (2.0 * a));
            let ahead = roots.into_iter().filter(|square| *square > 0.0);
            ahead.fold(f64::INFINITY, f64::min)
        };
        if root > 0.0 {
            root.sqrt().min(FARTHEST)
        } else {
            FARTHEST
        }
    }
}

/// The centre of a picture; the centre of the first pixel is 0, 0.
fn middle(size: Size) -> (f64, f64) {
    let half = |length: u32| f64::from(length) / 2.0 - 0.5;
    (half(size.width), half(size.height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: Size = Size {
        width: 320,
        height: 240,
    };

    #[test]
    fn without_distortion_bearings_match_the_field_of_view() {
        let camera = Camera::pinhole(1.0);
        for (x, bearing) in [(159.5, 0.0), (-0.5, 0.5), (319.5, -0.5)] {
            let found = camera.direction(x, 119.5, SIZE);
            assert!((found.bearing - bearing).abs() < 1e-12 && found.elevation == 0.0);
        }
        // A vertical object has the same bearing from top to bottom.
        let head = camera.bearing(20.0, 10.0, SIZE);
        let foot = camera.bearing(20.0, 200.0, SIZE);
        assert!((head - foot).abs() < 1e-12);
    }

    #[test]
    fn the_edge_of_a_bulging_picture_has_a_larger_bearing() {
        let straight = Camera::pinhole(Camera::default().hfov);
        let (distorted, plain) = [Camera::default(), straight]
            .map(|camera| camera.bearing(-0.5, 119.5, SIZE).to_degrees())
            .into();
        assert!(
            (plain - 22.8).abs() < 0.01 && distorted > plain + 0.8,
            "{distorted} {plain}"
        );
    }

    #[test]
    fn lenses_that_fold_the_picture_are_detected() {
        assert!(Camera::default().is_one_to_one());
        assert!(Camera::pinhole(3.0).is_one_to_one());
        for distortion in [[-2.0, 0.0], [0.0, -9.0], [-2.0, 0.5]] {
            let camera = Camera {
                distortion,
                ..Camera::default()
            };
            assert!(!camera.is_one_to_one(), "{distortion:?}");
            assert!(camera.bearing(0.0, 0.0, SIZE).is_finite());
        }
    }

    proptest! {
        #[test]
        fn a_position_survives_the_round_trip_through_its_direction(
            x in 0.0..320.0, y in 0.0..240.0, k1 in -0.4..0.4, k2 in 0.0..0.3,
        ) {
            let camera = Camera { distortion: [k1, k2], ..Camera::default() };
            prop_assume!(camera.is_one_to_one());
            let (back_x, back_y) = camera.pixel(camera.direction(x, y, SIZE), SIZE).unwrap();
            prop_assert!((back_x - x).abs() < 1e-6 && (back_y - y).abs() < 1e-6);
        }

        #[test]
        fn any_numbers_are_accepted_without_panic(
            x in any::<f64>(), y in any::<f64>(), k1 in any::<f64>(), k2 in any::<f64>(),
        ) {
            let camera = Camera { distortion: [k1, k2], ..Camera::default() };
            let _ = (camera.direction(x, y, SIZE), camera.is_one_to_one());
        }
    }
}
