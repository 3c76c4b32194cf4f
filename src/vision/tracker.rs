//! Tracks blobs from frame to frame and gives them identities. Each track predicts its position by
//! constant velocity and takes the nearest blob; all pairs are assigned together. When two blobs
//! merge, both tracks continue on their own courses until it splits again.

use serde::{Deserialize, Serialize};
use std::time::Duration;

use super::blobs::Blob;
use super::camera::Camera;
use crate::picture::Size;

const MAX_TRACKS: usize = 64;
/// How many times `max_lost` a track may stay hidden in another track's blob.
const HIDDEN_PATIENCE: u32 = 6;
/// Least gain of the filter: the share of the prediction error that corrects the position, and the
/// velocity.
const GAIN: (f64, f64) = (0.5, 0.15);
/// The gain for the position while blobs are merged: their common outline says little, and nothing
/// about the velocity.
const SHARED_GAIN: f64 = 0.3;
/// Bounds of the assumed time between two frames, seconds.
const STEP: (f64, f64) = (0.001, 1.0);

/// When a track begins and when it ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerOptions {
    /// In how many frames a blob must have been seen before its track is reported.
    pub min_age: u32,
    /// For how many frames a blob may be missing.
    pub max_lost: u32,
    /// Largest distance of a blob from its predicted position, pixels.
    pub max_jump: f64,
}

impl TrackerOptions {
    /// The defaults.
    pub const DEFAULT: TrackerOptions = TrackerOptions {
        min_age: 3,
        max_lost: 5,
        max_jump: 80.0,
    };
}

impl Default for TrackerOptions {
    fn default() -> TrackerOptions {
        TrackerOptions::DEFAULT
    }
}

/// A blob with an identity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// Counts from 1; one tracker never gives an id twice.
    pub id: u64,
    /// In how many frames the blob was seen.
    pub age: u32,
    /// For how many frames the blob has been missing or hidden in another track's blob; 0 if it is
    /// seen.
    pub lost: u32,
    /// Velocity to the right, pixels per second.
    pub vx: f64,
    /// Velocity downwards, pixels per second.
    pub vy: f64,
    /// The blob as seen now; if it is lost, the last one seen, moved to the predicted position.
    pub blob: Blob,
    x: f64,
    y: f64,
    hidden: u32,
}

/// Follows blobs from frame to frame.
#[derive(Debug, Default)]
pub struct Tracker {
    options: TrackerOptions,
    camera: Camera,
    newest: Option<Duration>,
    given: u64,
    followed: Vec<Track>,
    /// The tracks seen often enough, as reported.
    tracks: Vec<Track>,
    pairs: Vec<(f64, usize, usize)>,
    owned: Vec<Option<usize>>,
    /// For each track without a blob, the other track's blob that hides it.
    hosts: Vec<Option<usize>>,
    crowd: Vec<u32>,
}

impl Tracker {
    /// A tracker without tracks.
    pub fn new(options: TrackerOptions, camera: Camera) -> Tracker {
        Tracker {
            options,
            camera,
            ..Tracker::default()
        }
    }

    /// Processes the blobs of a frame of this size, taken at this time. Returns the tracks that
    /// were seen in at least `min_age` frames, oldest first, including those that are temporarily
    /// lost.
    pub fn update(&mut self, at: Duration, size: Size, blobs: &[Blob]) -> &[Track] {
        let blobs = &blobs[..blobs.len().min(MAX_TRACKS)];
        let passed = self
            .newest
            .map_or(0.0, |newest| at.saturating_sub(newest).as_secs_f64());
        let step = passed.clamp(STEP.0, STEP.1);
        self.newest = Some(at);
        self.followed
            .iter_mut()
            .for_each(|track| track.predict(step));
        self.pair(blobs);
        self.hide(blobs);
        self.follow(blobs, step);
        self.followed.retain(|track| track.lives(&self.options));
        self.begin(blobs);
        self.show(size)
    }

    /// The tracks of the last update.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The track to follow: the one seen most recently; among several the largest, then the oldest.
    pub fn best(&self) -> Option<&Track> {
        self.tracks
            .iter()
            .min_by_key(|track| (track.lost, std::cmp::Reverse(track.blob.pixels), track.id))
    }

