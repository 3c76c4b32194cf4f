use super::*;

const SIZE: Size = Size {
    width: 320,
    height: 240,
};
const BOARD: Board = Board {
    columns: 9,
    rows: 6,
};

/// The sightings of a board in these poses, with small errors like those of a corner finder.
fn sightings(camera: [f64; CAMERA_PARAMETERS], poses: &[Pose]) -> Vec<Sighting> {
    let shared = [camera[0].ln(), camera[1], camera[2]];
    let corner = |pose: &Pose, index: usize| {
        let place = [
            (index % BOARD.columns) as f64,
            (index / BOARD.columns) as f64,
        ];
        let [x, y] = residual(&shared, pose, &(place, [0.0, 0.0]));
        let off = 0.05 * (index as f64 * 7.3).sin();
        [x + 159.5 + off, y + 119.5 - off]
    };
    let view = |pose| {
        (0..BOARD.columns * BOARD.rows)
            .map(|index| corner(pose, index))
            .collect()
    };
    poses.iter().map(view).collect()
}

const TILTED: [Pose; 5] = [
    [0.4, 0.0, 0.0, -4.0, -2.5, 14.0],
    [-0.4, 0.1, 0.0, -3.0, -3.0, 13.0],
    [0.0, 0.5, 0.1, -4.5, -2.0, 13.0],
    [0.1, -0.5, -0.1, -3.5, -2.5, 12.0],
    [0.3, 0.3, 0.3, -4.0, -3.5, 15.0],
];

#[test]
fn finds_field_of_view_and_distortion() {
    let found = calibrate(&sightings([381.0, -0.25, 0.08], &TILTED), BOARD, SIZE).unwrap();
    let truth = Camera {
        hfov: 2.0 * (160.0_f64 / 381.0).atan(),
        distortion: [-0.25, 0.08],
    };
    assert!(
        (found.camera.hfov - truth.hfov).abs().to_degrees() < 0.3,
        "{found:?}"
    );
    for x in [0.0, 80.0, 319.0] {
        let off = found.camera.bearing(x, 20.0, SIZE) - truth.bearing(x, 20.0, SIZE);
        assert!(off.abs().to_degrees() < 0.2, "{x}: {off} {found:?}");
    }
    assert!(found.errors.iter().all(|error| *error < 0.1), "{found:?}");
}

#[test]
fn boards_in_similar_poses_are_refused() {
    let flat: Vec<Pose> = (0..4)
        .map(|i| [0.0, 0.0, 0.0, -4.0, -2.5, 13.0 + f64::from(i)])
        .collect();
    let error = calibrate(&sightings([381.0, -0.25, 0.08], &flat), BOARD, SIZE).unwrap_err();
    assert_eq!(error, CalibrationError::Alike);
    let error = calibrate(&[], BOARD, SIZE).unwrap_err();
    assert_eq!(error, CalibrationError::Number { found: 0 });
}
