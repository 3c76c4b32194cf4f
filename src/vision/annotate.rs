//! Draws what was seen, so that a person can see it too.

use image::{Rgb, RgbImage};
use imageproc::drawing::{draw_cross_mut, draw_filled_rect_mut, draw_hollow_rect_mut};
use imageproc::rect::Rect;

use super::blobs::Blob;
use super::font;
use super::picture::Image;

/// Screen pixels of one dot of a letter.
const DOT: i32 = 2;
/// Most letters of a mark's text that are drawn.
const MAX_LETTERS: usize = 24;
const PAPER: Rgb<u8> = Rgb([0, 0, 0]);
const INK: Rgb<u8> = Rgb([255, 255, 255]);
/// Box colours, by the index of the blob's colour: none is one of the named colours, so that boxes stand out.
const BOXES: [Rgb<u8>; 6] = [
    Rgb([120, 255, 40]),
    Rgb([255, 60, 200]),
    Rgb([60, 220, 255]),
    Rgb([255, 220, 60]),
    Rgb([170, 110, 255]),
    Rgb([255, 255, 255]),
];

/// A blob and what is written above its box, such as its name and id.
#[derive(Debug, Clone, Copy)]
pub struct Mark<'a> {
    /// Where the box goes.
    pub blob: &'a Blob,
    /// What is written: letters, digits and `# - _ . +`.
    pub text: &'a str,
}

/// A copy of the picture with a box, a cross at the centroid and a text for every mark.
pub fn annotate(image: &Image, marks: &[Mark<'_>]) -> RgbImage {
    let mut canvas = image.to_rgb();
    if canvas.width() > 0 && canvas.height() > 0 {
        marks.iter().for_each(|mark| draw(&mut canvas, mark));
    }
    canvas
}

fn draw(canvas: &mut RgbImage, Mark { blob, text }: &Mark<'_>) {
    let colour = BOXES[blob.colour % BOXES.len()];
    // A pixel outside, so that the blob itself stays visible; drawing clips at the border.
    let (x, y) = (blob.x as i32 - 1, blob.y as i32 - 1);
    draw_hollow_rect_mut(
        canvas,
        Rect::at(x, y).of_size(blob.w + 2, blob.h + 2),
        colour,
    );
    draw_cross_mut(
        canvas,
        colour,
        blob.cx.round() as i32,
        blob.cy.round() as i32,
    );
    write(canvas, text, (x, y));
}

/// Writes above the corner `(x, y)`, or inside the box where there is no room above.
fn write(canvas: &mut RgbImage, text: &str, (x, y): (i32, i32)) {
    let letters = text.chars().count().min(MAX_LETTERS) as i32;
    if letters == 0 {
        return;
    }
    let (w, h) = (
        (letters * (font::WIDTH + 1) + 1) * DOT,
        (font::HEIGHT + 2) * DOT,
    );
    let x = x.min(canvas.width() as i32 - w).max(0);
    let y = if y >= h { y - h } else { y + 2 };
    draw_filled_rect_mut(canvas, Rect::at(x, y).of_size(w as u32, h as u32), PAPER);
    for (index, letter) in (0..letters).zip(text.chars()) {
        let left = x + (1 + index * (font::WIDTH + 1)) * DOT;
        for (column, row) in font::dots(letter) {
            let dot =
                Rect::at(left + column * DOT, y + (1 + row) * DOT).of_size(DOT as u32, DOT as u32);
            draw_filled_rect_mut(canvas, dot, INK);
        }
    }
}
