//! Balls that cross, vanish and jump.

use super::*;
use crate::vision::{BlobFinder, BlobOptions, Colour, Image, Palette};
use image::{Rgb, RgbImage};
use imageproc::drawing::draw_filled_circle_mut;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

const SIZE: Size = Size {
    width: 320,
    height: 240,
};
const FRAME: Duration = Duration::from_millis(40);

/// Finds real blobs of red balls drawn at given positions.
struct Scene {
    finder: BlobFinder,
    palette: Palette,
}

impl Scene {
    fn new() -> Scene {
        let palette = Palette::compile(&[Colour::named("red").unwrap()], false);
        Scene {
            finder: BlobFinder::default(),
            palette,
        }
    }

    fn blobs(&mut self, balls: &[(f64, f64, i32)]) -> Vec<Blob> {
        let mut picture = RgbImage::from_pixel(SIZE.width, SIZE.height, Rgb([110, 110, 110]));
        for &(x, y, radius) in balls {
            draw_filled_circle_mut(
                &mut picture,
                (x.round() as i32, y.round() as i32),
                radius,
                Rgb([210, 20, 20]),
            );
        }
        let image = Image::from_rgb(&picture);
        self.finder
            .find(
                &image,
                &mut self.palette,
                &BlobOptions::default(),
                Camera::default(),
            )
            .to_vec()
    }
}

fn tracker() -> Tracker {
    Tracker::new(TrackerOptions::default(), Camera::default())
}

fn nearest(tracks: &[Track], x: f64, y: f64) -> Option<u64> {
    let distance = |track: &&Track| (track.blob.cx - x).hypot(track.blob.cy - y);
    tracks
        .iter()
        .filter(|track| distance(track) < 15.0)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .map(|t| t.id)
}

/// Two equal balls on straight courses cross in the middle, with jitter. Returns whether each still
/// has its id when they have separated again.
fn ids_survive_a_crossing(scene: &mut Scene, random: &mut StdRng) -> bool {
    let radius = random.random_range(8..18);
    let meeting = (
        random.random_range(130.0..190.0),
        random.random_range(90.0..150.0),
    );
    let course = random.random_range(0.0..std::f64::consts::TAU);
    let between = random.random_range(0.5..std::f64::consts::PI);
    let speeds = [random.random_range(2.0..6.0), random.random_range(2.0..6.0)];
    let courses = [course, course + between];
    let place = |ball: usize, frame: f64| {
        let (sin, cos) = courses[ball].sin_cos();
        (
            meeting.0 + cos * speeds[ball] * frame,
            meeting.1 + sin * speeds[ball] * frame,
        )
    };
    let mut tracker = tracker();
    let mut before = None;
    for (number, frame) in (-18..=18).enumerate() {
        let mut at = |ball| {
            let (x, y) = place(ball, f64::from(frame));
            (
                x + random.random_range(-1.0..1.0),
                y + random.random_range(-1.0..1.0),
                radius,
            )
        };
        let balls = [at(0), at(1)];
        let blobs = scene.blobs(&balls);
        let tracks = tracker.update(FRAME * number as u32, SIZE, &blobs);
        let ids = [0, 1].map(|ball| nearest(tracks, balls[ball].0, balls[ball].1));
        match frame {
            -13 => before = Some(ids),
            18 => return before == Some(ids) && ids[0].is_some() && ids[0] != ids[1],
            _ => {}
        }
    }
    false
}

#[test]
fn ids_survive_two_equal_balls_crossing() {
    let (mut scene, mut random) = (Scene::new(), StdRng::seed_from_u64(7));
    let runs = 120;
    let survived = std::iter::repeat_with(|| ids_survive_a_crossing(&mut scene, &mut random))
        .take(runs)
        .filter(|survived| *survived)
        .count();
    println!("{survived} of {runs} crossings");
    assert!(
        survived * 100 > runs * 95,
        "ids survived only {survived} of {runs} crossings"
    );
}

