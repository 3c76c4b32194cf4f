//! Encodes the simulator's frames as baseline JPEGs. The `jpeg_encoder` crate writes the headers,
//! including the tables; the pixels are encoded here in half of that crate's time, because encoding
//! takes most of the time of a simulation with pictures (`scripts/bench-fast`). Shares no code with
//! the decoder, so that an error in one is not hidden by the same error in the other.

mod bit_writer;
mod dct;
mod subsampling;
mod tables;
#[cfg(test)]
mod tests;

use bytes::Bytes;

use self::bit_writer::BitWriter;
use self::dct::{Block, SIDE, transform, transposed};
pub use self::subsampling::Subsampling;
use self::tables::{Codes, ZIGZAG, codes, factors, head, nonzero_ac};

/// Red, green, blue and an unused byte.
pub(crate) type Pixel = [u8; 4];

/// Encodes frames of one size.
pub struct Encoder {
    width: usize,
    subsampling: Subsampling,
    /// The headers: everything before the pixel data.
    head: Vec<u8>,
    luma: Coder,
    chroma: Coder,
    planes: [Vec<f32>; 3],
}

/// The tables with which the blocks of a component are encoded.
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
    pub fn new(quality: u8, subsampling: Subsampling, (width, height): (u16, u16)) -> Encoder {
        let head = head(quality, subsampling, (width, height)).unwrap_or_else(|error| {
            // Writing to memory with a valid size does not fail.
            tracing::error!(target: "spykee::sim", %error, "cannot encode frames");
            Vec::new()
        });
        let coder = |id| Coder {
            factors: factors(&head, id),
            dc_codes: codes(&head, id),
            ac_codes: codes(&head, 0x10 | id),
        };
        let (luma, chroma) = (coder(0), coder(1));
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

/// The block of a plane that begins at this column and row.
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
        let (values, factors) = (block.as_flattened(), self.factors.as_flattened());
        std::array::from_fn(|i| (values[i] * factors[i] + NEAREST).to_bits() as i16)
    }
}
