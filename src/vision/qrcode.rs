//! Reads QR codes.

use crate::vision::picture::image::Image;

/// Most codes of one picture that are read.
const MAX_CODES: usize = 8;

/// A QR code that could be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct QrCode {
    /// What it says; bytes that are no UTF-8 become replacement characters. At most 7,089 characters, by its format.
    pub text: String,
    /// Its corners as column and row, from the one between the code's two top squares clockwise as printed:
    /// top left, top right, bottom right, bottom left.
    pub corners: [[i32; 2]; 4],
}

/// The QR codes of a picture that can be read.
pub fn find_qrcodes(image: &Image) -> Vec<QrCode> {
    let size = image.size();
    if size.width == 0 || size.height == 0 {
        return Vec::new();
    }
    let (width, height) = (size.width as usize, size.height as usize);
    let mut prepared = rqrr::PreparedImage::prepare_from_greyscale(width, height, |x, y| {
        image.luma_row(y as u32)[x]
    });
    prepared
        .detect_grids()
        .into_iter()
        .take(MAX_CODES)
        .filter_map(|grid| read(&grid))
        .collect()
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
