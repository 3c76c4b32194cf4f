//! Fits the camera to sightings of boards: Levenberg-Marquardt least squares over the focal length,
//! the distortion and the pose of each board. The optical centre is assumed to be the picture's
//! centre.

use super::grid::Board;
use super::linear::Symmetric;
use super::pose::{Homography, Pair, Pose, focal_length, homography, pose, to_camera_axes};
use crate::vision::{Camera, Size};

/// Least number of pictures.
const MIN_PICTURES: usize = 3;
/// Most pictures; the system of equations grows too slow to solve beyond that.
const MAX_PICTURES: usize = 60;
/// Number of shared parameters: focal length, k1 and k2.
const CAMERA_PARAMETERS: usize = 3;
const POSE_PARAMETERS: usize = 6;
const MAX_ITERATIONS: usize = 100;
/// Largest standard deviation of the focal length, as a share of it.
const MAX_DEVIATION: f64 = 0.02;
/// Plausible fields of view of a lens in radians, and its largest distortion factor.
const FIELDS_OF_VIEW: std::ops::RangeInclusive<f64> = 0.1..=3.0;
const MAX_DISTORTION: f64 = 2.0;
/// Largest root mean square error of the corners of one flat board, in pixels per pixel of the
/// picture's width.
const MAX_BOARD_ERROR: f64 = 0.01;

/// The corners of a board in a picture, row by row, in pixels; the centre of the first pixel is the
/// origin.
pub type Sighting = Vec<[f64; 2]>;

/// The result of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibrated {
    /// The camera.
    pub camera: Camera,
    /// Standard deviation of its field of view, radians.
    pub uncertainty: f64,
    /// Root mean square error of the corners in pixels, for each picture.
    pub errors: Vec<f64>,
}

/// Why the pictures are not sufficient for a calibration.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationError {
    /// Too few or too many pictures.
    #[error("the board was found in {found} pictures; expected {MIN_PICTURES} to {MAX_PICTURES}")]
    Number {
        /// The number of pictures in which the board was found.
        found: usize,
    },
    /// The board was always held in a similar way: the result is uncertain or implausible.
    #[error(
        "the pictures are too similar: tilt the board in a different direction in each picture"
    )]
    Alike,
    /// Something other than a flat board was seen.
    #[error(
        "the corners are {pixels:.1} pixels off on average: is the board flat, and does it have {columns} by {rows} inner corners?"
    )]
    Bent {
        /// The root mean square error, pixels.
        pixels: f64,
        /// The board's columns as given.
        columns: usize,
        /// The board's rows as given.
        rows: usize,
    },
}

/// Determines the camera that took pictures of this size.
///
/// # Errors
/// See [`CalibrationError`].
pub fn calibrate(
    sightings: &[Sighting],
    board: Board,
    size: Size,
) -> Result<Calibrated, CalibrationError> {
    if !(MIN_PICTURES..=MAX_PICTURES).contains(&sightings.len()) {
        return Err(CalibrationError::Number {
            found: sightings.len(),
        });
    }
    let problem = Problem::of(sightings, board, size);
    let width = f64::from(size.width);
    let homographies: Option<Vec<Homography>> =
        problem.views.iter().map(|view| homography(view)).collect();
    let homographies = homographies.ok_or(CalibrationError::Alike)?;
    let starts = [
        focal_length(&homographies),
        Some(0.8 * width),
        Some(1.2 * width),
        Some(2.0 * width),
    ];
    let starts = starts.into_iter().flatten();
    let tried = starts.filter_map(|focal| problem.solved(focal, &homographies));
    let (state, cost) = tried
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .ok_or(CalibrationError::Alike)?;
    let focal = state.focal();
    let hfov = 2.0 * (width / 2.0 / focal).atan();
    let camera = Camera {
        hfov,
        distortion: [state.shared[1], state.shared[2]],
    };
    let errors = problem.errors(&state);
    let mean = (cost / problem.corners() as f64).sqrt();
    if mean > MAX_BOARD_ERROR * width {
        let Board { columns, rows } = board;
        return Err(CalibrationError::Bent {
            pixels: mean,
            columns,
            rows,
        });
    }
    let sigma = problem
        .deviation(&state, cost)
        .filter(|sigma| *sigma < MAX_DEVIATION);
    let bends = camera
        .distortion
        .iter()
        .any(|factor| factor.abs() > MAX_DISTORTION);
    let possible = FIELDS_OF_VIEW.contains(&hfov) && !bends && camera.is_one_to_one();
    match sigma.filter(|_| possible) {
        Some(sigma) => Ok(Calibrated {
            camera,
            // From the logarithm of the focal length to the angle.
            uncertainty: sigma * width * focal / (focal * focal + width * width / 4.0),
            errors,
        }),
        None => Err(CalibrationError::Alike),
    }
}

