//! The canvas of maps: draws shapes given in metres, and text in a built-in font, to an image.

use image::RgbImage;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
pub(crate) use tiny_skia::Point as Pixel;
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash,
    Transform,
};

use crate::geometry::Point;

/// Red, green, blue and opacity.
pub(crate) type Ink = [u8; 4];

#[derive(Debug, Clone, Copy)]
pub(crate) struct TextStyle {
    ink: Ink,
    height: RasterHeight,
    weight: FontWeight,
}

impl TextStyle {
    pub(crate) const fn small(ink: Ink) -> TextStyle {
        TextStyle {
            ink,
            height: RasterHeight::Size16,
            weight: FontWeight::Regular,
        }
    }

    pub(crate) const fn title(ink: Ink) -> TextStyle {
        TextStyle {
            ink,
            height: RasterHeight::Size20,
            weight: FontWeight::Bold,
        }
    }

    /// Width and height of a text in this style, pixels.
    pub(crate) fn size(self, text: &str) -> (f32, f32) {
        let letter = get_raster_width(self.weight, self.height);
        let width = letter * text.chars().count();
        (width as f32, self.height.val() as f32)
    }
}

/// An axis-aligned rectangle in pixels: left, top, right, bottom.
type Frame = [f32; 4];

/// A white canvas with a transform from world coordinates to pixels.
pub(crate) struct MapCanvas {
    pixels: Pixmap,
    /// Pixels per metre.
    pub(crate) scale: f32,
    /// The pixel of the world's (0, 0).
    origin: Pixel,
    taken: Vec<Frame>,
}

impl MapCanvas {
    /// Creates a white canvas of a size in pixels; `None` if the size is invalid.
    pub(crate) fn new(width: u32, height: u32, scale: f32, origin: Pixel) -> Option<MapCanvas> {
        let mut pixels = Pixmap::new(width, height)?;
        pixels.fill(Color::WHITE);
        Some(MapCanvas {
            pixels,
            scale,
            origin,
            taken: Vec::new(),
        })
    }

    /// Converts a place in the world to a pixel.
    pub(crate) fn at(&self, place: Point) -> Pixel {
        let x = place.x as f32;
        let y = place.y as f32;
        Pixel {
            x: self.origin.x + x * self.scale,
            y: self.origin.y - y * self.scale,
        }
    }

    pub(crate) fn fill(&mut self, corners: &[Point], ink: Ink) {
        let corners: Vec<Pixel> = corners.iter().map(|corner| self.at(*corner)).collect();
        self.fill_pixels(&corners, ink);
    }

    pub(crate) fn fill_pixels(&mut self, corners: &[Pixel], ink: Ink) {
        if let Some(path) = through(corners, true) {
            self.fill_path(&path, ink);
        }
    }

    /// Draws a line through places; the width and the optional dash length are in pixels.
    pub(crate) fn line(&mut self, places: &[Point], width: f32, dash: Option<f32>, ink: Ink) {
        let places: Vec<Pixel> = places.iter().map(|place| self.at(*place)).collect();
        if let Some(path) = through(&places, false) {
            self.stroke(&path, width, dash, ink, Transform::identity());
        }
    }

    /// Draws a path; path and width are in metres.
    pub(crate) fn tape(&mut self, path: &Path, width: f32, ink: Ink) {
        let Pixel { x, y } = self.origin;
        let transform = Transform::from_row(self.scale, 0.0, 0.0, -self.scale, x, y);
        self.stroke(path, width, None, ink, transform);
    }

    /// Draws a filled circle with a radius in pixels.
    pub(crate) fn dot(&mut self, place: Point, radius: f32, ink: Ink) {
        let Pixel { x, y } = self.at(place);
        if let Some(path) = PathBuilder::from_circle(x, y, radius.max(0.5)) {
            self.fill_path(&path, ink);
        }
    }

    /// Draws a circle outline with a radius in pixels.
    pub(crate) fn ring(&mut self, place: Point, radius: f32, width: f32, ink: Ink) {
        let Pixel { x, y } = self.at(place);
        if let Some(path) = PathBuilder::from_circle(x, y, radius.max(0.5)) {
            self.stroke(&path, width, None, ink, Transform::identity());
        }
    }

    /// Draws a line given in pixels.
    pub(crate) fn rule(&mut self, from: Pixel, to: Pixel, width: f32, ink: Ink) {
        if let Some(path) = through(&[from, to], false) {
            self.stroke(&path, width, None, ink, Transform::identity());
        }
    }

    /// Writes a text with its top left corner at a pixel.
    pub(crate) fn write(&mut self, at: Pixel, text: &str, style: TextStyle) {
        let Pixel { x, y } = at;
        let (width, height) = style.size(text);
        self.taken.push([x, y, x + width, y + height]);
        let mut left = x.round() as i32;
        for letter in text.chars() {
            let raster = |letter| get_raster(letter, style.weight, style.height);
            let Some(raster) = raster(letter).or_else(|| raster('?')) else {
                continue;
            };
            for (row, line) in raster.rows().enumerate() {
                for (column, shade) in line.iter().enumerate() {
                    let x = left + column as i32;
                    let y = y.round() as i32 + row as i32;
                    self.blend(x, y, style.ink, *shade);
                }
            }
            left += raster.width() as i32;
        }
    }

