//! The canvas of maps: draws shapes given in metres, and text, to an image.

use image::RgbImage;
use tiny_skia::{Path, Transform};

use crate::canvas::Canvas;
pub(crate) use crate::canvas::{Ink, TextStyle};
use crate::sim::geometry::Point;

/// An axis-aligned rectangle in pixels: left, top, right, bottom.
type Frame = [f32; 4];

/// A canvas with a transform from world coordinates to pixels.
pub(crate) struct MapCanvas {
    canvas: Canvas,
    /// Pixels per metre.
    pub(crate) scale: f32,
    /// The pixel of the world's (0, 0).
    origin: (f32, f32),
    taken: Vec<Frame>,
}

impl MapCanvas {
    /// Creates a white canvas of a size in pixels; `None` if the size is invalid.
    pub(crate) fn new(size: (u32, u32), scale: f32, origin: (f32, f32)) -> Option<MapCanvas> {
        let canvas = Canvas::new(size.0, size.1)?;
        let taken = Vec::new();
        Some(MapCanvas {
            canvas,
            scale,
            origin,
            taken,
        })
    }

    /// Converts a place in the world to a pixel.
    pub(crate) fn at(&self, place: Point) -> (f32, f32) {
        let x = place.x as f32;
        let y = place.y as f32;
        (
            self.origin.0 + x * self.scale,
            self.origin.1 - y * self.scale,
        )
    }

    /// Fills a polygon.
    pub(crate) fn fill(&mut self, corners: &[Point], ink: Ink) {
        let corners: Vec<(f32, f32)> = corners.iter().map(|corner| self.at(*corner)).collect();
        self.fill_pixels(&corners, ink);
    }

    /// Fills a polygon given in pixels.
    pub(crate) fn fill_pixels(&mut self, corners: &[(f32, f32)], ink: Ink) {
        self.canvas.fill(corners, ink);
    }

    /// Draws a line through places; the width and the optional dash length are in pixels.
    pub(crate) fn line(&mut self, places: &[Point], width: f32, dash: Option<f32>, ink: Ink) {
        let places: Vec<(f32, f32)> = places.iter().map(|place| self.at(*place)).collect();
        self.canvas.line(&places, width, dash, ink);
    }

    /// Draws a path; path and width are in metres.
    pub(crate) fn tape(&mut self, path: &Path, width: f32, ink: Ink) {
        let (x, y) = self.origin;
        let transform = Transform::from_row(self.scale, 0.0, 0.0, -self.scale, x, y);
        self.canvas.stroke(path, width, None, ink, transform);
    }

    /// Draws a filled circle with a radius in pixels.
    pub(crate) fn dot(&mut self, place: Point, radius: f32, ink: Ink) {
        self.canvas.dot(self.at(place), radius, ink);
    }

    /// Draws a circle outline with a radius in pixels.
    pub(crate) fn ring(&mut self, place: Point, radius: f32, width: f32, ink: Ink) {
        self.canvas.ring(self.at(place), radius, width, ink);
    }

    /// Draws a line given in pixels.
    pub(crate) fn rule(&mut self, from: (f32, f32), to: (f32, f32), width: f32, ink: Ink) {
        self.canvas.line(&[from, to], width, None, ink);
    }

    /// Writes a text with its top left corner at a pixel.
    pub(crate) fn write(&mut self, (x, y): (f32, f32), text: &str, style: TextStyle) {
        let (width, height) = style.size(text);
        self.taken.push([x, y, x + width, y + height]);
        self.canvas.write((x, y), text, style);
    }

    /// Writes a label beside a place, on a side without other text, or below the place if there is
    /// no such side.
    pub(crate) fn label(&mut self, place: Point, away: f32, text: &str, style: TextStyle) {
        let (x, y) = self.at(place);
        let (width, _) = style.size(text);
        let at = self.free_side(place, away, text, style);
        self.write_with_background(at.unwrap_or((x - width / 2.0, y + away)), text, style);
    }

    /// Writes a label beside a place, or omits it if there is no room.
    pub(crate) fn label_if_room(&mut self, place: Point, away: f32, text: &str, style: TextStyle) {
        if let Some(at) = self.free_side(place, away, text, style) {
            self.write_with_background(at, text, style);
        }
    }

    /// Returns the top left corner of a free spot for a label beside a place.
    fn free_side(
        &self,
        place: Point,
        away: f32,
        text: &str,
        style: TextStyle,
    ) -> Option<(f32, f32)> {
        let ((x, y), (width, height)) = (self.at(place), style.size(text));
        let (edge_x, edge_y) = self.canvas.size();
        let left = x - away.abs() - width;
        let right = x + away.abs();
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

    fn write_with_background(&mut self, (x, y): (f32, f32), text: &str, style: TextStyle) {
        if text.is_empty() {
            return;
        }
        let (width, height) = style.size(text);
        let corners = [
            (x - 2.0, y),
            (x + width + 2.0, y),
            (x + width + 2.0, y + height),
            (x - 2.0, y + height),
        ];
        self.fill_pixels(&corners, [255, 255, 255, 190]);
        self.write((x, y), text, style);
    }

    /// Returns the image.
    pub(crate) fn finish(self) -> RgbImage {
        self.canvas.finish()
    }
}

fn overlap(a: &Frame, b: &Frame) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_without_room_are_omitted_and_do_not_overlap() {
        let mut canvas = MapCanvas::new((300, 300), 100.0, (20.0, 280.0)).unwrap();
        let style = TextStyle::small([0, 0, 0, 255]);
        for step in 0..20 {
            let place = Point::new(1.0 + 0.01 * f64::from(step), 1.0);
            canvas.label_if_room(place, 8.0, "1:00", style);
        }
        let taken = &canvas.taken;
        assert!(taken.len() > 2 && taken.len() < 20, "{}", taken.len());
        for (number, one) in taken.iter().enumerate() {
            assert!(!taken[number + 1..].iter().any(|other| overlap(one, other)));
        }
    }
}
