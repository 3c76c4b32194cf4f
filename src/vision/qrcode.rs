//! Reads QR codes. The crate that does so tries every triple of squares that look like corners,
//! which on a crafted sheet of paper takes longer than a script may run. Therefore it gets a
//! picture that counts each access to a pixel, and the search ends with its budget.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

use image::imageops::{self, FilterType};
use image::{GenericImage, GenericImageView, GrayImage, Luma};

use crate::picture::Image;

/// Most codes that are read in one picture.
pub const MAX_CODES: usize = 8;
/// Most steps of the search for codes in one picture. A step is an access to a pixel or to the size
/// of the picture; four codes take six million, a fine one of 57 by 57 dots three million.
pub const MAX_QR_STEPS: u64 = 8_000_000;

/// Steps that are charged for a square: the crate compares every square with every pair of others
/// without looking at the picture.
const SQUARE_STEPS: u64 = 20_000;
/// Pixels that are copied in the time of one step.
const COPIED_PER_STEP: usize = 16;
/// The shade in which the crate first paints a square that it has found.
const SQUARE_SHADE: u8 = 4;
const WIDEST_ENLARGED: u32 = 400;

/// A QR code that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QrCode {
    /// The content; bytes that are not UTF-8 become replacement characters. At most 7,089
    /// characters, the limit of the format.
    pub text: String,
    /// The corners as column and row, clockwise as printed: top left (at the finder pattern between
    /// the other two), top right, bottom right, bottom left.
    pub corners: [[i32; 2]; 4],
}

/// Finds the readable QR codes of a picture. The work is bounded for every picture: in one that is
/// designed to be hard, no codes are found.
pub fn find_qrcodes(image: &Image) -> Vec<QrCode> {
    find_qrcodes_counting(image).0
}

/// Like [`find_qrcodes`]; also returns the number of steps, at most [`MAX_QR_STEPS`].
pub fn find_qrcodes_counting(image: &Image) -> (Vec<QrCode>, u64) {
    let meter = Meter::default();
    // The meter ends the search by unwinding. The crate also panics by itself: it relies on
    // arithmetic that overflows on some pictures.
    let read = catch_unwind(AssertUnwindSafe(|| search(image, &meter)));
    (read.unwrap_or_default(), meter.steps.get())
}

/// Searches the picture as it is, and again at twice the size if it has squares but no readable
/// code.
fn search(image: &Image, meter: &Meter) -> Vec<QrCode> {
    let size = image.size();
    if size.width == 0 || size.height == 0 {
        return Vec::new();
    }
    let grey = |x: u32, y: u32| Luma([image.luma_row(y)[x as usize]]);
    let picture = GrayImage::from_fn(size.width, size.height, grey);
    let codes = search_in(picture.clone(), meter);
    if !codes.is_empty() || meter.squares.get() == 0 || size.width > WIDEST_ENLARGED {
        return codes;
    }
    let width = 2 * size.width;
    let height = 2 * size.height;
    let enlarged = imageops::resize(&picture, width, height, FilterType::CatmullRom);
    let mut codes = search_in(enlarged, meter);
    let corners = codes.iter_mut().flat_map(|code| &mut code.corners);
    corners.flatten().for_each(|place| *place /= 2);
    codes
}

fn search_in(picture: GrayImage, meter: &Meter) -> Vec<QrCode> {
    let before = meter.steps.get();
    let mut prepared = rqrr::PreparedImage::prepare(MeteredImage {
        picture,
        last_shade: 0,
        meter,
    });
    // The preparation takes the same time for every picture of this size.
    meter.steps.set(before);
    let grids = prepared.detect_grids();
    grids.iter().take(MAX_CODES).filter_map(read).collect()
}

fn read<G: rqrr::BitGrid>(grid: &rqrr::Grid<G>) -> Option<QrCode> {
    let mut text = Vec::new();
    grid.decode_to(&mut text).ok()?;
    let corners = grid.bounds.map(|corner| [corner.x, corner.y]);
    Some(QrCode {
        text: String::from_utf8_lossy(&text).into_owned(),
        corners,
    })
}

#[derive(Debug, Default)]
struct Meter {
    steps: Cell<u64>,
    squares: Cell<u32>,
}

impl Meter {
    /// Counts steps; unwinds when the budget is used up.
    fn add(&self, steps: u64) {
        let sum = self.steps.get() + steps;
        if sum > MAX_QR_STEPS {
            self.steps.set(MAX_QR_STEPS);
            resume_unwind(Box::new("the budget is used up"));
        }
        self.steps.set(sum);
    }
}

struct MeteredImage<'a> {
    picture: GrayImage,
    last_shade: u8,
    meter: &'a Meter,
}

impl Clone for MeteredImage<'_> {
    fn clone(&self) -> Self {
        self.meter
            .add((self.picture.len() / COPIED_PER_STEP) as u64);
        MeteredImage {
            picture: self.picture.clone(),
            ..*self
        }
    }
}

impl GenericImageView for MeteredImage<'_> {
    type Pixel = Luma<u8>;

    fn dimensions(&self) -> (u32, u32) {
        self.meter.add(1);
        self.picture.dimensions()
    }

    fn get_pixel(&self, x: u32, y: u32) -> Luma<u8> {
        self.meter.add(1);
        *self.picture.get_pixel(x, y)
    }
}

impl GenericImage for MeteredImage<'_> {
    fn get_pixel_mut(&mut self, x: u32, y: u32) -> &mut Luma<u8> {
        self.meter.add(1);
        self.picture.get_pixel_mut(x, y)
    }

    fn put_pixel(&mut self, x: u32, y: u32, pixel: Luma<u8>) {
        let Luma([shade]) = pixel;
        self.meter.add(1);
        if shade == SQUARE_SHADE && self.last_shade != SQUARE_SHADE {
            self.meter.squares.set(self.meter.squares.get() + 1);
            self.meter.add(SQUARE_STEPS);
        }
        self.last_shade = shade;
        self.picture.put_pixel(x, y, pixel);
    }

    fn blend_pixel(&mut self, x: u32, y: u32, pixel: Luma<u8>) {
        self.put_pixel(x, y, pixel);
    }
}
