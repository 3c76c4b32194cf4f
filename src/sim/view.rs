//! Where the camera is and what that means: which way each column of the picture looks, which row
//! shows what height, and how much light comes back from a distance.

use serde::Deserialize;

use super::camera::{HEIGHT, WIDTH};
use super::geometry::{Point, Pose};
use super::number;

/// The lens above the floor, metres.
pub(super) const EYE: f32 = 0.20;
/// The lens before the middle of the robot, metres.
const AHEAD: f64 = 0.10;
/// The row at which what is as high as the lens appears.
pub(super) const HORIZON: f32 = HEIGHT as f32 / 2.0;

/// How the robot sees.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Frames a second while the video stream is on.
    #[serde(deserialize_with = "number::frames")]
    pub fps: f64,
    /// What it sees from side to side, degrees.
    #[serde(deserialize_with = "number::view_degrees")]
    pub hfov_degrees: f64,
    /// Grain of the picture, 0..=1.
    #[serde(deserialize_with = "number::share")]
    pub noise: f64,
}

impl Default for CameraSettings {
    fn default() -> CameraSettings {
        CameraSettings {
            fps: 15.0,
            hfov_degrees: 60.0,
            noise: 0.25,
        }
    }
}

/// Where the camera is for one frame.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub(super) eye: Point,
    sin: f64,
    cos: f64,
    pub(super) focal: f32,
    pub(super) light: f32,
    pub(super) flash: bool,
}

/// What one row shows of the floor.
#[derive(Clone, Copy)]
pub(super) struct Row {
    pub(super) depth: f32,
    /// Fine lines fade with the distance: 1 near and 0 far.
    pub(super) detail: f32,
    pub(super) lamps: f32,
    pub(super) flash: f32,
}

/// One column of the picture.
#[derive(Clone, Copy)]
pub(super) struct Column {
    pub(super) index: usize,
    /// To the right of the middle for each length ahead.
    pub(super) slope: f32,
}

impl View {
    /// Of a robot at `pose`; `focal` in pixels, `light` 0..=1.
    pub(super) fn of(pose: Pose, focal: f32, light: f32, flash: bool) -> View {
        let (sin, cos) = pose.heading.sin_cos();
        let eye = pose.point().ahead(pose.heading, AHEAD);
        View {
            eye,
            sin,
            cos,
            focal,
            light,
            flash,
        }
    }

    /// The column with a number, from the left.
    pub(super) fn column(&self, index: usize) -> Column {
        Column {
            index,
            slope: (index as f32 + 0.5 - WIDTH as f32 / 2.0) / self.focal,
        }
    }

    /// The direction of a column's ray; one length of it is one metre ahead.
    pub(super) fn direction(&self, column: Column) -> (f64, f64) {
        let slope = f64::from(column.slope);
        (self.cos + slope * self.sin, self.sin - slope * self.cos)
    }

    /// A point's metres ahead and to the right.
    pub(super) fn relative(&self, point: Point) -> (f32, f32) {
        let (dx, dy) = (point.x - self.eye.x, point.y - self.eye.y);
        (
            (dx * self.cos + dy * self.sin) as f32,
            (dx * self.sin - dy * self.cos) as f32,
        )
    }

    /// The row in which a height above the floor appears at a depth, within the picture.
    pub(super) fn row(&self, height: f32, depth: f32) -> usize {
        let row = HORIZON + (EYE - height) * self.focal / depth;
        (row + 0.5).clamp(0.0, HEIGHT as f32) as usize
    }

    /// The height above the floor that a row shows at a depth.
    pub(super) fn height(&self, row: usize, depth: f32) -> f32 {
        EYE - (row as f32 + 0.5 - HORIZON) * depth / self.focal
    }

    /// How bright things at a depth are: the room's lamps and the headlight's beam.
    pub(super) fn gain(&self, column: Column, depth: f32) -> f32 {
        lamps(self.light, depth) + flash(depth) * self.beam(column)
    }

    /// How much of the headlight falls on a column.
    pub(super) fn beam(&self, column: Column) -> f32 {
        let beam = (1.0 - 2.0 * column.slope * column.slope).max(0.0);
        if self.flash { beam } else { 0.0 }
    }
}

impl Row {
    /// The row that many rows below the horizon.
    pub(super) fn below_horizon(row: usize, focal: f32, light: f32) -> Row {
        let depth = EYE * focal / (row as f32 + 0.5);
        let detail = (1.2 / depth).min(1.0);
        Row {
            depth,
            detail,
            lamps: lamps(light, depth),
            flash: flash(depth),
        }
    }
}

/// The light of the room's lamps that comes from a depth.
fn lamps(light: f32, depth: f32) -> f32 {
    light / (1.0 + 0.012 * depth * depth)
}

/// The headlight's light that comes back from a depth, in the middle of its beam.
fn flash(depth: f32) -> f32 {
    0.45 / (0.6 + 0.5 * depth * depth)
}
