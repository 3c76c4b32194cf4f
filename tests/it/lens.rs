//! Field of view and distortion, measured from pictures of a chessboard by the real program.

use image::{GrayImage, Luma};
use spykee::sim::{Firmware, Pose, Robot, World};
use spykee::wire::{Command, Report, Stream};

use crate::rig::{Rig, assert_contains};

/// A camera whose lens distorts the picture; implemented independently of the program.
struct Lens {
    focal: f64,
    k1: f64,
    k2: f64,
}

impl Lens {
    /// The direction of the ray through a pixel, to the right and down per unit ahead.
    fn slopes(&self, x: f64, y: f64) -> (f64, f64) {
        let (u, v) = ((x - 159.5) / self.focal, (y - 119.5) / self.focal);
        let bent = u.hypot(v);
        let mut straight = bent;
        for _ in 0..100 {
            let square = straight * straight;
            straight = bent / (1.0 + square * (self.k1 + self.k2 * square));
        }
        let scale = if bent > 0.0 { straight / bent } else { 1.0 };
        (u * scale, v * scale)
    }
}

/// A board of 10x7 fields of 3 cm with a white border: the position of its centre, and its
/// rotation.
#[derive(Clone, Copy)]
struct Board {
    middle: [f64; 3],
    about_x: f64,
    about_y: f64,
    about_z: f64,
}

impl Board {
    /// The board's axes (right, down, forward) in the camera's coordinates.
    fn axes(&self) -> [[f64; 3]; 3] {
        let turn = |v: [f64; 3]| {
            let (s, c) = self.about_z.sin_cos();
            let v = [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]];
            let (s, c) = self.about_x.sin_cos();
            let v = [v[0], c * v[1] - s * v[2], s * v[1] + c * v[2]];
            let (s, c) = self.about_y.sin_cos();
            [c * v[0] + s * v[2], v[1], c * v[2] - s * v[0]]
        };
        [
            turn([1.0, 0.0, 0.0]),
            turn([0.0, 1.0, 0.0]),
            turn([0.0, 0.0, 1.0]),
        ]
    }

    /// The brightness of the board where a ray meets it.
    fn brightness(&self, (right, down): (f64, f64)) -> f64 {
        let [x, y, z] = self.axes();
        let ray = [right, down, 1.0];
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let way = dot(self.middle, z) / dot(ray, z);
        let off = [0, 1, 2].map(|i| ray[i] * way - self.middle[i]);
        let (a, b) = (dot(off, x) / 0.03 + 5.0, dot(off, y) / 0.03 + 3.5);
        if !(-1.0..=11.0).contains(&a) || !(-1.0..=8.0).contains(&b) {
            return 0.35;
        }
        let field = (a.floor() as i64, b.floor() as i64);
        let inside = (0..10).contains(&field.0) && (0..7).contains(&field.1);
        if inside && (field.0 + field.1) % 2 == 0 {
            0.12
        } else {
            0.85
        }
    }
}

/// A picture as the robot's camera takes it: slightly blurred, noisy, compressed.
fn picture(lens: &Lens, board: Board, seed: u32) -> Vec<u8> {
    let mut noise = seed;
    let image = GrayImage::from_fn(320, 240, |x, y| {
        let mut sum = 0.0;
        for (right, down) in (0..16).map(|i| (f64::from(i % 4), f64::from(i / 4))) {
            let (x, y) = (
                f64::from(x) + (right - 1.5) / 3.0,
                f64::from(y) + (down - 1.5) / 3.0,
            );
            sum += board.brightness(lens.slopes(x, y));
        }
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let grain = f64::from(noise >> 16) / 65_536.0 - 0.5;
        Luma([(sum / 16.0 * 255.0 + 8.0 * grain) as u8])
    });
    let mut jpeg = Vec::new();
    let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 50);
    image.write_with_encoder(encoder).unwrap();
    jpeg
}

fn boards() -> Vec<Board> {
    [
        ([0.0, 0.0, 0.45], 0.0, 0.0, 0.0),
        ([0.02, 0.01, 0.45], 0.6, 0.1, 0.1),
        ([-0.02, 0.0, 0.45], -0.6, 0.0, -0.1),
        ([0.0, 0.01, 0.5], 0.1, 0.6, 0.0),
        ([0.0, -0.01, 0.5], 0.0, -0.6, 0.2),
        ([-0.05, -0.03, 0.52], 0.4, 0.4, 0.0),
        ([0.05, 0.03, 0.52], -0.4, -0.4, 1.4),
        ([0.05, -0.03, 0.5], 0.3, -0.5, -0.2),
        ([-0.05, 0.04, 0.5], -0.5, 0.3, 0.1),
    ]
    .map(|(middle, about_x, about_y, about_z)| Board {
        middle,
        about_x,
        about_y,
        about_z,
    })
    .to_vec()
}

