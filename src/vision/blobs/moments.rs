//! Image moments of a shape: its area, centroid and orientation.

/// Exact sums of coordinates and of their products.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Moments {
    pub(crate) pixels: u64,
    sum_x: u64,
    sum_y: u64,
    sum_xx: u64,
    sum_yy: u64,
    sum_xy: u64,
}

/// The orientation and roundness of a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Axes {
    /// Direction of the major axis in radians, 0..pi, from x towards y.
    pub(crate) rotation: f64,
    /// Smaller second moment divided by the larger one, 0..1; 0 for a line and for a single pixel.
    pub(crate) roundness: f64,
}

impl Moments {
    /// Adds the pixels `start..end` of row `y`.
    pub(crate) fn add_run(&mut self, start: u32, end: u32, y: u32) {
        // Sum of the squares below n.
        let squares = |n: u64| n * n.saturating_sub(1) * (2 * n).saturating_sub(1) / 6;
        let start = u64::from(start);
        let end = u64::from(end);
        let y = u64::from(y);
        let pixels = end - start;
        let sum_x = (start + end).saturating_sub(1) * pixels / 2;
        self.pixels += pixels;
        self.sum_x += sum_x;
        self.sum_y += y * pixels;
        self.sum_xx += squares(end) - squares(start);
        self.sum_yy += y * y * pixels;
        self.sum_xy += y * sum_x;
    }

    /// Adds another shape.
    pub(crate) fn absorb(&mut self, other: &Moments) {
        self.pixels += other.pixels;
        self.sum_x += other.sum_x;
        self.sum_y += other.sum_y;
        self.sum_xx += other.sum_xx;
        self.sum_yy += other.sum_yy;
        self.sum_xy += other.sum_xy;
    }

    /// Mean column and row.
    pub(crate) fn centroid(&self) -> (f64, f64) {
        let pixels = self.pixels as f64;
        (self.sum_x as f64 / pixels, self.sum_y as f64 / pixels)
    }

    /// Direction and ratio of the axes of the ellipse with the same second moments.
    pub(crate) fn axes(&self) -> Axes {
        let (cx, cy) = self.centroid();
        let pixels = self.pixels as f64;
        let xx = self.sum_xx as f64 / pixels - cx * cx;
        let yy = self.sum_yy as f64 / pixels - cy * cy;
        let xy = self.sum_xy as f64 / pixels - cx * cy;
        let mean = (xx + yy) / 2.0;
        let spread = ((xx - yy) / 2.0).hypot(xy);
        let rotation = (0.5 * (2.0 * xy).atan2(xx - yy)).rem_euclid(std::f64::consts::PI);
        let roundness = if mean > 1e-9 {
            ((mean - spread) / (mean + spread)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        Axes {
            rotation,
            roundness,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn of(points: &[(u32, u32)]) -> Moments {
        let mut moments = Moments::default();
        points
            .iter()
            .for_each(|&(x, y)| moments.add_run(x, x + 1, y));
        moments
    }

    #[test]
    fn a_run_equals_its_single_pixels() {
        let mut run = Moments::default();
        run.add_run(3, 9, 7);
        assert_eq!(run, of(&[(3, 7), (4, 7), (5, 7), (6, 7), (7, 7), (8, 7)]));
    }

    #[test]
    fn lines_have_their_direction_and_no_roundness() {
        let line = |dx: u32, dy: u32| of(&[0, 1, 2, 3].map(|i| (10 + i * dx, 10 + i * dy))).axes();
        assert_eq!(
            line(1, 0),
            Axes {
                rotation: 0.0,
                roundness: 0.0
            }
        );
        assert!((line(1, 1).rotation - PI / 4.0).abs() < 1e-9);
        assert!((line(0, 1).rotation - PI / 2.0).abs() < 1e-9);
        assert!(line(1, 1).roundness < 1e-9);
    }

    #[test]
    fn a_square_is_round_and_a_pixel_has_no_shape() {
        let mut square = Moments::default();
        (10..20).for_each(|y| square.add_run(30, 40, y));
        assert!((square.axes().roundness - 1.0).abs() < 1e-9);
        assert_eq!(of(&[(5, 5)]).axes().roundness, 0.0);
    }
}
