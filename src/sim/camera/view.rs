//! The camera's pose and projection: the direction of each column, the row of each height, and the
//! light reflected from a distance.

use crate::sim::geometry::{Point, Pose};

/// Width of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const WIDTH: usize = 320;
/// Height of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const HEIGHT: usize = 240;

/// Height of the lens above the floor, metres.
pub(crate) const EYE: f32 = 0.20;
/// Distance of the lens in front of the robot's centre, metres.
const AHEAD: f64 = 0.10;
/// The row at which points at the height of the lens appear.
pub(crate) const HORIZON: f32 = HEIGHT as f32 / 2.0;

#[derive(Clone, Copy)]
pub(crate) struct View {
    pub(crate) eye: Point,
    sin: f64,
    cos: f64,
    pub(crate) focal: f32,
    pub(crate) flash: bool,
}

/// The part of the floor that one row shows.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    pub(crate) depth: f32,
    /// Share of the room's light reflected from there.
    pub(crate) lamps: f32,
    /// The same for the headlight, in the centre of its beam.
    pub(crate) flash: f32,
}

#[derive(Clone, Copy)]
pub(crate) struct Column {
    pub(crate) index: usize,
    /// Lateral offset to the right per unit of depth.
    pub(crate) slope: f32,
}

impl View {
    /// Creates the view of a robot at `pose`; `focal` is in pixels.
    pub(crate) fn new(pose: Pose, focal: f32, flash: bool) -> View {
        let (sin, cos) = pose.heading.sin_cos();
        let eye = pose.point().ahead(pose.heading, AHEAD);
        View {
            eye,
            sin,
            cos,
            focal,
            flash,
        }
    }

    pub(crate) fn column(&self, index: usize) -> Column {
        Column {
            index,
            slope: (index as f32 + 0.5 - WIDTH as f32 / 2.0) / self.focal,
        }
    }

    /// Returns the columns between two slopes, with one more on each side to compensate for
    /// rounding.
    pub(crate) fn columns(&self, left: f32, right: f32) -> std::ops::Range<usize> {
        let column = |slope: f32| slope * self.focal + WIDTH as f32 / 2.0;
        // The conversion turns a negative float into 0.
        let from = (column(left) - 1.0) as usize;
        let to = (column(right) + 2.0) as usize;
        from.min(WIDTH)..to.min(WIDTH)
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

    /// Returns the row in which a height above the floor appears at a depth, clamped to the frame.
    pub(crate) fn row(&self, height: f32, depth: f32) -> usize {
        let row = HORIZON + (EYE - height) * self.focal / depth;
        (row + 0.5).clamp(0.0, HEIGHT as f32) as usize
    }

    /// Returns the height above the floor that a row shows at a depth.
    pub(crate) fn height(&self, row: usize, depth: f32) -> f32 {
        EYE - (row as f32 + 0.5 - HORIZON) * depth / self.focal
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

impl Row {
    pub(crate) fn below_horizon(row: usize, focal: f32) -> Row {
        let depth = EYE * focal / (row as f32 + 0.5);
        Row {
            depth,
            lamps: lamps(depth),
            flash: flash(depth),
        }
    }
}

/// Returns the share of the room's light reflected from a depth.
pub(crate) fn lamps(depth: f32) -> f32 {
    1.0 / (1.0 + 0.012 * depth * depth)
}

/// Returns the headlight's light reflected from a depth, in the centre of its beam.
fn flash(depth: f32) -> f32 {
    0.45 / (0.6 + 0.5 * depth * depth)
}
