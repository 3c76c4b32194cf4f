//! The camera's pose and projection: the direction of each column, the row of each height, and the
//! light reflected from a distance.

use crate::geometry::{Point, Pose};

/// Width of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const WIDTH: usize = 320;
/// Height of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const HEIGHT: usize = 240;

/// Distance of the lens in front of the robot's centre, metres.
const AHEAD: f64 = 0.10;

/// The image that is rendered: what a lens without distortion that looks level would show. It covers
/// whatever the frame shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Canvas {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Number of columns to the left of the direction straight ahead.
    pub(crate) left: usize,
    /// Number of rows above the horizon.
    pub(crate) horizon: usize,
    /// Focal length, pixels.
    pub(crate) focal: f32,
    /// Height of the lens above the floor, metres.
    pub(crate) eye: f32,
}

#[derive(Clone, Copy)]
pub(crate) struct View {
    pub(crate) eye: Point,
    sin: f64,
    cos: f64,
    pub(crate) canvas: Canvas,
    pub(crate) flash: bool,
}

#[derive(Clone, Copy)]
pub(crate) struct Column {
    pub(crate) index: usize,
    /// Lateral offset to the right per unit of depth.
    pub(crate) slope: f32,
}

impl View {
    /// Creates the view of a robot at `pose`.
    pub(crate) fn new(pose: Pose, canvas: Canvas, flash: bool) -> View {
        let (sin, cos) = pose.heading.sin_cos();
        let eye = pose.point().ahead(pose.heading, AHEAD);
        View {
            eye,
            sin,
            cos,
            canvas,
            flash,
        }
    }

    pub(crate) fn column(&self, index: usize) -> Column {
        Column {
            index,
            slope: (index as f32 + 0.5 - self.canvas.left as f32) / self.canvas.focal,
        }
    }

    /// Returns the columns between two slopes, with one more on each side to compensate for
    /// rounding.
    pub(crate) fn columns(&self, left: f32, right: f32) -> std::ops::Range<usize> {
        let width = self.canvas.width;
        let column = |slope: f32| slope * self.canvas.focal + self.canvas.left as f32;
        // The conversion turns a negative float into 0.
        let from = (column(left) - 1.0) as usize;
        let to = (column(right) + 2.0) as usize;
        from.min(width)..to.min(width)
    }

    /// Returns the direction vector of a column's ray, scaled to a depth of one metre.
    pub(crate) fn direction(&self, column: Column) -> (f64, f64) {
        let slope = f64::from(column.slope);
        (self.cos + slope * self.sin, self.sin - slope * self.cos)
    }

    /// Returns how far a point lies ahead and to the right, in metres.
    pub(crate) fn relative(&self, point: Point) -> (f32, f32) {
        let dx = point.x - self.eye.x;
        let dy = point.y - self.eye.y;
        (
            (dx * self.cos + dy * self.sin) as f32,
            (dx * self.sin - dy * self.cos) as f32,
        )
    }

    /// Returns the row in which a height above the floor appears at a depth, clamped to the canvas.
    pub(crate) fn row(&self, height: f32, depth: f32) -> usize {
        let canvas = &self.canvas;
        let row = canvas.horizon as f32 + (canvas.eye - height) * canvas.focal / depth;
        (row + 0.5).clamp(0.0, canvas.height as f32) as usize
    }

    /// Returns the height above the floor that a row shows at a depth.
    pub(crate) fn height(&self, row: usize, depth: f32) -> f32 {
        self.canvas.eye - self.down(row) * depth
    }

    /// Returns the slope downwards of a row's rays.
    pub(crate) fn down(&self, row: usize) -> f32 {
        (row as f32 + 0.5 - self.canvas.horizon as f32) / self.canvas.focal
    }

    pub(crate) fn place(&self, column: Column, depth: f32) -> (f32, f32) {
        let (dx, dy) = self.direction(column);
        (
            self.eye.x as f32 + dx as f32 * depth,
            self.eye.y as f32 + dy as f32 * depth,
        )
    }

    /// Returns the headlight's light on things at a depth in a column.
    pub(crate) fn headlight(&self, column: Column, depth: f32) -> f32 {
        flash(depth) * self.beam(column)
    }

    /// Returns the share of the headlight that falls on a column.
    pub(crate) fn beam(&self, column: Column) -> f32 {
        let beam = (1.0 - 2.0 * column.slope * column.slope).max(0.0);
        if self.flash { beam } else { 0.0 }
    }
}

/// Returns the share of the room's light reflected from a depth.
pub(crate) fn lamps(depth: f32) -> f32 {
    1.0 / (1.0 + 0.012 * depth * depth)
}

/// Returns the headlight's light reflected from a depth, in the centre of its beam.
pub(super) fn flash(depth: f32) -> f32 {
    0.45 / (0.6 + 0.5 * depth * depth)
}