/// The unknowns: the logarithm of the focal length, k1, k2, and the poses of the boards.
#[derive(Clone)]
struct State {
    shared: [f64; CAMERA_PARAMETERS],
    poses: Vec<Pose>,
}

impl State {
    fn focal(&self) -> f64 {
        self.shared[0].exp()
    }

    /// The state after a step.
    fn moved(&self, step: &[f64]) -> State {
        let mut next = self.clone();
        for (value, step) in next.shared.iter_mut().zip(step) {
            *value += step;
        }
        for (pose, steps) in next
            .poses
            .iter_mut()
            .zip(step[CAMERA_PARAMETERS..].chunks(POSE_PARAMETERS))
        {
            for (value, step) in pose.iter_mut().zip(steps) {
                *value += step;
            }
        }
        next
    }
}

struct Problem {
    views: Vec<Vec<Pair>>,
}

impl Problem {
    fn of(sightings: &[Sighting], board: Board, size: Size) -> Problem {
        let middle = |length: u32| f64::from(length) / 2.0 - 0.5;
        let (middle_x, middle_y) = (middle(size.width), middle(size.height));
        let pair = |(index, [x, y]): (usize, &[f64; 2])| {
            let (column, row) = (index % board.columns, index / board.columns);
            ([column as f64, row as f64], [x - middle_x, y - middle_y])
        };
        let view = |sighting: &Sighting| sighting.iter().enumerate().map(pair).collect();
        Problem {
            views: sightings.iter().map(view).collect(),
        }
    }

    fn corners(&self) -> usize {
        self.views.iter().map(Vec::len).sum()
    }

    /// Starts from a focal length. Returns the best state and its sum of squared errors.
    fn solved(&self, focal: f64, homographies: &[Homography]) -> Option<(State, f64)> {
        let poses = homographies.iter().map(|h| pose(h, focal));
        let mut state = State {
            shared: [focal.ln(), 0.0, 0.0],
            poses: poses.collect::<Option<_>>()?,
        };
        let (mut cost, mut damping) = (self.cost(&state), 1e-3);
        for _ in 0..MAX_ITERATIONS {
            let (matrix, slope) = self.equations(&state);
            let Some((next, less)) = self.improved(&state, cost, &matrix, &slope, &mut damping)
            else {
                break;
            };
            let gain = cost - less;
            (state, cost) = (next, less);
            if gain < 1e-9 * cost {
                break;
            }
        }
        cost.is_finite().then_some((state, cost))
    }

    /// Finds a state with a smaller error, increasing the damping only as far as needed.
    fn improved(
        &self,
        state: &State,
        cost: f64,
        matrix: &Symmetric,
        slope: &[f64],
        damping: &mut f64,
    ) -> Option<(State, f64)> {
        while *damping < 1e9 {
            let mut damped = Symmetric {
                size: matrix.size,
                cells: matrix.cells.clone(),
            };
            for i in 0..matrix.size {
                damped.add(i, i, *damping * matrix.at(i, i) + 1e-12);
            }
            if let Some(step) = damped.solve(slope) {
                let next = state.moved(&step);
                let less = self.cost(&next);
                if less < cost {
                    *damping = (*damping * 0.2).max(1e-9);
                    return Some((next, less));
                }
            }
            *damping *= 5.0;
        }
        None
    }

