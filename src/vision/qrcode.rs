//! Reads QR codes.

use std::panic::{AssertUnwindSafe, catch_unwind};

use image::imageops::{self, FilterType};
use image::{GrayImage, Luma};

use super::finders::{Bitmap, QrWork};
use crate::vision::picture::image::Image;

/// Most codes that are read in one picture.
pub const MAX_CODES: usize = 8;

/// Greatest width of a picture that is enlarged.
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
/// designed to be hard, fewer codes are found, or none.
pub fn find_qrcodes(image: &Image) -> Vec<QrCode> {
    find_qrcodes_counting(image).0
}

/// Like [`find_qrcodes`]; also returns the amount of work.
pub fn find_qrcodes_counting(image: &Image) -> (Vec<QrCode>, QrWork) {
    // The crate relies on arithmetic that overflows on some pictures: no codes are found in them.
    let read = catch_unwind(AssertUnwindSafe(|| search(image)));
    read.ok().flatten().unwrap_or_default()
}

/// Searches the picture as it is, and again at twice the size if it has finder patterns but no
/// readable code.
fn search(image: &Image) -> Option<(Vec<QrCode>, QrWork)> {
    let size = image.size();
    if size.width == 0 || size.height == 0 {
        return None;
    }
    let grey = |x: u32, y: u32| Luma([image.luma_row(y)[x as usize]]);
    let picture = GrayImage::from_fn(size.width, size.height, grey);
    let (codes, work) = search_in(&picture)?;
    if !codes.is_empty() || work.finders == 0 || size.width > WIDEST_ENLARGED {
        return Some((codes, work));
    }
    let (width, height) = (2 * size.width, 2 * size.height);
    let enlarged = imageops::resize(&picture, width, height, FilterType::CatmullRom);
    let Some((mut codes, again)) = search_in(&enlarged) else {
        return Some((codes, work));
    };
    let corners = codes.iter_mut().flat_map(|code| &mut code.corners);
    corners.flatten().for_each(|place| *place /= 2);
    let work = QrWork {
        finders: work.finders.max(again.finders),
        filled: work.filled.max(again.filled),
        steps: work.steps.max(again.steps),
        decoded: work.decoded.max(again.decoded),
    };
    Some((codes, work))
}

fn search_in(picture: &GrayImage) -> Option<(Vec<QrCode>, QrWork)> {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let grey = |x: usize, y: usize| picture.get_pixel(x as u32, y as u32).0[0];
    let prepared = rqrr::PreparedImage::prepare_from_greyscale(width, height, grey);
    let mut bitmap = Bitmap::new(width, height, |x, y| prepared.get_pixel_at(x, y) != 0u8);
    let mut work = bitmap.limit_work()?;
    let black = |x: usize, y: usize| bitmap.is_black(x, y);
    let mut limited = rqrr::PreparedImage::prepare_from_bitmap(width, height, black);
    let grids = limited.detect_grids();
    let codes: Vec<_> = grids.iter().take(MAX_CODES).map(read).collect();
    work.decoded = codes.len();
    Some((codes.into_iter().flatten().collect(), work))
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
