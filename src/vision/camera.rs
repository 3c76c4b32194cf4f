//! What turns places of the picture into directions and back: the field of view and how the lens
//! bends the picture. Radial distortion as Brown and Conrady have it: a place that a lens without
//! distortion would show at the distance r from the middle, in focal lengths, is shown at r (1 + k1
//! r² + k2 r⁴).

use serde::{Deserialize, Serialize};

use super::Size;

/// Farther from the middle than this, in focal lengths, no lens shows anything.
const FARTHEST: f64 = 100.0;
/// Steps towards the place that a lens bends to another: four are usual.
const MOST_STEPS: usize = 12;
/// Such a step, in focal lengths, is the last.
const CLOSE: f64 = 1e-9;
const HALVINGS: usize = 60;

/// Field of view and distortion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Camera {
    /// Horizontal field of view in radians, without distortion: twice the arc tangent
    /// of half the picture's width over the focal length, both in pixels.
    pub hfov: f64,
    /// `[k1, k2]`; `[0, 0]` is a lens without distortion. With values below 0 straight lines bulge
    /// outwards.
    pub distortion: [f64; 2],
}

/// Where something is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Direction {
    /// Radians in the plane, left positive, 0 straight ahead.
    pub bearing: f64,
    /// Radians above the horizon, below it negative.
    pub elevation: f64,
}

impl Default for Camera {
    /// The robot's: a focal length of 381 pixels was measured; the distortion is usual for such
    /// lenses.
    fn default() -> Self {
        Camera {
            hfov: 45.6_f64.to_radians(),
            distortion: [-0.25, 0.08],
        }
    }
}

impl Camera {
    /// Without distortion.
    pub fn pinhole(hfov: f64) -> Camera {
        Camera {
            hfov,
            distortion: [0.0, 0.0],
        }
    }

    /// Focal length in pixels of a picture of some width.
    pub fn focal_length(&self, width: u32) -> f64 {
        f64::from(width) / 2.0 / (self.hfov / 2.0).tan()
    }

    /// Whether each place of a picture of the shape 4:3 shows another direction. Strong distortion
    /// folds the picture: then there is no telling.
    pub fn is_one_to_one(&self) -> bool {
        let half = (self.hfov / 2.0).tan();
        let corner = half.hypot(half * 0.75);
        let limit = self.limit();
        limit > 0.0 && self.bent(limit) > corner
    }

    /// Direction of the column `x` and the row `y`, which may be fractions, in a picture.
    pub fn direction(&self, x: f64, y: f64, size: Size) -> Direction {
        let (right, down) = self.slopes(x, y, size);
        Direction {
            bearing: (-right).atan(),
            elevation: (-down / right.hypot(1.0)).atan(),
        }
    }

    /// Direction of a place in radians, left positive, 0 straight ahead.
    pub fn bearing(&self, x: f64, y: f64, size: Size) -> f64 {
        self.direction(x, y, size).bearing
    }

    /// Column and row where a direction is seen, possibly outside of the picture; `None` for what
    /// is beside or behind the camera.
    pub fn pixel(&self, direction: Direction, size: Size) -> Option<(f64, f64)> {
        let Direction { bearing, elevation } = direction;
        if bearing.cos() <= 0.0 || elevation.cos() <= 0.0 {
            return None;
        }
        let right = -bearing.tan();
        let down = -elevation.tan() * right.hypot(1.0);
        let r = right.hypot(down);
        let stretch = if r > self.limit() {
            return None;
        } else {
            self.stretch(r)
        };
        let focal = self.focal_length(size.width);
        let (middle_x, middle_y) = middle(size);
        Some((
            middle_x + focal * stretch * right,
            middle_y + focal * stretch * down,
        ))
    }

