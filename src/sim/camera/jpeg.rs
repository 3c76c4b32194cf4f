//! Frames as baseline JPEGs. What a file begins with, tables included, is made by `jpeg_encoder`;
//! the pixels are coded here, in half of that crate's time: with pictures, an hour of virtual time
//! is little else.

use std::ops::Range;

use bytes::Bytes;
use jpeg_encoder::{ColorType, EncodingError, SamplingFactor};

use super::texture::Pixel;
use super::view::{HEIGHT, WIDTH};
use crate::sim::world::settings::Subsampling;

/// Rows and columns of a block.
const SIDE: usize = 8;

/// A block: rows of columns; once transformed, horizontal frequencies of vertical ones.
type Block = [[f32; SIDE]; SIDE];

/// Encodes frames of [`WIDTH`] by [`HEIGHT`] pixels.
pub(crate) struct Encoder {
    subsampling: Subsampling,
    /// All that stands before the pixels.
    head: Vec<u8>,
    luma: Coder,
    chroma: Coder,
    planes: [Vec<f32>; 3],
}

/// How the blocks of a component are coded.
struct Coder {
    /// What a frequency is multiplied by, as the blocks have them.
    factors: Block,
    /// By the number of bits of a difference.
    dc: Codes,
    /// By the zeros before a value, times 16, and the number of its bits.
    ac: Codes,
}

/// The code of each symbol and its length.
type Codes = [(u32, u32); 256];

impl Encoder {
    /// `quality` from 1 to 100.
    pub(crate) fn new(quality: u8, subsampling: Subsampling) -> Encoder {
        let head = head(quality, subsampling).unwrap_or_else(|error| {
            // Into memory and with a size that is right, it does not fail.
            tracing::error!(target: "spykee::sim", %error, "cannot encode frames");
            Vec::new()
        });
        let coder = |id| Coder {
            factors: factors(table(&head, QUANTISERS, id)),
            dc: codes(table(&head, CODES, id)),
            ac: codes(table(&head, CODES, 0x10 | id)),
        };
        let (luma, chroma) = (coder(0), coder(1));
        Encoder {
            subsampling,
            luma,
            chroma,
            head,
            planes: Default::default(),
        }
    }

    /// A frame as a JPEG.
    pub(crate) fn encode(&mut self, frame: &[Pixel]) -> Bytes {
        let mut bits = Bits::after(&self.head);
        let (across, down) = match self.subsampling {
            Subsampling::None => (1, 1),
            Subsampling::Half => (2, 1),
            Subsampling::Quarter => (2, 2),
        };
        let mut before = [0; 3];
        for rows in frame.chunks_exact(WIDTH * SIDE * down) {
            self.split(rows);
            let [luma, blue, red] = &self.planes;
            for column in (0..WIDTH).step_by(SIDE * across) {
                for y in 0..down {
                    for x in 0..across {
                        let block = block(luma, column + x * SIDE, y * SIDE);
                        self.luma.code(block, &mut before[0], &mut bits);
                    }
                }
                for (plane, before) in [blue, red].into_iter().zip(&mut before[1..]) {
                    let block = match self.subsampling {
                        Subsampling::None => block(plane, column, 0),
                        Subsampling::Half => mean::<2, 1>(plane, column),
                        Subsampling::Quarter => mean::<2, 2>(plane, column),
                    };
                    self.chroma.code(block, before, &mut bits);
                }
            }
        }
        bits.end()
    }

    /// Luma and chroma of some rows, all around 0 (JFIF 1.02, page 3).
    fn split(&mut self, rows: &[Pixel]) {
        let [luma, blue, red] = &mut self.planes;
        for plane in [&mut *luma, &mut *blue, &mut *red] {
            plane.resize(rows.len(), 0.0);
        }
        let planes = luma.iter_mut().zip(blue).zip(red);
        for (((luma, blue), red), pixel) in planes.zip(rows) {
            let [r, g, b] = [pixel[0], pixel[1], pixel[2]].map(f32::from);
            *luma = 0.299 * r + 0.587 * g + 0.114 * b - 128.0;
            *blue = 0.5 * b - 0.168_736 * r - 0.331_264 * g;
            *red = 0.5 * r - 0.418_688 * g - 0.081_312 * b;
        }
    }
}

/// The block of a plane that begins there.
fn block(plane: &[f32], column: usize, row: usize) -> Block {
    std::array::from_fn(|y| {
        let line = &plane[(row + y) * WIDTH + column..][..SIDE];
        std::array::from_fn(|x| line[x])
    })
}

