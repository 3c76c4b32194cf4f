//! Encodes the simulator's frames as baseline JPEGs. The `jpeg_encoder` crate writes the headers,
//! including the tables; the pixels are encoded here in half of that crate's time, because encoding
//! takes most of the time of a simulation with pictures (`scripts/bench-fast`). Shares no code with
//! the decoder, so that an error in one is not hidden by the same error in the other.

use std::ops::Range;

use bytes::Bytes;
use jpeg_encoder::{ColorType, EncodingError, SamplingFactor};
use serde::Deserialize;

pub(crate) type Pixel = [u8; 4];

/// How much of the chroma resolution a JPEG omits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
pub enum Subsampling {
    /// Full chroma resolution.
    #[serde(rename = "4:4:4")]
    None,
    /// Half the columns.
    #[serde(rename = "4:2:2")]
    Half,
    /// Half the columns and half the rows.
    #[default]
    #[serde(rename = "4:2:0")]
    Quarter,
}

fn factor(subsampling: Subsampling) -> SamplingFactor {
    match subsampling {
        Subsampling::None => SamplingFactor::F_1_1,
        Subsampling::Half => SamplingFactor::F_2_1,
        Subsampling::Quarter => SamplingFactor::F_2_2,
    }
}

/// Encodes frames of one size.
pub struct Encoder {
    width: usize,
    subsampling: Subsampling,
    head: Vec<u8>,
    luma: Coder,
    chroma: Coder,
    planes: [Vec<f32>; 3],
}

struct Coder {
    /// The factor of each coefficient, in the order of a block.
    factors: Block,
    /// Indexed by the number of bits of a DC difference.
    dc_codes: Codes,
    /// Indexed by 16 times the zeros before a value, plus the number of its bits.
    ac_codes: Codes,
}

impl Encoder {
    /// `quality` is 1 to 100; width and height must be multiples of 16.
    pub fn new(quality: u8, subsampling: Subsampling, width: u16, height: u16) -> Encoder {
        let head = head(quality, subsampling, width, height).unwrap_or_else(|error| {
            // Writing to memory with a valid size does not fail.
            tracing::error!(target: "spykee::sim", %error, "cannot encode frames");
            Vec::new()
        });
        let coder = |id| Coder {
            factors: factors(&head, id),
            dc_codes: codes(&head, id),
            ac_codes: codes(&head, 0x10 | id),
        };
        let luma = coder(0);
        let chroma = coder(1);
        Encoder {
            width: usize::from(width),
            subsampling,
            luma,
            chroma,
            head,
            planes: Default::default(),
        }
    }

    /// Encodes a frame as a JPEG.
    pub fn encode(&mut self, frame: &[Pixel]) -> Bytes {
        let mut bits = BitWriter::after(&self.head);
        let (across, down) = match self.subsampling {
            Subsampling::None => (1, 1),
            Subsampling::Half => (2, 1),
            Subsampling::Quarter => (2, 2),
        };
        let width = self.width;
        let mut predictors = [0; 3];
        for rows in frame.chunks_exact(self.width * SIDE * down) {
            self.split(rows);
            let [luma, cb, cr] = &self.planes;
            for column in (0..self.width).step_by(SIDE * across) {
                for y in 0..down {
                    for x in 0..across {
                        let block = block(luma, width, column + x * SIDE, y * SIDE);
                        self.luma.code(block, &mut predictors[0], &mut bits);
                    }
                }
                for (plane, predictor) in [cb, cr].into_iter().zip(&mut predictors[1..]) {
                    let block = match self.subsampling {
                        Subsampling::None => block(plane, width, column, 0),
                        Subsampling::Half => mean::<2, 1>(plane, width, column),
                        Subsampling::Quarter => mean::<2, 2>(plane, width, column),
                    };
                    self.chroma.code(block, predictor, &mut bits);
                }
            }
        }
        bits.end()
    }

