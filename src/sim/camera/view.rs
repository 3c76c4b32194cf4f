//! Where the camera is and what that means: which way each column of the picture looks, which row
//! shows what height, and how much light comes back from a distance.

use crate::sim::geometry::{Point, Pose};

/// Width of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const WIDTH: usize = 320;
/// Height of a frame, pixels (`PROTOCOL.md`, VIDEO).
pub const HEIGHT: usize = 240;

/// The lens above the floor, metres.
pub(crate) const EYE: f32 = 0.20;
/// The lens before the middle of the robot, metres.
const AHEAD: f64 = 0.10;
/// The row at which what is as high as the lens appears.
pub(crate) const HORIZON: f32 = HEIGHT as f32 / 2.0;

/// Where the camera is for one frame.
#[derive(Clone, Copy)]
pub(crate) struct View {
    pub(crate) eye: Point,
    sin: f64,
    cos: f64,
    pub(crate) focal: f32,
    pub(crate) flash: bool,
}

/// What one row shows of the floor.
#[derive(Clone, Copy)]
pub(crate) struct Row {
    pub(crate) depth: f32,
    /// How much of the room's light comes back from there.
    pub(crate) lamps: f32,
    /// The same for the headlight, in the middle of its beam.
    pub(crate) flash: f32,
}

/// One column of the picture.
#[derive(Clone, Copy)]
pub(crate) struct Column {
    pub(crate) index: usize,
    /// To the right of the middle for each length ahead.
    pub(crate) slope: f32,
}

impl View {
    /// Of a robot at `pose`; `focal` in pixels.
    pub(crate) fn of(pose: Pose, focal: f32, flash: bool) -> View {
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

    /// The column with a number, from the left.
    pub(crate) fn column(&self, index: usize) -> Column {
        Column {
            index,
            slope: (index as f32 + 0.5 - WIDTH as f32 / 2.0) / self.focal,
        }
    }

    /// The columns between two slopes, one more to each side for what rounding takes away.
    pub(crate) fn columns(&self, left: f32, right: f32) -> std::ops::Range<usize> {
        let column = |slope: f32| slope * self.focal + WIDTH as f32 / 2.0;
        // A float below 0 becomes 0.
        let (from, to) = (
            (column(left) - 1.0) as usize,
            (column(right) + 2.0) as usize,
        );
        from.min(WIDTH)..to.min(WIDTH)
    }

    /// The direction of a column's ray; one length of it is one metre ahead.
    pub(crate) fn direction(&self, column: Column) -> (f64, f64) {
        let slope = f64::from(column.slope);
        (self.cos + slope * self.sin, self.sin - slope * self.cos)
    }

    /// A point's metres ahead and to the right.
    pub(crate) fn relative(&self, point: Point) -> (f32, f32) {
        let (dx, dy) = (point.x - self.eye.x, point.y - self.eye.y);
        (
            (dx * self.cos + dy * self.sin) as f32,
            (dx * self.sin - dy * self.cos) as f32,
        )
    }

    /// The row in which a height above the floor appears at a depth, within the picture.
    pub(crate) fn row(&self, height: f32, depth: f32) -> usize {
        let row = HORIZON + (EYE - height) * self.focal / depth;
        (row + 0.5).clamp(0.0, HEIGHT as f32) as usize
    }

    /// The height above the floor that a row shows at a depth.
    pub(crate) fn height(&self, row: usize, depth: f32) -> f32 {
        EYE - (row as f32 + 0.5 - HORIZON) * depth / self.focal
    }

    /// The place on the floor at a depth in a column.
    pub(crate) fn place(&self, column: Column, depth: f32) -> (f32, f32) {
        let (dx, dy) = self.direction(column);
        (
            self.eye.x as f32 + dx as f32 * depth,
            self.eye.y as f32 + dy as f32 * depth,
        )
    }

    /// The headlight's light on things at a depth.
    pub(crate) fn headlight(&self, column: Column, depth: f32) -> f32 {
        flash(depth) * self.beam(column)
    }

    /// How much of the headlight falls on a column.
    pub(crate) fn beam(&self, column: Column) -> f32 {
        let beam = (1.0 - 2.0 * column.slope * column.slope).max(0.0);
        if self.flash { beam } else { 0.0 }
    }
}

impl Row {
    /// The row that many rows below the horizon.
    pub(crate) fn below_horizon(row: usize, focal: f32) -> Row {
        let depth = EYE * focal / (row as f32 + 0.5);
        Row {
            depth,
            lamps: lamps(depth),
            flash: flash(depth),
        }
    }
}

/// How much of the room's light comes back from a depth.
pub(crate) fn lamps(depth: f32) -> f32 {
    1.0 / (1.0 + 0.012 * depth * depth)
}

/// The headlight's light that comes back from a depth, in the middle of its beam.
fn flash(depth: f32) -> f32 {
    0.45 / (0.6 + 0.5 * depth * depth)
}
