//! Locates a wall ahead of the robot by its foot, the line where it meets the floor, seen while the
//! robot drives straight, at an angle to the wall or in a curve.
//!
//! The farthest edge below the horizon is the foot of what stands there, or the upper edge of a
//! skirting board, which is equally straight and nearly at the same position. How far such an edge
//! is below the lens follows from how it moves down in the picture while the robot drives; while
//! that is still uncertain, the greatest plausible distance of the wall is used.

use std::collections::VecDeque;

use super::camera::Camera;
use super::standstill::{HalfLuma, LENS_AHEAD, LENS_HEIGHT};
use crate::vision::picture::size::Size;

/// Number of column groups in which a foot is searched for, and the width of each, half-size
/// pixels.
const PROBES: usize = 9;
const WIDE: usize = 8;
/// Rows compared on each side of an edge, and the least step of brightness there, of 255.
const REACH: usize = 3;
const EDGE: f64 = 2.5;
/// Edges with a smaller slope below the horizon are too far away to be measured.
const FARTHEST: f64 = 0.03;
/// Number of pictures that are kept; a wall is first fitted to the last few of them.
const MAX_SEEN: usize = 24;
const LAST: [usize; 4] = [4, 8, 16, MAX_SEEN];
/// How often a wall is fitted, each time to all feet that match the previous fit.
const ROUNDS: usize = 4;
/// Least number of feet of a wall, and their least share of all feet.
const FEWEST: usize = 12;
const SHARE: f64 = 0.6;
/// Least number of feet for a picture to count.
const FEWEST_AT_ONCE: usize = 3;
/// Half of the feet in this many last pictures must belong to the wall.
const NEWEST: usize = 5;
/// A foot belongs to a wall within [`TOLERANCE`], in metres, if its distance is less than [`NEAR`]
/// times the height of the lens above it; more distant feet are measured less accurately and have a
/// larger tolerance.
const NEAR: f64 = 3.0;
const TOLERANCE: f64 = 0.016;
/// Greatest deviation of a wall's feet from a straight line, metres.
const STRAIGHT: f64 = 0.01;
/// The candidate heights of the lens above the edge, metres: the least, how many, and the least for
/// which the edge is a foot.
const MIN_LENS_HEIGHT: f64 = 0.07;
const HEIGHT_STEPS: usize = 14;
const MIN_HEIGHT_OF_FOOT: f64 = 0.095;
/// A height is still plausible if its squared error is at most this many times the least one, plus
/// [`NOISE`].
const MAX_ERROR_RATIO: f64 = 1.05;
const NOISE: f64 = 1e-5;
/// A wall is extended by this much beyond its seen parts, metres.
const EXTENSION: f64 = 0.2;

/// Position of the robot's centre and its heading, from odometry.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RobotPose {
    /// Metres.
    pub x: f64,
    /// Metres.
    pub y: f64,
    /// Radians, left positive.
    pub heading: f64,
}

impl RobotPose {
    /// The pose after driving `way` metres while turning by `turned` radians.
    pub fn after(self, way: f64, turned: f64) -> RobotPose {
        let middle = self.heading + turned / 2.0;
        RobotPose {
            x: self.x + way * middle.cos(),
            y: self.y + way * middle.sin(),
            heading: self.heading + turned,
        }
    }
}

/// A straight wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// The unit vector perpendicular to the wall, pointing towards it.
    normal: (f64, f64),
    /// Distance of the wall from the origin in that direction, metres.
    offset: f64,
    /// The extent along the wall that was seen, metres; positive is to the left.
    seen: (f64, f64),
    /// Root mean square of the weighted distances of its feet, metres.
    rms_error: f64,
    /// Height of the lens above the edge, metres.
    lens_height: f64,
}

impl Wall {
    /// Distance from the robot's centre to the wall, metres; `None` where no wall was seen.
    pub fn distance(&self, pose: RobotPose) -> Option<f64> {
        let along = pose.y * self.normal.0 - pose.x * self.normal.1;
        let here = self.seen.0 - EXTENSION <= along && along <= self.seen.1 + EXTENSION;
        here.then_some(self.offset - self.normal.0 * pose.x - self.normal.1 * pose.y)
    }