    /// Converts some rows to luma, Cb and Cr, all centred on 0 (JFIF 1.02, page 3).
    fn split(&mut self, rows: &[Pixel]) {
        let [luma, cb, cr] = &mut self.planes;
        for plane in [&mut *luma, &mut *cb, &mut *cr] {
            plane.resize(rows.len(), 0.0);
        }
        let planes = luma.iter_mut().zip(cb).zip(cr);
        for (((luma, cb), cr), pixel) in planes.zip(rows) {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(f32::from);
            *luma = 0.299 * r + 0.587 * g + 0.114 * b - 128.0;
            *cb = 0.5 * b - 0.168_736 * r - 0.331_264 * g;
            *cr = 0.5 * r - 0.418_688 * g - 0.081_312 * b;
        }
    }
}

fn block(plane: &[f32], width: usize, column: usize, row: usize) -> Block {
    std::array::from_fn(|y| {
        let line = &plane[(row + y) * width + column..][..SIDE];
        std::array::from_fn(|x| line[x])
    })
}

/// The block that begins at this column of a plane's first row, each value the mean of `ACROSS` by
/// `DOWN` values.
fn mean<const ACROSS: usize, const DOWN: usize>(
    plane: &[f32],
    width: usize,
    column: usize,
) -> Block {
    std::array::from_fn(|y| {
        let mut sums = [0.0; SIDE];
        for line in 0..DOWN {
            let line = &plane[(y * DOWN + line) * width + column..][..SIDE * ACROSS];
            for (sum, some) in sums.iter_mut().zip(line.chunks_exact(ACROSS)) {
                *sum += some.iter().sum::<f32>();
            }
        }
        sums.map(|sum| sum / (ACROSS * DOWN) as f32)
    })
}

impl Coder {
    fn code(&self, mut block: Block, predictor: &mut i32, bits: &mut BitWriter) {
        transform(&mut block);
        let mut block = transposed(&block);
        transform(&mut block);
        let values = self.rounded(&block);
        let difference = i32::from(values[0]) - *predictor;
        *predictor = i32::from(values[0]);
        bits.push_value(&self.dc_codes, 0, difference);
        let mut last = 0;
        let mut left = nonzero_ac(&values);
        while left != 0 {
            let index = left.trailing_zeros();
            left &= left - 1;
            let mut zeros = index - last - 1;
            last = index;
            while zeros > 15 {
                bits.push_code(&self.ac_codes, 0xF0);
                zeros -= 16;
            }
            let value = values[usize::from(ZIGZAG[index as usize & 63])];
            bits.push_value(&self.ac_codes, zeros, i32::from(value));
        }
        if last < 63 {
            bits.push_code(&self.ac_codes, 0);
        }
    }

    fn rounded(&self, block: &Block) -> [i16; SIDE * SIDE] {
        // Adding this constant rounds a value to the nearest integer, which is then in the lowest
        // bits of the sum: much faster than a call.
        const NEAREST: f32 = 12_582_912.0;
        let values = block.as_flattened();
        let factors = self.factors.as_flattened();
        std::array::from_fn(|i| (values[i] * factors[i] + NEAREST).to_bits() as i16)
    }
}

/// Number of rows and of columns of a block.
const SIDE: usize = 8;

/// A block as rows of columns; after the transform, horizontal coefficients of vertical ones.
type Block = [[f32; SIDE]; SIDE];

/// Transforms every column at once; the results are scaled by [`scale`] (Arai, Agui and Nakajima,
/// 1988).
fn transform(block: &mut Block) {
    const COS_2: f32 = 0.382_683_43;
    const COS_4: f32 = std::f32::consts::FRAC_1_SQRT_2;
    #[expect(clippy::needless_range_loop, reason = "every row has the column")]
    for column in 0..SIDE {
        let a = block[0][column];
        let b = block[1][column];
        let c = block[2][column];
        let d = block[3][column];
        let e = block[4][column];
        let f = block[5][column];
        let g = block[6][column];
        let h = block[7][column];
        let outer = [a + h, b + g, c + f, d + e];
        let [s0, s1, s2, s3] = [d - e, c - f, b - g, a - h];
        let p0 = outer[0] + outer[3];
        let p3 = outer[0] - outer[3];
        let p1 = outer[1] + outer[2];
        let p2 = outer[1] - outer[2];
        let turned = (p2 + p3) * COS_4;
        let q0 = s0 + s1;
        let q1 = s1 + s2;
        let q2 = s2 + s3;
        let shared = (q0 - q2) * COS_2;
        let low = q0 * 0.541_196_1 + shared;
        let high = q2 * 1.306_563 + shared;
        let middle = q1 * COS_4;
        let near = s3 + middle;
        let far = s3 - middle;
        let coefficients = [
            p0 + p1,
            near + high,
            p3 + turned,
            far - low,
            p0 - p1,
            far + low,
            p3 - turned,
            near - high,
        ];
        for (row, coefficient) in coefficients.into_iter().enumerate() {
            block[row][column] = coefficient;
        }
    }
}