    /// Writes a label beside a place, on a side without other text, or below the place if there is
    /// no such side.
    pub(crate) fn label(&mut self, place: Point, away: f32, text: &str, style: TextStyle) {
        let Pixel { x, y } = self.at(place);
        let (width, _) = style.size(text);
        let at = self.free_side(place, away, text, style);
        let below = Pixel::from_xy(x - width / 2.0, y + away);
        self.write_with_background(at.unwrap_or(below), text, style);
    }

    /// Writes a label beside a place, or omits it if there is no room.
    pub(crate) fn label_if_room(&mut self, place: Point, away: f32, text: &str, style: TextStyle) {
        if let Some(at) = self.free_side(place, away, text, style) {
            self.write_with_background(at, text, style);
        }
    }

    /// Returns the top left corner of a free spot for a label beside a place.
    fn free_side(&self, place: Point, away: f32, text: &str, style: TextStyle) -> Option<Pixel> {
        let Pixel { x, y } = self.at(place);
        let (width, height) = style.size(text);
        let edge_x = self.pixels.width() as f32;
        let edge_y = self.pixels.height() as f32;
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
        sides.map(Pixel::from).into_iter().find(|side| {
            let Pixel { x, y } = *side;
            let own = [x, y, x + width, y + height];
            let inside = x >= 0.0 && y >= 0.0 && own[2] < edge_x && own[3] < edge_y;
            inside && !self.taken.iter().any(|other| overlap(&own, other))
        })
    }

    fn write_with_background(&mut self, at: Pixel, text: &str, style: TextStyle) {
        if text.is_empty() {
            return;
        }
        let Pixel { x, y } = at;
        let (width, height) = style.size(text);
        let corners = [
            (x - 2.0, y),
            (x + width + 2.0, y),
            (x + width + 2.0, y + height),
            (x - 2.0, y + height),
        ];
        self.fill_pixels(&corners.map(Pixel::from), [255, 255, 255, 190]);
        self.write(at, text, style);
    }

    pub(crate) fn finish(self) -> RgbImage {
        let width = self.pixels.width();
        let height = self.pixels.height();
        let pixels = self.pixels.pixels().iter();
        let bytes = pixels.flat_map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]);
        // The canvas is opaque, so premultiplied and plain colours are the same; the buffer always
        // has the right size.
        RgbImage::from_raw(width, height, bytes.collect()).unwrap_or_default()
    }

    fn blend(&mut self, x: i32, y: i32, ink: Ink, shade: u8) {
        let width = self.pixels.width() as i32;
        let height = self.pixels.height() as i32;
        if shade == 0 || !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let index = (y * width + x) as usize * 4;
        for (channel, ink) in self.pixels.data_mut()[index..index + 3].iter_mut().zip(ink) {
            let old = u32::from(*channel);
            let new = u32::from(ink);
            let share = u32::from(shade);
            *channel = ((old * (255 - share) + new * share) / 255) as u8;
        }
    }

    fn fill_path(&mut self, path: &Path, ink: Ink) {
        let transform = Transform::identity();
        self.pixels
            .fill_path(path, &paint(ink), FillRule::Winding, transform, None);
    }

    /// Strokes a path given in its own units; `transform` maps it to pixels.
    fn stroke(
        &mut self,
        path: &Path,
        width: f32,
        dash: Option<f32>,
        ink: Ink,
        transform: Transform,
    ) {
        let stroke = Stroke {
            width,
            line_cap: if dash.is_some() {
                LineCap::Butt
            } else {
                LineCap::Round
            },
            line_join: LineJoin::Round,
            dash: dash.and_then(|dash| StrokeDash::new(vec![dash, dash], 0.0)),
            ..Stroke::default()
        };
        self.pixels
            .stroke_path(path, &paint(ink), &stroke, transform, None);
    }
}

fn paint(ink: Ink) -> Paint<'static> {
    let mut paint = Paint::default();
    let [r, g, b, a] = ink;
    paint.set_color_rgba8(r, g, b, a);
    paint.anti_alias = true;
    paint
}

fn through(corners: &[Pixel], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (index, Pixel { x, y }) in corners.iter().copied().enumerate() {
        if index == 0 {
            path.move_to(x, y);
        } else {
            path.line_to(x, y);
        }
    }
    if closed {
        path.close();
    }
    path.finish()
}

fn overlap(a: &Frame, b: &Frame) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_without_room_are_omitted_and_do_not_overlap() {
        let mut canvas = MapCanvas::new(300, 300, 100.0, Pixel::from_xy(20.0, 280.0)).unwrap();
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