#[tokio::test(flavor = "multi_thread")]
async fn field_of_view_and_distortion_are_measured_from_pictures_of_a_chessboard() {
    let rig = Rig::quiet().await;
    for (focal, k1, k2) in [(381.0, -0.25, 0.08), (300.0, 0.1, 0.0)] {
        let lens = Lens { focal, k1, k2 };
        let mut arguments = vec!["calibrate".to_owned(), "camera".to_owned()];
        for (number, board) in boards().into_iter().enumerate() {
            let name = format!("board{number}.jpg");
            let jpeg = picture(&lens, board, number as u32);
            std::fs::write(rig.folder().join(&name), jpeg).unwrap();
            arguments.push(name);
        }
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let mut run = rig.spykee(&[&arguments[..], &["--json"]].concat());
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let text = run.text();
        let line = text.lines().find(|line| line.starts_with('{')).unwrap();
        let found: serde_json::Value = serde_json::from_str(line).unwrap();
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let camera = spykee::vision::Camera {
            hfov: number(&found["hfov"]),
            distortion: [
                number(&found["distortion"][0]),
                number(&found["distortion"][1]),
            ],
        };
        let truth = 2.0 * (160.0 / focal).atan();
        let off = (camera.hfov - truth).to_degrees();
        assert!(off.abs() < 0.5, "{off} degrees: {found}");
        let size = spykee::vision::Size {
            width: 320,
            height: 240,
        };
        for (x, y) in [(0.0, 0.0), (20.0, 120.0), (160.0, 10.0), (300.0, 200.0)] {
            let bearing = camera.bearing(x, y, size);
            let off = (bearing + lens.slopes(x, y).0.atan()).to_degrees();
            assert!(off.abs() < 0.4, "at {x} {y}: {off} degrees: {found}");
        }
        assert!(found["pictures"].as_array().unwrap().len() >= 7, "{found}");
        let mut shown = rig.spykee(&arguments);
        assert_eq!(shown.code().await, Some(0), "{}", shown.text());
        assert_contains(&shown.text(), &["camera: { hfov: "]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn useless_pictures_are_refused_with_advice() {
    let rig = Rig::quiet().await;
    let lens = Lens {
        focal: 381.0,
        k1: 0.0,
        k2: 0.0,
    };
    let jpeg = picture(&lens, boards()[0], 1);
    for name in ["a.jpg", "b.jpg", "c.jpg"] {
        std::fs::write(rig.folder().join(name), &jpeg).unwrap();
    }
    for (arguments, words) in [
        (
            &["a.jpg"][..],
            "the board was found in 1 pictures; expected 3 to 60",
        ),
        (&["a.jpg", "b.jpg", "c.jpg"], "tilt the board"),
        (
            &["a.jpg", "b.jpg", "c.jpg", "--board", "8x6"],
            "found in 0 pictures",
        ),
        (&["none.jpg"], "cannot read the picture none.jpg"),
    ] {
        let mut run = rig.spykee(&[&["calibrate", "camera"], arguments].concat());
        assert_eq!(run.code().await, Some(2), "{}", run.text());
        assert!(run.text().contains(words), "{words}: {}", run.text());
    }
}

/// A picture of the station by the simulated camera, from this distance.
fn of_the_station(distance: f64) -> Vec<u8> {
    let yaml = "room: { width: 6, depth: 4 }\nstation: { at: [0, 2], heading_degrees: 0 }\nstart: { at: [3, 2], heading_degrees: 180 }\n";
    let world = World::from_yaml(yaml, "test").unwrap();
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    robot.execute(&Command::Stream {
        stream: Stream::Video,
        on: true,
    });
    // The station's front is 0.1 m before the wall, the lens 0.1 m before the robot's centre.
    robot.place(Pose::new(0.2 + distance, 2.0, std::f64::consts::PI));
    let mut frame = Vec::new();
    for _ in 0..30 {
        robot.step(std::time::Duration::from_millis(20));
        for report in robot.take_reports() {
            if let Report::Video(jpeg) = report {
                frame = jpeg.to_vec();
            }
        }
    }
    frame
}

#[tokio::test(flavor = "multi_thread")]
async fn the_field_of_view_is_measured_from_pictures_of_the_station_at_known_distances() {
    let rig = Rig::quiet().await;
    let names = ["a.jpg", "b.jpg", "c.jpg"];
    for (name, distance) in names.iter().zip([1.0, 1.5, 2.0]) {
        std::fs::write(rig.folder().join(name), of_the_station(distance)).unwrap();
    }
    let calibrate =
        |rest: &[&str]| rig.spykee(&[&["calibrate", "camera"][..], &names[..], rest].concat());
    let mut run = calibrate(&["--station", "1,1.5,2", "--json"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let line = text.lines().find(|line| line.starts_with('{')).unwrap();
    let found: serde_json::Value = serde_json::from_str(line).unwrap();
    let degrees = found["hfov"].as_f64().unwrap().to_degrees();
    assert!((degrees - 45.6).abs() < 1.0, "{found}");
    for (distances, words) in [
        ("1,1.5", "2 distances for 3 pictures"),
        ("1,3,2", "are the distances right"),
        ("1,1.5,99", "from 0.3 to 5 metres"),
    ] {
        let mut run = calibrate(&["--station", distances]);
        assert_eq!(run.code().await, Some(2), "{}", run.text());
        assert!(run.text().contains(words), "{words}: {}", run.text());
    }
}
