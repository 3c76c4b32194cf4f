//! A white canvas in pixels with filled areas, lines and text in a built-in font.

use image::RgbImage;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash,
    Transform,
};

/// Red, green, blue and opacity.
pub type Ink = [u8; 4];

/// The style of a text.
#[derive(Debug, Clone, Copy)]
pub struct TextStyle {
    /// Its colour.
    pub ink: Ink,
    /// 20 pixels high, instead of 16.
    pub large: bool,
    /// Bold.
    pub bold: bool,
}

impl TextStyle {
    /// Small regular text in a colour.
    pub const fn small(ink: Ink) -> TextStyle {
        TextStyle {
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

    /// Width and height of a text in this style, pixels.
    pub fn size(self, text: &str) -> (f32, f32) {
        let letter = get_raster_width(self.weight(), self.height());
        (
            (letter * text.chars().count()) as f32,
            self.height().val() as f32,
        )
    }
}

/// A white canvas.
pub struct Canvas {
    pixels: Pixmap,
}

impl Canvas {
    /// A canvas of this size in pixels; `None` if the size is not possible.
    pub fn new(width: u32, height: u32) -> Option<Canvas> {
        let mut pixels = Pixmap::new(width, height)?;
        pixels.fill(Color::WHITE);
        Some(Canvas { pixels })
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> (f32, f32) {
        (self.pixels.width() as f32, self.pixels.height() as f32)
    }

    /// Fills the polygon with these corners.
    pub fn fill(&mut self, corners: &[(f32, f32)], ink: Ink) {
        if let Some(path) = through(corners, true) {
            self.fill_path(&path, ink);
        }
    }

    /// Draws a line through these points, `width` pixels wide; with `dash`, dashes and gaps of that
    /// many pixels.
    pub fn line(&mut self, places: &[(f32, f32)], width: f32, dash: Option<f32>, ink: Ink) {
        if let Some(path) = through(places, false) {
            self.stroke(&path, width, dash, ink, Transform::identity());
        }
    }

    /// Draws a filled circle.
    pub fn dot(&mut self, (x, y): (f32, f32), radius: f32, ink: Ink) {
        if let Some(path) = PathBuilder::from_circle(x, y, radius.max(0.5)) {
            self.fill_path(&path, ink);
        }
    }

    /// Draws the outline of a circle.
    pub fn ring(&mut self, (x, y): (f32, f32), radius: f32, width: f32, ink: Ink) {
        if let Some(path) = PathBuilder::from_circle(x, y, radius.max(0.5)) {
            self.stroke(&path, width, None, ink, Transform::identity());
        }
    }

    /// Writes a text with its upper left corner at this position.
    pub fn write(&mut self, (x, y): (f32, f32), text: &str, style: TextStyle) {
        let mut left = x.round() as i32;
        for letter in text.chars() {
            let raster = |letter| get_raster(letter, style.weight(), style.height());
            let Some(raster) = raster(letter).or_else(|| raster('?')) else {
                continue;
            };
            for (row, line) in raster.rows().enumerate() {
                for (column, shade) in line.iter().enumerate() {
                    let place = (left + column as i32, y.round() as i32 + row as i32);
                    self.blend(place, style.ink, *shade);
                }
            }
            left += raster.width() as i32;
        }
    }

    /// Returns the finished image.
    pub fn finish(self) -> RgbImage {
        let width = self.pixels.width();
        let height = self.pixels.height();
        let pixels = self.pixels.pixels().iter();
        let bytes = pixels.flat_map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]);
        // The canvas is opaque, so premultiplied and plain colours are the same; the buffer always
        // has the right size.
        RgbImage::from_raw(width, height, bytes.collect()).unwrap_or_default()
    }

    fn blend(&mut self, (x, y): (i32, i32), ink: Ink, shade: u8) {
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
        let rule = FillRule::Winding;
        let still = Transform::identity();
        self.pixels.fill_path(path, &paint(ink), rule, still, None);
    }

    /// Strokes a path given in its own units; `transform` maps it to pixels.
    pub(crate) fn stroke(
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