#[test]
fn a_ball_is_reported_once_it_is_old_enough_and_kept_while_it_is_gone() {
    let (mut scene, mut tracker) = (Scene::new(), tracker());
    let mut reported = Vec::new();
    for frame in 0..14 {
        let blobs = if frame < 6 {
            scene.blobs(&[(50.0 + 5.0 * f64::from(frame), 100.0, 10)])
        } else {
            Vec::new()
        };
        let tracks = tracker.update(FRAME * frame, SIZE, &blobs);
        reported.push(
            tracks
                .first()
                .map(|track| (track.id, track.age, track.lost)),
        );
    }
    let seen = |age| Some((1, age, 0));
    let lost = |frames| Some((1, 6, frames));
    assert_eq!(
        reported[..6],
        [None, None, seen(3), seen(4), seen(5), seen(6)]
    );
    assert_eq!(
        reported[6..],
        [
            lost(1),
            lost(2),
            lost(3),
            lost(4),
            lost(5),
            None,
            None,
            None
        ]
    );
}

#[test]
fn velocity_is_that_of_the_ball_and_carries_on_while_it_is_gone() {
    let (mut scene, mut tracker) = (Scene::new(), tracker());
    for frame in 0..20 {
        let blobs = scene.blobs(&[(
            40.0 + 4.0 * f64::from(frame),
            200.0 - 2.0 * f64::from(frame),
            10,
        )]);
        tracker.update(FRAME * frame, SIZE, &blobs);
    }
    let track = *tracker.best().unwrap();
    assert!(
        (track.vx - 100.0).abs() < 3.0 && (track.vy + 50.0).abs() < 3.0,
        "{track:?}"
    );
    tracker.update(FRAME * 22, SIZE, &[]);
    let gone = *tracker.best().unwrap();
    assert_eq!((gone.id, gone.lost), (track.id, 1));
    assert!(
        (gone.blob.cx - (track.blob.cx + 12.0)).abs() < 1.5,
        "{gone:?}"
    );
}

#[test]
fn a_jump_too_far_starts_another_track() {
    let (mut scene, mut tracker) = (Scene::new(), tracker());
    for frame in 0..8 {
        let x = if frame < 4 { 50.0 } else { 250.0 };
        let blobs = scene.blobs(&[(x, 100.0, 10)]);
        tracker.update(FRAME * frame, SIZE, &blobs);
    }
    let ids: Vec<u64> = tracker.tracks().iter().map(|track| track.id).collect();
    assert_eq!(ids, [1, 2]);
    assert_eq!(tracker.best().unwrap().id, 2);
    tracker.reset();
    assert_eq!(tracker.best(), None);
}

#[test]
fn a_ball_that_vanishes_beside_another_loses_its_track() {
    let (mut scene, mut tracker) = (Scene::new(), tracker());
    for frame in 0..60 {
        let both = [
            (150.0, 100.0, 14),
            (150.0 + f64::from(40 - frame.min(38)), 100.0, 14),
        ];
        let blobs = scene.blobs(&both[..if frame < 39 { 2 } else { 1 }]);
        tracker.update(FRAME * frame as u32, SIZE, &blobs);
    }
    (60..90).for_each(|frame| {
        let blobs = scene.blobs(&[(150.0, 100.0, 14)]);
        tracker.update(FRAME * frame, SIZE, &blobs);
    });
    let lost: Vec<u32> = tracker.tracks().iter().map(|track| track.lost).collect();
    assert_eq!(lost, [0]);
}

#[test]
fn the_number_of_tracks_is_bounded() {
    let (mut scene, mut tracker) = (Scene::new(), tracker());
    let blob = scene.blobs(&[(50.0, 50.0, 10)])[0];
    let blobs: Vec<Blob> = (0..500)
        .map(|i| Blob {
            cx: f64::from(i % 300),
            cy: f64::from(i / 3),
            ..blob
        })
        .collect();
    for frame in 0..10 {
        assert!(tracker.update(FRAME * frame, SIZE, &blobs).len() <= MAX_TRACKS);
    }
}