    /// The share of a movement straight ahead that leads towards the wall, -1 to 1.
    pub fn ahead(&self, pose: RobotPose) -> f64 {
        self.normal.0 * pose.heading.cos() + self.normal.1 * pose.heading.sin()
    }

    /// Distance of a foot from the wall, metres.
    fn error(&self, foot: &Foot) -> f64 {
        let (x, y) = foot.place(self.lens_height);
        (self.normal.0 * x + self.normal.1 * y - self.offset).abs()
    }

    fn has(&self, foot: &Foot) -> bool {
        self.error(foot) <= TOLERANCE / foot.weight.sqrt()
    }
}

/// A foot: the position of the lens, and the vector from there to the foot per metre of height of
/// the lens above it.
#[derive(Debug, Clone, Copy)]
struct Foot {
    lens: (f64, f64),
    way: (f64, f64),
    /// The accuracy of the measurement, at most 1.
    weight: f64,
}

impl Foot {
    fn place(&self, lens_height: f64) -> (f64, f64) {
        let ((x, y), (right, ahead)) = (self.lens, self.way);
        (x + lens_height * right, y + lens_height * ahead)
    }
}

/// The feet seen while the robot drove.
#[derive(Debug, Clone, Default)]
pub struct WallFeet {
    seen: VecDeque<[Option<Foot>; PROBES]>,
}

impl WallFeet {
    /// Adds the feet of a picture taken at this pose. Returns whether feet were seen.
    pub fn note(&mut self, luma: &HalfLuma, camera: Camera, pose: RobotPose) -> bool {
        let (w, h) = luma.size();
        if w < PROBES * WIDE || h < 8 * REACH {
            return false;
        }
        let size = Size {
            width: w as u32,
            height: h as u32,
        };
        let (sin, cos) = pose.heading.sin_cos();
        let lens = (pose.x + LENS_AHEAD * cos, pose.y + LENS_AHEAD * sin);
        let feet = std::array::from_fn(|probe| {
            let left = (w - WIDE) * probe / (PROBES - 1);
            let row = farthest_edge(luma, left)?;
            let seen = camera.direction((left + WIDE / 2) as f64 - 0.5, row, size);
            let down = -seen.elevation.tan();
            let (sin, cos) = (pose.heading + seen.bearing).sin_cos();
            (down >= FARTHEST).then(|| Foot {
                lens,
                way: (cos / down, sin / down),
                weight: (NEAR * down).min(1.0).powi(4),
            })
        });
        let any = feet.iter().flatten().count() >= FEWEST_AT_ONCE;
        if any {
            if self.seen.len() == MAX_SEEN {
                self.seen.pop_front();
            }
            self.seen.push_back(feet);
        }
        any
    }

    /// The wall to which the feet seen last belong; `None` if they do not fit one wall.
    pub fn wall(&self) -> Option<Wall> {
        let all: Vec<Foot> = self.last(MAX_SEEN).collect();
        let fits = LAST
            .iter()
            .filter_map(|pictures| agreed(self.last(*pictures).collect(), &all));
        let (count, wall) = fits.max_by_key(|(count, _)| *count)?;
        let newest = self.last(NEWEST).count();
        let belong = self.last(NEWEST).filter(|foot| wall.has(foot)).count();
        let sure = count as f64 >= SHARE * all.len() as f64 && 2 * belong >= newest;
        (sure && wall.rms_error < STRAIGHT && wall.lens_height >= MIN_HEIGHT_OF_FOOT)
            .then_some(wall)
    }

    /// The feet of the last pictures.
    fn last(&self, pictures: usize) -> impl Iterator<Item = Foot> {
        self.seen
            .iter()
            .rev()
            .take(pictures)
            .flatten()
            .flatten()
            .copied()
    }
}

