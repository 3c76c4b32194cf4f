//! The canvas of maps: metres in, pixels out, with text.

use image::RgbImage;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash,
    Transform,
};

use crate::sim::geometry::Point;

/// Red, green, blue and how opaque it is.
pub(crate) type Ink = [u8; 4];

/// An upright rectangle of pixels: left, top, right, bottom.
type Frame = [f32; 4];

/// How a text is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Script {
    pub(crate) ink: Ink,
    pub(crate) large: bool,
    pub(crate) bold: bool,
}

impl Script {
    /// Small letters of a colour.
    pub(crate) const fn small(ink: Ink) -> Script {
        Script {
            ink,
            large: false,
            bold: false,
        }
    }

    fn height(self) -> RasterHeight {
        if self.large {
            RasterHeight::Size20
        } else {
            RasterHeight::Size16
        }
    }

    fn weight(self) -> FontWeight {
        if self.bold {
            FontWeight::Bold
        } else {
            FontWeight::Regular
        }
    }

    /// Pixels from left to right and from top to bottom.
    pub(crate) fn size(self, text: &str) -> (f32, f32) {
        let letter = get_raster_width(self.weight(), self.height());
        (
            (letter * text.chars().count()) as f32,
            self.height().val() as f32,
        )
    }
}

/// The paper.
pub(crate) struct Canvas {
    pixels: Pixmap,
    /// Pixels a metre.
    pub(crate) scale: f32,
    /// Where the world's (0, 0) is.
    origin: (f32, f32),
    taken: Vec<Frame>,
}

impl Canvas {
    /// White paper of a size in pixels; `None` if there is no such paper.
    pub(crate) fn new(size: (u32, u32), scale: f32, origin: (f32, f32)) -> Option<Canvas> {
        let mut pixels = Pixmap::new(size.0, size.1)?;
        pixels.fill(Color::WHITE);
        let taken = Vec::new();
        Some(Canvas {
            pixels,
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
        if let Some(path) = through(corners, true) {
            self.fill_path(&path, ink);
        }
    }

    /// A line through places, so many pixels wide, dashed by so many pixels if at all.
    pub(crate) fn line(&mut self, places: &[Point], width: f32, dash: Option<f32>, ink: Ink) {
        let places: Vec<(f32, f32)> = places.iter().map(|place| self.at(*place)).collect();
        if let Some(path) = through(&places, false) {
            self.stroke(&path, width, dash, ink, Transform::identity());
        }
    }

    /// A path in metres, so many metres wide.
    pub(crate) fn tape(&mut self, path: &Path, width: f32, ink: Ink) {
        let (x, y) = self.origin;
        let transform = Transform::from_row(self.scale, 0.0, 0.0, -self.scale, x, y);
        self.stroke(path, width, None, ink, transform);
    }

    /// A filled circle, its radius in pixels.
    pub(crate) fn dot(&mut self, place: Point, radius: f32, ink: Ink) {
        let (x, y) = self.at(place);
        if let Some(path) = PathBuilder::from_circle(x, y, radius.max(0.5)) {
            self.fill_path(&path, ink);
        }
    }

    /// A circle line, its radius in pixels.
    pub(crate) fn ring(&mut self, place: Point, radius: f32, width: f32, ink: Ink) {
        let (x, y) = self.at(place);
        if let Some(path) = PathBuilder::from_circle(x, y, radius.max(0.5)) {
            self.stroke(&path, width, None, ink, Transform::identity());
        }
    }

    /// A line in pixels.
    pub(crate) fn rule(&mut self, from: (f32, f32), to: (f32, f32), width: f32, ink: Ink) {
        if let Some(path) = through(&[from, to], false) {
            self.stroke(&path, width, None, ink, Transform::identity());
        }
    }

    /// A text with its left upper corner at a pixel.
    pub(crate) fn write(&mut self, (x, y): (f32, f32), text: &str, script: Script) {
        let (width, height) = script.size(text);
        self.taken.push([x, y, x + width, y + height]);
        let mut left = x.round() as i32;
        for letter in text.chars() {
            let raster = |letter| get_raster(letter, script.weight(), script.height());
            let Some(raster) = raster(letter).or_else(|| raster('?')) else {
                continue;
            };
            for (row, line) in raster.rows().enumerate() {
                for (column, shade) in line.iter().enumerate() {
                    let place = (left + column as i32, y.round() as i32 + row as i32);
                    self.blend(place, script.ink, *shade);
                }
            }
            left += raster.width() as i32;
        }
    }

    /// A name beside a place, on the side where nothing is written yet.
    pub(crate) fn label(&mut self, place: Point, away: f32, text: &str, script: Script) {
        if text.is_empty() {
            return;
        }
        let ((x, y), (width, height)) = (self.at(place), script.size(text));
        let (edge_x, edge_y) = (self.pixels.width() as f32, self.pixels.height() as f32);
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
        let (width, height) = (self.pixels.width(), self.pixels.height());
        let pixels = self.pixels.pixels().iter();
        let bytes = pixels.flat_map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]);
        // The paper is opaque, so nothing was multiplied away; the size fits by construction.
        RgbImage::from_raw(width, height, bytes.collect()).unwrap_or_default()
    }

    fn blend(&mut self, (x, y): (i32, i32), ink: Ink, shade: u8) {
        let (width, height) = (self.pixels.width() as i32, self.pixels.height() as i32);
        if shade == 0 || !(0..width).contains(&x) || !(0..height).contains(&y) {
            return;
        }
        let index = (y * width + x) as usize * 4;
        for (channel, ink) in self.pixels.data_mut()[index..index + 3].iter_mut().zip(ink) {
            let (old, new, share) = (u32::from(*channel), u32::from(ink), u32::from(shade));
            *channel = ((old * (255 - share) + new * share) / 255) as u8;
        }
    }

    fn fill_path(&mut self, path: &Path, ink: Ink) {
        let (rule, still) = (FillRule::Winding, Transform::identity());
        self.pixels.fill_path(path, &paint(ink), rule, still, None);
    }

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

fn through(corners: &[(f32, f32)], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for (index, (x, y)) in corners.iter().enumerate() {
        if index == 0 {
            path.move_to(*x, *y);
        } else {
            path.line_to(*x, *y);
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
