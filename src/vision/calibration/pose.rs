//! Estimates the pose of a board relative to the camera from its homography, without distortion.

use super::linear::Symmetric;

/// Rotation (axis times angle) and position of a board, in the camera's right, down and forward
/// axes.
pub(super) type Pose = [f64; 6];

/// Position on the board, in fields, and position in the picture, in pixels from the centre.
pub(super) type Pair = ([f64; 2], [f64; 2]);

/// The mapping of a plane to the picture; `h[0..3]`, `h[3..6]` and `h[6..9]` are its rows.
pub(super) type Homography = [f64; 9];

/// The least-squares homography.
pub(super) fn homography(pairs: &[Pair]) -> Option<Homography> {
    // Keeps the numbers at a similar magnitude: board positions in fields, pixels in hundreds.
    const SCALE: f64 = 0.01;
    let mut matrix = Symmetric::zero(8);
    let mut right = vec![0.0; 8];
    for ([x, y], [u, v]) in pairs {
        let (u, v) = (u * SCALE, v * SCALE);
        let rows = [
            ([*x, *y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y], u),
            ([0.0, 0.0, 0.0, *x, *y, 1.0, -v * x, -v * y], v),
        ];
        for (row, value) in rows {
            for i in 0..8 {
                right[i] += row[i] * value;
                for j in 0..8 {
                    matrix.add(i, j, row[i] * row[j]);
                }
            }
        }
    }
    let h = matrix.solve(&right)?;
    let pixels = |value: f64| value / SCALE;
    Some([
        pixels(h[0]),
        pixels(h[1]),
        pixels(h[2]),
        pixels(h[3]),
        pixels(h[4]),
        pixels(h[5]),
        h[6],
        h[7],
        1.0,
    ])
}

/// The focal length that makes the sides of all boards perpendicular and equally long; `None` if
/// the boards do not determine it.
pub(super) fn focal_length(homographies: &[Homography]) -> Option<f64> {
    let (mut squares, mut products) = (0.0, 0.0);
    for h in homographies {
        let size = h[0] * h[0] + h[3] * h[3] + h[1] * h[1] + h[4] * h[4];
        let perpendicular = (h[0] * h[1] + h[3] * h[4], h[6] * h[7]);
        let equal = (
            h[0] * h[0] + h[3] * h[3] - h[1] * h[1] - h[4] * h[4],
            h[6] * h[6] - h[7] * h[7],
        );
        // flat / focal^2 + deep = 0
        for (flat, deep) in [perpendicular, equal] {
            squares += flat * flat / (size * size);
            products += flat * deep / (size * size);
        }
    }
    let square = -squares / products;
    (square > 0.0 && square.is_finite()).then(|| square.sqrt())
}

/// The pose of a board with this homography, for a camera of this focal length.
pub(super) fn pose(h: &Homography, focal: f64) -> Option<Pose> {
    let column = |i: usize| [h[i] / focal, h[i + 3] / focal, h[i + 6]];
    let (first, second, place) = (column(0), column(1), column(2));
    let size = (length(first) + length(second)) / 2.0;
    let sign = if place[2] < 0.0 { -1.0 } else { 1.0 };
    let scaled = |v: [f64; 3]| v.map(|part| part * sign / size);
    let (x, place) = (unit(scaled(first))?, scaled(place));
    let along = dot(scaled(second), x);
    let rest = [0, 1, 2].map(|i| scaled(second)[i] - along * x[i]);
    let y = unit(rest)?;
    let z = cross(x, y);
    let turn = axis_angle([x, y, z])?;
    Some([turn[0], turn[1], turn[2], place[0], place[1], place[2]])
}

/// A position on the board in the camera's right, down and forward axes.
pub(super) fn to_camera_axes(pose: &Pose, [x, y]: [f64; 2]) -> [f64; 3] {
    let axis = [pose[0], pose[1], pose[2]];
    let angle = length(axis);
    let point = [x, y, 0.0];
    let turned = if angle < 1e-12 {
        let off = cross(axis, point);
        [0, 1, 2].map(|i| point[i] + off[i])
    } else {
        // Rodrigues' rotation formula.
        let axis = axis.map(|part| part / angle);
        let (sin, cos) = angle.sin_cos();
        let (off, along) = (cross(axis, point), dot(axis, point) * (1.0 - cos));
        [0, 1, 2].map(|i| point[i] * cos + off[i] * sin + axis[i] * along)
    };
    [0, 1, 2].map(|i| turned[i] + pose[i + 3])
}

/// The axis times the angle of the rotation with these columns.
fn axis_angle([x, y, z]: [[f64; 3]; 3]) -> Option<[f64; 3]> {
    let cos = ((x[0] + y[1] + z[2] - 1.0) / 2.0).clamp(-1.0, 1.0);
    let angle = cos.acos();
    let off = [y[2] - z[1], z[0] - x[2], x[1] - y[0]];
    let sine = length(off) / 2.0;
    if angle < 1e-9 {
        return Some([0.0; 3]);
    }
    if sine > 1e-6 {
        return Some(off.map(|part| part / (2.0 * sine) * angle));
    }
    // Rotation by 180 degrees: the axis is the longest column of the rotation matrix plus the
    // identity.
    let columns = [
        [x[0] + 1.0, x[1], x[2]],
        [y[0], y[1] + 1.0, y[2]],
        [z[0], z[1], z[2] + 1.0],
    ];
    let longest = columns
        .into_iter()
        .max_by(|a, b| length(*a).total_cmp(&length(*b)))?;
    Some(unit(longest)?.map(|part| part * angle))
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = length(v);
    (length > 1e-12).then(|| v.map(|part| part / length))
}
