//! The headers of a file as written by `jpeg_encoder`, and the tables in them.

use std::ops::Range;

use jpeg_encoder::{ColorType, EncodingError};

use super::dct::{Block, SIDE, scale};
use super::subsampling::{Subsampling, factor};

/// The code of each symbol and its length in bits.
pub(super) type Codes = [(u32, u32); 256];

/// The position in a transformed block of each coefficient in file order (T.81, figure A.6).
pub(super) const ZIGZAG: [u8; SIDE * SIDE] = {
    let mut places = [0; SIDE * SIDE];
    let (mut u, mut v) = (0, 0);
    let mut index = 0;
    while index < SIDE * SIDE {
        places[index] = (u * SIDE + v) as u8;
        let up = (u + v) % 2 == 0;
        match (up, u, v) {
            (true, 7, _) => v += 1,
            (true, _, 0) => u += 1,
            (true, ..) => (u, v) = (u + 1, v - 1),
            (false, _, 7) => u += 1,
            (false, 0, _) => v += 1,
            (false, ..) => (u, v) = (u - 1, v + 1),
        }
        index += 1;
    }
    places
};

/// The position in file order of each coefficient of a block.
const ORDER: [u8; SIDE * SIDE] = {
    let mut order = [0; SIDE * SIDE];
    let mut index = 0;
    while index < SIDE * SIDE {
        order[ZIGZAG[index] as usize] = index as u8;
        index += 1;
    }
    order
};

/// A bit for each AC value that is not 0, in file order. Most values are 0.
pub(super) fn nonzero_ac(values: &[i16; SIDE * SIDE]) -> u64 {
    let present: [u8; SIDE * SIDE] = std::array::from_fn(|i| u8::from(values[i] != 0));
    let mut bits = 0;
    for (row, order) in present.chunks_exact(SIDE).zip(ORDER.chunks_exact(SIDE)) {
        for (present, place) in row.iter().zip(order) {
            bits |= u64::from(*present) << place;
        }
    }
    bits & !1
}

/// A file up to its pixel data.
pub(super) fn head(
    quality: u8,
    subsampling: Subsampling,
    (width, height): (u16, u16),
) -> Result<Vec<u8>, EncodingError> {
    let mut file = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(factor(subsampling));
    let black = vec![0; usize::from(width) * usize::from(height) * 3];
    encoder.encode(&black, width, height, ColorType::Rgb)?;
    let end = segments(&file).last().map_or(0, |segment| segment.end);
    file.truncate(end);
    match_robot_headers(&mut file);
    Ok(file)
}

/// Sets version 1.01 of JFIF and the component ids 1, 2 and 3, as in the frames of robots
/// (`PROTOCOL.md`, VIDEO).
fn match_robot_headers(file: &mut [u8]) {
    let places: Vec<Range<usize>> = segments(file).collect();
    for place in places {
        let Some(segment) = file.get_mut(place) else {
            continue;
        };
        let (first, step) = match segment {
            [_, START, _, _, b'J', b'F', b'I', b'F', 0, major, minor, ..] => {
                (*major, *minor) = (1, 1);
                continue;
            }
            [_, FRAME, ..] => (10, 3),
            [_, SCAN, ..] => (5, 2),
            _ => continue,
        };
        for (id, at) in (1..=3).zip((first..).step_by(step)) {
            if let Some(byte) = segment.get_mut(at) {
                *byte = id;
            }
        }
    }
}

const START: u8 = 0xE0;
const FRAME: u8 = 0xC0;
const QUANTISERS: u8 = 0xDB;
const CODES: u8 = 0xC4;
const SCAN: u8 = 0xDA;

/// The ranges of a file's segments, including the markers, up to the scan header.
fn segments(file: &[u8]) -> impl Iterator<Item = Range<usize>> {
    let mut next = Some(2);
    std::iter::from_fn(move || {
        let start = next?;
        let [_, marker, high, low] = *file.get(start..)?.first_chunk()?;
        let end = start + 2 + usize::from(u16::from_be_bytes([high, low]));
        next = (marker != SCAN).then_some(end);
        Some(start..end)
    })
}

/// The content of the table with this marker and number, without both.
fn table(file: &[u8], marker: u8, id: u8) -> &[u8] {
    let mut all = segments(file).filter_map(|segment| file.get(segment));
    let found = all.find(|segment| segment[1] == marker && segment[4] == id);
    found.map_or(&[], |segment| &segment[5..])
}

/// The factors of a component's coefficients, from the quantisers in a file's headers.
pub(super) fn factors(head: &[u8], id: u8) -> Block {
    let quantisers = table(head, QUANTISERS, id);
    let mut factors = [0.0; SIDE * SIDE];
    for (place, quantiser) in ZIGZAG.into_iter().zip(quantisers) {
        let place = usize::from(place);
        let scale = scale(place / SIDE) * scale(place % SIDE);
        factors[place] = (1.0 / (f64::from(*quantiser) * scale)) as f32;
    }
    std::array::from_fn(|u| std::array::from_fn(|v| factors[u * SIDE + v]))
}

/// Builds the codes from the number of codes of each length and their symbols (T.81, annex C).
pub(super) fn codes(head: &[u8], id: u8) -> Codes {
    let table = table(head, CODES, id);
    let mut codes = [(0, 0); 256];
    let (counts, mut symbols) = table.split_at(table.len().min(16));
    let mut code = 0;
    for (count, len) in counts.iter().zip(1..) {
        let these;
        (these, symbols) = symbols.split_at(symbols.len().min(usize::from(*count)));
        for symbol in these {
            codes[usize::from(*symbol)] = (code, len);
            code += 1;
        }
        code <<= 1;
    }
    codes
}
