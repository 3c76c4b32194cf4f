//! Arbitrary pictures, with and without a chessboard, and arbitrary places of its corners: a board
//! that is found has the requested size and lies within the picture; the result of a calibration
//! can be pasted into a config.
#![no_main]

use image::{GrayImage, Luma};
use libfuzzer_sys::fuzz_target;
use spykee::config::Config;
use spykee::vision::{Board, Sighting, Size, calibrate, find_chessboard};

#[path = "../poster.rs"]
mod poster;

/// Number of bytes that determine a board's place in a picture.
const PLACE: usize = 8;
/// Maximum number of views of one calibration.
const VIEWS: usize = 4;
/// Number of bytes of a view.
const VIEW: usize = 12;

fuzz_target!(|bytes: &[u8]| {
    let Some(([how, sides, place @ ..], rest)) = bytes.split_first_chunk::<{ PLACE + 2 }>() else {
        return;
    };
    let board = Board {
        columns: usize::from(sides >> 4) % 10 + 3,
        rows: usize::from(sides & 15) % 8 + 3,
    };
    match how & 1 {
        0 => look(place, board, rest),
        _ => measure(board, rest),
    }
});

fn look(place: &[u8], board: Board, rest: &[u8]) {
    let sheet = poster::paint(rest);
    let (width, height) = (sheet.width as u32, sheet.height as u32);
    let mut picture = GrayImage::from_raw(width, height, sheet.pixels).expect("a byte a pixel");
    paint(&mut picture, place, board);
    let Some(corners) = find_chessboard(&picture, board) else {
        return;
    };
    assert_eq!(corners.len(), board.columns * board.rows);
    let inside = |value: f64, length: u32| (0.0..=f64::from(length)).contains(&value);
    let seen = corners.iter().all(|[x, y]| inside(*x, width) && inside(*y, height));
    assert!(seen, "beyond {width} x {height}: {corners:?}");
}

/// Paints a board that is rotated, stretched and in perspective; its white squares are transparent.
fn paint(picture: &mut GrayImage, place: &[u8], board: Board) {
    let number = |index: usize| f64::from(place[index]) - 128.0;
    let (middle_x, middle_y) = (160.0 + number(0) / 2.0, 120.0 + number(1) / 2.0);
    let (sine, cosine) = (number(2) / 40.0).sin_cos();
    let (wide, high) = (4.0 + f64::from(place[3]) / 8.0, 4.0 + f64::from(place[4]) / 8.0);
    let (lean_x, lean_y) = (number(5) / 100_000.0, number(6) / 100_000.0);
    let (columns, rows) = (board.columns as f64 + 1.0, board.rows as f64 + 1.0);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let (x, y) = (f64::from(x) - middle_x, f64::from(y) - middle_y);
        let depth = 1.0 + lean_x * x + lean_y * y;
        let (along, down) = ((cosine * x + sine * y) / depth, (cosine * y - sine * x) / depth);
        let (column, row) = (along / wide + columns / 2.0, down / high + rows / 2.0);
        let is_on = (0.0..columns).contains(&column) && (0.0..rows).contains(&row);
        if is_on && (column as i64 + row as i64) % 2 == 0 {
            *pixel = Luma([place[7] / 2]);
        }
    }
}

fn measure(board: Board, bytes: &[u8]) {
    let size = Size { width: 320, height: 240 };
    let views = bytes.chunks_exact(VIEW).take(VIEWS);
    let sightings: Vec<Sighting> = views.map(|view| sighting(view, board)).collect();
    let Ok(found) = calibrate(&sightings, board, size) else {
        return;
    };
    assert_eq!(found.errors.len(), sightings.len());
    assert!(found.errors.iter().all(|error| error.is_finite()), "{found:?}");
    assert!(found.uncertainty.is_finite() && found.uncertainty >= 0.0, "{found:?}");
    let [k1, k2] = found.camera.distortion;
    let pasted = format!("camera: {{ hfov: {:.4}, distortion: [{k1:.4}, {k2:.4}] }}", found.camera.hfov);
    let config = Config::parse(&pasted, "fuzz.yaml").unwrap_or_else(|error| panic!("{pasted}: {error}"));
    assert!((config.camera.hfov - found.camera.hfov).abs() < 0.001);
}

/// Returns the corners of a board in some pose as seen through some lens, with one corner
/// displaced.
fn sighting(view: &[u8], board: Board) -> Sighting {
    let number = |index: usize| (f64::from(view[index]) - 128.0) / 128.0;
    let (focal, k1, k2) = (300.0 + 250.0 * number(0), 0.5 * number(1), 0.3 * number(2));
    let (tilt, lean, turn) = (number(3), number(4), 3.0 * number(5));
    let far = 14.0 + 10.0 * number(6);
    let astray = usize::from(view[7]) % (board.columns * board.rows);
    let corner = |index: usize| {
        let (x, y) = ((index % board.columns) as f64 - 4.0, (index / board.columns) as f64 - 3.0);
        let (x, y) = (x * turn.cos() - y * turn.sin(), x * turn.sin() + y * turn.cos());
        let ahead = far + tilt * x + lean * y;
        let (x, y) = ((x + 3.0 * number(8)) / ahead, (y + 3.0 * number(9)) / ahead);
        let square = x * x + y * y;
        let scale = focal * (1.0 + square * (k1 + k2 * square));
        let off = if index == astray { 1000.0 * number(10).powi(9) } else { 0.2 * number(11) };
        [159.5 + x * scale + off, 119.5 + y * scale - off]
    };
    (0..board.columns * board.rows).map(corner).collect()
}