fn transposed(block: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| block[j][i]))
}

/// The factor by which [`transform`] makes a coefficient too large.
fn scale(coefficient: usize) -> f64 {
    let angle = coefficient as f64 * std::f64::consts::PI / 16.0;
    let scale = if coefficient == 0 {
        1.0
    } else {
        angle.cos() * std::f64::consts::SQRT_2
    };
    scale * 8f64.sqrt()
}

type Codes = [(u32, u32); 256];

/// The position in a transformed block of each coefficient in file order (T.81, figure A.6).
const ZIGZAG: [u8; SIDE * SIDE] = {
    let mut places = [0; SIDE * SIDE];
    let mut u = 0;
    let mut v = 0;
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
fn nonzero_ac(values: &[i16; SIDE * SIDE]) -> u64 {
    let present: [u8; SIDE * SIDE] = std::array::from_fn(|i| u8::from(values[i] != 0));
    let mut bits = 0;
    for (row, order) in present.chunks_exact(SIDE).zip(ORDER.chunks_exact(SIDE)) {
        for (present, place) in row.iter().zip(order) {
            bits |= u64::from(*present) << place;
        }
    }
    bits & !1
}

fn head(
    quality: u8,
    subsampling: Subsampling,
    width: u16,
    height: u16,
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
fn factors(head: &[u8], id: u8) -> Block {
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
fn codes(head: &[u8], id: u8) -> Codes {
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

struct BitWriter {
    file: Vec<u8>,
    waiting: u64,
    count: u32,
}

impl BitWriter {
    fn after(head: &[u8]) -> BitWriter {
        let mut file = Vec::with_capacity(16 * 1024);
        file.extend_from_slice(head);
        BitWriter {
            file,
            waiting: 0,
            count: 0,
        }
    }

    /// Writes a value: the code of `zeros` and of the value's length, and its bits (T.81, F.1.2).
    fn push_value(&mut self, codes: &Codes, zeros: u32, value: i32) {
        let len = 32 - value.unsigned_abs().leading_zeros();
        let (code, code_len) = codes[(zeros << 4 | len) as usize & 255];
        let ones = (1 << len) - 1;
        let bits = (value + (value >> 31)) as u32 & ones;
        self.push(code << len | bits, code_len + len);
    }

    fn push_code(&mut self, codes: &Codes, symbol: u8) {
        let (code, len) = codes[usize::from(symbol)];
        self.push(code, len);
    }

    fn push(&mut self, bits: u32, len: u32) {
        self.waiting = self.waiting << len | u64::from(bits);
        self.count += len;
        if self.count >= 32 {
            self.count -= 32;
            let four = ((self.waiting >> self.count) as u32).to_be_bytes();
            if four.contains(&0xFF) {
                four.into_iter().for_each(|byte| self.put(byte));
            } else {
                self.file.extend_from_slice(&four);
            }
        }
    }

    fn put(&mut self, byte: u8) {
        self.file.push(byte);
        if byte == 0xFF {
            self.file.push(0);
        }
    }

    fn end(mut self) -> Bytes {
        while self.count > 0 {
            let missing = 8u32.saturating_sub(self.count);
            self.waiting = self.waiting << missing | ((1 << missing) - 1);
            self.count = self.count + missing - 8;
            self.put((self.waiting >> self.count) as u8);
        }
        self.file.extend_from_slice(&[0xFF, 0xD9]);
        Bytes::from(self.file)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 240;
    const SIZE: (u16, u16) = (WIDTH as u16, HEIGHT as u16);

    const ALL: [Subsampling; 3] = [Subsampling::None, Subsampling::Half, Subsampling::Quarter];

    /// A grey and a coloured gradient with sharp edges and noise.
    fn picture(seed: u64) -> Vec<Pixel> {
        let mut random = StdRng::seed_from_u64(seed);
        let mut pixel = |index: usize| {
            let x = index % WIDTH;
            let y = index / WIDTH;
            let edge = if (x / 50 + y / 37).is_multiple_of(2) {
                60
            } else {
                0
            };
            let noise = random.random_range(0..8);
            [x / 2 + edge, y / 2 + edge, 255 - x / 3 - y / 3, 0]
                .map(|level| (level + noise).min(255) as u8)
        };
        (0..WIDTH * HEIGHT).map(&mut pixel).collect()
    }

    fn decoded(file: &[u8]) -> Vec<u8> {
        let image = image::load_from_memory(file).unwrap().to_rgb8();
        assert_eq!(image.dimensions(), (WIDTH as u32, HEIGHT as u32));
        image.into_raw()
    }

    fn of_the_crate(frame: &[Pixel], quality: u8, subsampling: Subsampling) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut file, quality);
        encoder.set_sampling_factor(factor(subsampling));
        let pixels = frame.as_flattened();
        encoder
            .encode(pixels, SIZE.0, SIZE.1, ColorType::Rgba)
            .unwrap();
        file
    }

    fn error(image: &[u8], frame: &[Pixel]) -> f64 {
        let channels = frame.iter().flat_map(|pixel| &pixel[..3]);
        let differences = image
            .iter()
            .zip(channels)
            .map(|(a, b)| f64::from(*a) - f64::from(*b));
        let sum: f64 = differences.map(|difference| difference * difference).sum();
        (sum / image.len() as f64).sqrt()
    }

    #[test]
    fn files_are_as_accurate_and_as_short_as_those_of_the_crate() {
        for (quality, subsampling) in [1, 30, 75, 95, 100]
            .into_iter()
            .flat_map(|quality| ALL.map(|kind| (quality, kind)))
        {
            let frame = picture(u64::from(quality));
            let file = Encoder::new(quality, subsampling, SIZE.0, SIZE.1).encode(&frame);
            let other = of_the_crate(&frame, quality, subsampling);
            let own = error(&decoded(&file), &frame);
            let other_error = error(&decoded(&other), &frame);
            assert!(
                own <= other_error * 1.02 + 0.05,
                "{quality} {subsampling:?}: {own} and {other_error}"
            );
            let ratio = file.len() as f64 / other.len() as f64;
            assert!(
                (0.8..1.05).contains(&ratio),
                "{quality} {subsampling:?}: {ratio}"
            );
        }
    }

    #[test]
    fn an_encoder_keeps_no_state_between_frames() {
        let mut encoder = Encoder::new(75, Subsampling::Half, SIZE.0, SIZE.1);
        let first = encoder.encode(&picture(1));
        assert_ne!(encoder.encode(&picture(2)), first);
        assert_eq!(encoder.encode(&picture(1)), first);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Extreme pixels at every quality: nothing overflows, and every file is complete.
        #[test]
        fn any_pixels_give_a_valid_file(seed: u64, quality in 1u8..=100, kind in 0usize..3, extremes: bool) {
            let mut random = StdRng::seed_from_u64(seed);
            let frame: Vec<Pixel> = (0..WIDTH * HEIGHT)
                .map(|_| random.random::<Pixel>().map(|level| if extremes { level / 128 * 255 } else { level }))
                .collect();
            let file = Encoder::new(quality, ALL[kind], SIZE.0, SIZE.1).encode(&frame);
            let image = decoded(&file);
            let other = decoded(&of_the_crate(&frame, quality, ALL[kind]));
            prop_assert!(error(&image, &frame) <= error(&other, &frame) * 1.05 + 0.1);
        }
    }
}