    /// Forgets all tracks; ids continue to count.
    pub fn reset(&mut self) {
        self.followed.clear();
        self.tracks.clear();
        self.newest = None;
    }

    /// Assigns blobs to tracks: nearest pairs first, then swaps while that reduces the total cost.
    fn pair(&mut self, blobs: &[Blob]) {
        let reach = self.options.max_jump.powi(2);
        self.pairs.clear();
        for (index, track) in self.followed.iter().enumerate() {
            let costs = blobs
                .iter()
                .enumerate()
                .map(|(blob, seen)| (track.cost(seen), index, blob));
            self.pairs.extend(costs.filter(|pair| pair.0 <= reach));
        }
        self.pairs.sort_unstable_by(|a, b| {
            a.0.total_cmp(&b.0)
                .then_with(|| (a.1, a.2).cmp(&(b.1, b.2)))
        });
        self.owned.clear();
        self.owned.resize(self.followed.len(), None);
        self.crowd.clear();
        self.crowd.resize(blobs.len(), 0);
        for &(_, track, blob) in &self.pairs {
            if self.owned[track].is_none() && self.crowd[blob] == 0 {
                self.owned[track] = Some(blob);
                self.crowd[blob] = 1;
            }
        }
        self.swap_while_better(blobs);
    }

    /// Swaps the blobs of two tracks while that shortens their total distance. Each swap reduces
    /// the sum, and the number of rounds is bounded.
    fn swap_while_better(&mut self, blobs: &[Blob]) {
        for _ in 0..MAX_TRACKS {
            let mut swapped = false;
            for a in 0..self.owned.len() {
                for b in a + 1..self.owned.len() {
                    let (Some(of_a), Some(of_b)) = (self.owned[a], self.owned[b]) else {
                        continue;
                    };
                    let cost = |track: usize, blob: usize| self.followed[track].cost(&blobs[blob]);
                    if cost(a, of_b) + cost(b, of_a) < cost(a, of_a) + cost(b, of_b) - 1e-9 {
                        self.owned.swap(a, b);
                        swapped = true;
                    }
                }
            }
            if !swapped {
                return;
            }
        }
    }

    /// A confirmed track without a blob whose predicted position is inside another track's blob
    /// hides there.
    fn hide(&mut self, blobs: &[Blob]) {
        self.hosts.clear();
        for (track, owned) in self.followed.iter().zip(&self.owned) {
            let hides = owned.is_none() && track.age >= self.options.min_age;
            let inside = |index: &usize| self.crowd[*index] > 0 && track.is_within(&blobs[*index]);
            let host = if hides {
                (0..blobs.len()).find(inside)
            } else {
                None
            };
            self.hosts.push(host);
        }
        self.hosts
            .iter()
            .flatten()
            .for_each(|host| self.crowd[*host] += 1);
    }

    fn follow(&mut self, blobs: &[Blob], step: f64) {
        for (index, track) in self.followed.iter_mut().enumerate() {
            match (self.owned[index], self.hosts[index]) {
                (Some(blob), _) if self.crowd[blob] == 1 => track.see(&blobs[blob], step),
                (Some(blob), _) => track.share(&blobs[blob], true),
                (None, Some(host)) => track.share(&blobs[host], false),
                (None, None) => track.miss(),
            }
        }
    }

    fn begin(&mut self, blobs: &[Blob]) {
        for (blob, crowd) in blobs.iter().zip(&self.crowd) {
            if *crowd == 0 && self.followed.len() < MAX_TRACKS {
                self.given += 1;
                self.followed.push(Track::begin(self.given, blob));
            }
        }
    }

    fn show(&mut self, size: Size) -> &[Track] {
        self.tracks.clear();
        let known = self
            .followed
            .iter()
            .filter(|track| track.age >= self.options.min_age);
        self.tracks
            .extend(known.map(|track| track.placed(size, self.camera)));
        &self.tracks
    }
}

impl Track {
    fn begin(id: u64, blob: &Blob) -> Track {
        Track {
            id,
            age: 1,
            lost: 0,
            vx: 0.0,
            vy: 0.0,
            blob: *blob,
            x: blob.cx,
            y: blob.cy,
            hidden: 0,
        }
    }