/// Fits a wall to these feet, then repeatedly to all feet that match the previous fit. Returns the
/// number of feet and the wall.
fn agreed(mut feet: Vec<Foot>, all: &[Foot]) -> Option<(usize, Wall)> {
    let mut wall = fit(&feet)?;
    for _ in 1..ROUNDS {
        feet.clear();
        feet.extend(all.iter().filter(|foot| wall.has(foot)));
        wall = fit(&feet)?;
    }
    Some((feet.len(), wall))
}

/// The straight line with the least distance to the feet, with the greatest plausible height of the
/// lens above the edge.
fn fit(feet: &[Foot]) -> Option<Wall> {
    if feet.len() < FEWEST {
        return None;
    }
    let (mut weight, mut means, mut moments) = (0.0, [0.0; 4], [[0.0; 4]; 4]);
    for foot in feet {
        let values = [foot.lens.0, foot.lens.1, foot.way.0, foot.way.1];
        weight += foot.weight;
        for (one, value) in values.iter().enumerate() {
            means[one] += foot.weight * value;
            for (other, moment) in moments[one].iter_mut().enumerate() {
                *moment += foot.weight * value * values[other];
            }
        }
    }
    means.iter_mut().for_each(|mean| *mean /= weight);
    let moment =
        |one: usize, other: usize| moments[one][other] / weight - means[one] * means[other];
    // The mean squared distance of the feet from the best line, and the line's normal.
    let nearest = |lens_height: f64| {
        let moment = |one: usize, other: usize| {
            let mixed = moment(one, other + 2) + moment(one + 2, other);
            moment(one, other) + lens_height * (mixed + lens_height * moment(one + 2, other + 2))
        };
        let (xx, xy, yy) = (moment(0, 0), moment(0, 1), moment(1, 1));
        let error = 0.5 * (xx + yy) - (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        (error.max(0.0), (-angle.sin(), angle.cos()))
    };
    let lens_height = |step: usize| {
        MIN_LENS_HEIGHT + (LENS_HEIGHT - MIN_LENS_HEIGHT) * step as f64 / (HEIGHT_STEPS - 1) as f64
    };
    let lines: Vec<_> = (0..HEIGHT_STEPS)
        .map(|step| nearest(lens_height(step)))
        .collect();
    // The measured quantity scales with the height above the edge, and so does its error.
    let relative_error = |step: usize| lines[step].0 / lens_height(step).powi(2);
    let least = (0..HEIGHT_STEPS)
        .map(relative_error)
        .fold(f64::INFINITY, f64::min);
    let step =
        (0..HEIGHT_STEPS).rfind(|step| relative_error(*step) <= MAX_ERROR_RATIO * least + NOISE)?;
    let ((error, (x, y)), lens_height) = (lines[step], lens_height(step));
    let lens = x * means[0] + y * means[1];
    let offset = lens + lens_height * (x * means[2] + y * means[3]);
    let (normal, offset) = if offset >= lens {
        ((x, y), offset)
    } else {
        ((-x, -y), -offset)
    };
    let alongs = feet.iter().map(|foot| {
        let (x, y) = foot.place(lens_height);
        y * normal.0 - x * normal.1
    });
    let seen = alongs.fold(
        (f64::INFINITY, f64::NEG_INFINITY),
        |(least, most), along| (along.min(least), along.max(most)),
    );
    Some(Wall {
        normal,
        offset,
        seen,
        rms_error: (error * weight / feet.len() as f64).sqrt(),
        lens_height,
    })
}

/// The row of the first edge below the horizon in the columns from `left` on.
fn farthest_edge(luma: &HalfLuma, left: usize) -> Option<f64> {
    let (_, h) = luma.size();
    let horizon = h / 2;
    let rows: Vec<f64> = (horizon..h)
        .map(|y| {
            let row = &luma.row(y)[left..left + WIDE];
            let sum: u32 = row.iter().map(|value| u32::from(*value)).sum();
            f64::from(sum) / WIDE as f64
        })
        .collect();
    let sum = |rows: &[f64]| rows.iter().sum::<f64>() / REACH as f64;
    let steps: Vec<f64> = rows
        .windows(2 * REACH + 1)
        .map(|rows| (sum(&rows[..REACH]) - sum(&rows[REACH + 1..])).abs())
        .collect();
    let first = steps.iter().position(|step| *step >= EDGE)?;
    // The step is visible from REACH rows above the edge on and is largest at the edge.
    let near = steps.get(first..=first + 2 * REACH)?;
    let weighted = near
        .iter()
        .zip(0..)
        .map(|(step, row)| step * f64::from(row));
    let middle = weighted.sum::<f64>() / near.iter().sum::<f64>();
    Some((horizon + first + REACH) as f64 + middle)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::vision::Image;

    /// The view from this pose of a bright wall `far` metres from the origin, turned to the left by
    /// `turned` radians, with a skirting board of this height.
    fn seen(pose: RobotPose, far: f64, turned: f64, board: f64) -> HalfLuma {
        let camera = Camera::default();
        let size = Size {
            width: 320,
            height: 240,
        };
        let normal = (turned.cos(), turned.sin());
        let lens = (
            pose.x + LENS_AHEAD * pose.heading.cos(),
            pose.y + LENS_AHEAD * pose.heading.sin(),
        );
        let picture = RgbImage::from_fn(320, 240, |x, y| {
            let ray = camera.direction(f64::from(x), f64::from(y), size);
            let angle = pose.heading + ray.bearing;
            let away = far - normal.0 * lens.0 - normal.1 * lens.1;
            let way = away / (normal.0 * angle.cos() + normal.1 * angle.sin());
            let high = LENS_HEIGHT + way * ray.elevation.tan();
            Rgb([if high > board || way < 0.0 { 150 } else { 110 }; 3])
        });
        let mut luma = HalfLuma::default();
        luma.take(&Image::from_rgb(&picture));
        luma
    }

    /// Drives towards such a wall and returns its measured and its true distance at the end.
    fn driven(turn: f64, turned: f64, board: f64) -> Option<(f64, f64)> {
        let (mut feet, mut pose) = (WallFeet::default(), RobotPose::default());
        while pose.x < 0.5 {
            feet.note(&seen(pose, 1.1, turned, board), Camera::default(), pose);
            pose = pose.after(0.02, 0.02 * turn);
        }
        let truly = 1.1 - turned.cos() * pose.x - turned.sin() * pose.y;
        Some((feet.wall()?.distance(pose)?, truly))
    }

    #[test]
    fn a_wall_is_found_straight_ahead_at_an_angle_and_in_curves_with_and_without_skirting_board() {
        for (turn, turned) in [(0.0, 0.0), (0.0, 0.5), (0.0, -0.6), (0.6, 0.2), (-0.8, 0.0)] {
            for board in [0.0, 0.08] {
                let (seen, truly) = driven(turn, turned, board).unwrap();
                assert!(
                    (-0.02..0.08).contains(&(seen - truly)),
                    "{turn} {turned} {board}: {seen} {truly}"
                );
            }
        }
    }

    #[test]
    fn a_wall_is_not_placed_too_near_while_the_robot_stands_still() {
        let (mut feet, pose) = (WallFeet::default(), RobotPose::default());
        for _ in 0..10 {
            feet.note(&seen(pose, 1.1, 0.0, 0.08), Camera::default(), pose);
        }
        assert!(feet.wall().unwrap().distance(pose).unwrap() > 1.1);
    }

    #[test]
    fn no_wall_is_reported_where_none_was_seen() {
        assert_eq!(WallFeet::default().wall(), None);
        let (mut feet, pose) = (WallFeet::default(), RobotPose::default());
        for side in [1, 2, 9, 33, 160] {
            let mut luma = HalfLuma::default();
            let plain = RgbImage::from_pixel(2 * side, side, Rgb([90; 3]));
            luma.take(&Image::from_rgb(&plain));
            assert!(!feet.note(&luma, Camera::default(), pose));
        }
        for _ in 0..10 {
            feet.note(&seen(pose, 1.1, 0.0, 0.0), Camera::default(), pose);
        }
        let aside = RobotPose { y: 2.0, ..pose };
        assert_eq!(feet.wall().unwrap().distance(aside), None);
    }
}