    /// To the right and down for each length ahead, without distortion.
    fn slopes(&self, x: f64, y: f64, size: Size) -> (f64, f64) {
        let focal = self.focal_length(size.width);
        let (middle_x, middle_y) = middle(size);
        let (right, down) = ((x - middle_x) / focal, (y - middle_y) / focal);
        let bent = right.hypot(down);
        if bent == 0.0 || self.distortion == [0.0, 0.0] {
            return (right, down);
        }
        let scale = self.straight(bent) / bent;
        (right * scale, down * scale)
    }

    fn stretch(&self, r: f64) -> f64 {
        let [k1, k2] = self.distortion;
        1.0 + r * r * (k1 + k2 * r * r)
    }

    /// Where the lens shows what is `r` from the middle, both in focal lengths.
    fn bent(&self, r: f64) -> f64 {
        r * self.stretch(r)
    }

    /// What the lens shows at `bent`; where it folds the picture, the farthest before that.
    fn straight(&self, bent: f64) -> f64 {
        let limit = self.limit();
        if self.bent(limit) <= bent {
            return limit;
        }
        let mut r = bent.min(limit);
        for _ in 0..MOST_STEPS {
            let step = (self.bent(r) - bent) / self.slope(r);
            r = (r - step).clamp(0.0, limit);
            if step.abs() < CLOSE {
                return r;
            }
        }
        self.halved(bent, limit)
    }

    /// The same for what Newton's steps do not find.
    fn halved(&self, bent: f64, limit: f64) -> f64 {
        let (mut near, mut far) = (0.0, limit);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            if self.bent(middle) < bent {
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

    /// How far from the middle the lens does not fold the picture yet: up to where its slope
    /// 1 + 3 k1 r² + 5 k2 r⁴ becomes 0.
    fn limit(&self) -> f64 {
        let [k1, k2] = self.distortion;
        let (a, b) = (5.0 * k2, 3.0 * k1);
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

/// The middle of a picture; the first pixel's own middle is 0, 0.
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
    fn without_distortion_bearings_fit_the_field_of_view() {
        let camera = Camera::pinhole(1.0);
        for (x, bearing) in [(159.5, 0.0), (-0.5, 0.5), (319.5, -0.5)] {
            let found = camera.direction(x, 119.5, SIZE);
            assert!((found.bearing - bearing).abs() < 1e-12 && found.elevation == 0.0);
        }
        // Upright things are in one direction from head to foot.
        let (head, foot) = (
            camera.bearing(20.0, 10.0, SIZE),
            camera.bearing(20.0, 200.0, SIZE),
        );
        assert!((head - foot).abs() < 1e-12);
    }

    #[test]
    fn the_edge_of_a_bulging_picture_is_farther_aside() {
        let straight = Camera::pinhole(Camera::default().hfov);
        let (bent, plain) = [Camera::default(), straight]
            .map(|camera| camera.bearing(-0.5, 119.5, SIZE).to_degrees())
            .into();
        assert!(
            (plain - 22.8).abs() < 0.01 && bent > plain + 0.8,
            "{bent} {plain}"
        );
    }

    #[test]
    fn lenses_that_fold_the_picture_are_known() {
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
        fn a_place_and_its_direction_lead_to_each_other(
            x in 0.0..320.0, y in 0.0..240.0, k1 in -0.4..0.4, k2 in 0.0..0.3,
        ) {
            let camera = Camera { distortion: [k1, k2], ..Camera::default() };
            prop_assume!(camera.is_one_to_one());
            let (back_x, back_y) = camera.pixel(camera.direction(x, y, SIZE), SIZE).unwrap();
            prop_assert!((back_x - x).abs() < 1e-6 && (back_y - y).abs() < 1e-6);
        }

        #[test]
        fn any_numbers_give_numbers(
            x in any::<f64>(), y in any::<f64>(), k1 in any::<f64>(), k2 in any::<f64>(),
        ) {
            let camera = Camera { distortion: [k1, k2], ..Camera::default() };
            let _ = (camera.direction(x, y, SIZE), camera.is_one_to_one());
        }
    }
}
