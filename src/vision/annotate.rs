//! Draws detected blobs onto pictures for people to look at.

use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use imageproc::drawing::{draw_filled_rect_mut, draw_hollow_rect_mut};
use imageproc::rect::Rect;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};

use crate::blobs::Blob;
use crate::picture::Image;

const MAX_LETTERS: usize = 24;
/// Length of the arms of the cross at a centroid, screen pixels.
const ARM: i32 = 4;
const PAPER: Rgb<u8> = Rgb([0, 0, 0]);
/// Box colours, by the index of the blob's colour. None is one of the named colours, so that boxes
/// stand out.
const BOXES: [Rgb<u8>; 6] = [
    Rgb([120, 255, 40]),
    Rgb([255, 60, 200]),
    Rgb([60, 220, 255]),
    Rgb([255, 220, 60]),
    Rgb([170, 110, 255]),
    Rgb([255, 255, 255]),
];

/// A blob and the text above its box, such as its name and id.
#[derive(Debug, Clone, Copy)]
pub struct Annotation<'a> {
    /// The blob that the box encloses.
    pub blob: &'a Blob,
    /// The text, of which Latin letters, digits and punctuation can be drawn.
    pub text: &'a str,
}

/// Returns a copy of the picture with a box, a cross at the centroid and a text for each mark.
pub fn annotate(image: &Image, marks: &[Annotation<'_>]) -> RgbImage {
    annotate_enlarged(image, marks, 1)
}

/// Like [`annotate`], on a copy enlarged `times` times (0 counts as 1). Letters hardly grow with
/// it, so they hide less.
pub fn annotate_enlarged(image: &Image, marks: &[Annotation<'_>], times: u32) -> RgbImage {
    let times = times.max(1);
    let small = image.to_rgb();
    if small.width() == 0 || small.height() == 0 {
        return small;
    }
    let width = small.width() * times;
    let height = small.height() * times;
    let mut canvas = imageops::resize(&small, width, height, FilterType::Nearest);
    let mut labels = Vec::new();
    for mark in marks {
        outline(&mut canvas, mark.blob, times as i32);
    }
    // Drawn after all boxes, so that no box crosses a text.
    for mark in marks {
        label(&mut canvas, mark, times as i32, &mut labels);
    }
    canvas
}

/// Draws a box one pixel outside the blob, so that the blob stays visible; in an enlarged picture,
/// dark lines on both sides set the box off from any background. Drawing clips at the border.
fn outline(canvas: &mut RgbImage, blob: &Blob, times: i32) {
    let colour = colour(blob);
    let inner = frame(blob, times);
    for (grow, paint) in [(0, PAPER), (3, PAPER), (1, colour), (2, colour)] {
        if times > 1 || grow == 1 {
            draw_hollow_rect_mut(canvas, grown(inner, grow), paint);
        }
    }
    let middle = |centre: f64| ((centre + 0.5) * f64::from(times)) as i32;
    let cx = middle(blob.cx);
    let cy = middle(blob.cy);
    let thick = times.min(2) as u32;
    let bars = [(ARM, thick as i32 / 2), (thick as i32 / 2, ARM)];
    for (paint, wider) in [(PAPER, 1), (colour, 0)] {
        for (across, down) in bars {
            let across = across + wider;
            let down = down + wider;
            let bar = Rect::at(cx - across, cy - down)
                .of_size(2 * across as u32 + 1, 2 * down as u32 + 1);
            draw_filled_rect_mut(canvas, bar, paint);
        }
    }
}

fn colour(blob: &Blob) -> Rgb<u8> {
    BOXES[blob.colour % BOXES.len()]
}

fn frame(blob: &Blob, times: i32) -> Rect {
    let times_unsigned = times as u32;
    Rect::at(blob.x as i32 * times, blob.y as i32 * times).of_size(
        (blob.w * times_unsigned).max(1),
        (blob.h * times_unsigned).max(1),
    )
}

fn grown(rect: Rect, by: i32) -> Rect {
    let more = 2 * by as u32;
    Rect::at(rect.left() - by, rect.top() - by).of_size(rect.width() + more, rect.height() + more)
}

/// Draws the mark's text where no other text is, if there is such a place.
fn label(
    canvas: &mut RgbImage,
    Annotation { blob, text }: &Annotation<'_>,
    times: i32,
    taken: &mut Vec<Rect>,
) {
    let size = if times > 1 {
        RasterHeight::Size20
    } else {
        RasterHeight::Size16
    };
    let letters = text.chars().take(MAX_LETTERS);
    let letters = letters.filter_map(|letter| get_raster(letter, FontWeight::Bold, size));
    let letters: Vec<_> = letters.collect();
    if letters.is_empty() {
        return;
    }
    let wide = get_raster_width(FontWeight::Bold, size);
    let w = (letters.len() * wide) as i32;
    let picture = Rect::at(0, 0).of_size(canvas.width(), canvas.height());
    let around = grown(frame(blob, times), 3);
    let place = place(around, w, size.val() as i32, picture, taken);
    taken.push(place);
    draw_filled_rect_mut(canvas, place, PAPER);
    for (index, letter) in letters.iter().enumerate() {
        for (y, row) in (place.top()..).zip(letter.rows()) {
            for (x, shade) in (place.left() + (index * wide) as i32..).zip(row) {
                if let Some(pixel) = canvas.get_pixel_mut_checked(x as u32, y as u32) {
                    let Rgb(ink) = colour(blob);
                    let shaded = |ink: u8| (u16::from(ink) * u16::from(*shade) / 255) as u8;
                    *pixel = Rgb(ink.map(shaded));
                }
            }
        }
    }
}

/// Chooses a place above, below or inside the box, moved into the picture: the first candidate that
/// is free and visible, otherwise the first that is visible.
fn place(around: Rect, w: i32, h: i32, picture: Rect, taken: &[Rect]) -> Rect {
    let width = picture.width() as i32;
    let height = picture.height() as i32;
    let x = around.left().min(width - w).max(0);
    let above = around.top() - h;
    let inside = (around.top() + 4).clamp(0, (height - h).max(0));
    let candidates =
        [above, around.bottom() + 1, inside].map(|y| Rect::at(x, y).of_size(w as u32, h as u32));
    let visible = |rect: &&Rect| rect.top() >= 0 && rect.bottom() < height;
    let free = |rect: &&Rect| taken.iter().all(|other| rect.intersect(*other).is_none());
    let shown = || candidates.iter().filter(visible);
    let found = shown().find(free).or_else(|| shown().next());
    *found.unwrap_or(&candidates[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Rect {
        Rect::at(0, 0).of_size(320, 240)
    }

    #[test]
    fn texts_of_neighbours_do_not_overlap() {
        let around = Rect::at(100, 100).of_size(40, 40);
        let mut taken = Vec::new();
        for _ in 0..3 {
            let next = place(around, 60, 14, picture(), &taken);
            assert!(taken.iter().all(|other| next.intersect(*other).is_none()));
            taken.push(next);
        }
    }

    #[test]
    fn a_text_stays_in_the_picture() {
        for (x, y) in [(0, 0), (300, 0), (0, 230), (300, 230), (-3, -3)] {
            let place = place(Rect::at(x, y).of_size(30, 20), 80, 14, picture(), &[]);
            assert!(place.left() >= 0 && place.right() < 320, "{place:?}");
            assert!(place.top() >= 0 && place.bottom() < 240, "{place:?}");
        }
    }
}
