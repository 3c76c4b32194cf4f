//! Gives blobs an identity: which one of this frame is which one of the frame before.
//!
//! Every track predicts where its blob will be (steady velocity) and takes the blob nearest to
//! that; all pairs are settled together. When two blobs become one, because one passes in front of the
//! other, both tracks go on inside it on their own course until it parts again.

use serde::{Deserialize, Serialize};
use std::time::Duration;

use super::blobs::Blob;
use super::camera::Camera;
use crate::vision::picture::size::Size;

/// Most blobs of a frame, and most tracks, that are considered.
const MAX_TRACKS: usize = 64;
/// How many times `max_lost` a track may stay hidden in another's blob.
const HIDDEN_PATIENCE: u32 = 6;
/// Least share of a surprise that goes into the position, and into the velocity.
const GAIN: (f64, f64) = (0.5, 0.15);
/// The same while blobs are one: their common outline says little, and nothing about velocity.
const SHARED_GAIN: f64 = 0.3;
/// Frames are never thought to be nearer or farther apart in time than this, in seconds.
const STEP: (f64, f64) = (0.001, 1.0);

/// When a track begins, and when it ends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerOptions {
    /// In how many frames a blob must have been seen before it is reported.
    pub min_age: u32,
    /// For how many frames it may be gone.
    pub max_lost: u32,
    /// How far, in pixels, it may be from where it was expected.
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
    /// Never given twice by one tracker; from 1.
    pub id: u64,
    /// In how many frames it was seen.
    pub age: u32,
    /// For how many frames it has been gone, or hidden in another's blob; 0 when seen.
    pub lost: u32,
    /// Velocity to the right, pixels per second.
    pub vx: f64,
    /// Velocity downwards, pixels per second.
    pub vy: f64,
    /// The blob as seen now; when lost, the last one seen, moved to where it is thought to be.
    pub blob: Blob,
    x: f64,
    y: f64,
    /// For how many frames it has shared a blob.
    hidden: u32,
}

/// Follows blobs from frame to frame.
#[derive(Debug)]
pub struct Tracker {
    options: TrackerOptions,
    camera: Camera,
    newest: Option<Duration>,
    given: u64,
    followed: Vec<Track>,
    /// Those seen often enough, as handed out.
    tracks: Vec<Track>,
    pairs: Vec<(f64, usize, usize)>,
    /// For every track, the blob it takes.
    owned: Vec<Option<usize>>,
    /// For every track without one, the other's blob in which it hides.
    hosts: Vec<Option<usize>>,
    /// For every blob, how many tracks are in it.
    crowd: Vec<u32>,
}

impl Tracker {
    /// A tracker that has seen nothing.
    pub fn new(options: TrackerOptions, camera: Camera) -> Tracker {
        Tracker {
            options,
            camera,
            newest: None,
            given: 0,
            followed: Vec::new(),
            tracks: Vec::new(),
            pairs: Vec::new(),
            owned: Vec::new(),
            hosts: Vec::new(),
            crowd: Vec::new(),
        }
    }

    /// Takes the blobs of a frame of this size, seen at this time. Returns the tracks that were seen in at least
    /// `min_age` frames, oldest first, those lost for a while included.
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

    /// The tracks of the newest update.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// The one to follow: seen most recently; among those the largest, then the oldest.
    pub fn best(&self) -> Option<&Track> {
        self.tracks
            .iter()
            .min_by_key(|track| (track.lost, std::cmp::Reverse(track.blob.pixels), track.id))
    }

    /// Forgets every track; ids go on counting.
    pub fn reset(&mut self) {
        self.followed.clear();
        self.tracks.clear();
        self.newest = None;
    }

    /// Gives tracks their blobs: nearest pairs first, then swaps while that makes the whole better.
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
        self.pairs
            .sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
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

    /// Swaps the blobs of two tracks while that shortens their way. Each swap makes the sum smaller, and the
    /// number of rounds is bounded.
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

    /// A known track without a blob that is expected inside another's blob hides there.
    fn hide(&mut self, blobs: &[Blob]) {
        self.hosts.clear();
        for (track, owned) in self.followed.iter().zip(&self.owned) {
            let hides = owned.is_none() && track.age >= self.options.min_age;
            let inside = |index: &usize| self.crowd[*index] > 0 && track.is_within(&blobs[*index]);
            self.hosts
                .push((0..blobs.len()).filter(|_| hides).find(inside));
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

    /// Squared distance from where it is expected.
    fn cost(&self, blob: &Blob) -> f64 {
        (blob.cx - self.x).powi(2) + (blob.cy - self.y).powi(2)
    }

    /// Whether it is expected in the blob's box, or a quarter of its own size beside it.
    fn is_within(&self, blob: &Blob) -> bool {
        let near = |value: f64, low: u32, span: u32, own: u32| {
            let slack = f64::from(own) / 4.0;
            (f64::from(low) - slack..f64::from(low + span) + slack).contains(&value)
        };
        near(self.x, blob.x, blob.w, self.blob.w) && near(self.y, blob.y, blob.h, self.blob.h)
    }

    /// Seen alone: corrects position and velocity, at first by much, then by less.
    fn see(&mut self, blob: &Blob, step: f64) {
        let seen = f64::from(self.age.min(1000)) + 1.0;
        let place = (2.0 * (2.0 * seen - 1.0) / (seen * (seen + 1.0))).clamp(GAIN.0, 1.0);
        let speed = (6.0 / (seen * (seen + 1.0))).clamp(GAIN.1, 1.0);
        let (dx, dy) = (blob.cx - self.x, blob.cy - self.y);
        self.x += place * dx;
        self.y += place * dy;
        self.vx += speed * dx / step;
        self.vy += speed * dy / step;
        self.age = self.age.saturating_add(1);
        (self.lost, self.hidden) = (0, 0);
        self.blob = *blob;
    }

    /// One of several in a blob: stays on course, but inside the common outline.
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

    /// As handed out: a lost blob stands where it is thought to be.
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
mod tests;