/// The block that begins in a column of a plane's first row, each value the mean of so many.
fn mean<const ACROSS: usize, const DOWN: usize>(plane: &[f32], column: usize) -> Block {
    std::array::from_fn(|y| {
        let mut sums = [0.0; SIDE];
        for line in 0..DOWN {
            let line = &plane[(y * DOWN + line) * WIDTH + column..][..SIDE * ACROSS];
            for (sum, some) in sums.iter_mut().zip(line.chunks_exact(ACROSS)) {
                *sum += some.iter().sum::<f32>();
            }
        }
        sums.map(|sum| sum / (ACROSS * DOWN) as f32)
    })
}

impl Coder {
    fn code(&self, mut block: Block, before: &mut i32, bits: &mut Bits) {
        transform(&mut block);
        let mut block = transposed(&block);
        transform(&mut block);
        let values = self.rounded(&block);
        let difference = i32::from(values[0]) - *before;
        *before = i32::from(values[0]);
        bits.push_value(&self.dc, 0, difference);
        let mut last = 0;
        let mut left = others(&values);
        while left != 0 {
            let index = left.trailing_zeros();
            left &= left - 1;
            let mut zeros = index - last - 1;
            last = index;
            while zeros > 15 {
                bits.push_code(&self.ac, 0xF0);
                zeros -= 16;
            }
            let value = values[usize::from(ZIGZAG[index as usize & 63])];
            bits.push_value(&self.ac, zeros, i32::from(value));
        }
        if last < 63 {
            bits.push_code(&self.ac, 0);
        }
    }

    fn rounded(&self, block: &Block) -> [i16; SIDE * SIDE] {
        // In the sum's last bits stands the nearest whole number: much faster than to ask for it.
        const NEAREST: f32 = 12_582_912.0;
        let (values, factors) = (block.as_flattened(), self.factors.as_flattened());
        std::array::from_fn(|i| (values[i] * factors[i] + NEAREST).to_bits() as i16)
    }
}

/// The discrete cosine transform of every column at once, scaled by what [`scale`] says (Arai, Agui
/// and Nakajima, 1988).
fn transform(block: &mut Block) {
    const COS_2: f32 = 0.382_683_43;
    const COS_4: f32 = std::f32::consts::FRAC_1_SQRT_2;
    #[expect(clippy::needless_range_loop, reason = "every row has the column")]
    for column in 0..SIDE {
        let (a, b) = (block[0][column], block[1][column]);
        let (c, d) = (block[2][column], block[3][column]);
        let (e, f) = (block[4][column], block[5][column]);
        let (g, h) = (block[6][column], block[7][column]);
        let outer = [a + h, b + g, c + f, d + e];
        let [s0, s1, s2, s3] = [d - e, c - f, b - g, a - h];
        let (p0, p3) = (outer[0] + outer[3], outer[0] - outer[3]);
        let (p1, p2) = (outer[1] + outer[2], outer[1] - outer[2]);
        let turned = (p2 + p3) * COS_4;
        let (q0, q1, q2) = (s0 + s1, s1 + s2, s2 + s3);
        let shared = (q0 - q2) * COS_2;
        let low = q0 * 0.541_196_1 + shared;
        let high = q2 * 1.306_563 + shared;
        let middle = q1 * COS_4;
        let (near, far) = (s3 + middle, s3 - middle);
        let frequencies = [
            p0 + p1,
            near + high,
            p3 + turned,
            far - low,
            p0 - p1,
            far + low,
            p3 - turned,
            near - high,
        ];
        for (row, frequency) in frequencies.into_iter().enumerate() {
            block[row][column] = frequency;
        }
    }
}

fn transposed(block: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| block[j][i]))
}

/// How many times too large [`transform`] makes a frequency.
fn scale(frequency: usize) -> f64 {
    let angle = frequency as f64 * std::f64::consts::PI / 16.0;
    let scale = if frequency == 0 {
        1.0
    } else {
        angle.cos() * std::f64::consts::SQRT_2
    };
    scale * 8f64.sqrt()
}

