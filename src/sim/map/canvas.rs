//! The canvas of maps: metres in, pixels out, with text.

use image::RgbImage;
use tiny_skia::{Path, Transform};

use crate::paper::Paper;
pub(crate) use crate::paper::{Ink, Script};
use crate::sim::geometry::Point;

/// An upright rectangle of pixels: left, top, right, bottom.
type Frame = [f32; 4];

/// The paper.
pub(crate) struct Canvas {
    paper: Paper,
    /// Pixels a metre.
    pub(crate) scale: f32,
    /// Where the world's (0, 0) is.
    origin: (f32, f32),
    taken: Vec<Frame>,
}

impl Canvas {
    /// White paper of a size in pixels; `None` if there is no such paper.
    pub(crate) fn new(size: (u32, u32), scale: f32, origin: (f32, f32)) -> Option<Canvas> {
        let paper = Paper::new(size.0, size.1)?;
        let taken = Vec::new();
        Some(Canvas {
            paper,
            scale,
            origin,
            taken,
        })
    }

    /// Where a place of the world is on the paper.
    pub(crate) fn at(&self, place: Point) -> (f32, f32) {
        let (x, y) = (place.x as f32, place.y as f32);
        (
            self.origin.0 + x * self.scale,
            self.origin.1 - y * self.scale,
        )
    }

    /// Fills the area within corners.
    pub(crate) fn fill(&mut self, corners: &[Point], ink: Ink) {
        let corners: Vec<(f32, f32)> = corners.iter().map(|corner| self.at(*corner)).collect();
        self.fill_pixels(&corners, ink);
    }

    /// The same in pixels.
    pub(crate) fn fill_pixels(&mut self, corners: &[(f32, f32)], ink: Ink) {
        self.paper.fill(corners, ink);
    }

    /// A line through places, so many pixels wide, dashed by so many pixels if at all.
    pub(crate) fn line(&mut self, places: &[Point], width: f32, dash: Option<f32>, ink: Ink) {
        let places: Vec<(f32, f32)> = places.iter().map(|place| self.at(*place)).collect();
        self.paper.line(&places, width, dash, ink);
    }

    /// A path in metres, so many metres wide.
    pub(crate) fn tape(&mut self, path: &Path, width: f32, ink: Ink) {
        let (x, y) = self.origin;
        let transform = Transform::from_row(self.scale, 0.0, 0.0, -self.scale, x, y);
        self.paper.stroke(path, width, None, ink, transform);
    }

    /// A filled circle, its radius in pixels.
    pub(crate) fn dot(&mut self, place: Point, radius: f32, ink: Ink) {
        self.paper.dot(self.at(place), radius, ink);
    }

    /// A circle line, its radius in pixels.
    pub(crate) fn ring(&mut self, place: Point, radius: f32, width: f32, ink: Ink) {
        self.paper.ring(self.at(place), radius, width, ink);
    }

    /// A line in pixels.
    pub(crate) fn rule(&mut self, from: (f32, f32), to: (f32, f32), width: f32, ink: Ink) {
        self.paper.line(&[from, to], width, None, ink);
    }

    /// A text with its left upper corner at a pixel.
    pub(crate) fn write(&mut self, (x, y): (f32, f32), text: &str, script: Script) {
        let (width, height) = script.size(text);
        self.taken.push([x, y, x + width, y + height]);
        self.paper.write((x, y), text, script);
    }

    /// A name beside a place, on the side where nothing is written yet.
    pub(crate) fn label(&mut self, place: Point, away: f32, text: &str, script: Script) {
        if text.is_empty() {
            return;
        }
        let ((x, y), (width, height)) = (self.at(place), script.size(text));
        let (edge_x, edge_y) = self.paper.size();
        let sides = [
            (x - width / 2.0, y + away),
            (x - width / 2.0, y - away - height),
            (x + away, y - height / 2.0),
            (x - away - width, y - height / 2.0),
            (x - width / 2.0, y + away + height),
            (x - width / 2.0, y - away - 2.0 * height),
        ];
        let free = |(x, y): &&(f32, f32)| {
            let own = [*x, *y, x + width, y + height];
            let inside = *x >= 0.0 && *y >= 0.0 && own[2] < edge_x && own[3] < edge_y;
            inside && !self.taken.iter().any(|other| overlap(&own, other))
        };
        let (x, y) = *sides.iter().find(free).unwrap_or(&sides[0]);
        let paper = [255, 255, 255, 190];
        let corners = [
            (x - 2.0, y),
            (x + width + 2.0, y),
            (x + width + 2.0, y + height),
            (x - 2.0, y + height),
        ];
        self.fill_pixels(&corners, paper);
        self.write((x, y), text, script);
    }

    /// The picture.
    pub(crate) fn finish(self) -> RgbImage {
        self.paper.finish()
    }
}

fn overlap(a: &Frame, b: &Frame) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}