    fn cost(&self, state: &State) -> f64 {
        let views = self.views.iter().zip(&state.poses);
        let cost: f64 = views
            .flat_map(|(view, pose)| {
                view.iter()
                    .map(|pair| square(residual(&state.shared, pose, pair)))
            })
            .sum();
        if cost.is_nan() { f64::INFINITY } else { cost }
    }

    fn errors(&self, state: &State) -> Vec<f64> {
        let views = self.views.iter().zip(&state.poses);
        views
            .map(|(view, pose)| {
                let sum: f64 = view
                    .iter()
                    .map(|pair| square(residual(&state.shared, pose, pair)))
                    .sum();
                (sum / view.len() as f64).sqrt()
            })
            .collect()
    }

    /// The normal equations at a state, from the derivatives of all corner positions.
    fn equations(&self, state: &State) -> (Symmetric, Vec<f64>) {
        let size = CAMERA_PARAMETERS + POSE_PARAMETERS * self.views.len();
        let (mut matrix, mut slope) = (Symmetric::zero(size), vec![0.0; size]);
        for (number, (view, pose)) in self.views.iter().zip(&state.poses).enumerate() {
            let place = |i: usize| {
                if i < CAMERA_PARAMETERS {
                    i
                } else {
                    CAMERA_PARAMETERS + POSE_PARAMETERS * number + i - CAMERA_PARAMETERS
                }
            };
            for pair in view {
                let here = residual(&state.shared, pose, pair);
                let slopes = slopes(&state.shared, pose, pair);
                for (i, one) in slopes.iter().enumerate() {
                    slope[place(i)] -= one[0] * here[0] + one[1] * here[1];
                    for (j, other) in slopes.iter().enumerate() {
                        matrix.add(place(i), place(j), one[0] * other[0] + one[1] * other[1]);
                    }
                }
            }
        }
        (matrix, slope)
    }

    /// The standard deviation of the logarithm of the focal length.
    fn deviation(&self, state: &State, cost: f64) -> Option<f64> {
        let (matrix, _) = self.equations(state);
        let mut one = vec![0.0; matrix.size];
        *one.first_mut()? = 1.0;
        let variance = *matrix.solve(&one)?.first()?;
        let freedom = (2 * self.corners())
            .checked_sub(matrix.size)
            .filter(|freedom| *freedom > 0)?;
        Some((variance * cost / freedom as f64).sqrt())
    }
}

/// The difference between the projected and the observed position of a corner, pixels.
fn residual(
    [focal, k1, k2]: &[f64; CAMERA_PARAMETERS],
    pose: &Pose,
    (place, seen): &Pair,
) -> [f64; 2] {
    let [right, down, ahead] = to_camera_axes(pose, *place);
    if ahead <= 1e-6 {
        return [1e6, 1e6];
    }
    let (x, y) = (right / ahead, down / ahead);
    let square = x * x + y * y;
    let scale = focal.exp() * (1.0 + square * (k1 + k2 * square));
    [x * scale - seen[0], y * scale - seen[1]]
}

/// The derivatives of the residual with respect to each parameter, shared ones first.
fn slopes(
    shared: &[f64; CAMERA_PARAMETERS],
    pose: &Pose,
    pair: &Pair,
) -> [[f64; 2]; CAMERA_PARAMETERS + POSE_PARAMETERS] {
    const STEP: f64 = 1e-6;
    std::array::from_fn(|i| {
        let at = |step: f64| {
            let (mut shared, mut pose) = (*shared, *pose);
            match i.checked_sub(CAMERA_PARAMETERS) {
                None => shared[i] += step,
                Some(i) => pose[i] += step,
            }
            residual(&shared, &pose, pair)
        };
        let (before, after) = (at(-STEP), at(STEP));
        [0, 1].map(|i| (after[i] - before[i]) / (2.0 * STEP))
    })
}

fn square([x, y]: [f64; 2]) -> f64 {
    x * x + y * y
}

#[cfg(test)]
mod tests;