/// Where in a transformed block each of a file's frequencies is (T.81, figure A.6).
const ZIGZAG: [u8; SIDE * SIDE] = {
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

fn factor(subsampling: Subsampling) -> SamplingFactor {
    match subsampling {
        Subsampling::None => SamplingFactor::F_1_1,
        Subsampling::Half => SamplingFactor::F_2_1,
        Subsampling::Quarter => SamplingFactor::F_2_2,
    }
}

/// The place in a file of each place in a block.
const ORDER: [u8; SIDE * SIDE] = {
    let mut order = [0; SIDE * SIDE];
    let mut index = 0;
    while index < SIDE * SIDE {
        order[ZIGZAG[index] as usize] = index as u8;
        index += 1;
    }
    order
};

/// A bit for each value but the first that is not 0, in the order of a file. Most values are 0.
fn others(values: &[i16; SIDE * SIDE]) -> u64 {
    let present: [u8; SIDE * SIDE] = std::array::from_fn(|i| u8::from(values[i] != 0));
    let mut bits = 0;
    for (row, order) in present.chunks_exact(SIDE).zip(ORDER.chunks_exact(SIDE)) {
        for (present, place) in row.iter().zip(order) {
            bits |= u64::from(*present) << place;
        }
    }
    bits & !1
}

/// A file up to its pixels.
fn head(quality: u8, subsampling: Subsampling) -> Result<Vec<u8>, EncodingError> {
    let mut file = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(factor(subsampling));
    let black = vec![0; WIDTH * HEIGHT * 3];
    encoder.encode(&black, WIDTH as u16, HEIGHT as u16, ColorType::Rgb)?;
    let end = segments(&file).last().map_or(0, |segment| segment.end);
    file.truncate(end);
    Ok(file)
}

const QUANTISERS: u8 = 0xDB;
const CODES: u8 = 0xC4;
const SCAN: u8 = 0xDA;

/// Where the segments of a file are, markers included, as far as the one before its pixels.
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

/// The table of a kind and a number, without them.
fn table(file: &[u8], marker: u8, id: u8) -> &[u8] {
    let mut all = segments(file).filter_map(|segment| file.get(segment));
    let found = all.find(|segment| segment[1] == marker && segment[4] == id);
    found.map_or(&[], |segment| &segment[5..])
}

fn factors(quantisers: &[u8]) -> Block {
    let mut factors = [0.0; SIDE * SIDE];
    for (place, quantiser) in ZIGZAG.into_iter().zip(quantisers) {
        let place = usize::from(place);
        let scale = scale(place / SIDE) * scale(place % SIDE);
        factors[place] = (1.0 / (f64::from(*quantiser) * scale)) as f32;
    }
    std::array::from_fn(|u| std::array::from_fn(|v| factors[u * SIDE + v]))
}

/// From how many codes there are of each length, and their symbols (T.81, annex C).
fn codes(table: &[u8]) -> Codes {
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

/// A file to which bits are appended.
struct Bits {
    file: Vec<u8>,
    /// Those that are not in the file yet, as its last ones.
    waiting: u64,
    count: u32,
}

impl Bits {
    fn after(head: &[u8]) -> Bits {
        let mut file = Vec::with_capacity(16 * 1024);
        file.extend_from_slice(head);
        Bits {
            file,
            waiting: 0,
            count: 0,
        }
    }

    /// A value: the code of `zeros` and of the value's length, and its bits (T.81, F.1.2).
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

    /// At most 32.
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

    const ALL: [Subsampling; 3] = [Subsampling::None, Subsampling::Half, Subsampling::Quarter];

    /// A slope of grey and one of colour, with sharp edges and noise.
    fn picture(seed: u64) -> Vec<Pixel> {
        let mut random = StdRng::seed_from_u64(seed);
        let mut pixel = |index: usize| {
            let (x, y) = (index % WIDTH, index / WIDTH);
            let edge = if (x / 50 + y / 37) % 2 == 0 { 60 } else { 0 };
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
        let size = (WIDTH as u16, HEIGHT as u16);
        let pixels = frame.as_flattened();
        encoder
            .encode(pixels, size.0, size.1, ColorType::Rgba)
            .unwrap();
        file
    }

    /// Root of the mean square of the differences.
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
    fn files_are_as_true_and_as_short_as_those_of_the_crate() {
        for (quality, subsampling) in [1, 30, 75, 95, 100]
            .into_iter()
            .flat_map(|quality| ALL.map(|kind| (quality, kind)))
        {
            let frame = picture(u64::from(quality));
            let file = Encoder::new(quality, subsampling).encode(&frame);
            let other = of_the_crate(&frame, quality, subsampling);
            let (own, other_error) = (
                error(&decoded(&file), &frame),
                error(&decoded(&other), &frame),
            );
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
    fn an_encoder_codes_one_frame_as_it_does_another() {
        let mut encoder = Encoder::new(75, Subsampling::Half);
        let first = encoder.encode(&picture(1));
        assert_ne!(encoder.encode(&picture(2)), first);
        assert_eq!(encoder.encode(&picture(1)), first);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// The worst that pixels can be, at every quality: nothing overflows, every file is whole.
        #[test]
        fn any_pixels_are_a_file(seed: u64, quality in 1u8..=100, kind in 0usize..3, extremes: bool) {
            let mut random = StdRng::seed_from_u64(seed);
            let frame: Vec<Pixel> = (0..WIDTH * HEIGHT)
                .map(|_| random.random::<Pixel>().map(|level| if extremes { level / 128 * 255 } else { level }))
                .collect();
            let file = Encoder::new(quality, ALL[kind]).encode(&frame);
            let image = decoded(&file);
            let other = decoded(&of_the_crate(&frame, quality, ALL[kind]));
            prop_assert!(error(&image, &frame) <= error(&other, &frame) * 1.05 + 0.1);
        }
    }
}
