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

    /// A name beside a place, on a side where nothing is written yet, or below it if there is none.
    pub(crate) fn label(&mut self, place: Point, away: f32, text: &str, script: Script) {
        let (x, y) = self.at(place);
        let (width, _) = script.size(text);
        let at = self.free_side(place, away, text, script);
        self.write_on_paper(at.unwrap_or((x - width / 2.0, y + away)), text, script);
    }

    /// The same for what is left out where there is no room for it.
    pub(crate) fn label_if_room(&mut self, place: Point, away: f32, text: &str, script: Script) {
        if let Some(at) = self.free_side(place, away, text, script) {
            self.write_on_paper(at, text, script);
        }
    }

    /// Where a name has room beside a place: its top left corner.
    fn free_side(&self, place: Point, away: f32, text: &str, script: Script) -> Option<(f32, f32)> {
        let ((x, y), (width, height)) = (self.at(place), script.size(text));
        let (edge_x, edge_y) = self.paper.size();
        let (left, right) = (x - away.abs() - width, x + away.abs());
        let sides = [
            (x - width / 2.0, y + away),
            (x - width / 2.0, y - away - height),
            (x + away, y - height / 2.0),
            (x - away - width, y - height / 2.0),
            (right, y + away.abs()),
            (left, y + away.abs()),
            (right, y - away.abs() - height),
            (left, y - away.abs() - height),
            (x - width / 2.0, y + away + height),
            (x - width / 2.0, y - away - 2.0 * height),
        ];
        sides.into_iter().find(|(x, y)| {
            let own = [*x, *y, x + width, y + height];
            let inside = *x >= 0.0 && *y >= 0.0 && own[2] < edge_x && own[3] < edge_y;
            inside && !self.taken.iter().any(|other| overlap(&own, other))
        })
    }

    fn write_on_paper(&mut self, (x, y): (f32, f32), text: &str, script: Script) {
        if text.is_empty() {
            return;
        }
        let (width, height) = script.size(text);
        let corners = [
            (x - 2.0, y),
            (x + width + 2.0, y),
            (x + width + 2.0, y + height),
            (x - 2.0, y + height),
        ];
        self.fill_pixels(&corners, [255, 255, 255, 190]);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_a_short_run_are_left_out_rather_than_written_over_each_other() {
        let mut canvas = Canvas::new((300, 300), 100.0, (20.0, 280.0)).unwrap();
        let script = Script::small([0, 0, 0, 255]);
        for step in 0..20 {
            let place = Point::new(1.0 + 0.01 * f64::from(step), 1.0);
            canvas.label_if_room(place, 8.0, "1:00", script);
        }
        let taken = &canvas.taken;
        assert!(taken.len() > 2 && taken.len() < 20, "{}", taken.len());
        for (number, one) in taken.iter().enumerate() {
            assert!(!taken[number + 1..].iter().any(|other| overlap(one, other)));
        }
    }
}