    fn predict(&mut self, step: f64) {
        self.x += self.vx * step;
        self.y += self.vy * step;
    }

    fn cost(&self, blob: &Blob) -> f64 {
        (blob.cx - self.x).powi(2) + (blob.cy - self.y).powi(2)
    }

    /// Whether the predicted position is within the blob's box, extended by a quarter of this
    /// track's own size.
    fn is_within(&self, blob: &Blob) -> bool {
        let near = |value: f64, low: u32, span: u32, own: u32| {
            let slack = f64::from(own) / 4.0;
            (f64::from(low) - slack..f64::from(low + span) + slack).contains(&value)
        };
        near(self.x, blob.x, blob.w, self.blob.w) && near(self.y, blob.y, blob.h, self.blob.h)
    }

    /// Updates the track with a blob of its own; the gains decrease with its age.
    fn see(&mut self, blob: &Blob, step: f64) {
        let seen = f64::from(self.age.min(1000)) + 1.0;
        let place = (2.0 * (2.0 * seen - 1.0) / (seen * (seen + 1.0))).clamp(GAIN.0, 1.0);
        let speed = (6.0 / (seen * (seen + 1.0))).clamp(GAIN.1, 1.0);
        let dx = blob.cx - self.x;
        let dy = blob.cy - self.y;
        self.x += place * dx;
        self.y += place * dy;
        self.vx += speed * dx / step;
        self.vy += speed * dy / step;
        self.age = self.age.saturating_add(1);
        (self.lost, self.hidden) = (0, 0);
        self.blob = *blob;
    }

    /// Updates a track that shares a blob: it keeps its course, but stays inside the common
    /// outline.
    fn share(&mut self, blob: &Blob, owner: bool) {
        let corrected = |value: f64, low: u32, span: u32, own: u32| {
            let room = f64::from(span.saturating_sub(own)) / 2.0;
            let middle = f64::from(low) + f64::from(span.saturating_sub(1)) / 2.0;
            value + SHARED_GAIN * (value.clamp(middle - room, middle + room) - value)
        };
        self.x = corrected(self.x, blob.x, blob.w, self.blob.w);
        self.y = corrected(self.y, blob.y, blob.h, self.blob.h);
        self.hidden += 1;
        self.lost = if owner { 0 } else { self.hidden };
    }

    fn miss(&mut self) {
        self.lost = if self.hidden > 0 { 1 } else { self.lost + 1 };
        self.hidden = 0;
    }

    fn lives(&self, options: &TrackerOptions) -> bool {
        let patience = if self.hidden > 0 { HIDDEN_PATIENCE } else { 1 };
        self.lost <= options.max_lost.saturating_mul(patience)
    }

    /// The track as reported: a lost blob is moved to its predicted position.
    fn placed(&self, size: Size, camera: Camera) -> Track {
        let mut track = *self;
        if track.lost > 0 || track.hidden > 0 {
            let moved = |from: u32, by: f64, span: u32, limit: u32| {
                (f64::from(from) + by)
                    .round()
                    .clamp(0.0, f64::from(limit.saturating_sub(span))) as u32
            };
            track.blob.x = moved(self.blob.x, self.x - self.blob.cx, self.blob.w, size.width);
            track.blob.y = moved(self.blob.y, self.y - self.blob.cy, self.blob.h, size.height);
            (track.blob.cx, track.blob.cy) = (self.x, self.y);
            track.blob.bearing = camera.bearing(self.x, self.y, size);
        }
        track
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BlobFinder, BlobOptions, Colour, Image, Palette};
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
        let mut scene = Scene::new();
        let mut random = StdRng::seed_from_u64(7);
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
        let mut scene = Scene::new();
        let mut tracker = tracker();
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
        let mut scene = Scene::new();
        let mut tracker = tracker();
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
        let mut scene = Scene::new();
        let mut tracker = tracker();
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
        let mut scene = Scene::new();
        let mut tracker = tracker();
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
        let mut scene = Scene::new();
        let mut tracker = tracker();
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
}
