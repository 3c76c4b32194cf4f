//! The inverse discrete cosine transform of Arai, Agui and Nakajima, whose factors are partly
//! folded into the quantisation table, in a form that compilers vectorise ([`super::machine`] does the
//! same for two blocks). Results are within two levels of the exact ones. Sums wrap, so damaged
//! data gives wrong samples and no panic.

/// Fractional bits during the transform.
const FRACTION: u32 = 3;
/// Additional fractional bits in the quantisation tables, whose smallest values would be inaccurate
/// otherwise.
const FINER: u32 = 8;

/// The storage position of each coefficient in a frame's zigzag order. Blocks are stored
/// transposed, because the first pass processes the block's columns.
pub(crate) const ZIGZAG: [u8; 64] = {
    let mut places = [0; 64];
    let mut row = 0;
    let mut column = 0;
    let mut index = 0;
    while index < 64 {
        places[index] = (column * 8 + row) as u8;
        index += 1;
        let is_upwards = (row + column) % 2 == 0;
        match (is_upwards, row, column) {
            (true, _, 7) => row += 1,
            (true, 0, _) => column += 1,
            (true, ..) => (row, column) = (row - 1, column + 1),
            (false, 7, _) => column += 1,
            (false, _, 0) => row += 1,
            (false, ..) => (row, column) = (row + 1, column - 1),
        }
    }
    places
};

/// The transform's factor of the n-th coefficient: cos(n pi / 16) times the square root of two, but
/// 1 for the first.
const FACTORS: [f64; 8] = [
    1.0,
    1.387_039_845,
    1.306_562_965,
    1.175_875_602,
    1.0,
    0.785_694_958,
    0.541_196_100,
    0.275_899_379,
];

/// A quantisation table (in zigzag order), multiplied by the transform's factors.
pub(crate) fn scaled(quantisers: &[u16; 64]) -> [i32; 64] {
    std::array::from_fn(|index| {
        let place = usize::from(ZIGZAG[index]);
        let factor =
            FACTORS[place / 8] * FACTORS[place % 8] * f64::from(1u32 << (FRACTION + FINER));
        (f64::from(quantisers[index]) * factor).round() as i32
    })
}

/// A coefficient of the frame multiplied by its entry of a [`scaled`] table.
#[inline(always)]
pub(crate) fn dequantised(coefficient: i32, quantiser: i32) -> i16 {
    (coefficient
        .wrapping_mul(quantiser)
        .wrapping_add(1 << (FINER - 1))
        >> FINER) as i16
}

/// Half a level plus the level shift of 128 that JPEG subtracts, at the scale of the first
/// coefficient.
pub(super) const BIAS: i16 = (128 << (FRACTION + 3)) + (1 << (FRACTION + 2));
/// Right shift that converts transformed values to samples.
pub(super) const SHIFT: u32 = FRACTION + 3;

type Block = [i16; 64];

/// The arithmetic of the transform, for a value of one column or the values of many columns at
/// once. Every implementation wraps in 16 bits, so all give bit-identical samples.
pub(super) trait Arithmetic: Copy {
    type Lanes: Copy;
    fn plus(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn minus(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    /// Multiplies by a fraction in units of 1/65536, below one half.
    fn times(self, value: Self::Lanes, fraction: i16) -> Self::Lanes;

    #[inline(always)]
    fn root(self, value: Self::Lanes) -> Self::Lanes {
        self.plus(value, self.times(value, 27_146))
    }
}

/// Processes one column at a time, in a form that compilers vectorise.
#[derive(Debug, Clone, Copy)]
struct Column;

impl Arithmetic for Column {
    type Lanes = i16;

    #[inline(always)]
    fn plus(self, a: i16, b: i16) -> i16 {
        a.wrapping_add(b)
    }

    #[inline(always)]
    fn minus(self, a: i16, b: i16) -> i16 {
        a.wrapping_sub(b)
    }

    #[inline(always)]
    fn times(self, value: i16, fraction: i16) -> i16 {
        ((i32::from(value) * i32::from(fraction)) >> 16) as i16
    }
}

/// Transforms columns: eight coefficients of each to eight values.
#[inline(always)]
pub(super) fn butterfly<A: Arithmetic>(a: A, i: [A::Lanes; 8]) -> [A::Lanes; 8] {
    // Even coefficients.
    let sum = a.plus(i[0], i[4]);
    let difference = a.minus(i[0], i[4]);
    let outer = a.plus(i[2], i[6]);
    let inner = a.minus(a.root(a.minus(i[2], i[6])), outer);
    let e0 = a.plus(sum, outer);
    let e3 = a.minus(sum, outer);
    let e1 = a.plus(difference, inner);
    let e2 = a.minus(difference, inner);
    // Odd coefficients, by 1.84776 = 2 - 0.15224, by 2.61313 = 3 - 0.38687 and by 1.08239.
    let z13 = a.plus(i[5], i[3]);
    let z10 = a.minus(i[5], i[3]);
    let z11 = a.plus(i[1], i[7]);
    let z12 = a.minus(i[1], i[7]);
    let o7 = a.plus(z11, z13);
    let crossed = a.plus(z10, z12);
    let z5 = a.minus(a.plus(crossed, crossed), a.times(crossed, 9_977));
    let tripled = a.plus(a.plus(z10, z10), z10);
    let o6 = a.minus(a.minus(z5, a.minus(tripled, a.times(z10, 25_354))), o7);
    let o5 = a.minus(a.root(a.minus(z11, z13)), o6);
    let o4 = a.plus(a.minus(a.plus(z12, a.times(z12, 5_400)), z5), o5);
    [
        a.plus(e0, o7),
        a.plus(e1, o6),
        a.plus(e2, o5),
        a.minus(e3, o4),
        a.plus(e3, o4),
        a.minus(e2, o5),
        a.minus(e1, o6),
        a.minus(e0, o7),
    ]
}

/// Transforms every column. Not inlined: within a larger function the compiler splits the loop
/// before it recognises that the eight columns can be vectorised together.
#[inline(never)]
fn pass(block: &mut Block) {
    for column in 0..8 {
        // Written out: a closure might not be inlined, which would prevent vectorisation.
        let i0 = block[column];
        let i1 = block[8 + column];
        let i2 = block[16 + column];
        let i3 = block[24 + column];
        let i4 = block[32 + column];
        let i5 = block[40 + column];
        let i6 = block[48 + column];
        let i7 = block[56 + column];
        let out = butterfly(Column, [i0, i1, i2, i3, i4, i5, i6, i7]);
        block[column] = out[0];
        block[8 + column] = out[1];
        block[16 + column] = out[2];
        block[24 + column] = out[3];
        block[32 + column] = out[4];
        block[40 + column] = out[5];
        block[48 + column] = out[6];
        block[56 + column] = out[7];
    }
}

/// Interleaves the halves of a block; three times in succession this transposes the block.
#[inline(never)]
fn weave(from: &Block, to: &mut Block) {
    for index in 0..32 {
        to[2 * index] = from[index];
        to[2 * index + 1] = from[index + 32];
    }
}

#[inline(never)]
fn levels(block: &Block, bytes: &mut [u8; 64]) {
    for (byte, value) in bytes.iter_mut().zip(block) {
        *byte = (value >> SHIFT).clamp(0, 255) as u8;
    }
}

/// Computes the samples of a block from its [`dequantised`] coefficients, stored as in [`ZIGZAG`].
/// Writes eight samples to each of eight rows of the plane, which are `stride` apart.
pub(crate) fn transform(coefficients: &mut Block, plane: &mut [u8], stride: usize) {
    coefficients[0] = coefficients[0].wrapping_add(BIAS);
    let mut turned = [0; 64];
    pass(coefficients);
    weave(coefficients, &mut turned);
    weave(&turned, coefficients);
    weave(coefficients, &mut turned);
    pass(&mut turned);
    let mut bytes = [0; 64];
    levels(&turned, &mut bytes);
    for (row, bytes) in plane.chunks_mut(stride).zip(bytes.as_chunks::<8>().0) {
        row[..8].copy_from_slice(bytes);
    }
}

/// Like [`transform`], for a block with only its first coefficient.
#[inline(always)]
pub(crate) fn fill(coefficient: i16, plane: &mut [u8], stride: usize) {
    let level = (coefficient.wrapping_add(BIAS) >> SHIFT).clamp(0, 255) as u8;
    for row in 0..8 {
        plane[row * stride..][..8].copy_from_slice(&[level; 8]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    /// The definition of the inverse transform, T.81 A.3.3.
    fn exact(coefficients: &[i32; 64]) -> [f64; 64] {
        let weight = |n: usize| if n == 0 { 0.5_f64.sqrt() } else { 1.0 };
        let wave = |n: usize, at: usize| ((2 * at + 1) as f64 * n as f64 * PI / 16.0).cos();
        std::array::from_fn(|index| {
            let y = index / 8;
            let x = index % 8;
            let term = |v: usize, u: usize| {
                weight(u) * weight(v) * f64::from(coefficients[v * 8 + u]) * wave(u, x) * wave(v, y)
            };
            (0..8)
                .flat_map(|v| (0..8).map(move |u| (v, u)))
                .map(|(v, u)| term(v, u))
                .sum::<f64>()
                / 4.0
                + 128.0
        })
    }

    #[test]
    fn the_zigzag_equals_that_of_the_standard() {
        // Row and column of the first coefficients, T.81 figure A.6.
        let first = [
            (0, 0),
            (0, 1),
            (1, 0),
            (2, 0),
            (1, 1),
            (0, 2),
            (0, 3),
            (1, 2),
            (2, 1),
            (3, 0),
            (4, 0),
        ];
        for (index, (row, column)) in first.into_iter().enumerate() {
            assert_eq!(usize::from(ZIGZAG[index]), column * 8 + row);
        }
        let mut sorted = ZIGZAG;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..64));
        assert_eq!(ZIGZAG[63], 63);
    }

    proptest! {
            #[test]
            fn samples_are_within_two_levels_of_the_definition(
                values in proptest::collection::vec((0usize..64, -60i32..60), 0..20), dc in -90i32..90,
            ) {
                let quantisers = std::array::from_fn(|index| 3 + index as u16 / 8);
                let scaled = scaled(&quantisers);
                let mut natural = [0i32; 64];
    let mut ours = [0i16; 64];
                for (index, value) in values.into_iter().map(|(index, value)| (index.max(1), value / (1 + index as i32 / 6))).chain([(0, dc)]) {
                    let place = usize::from(ZIGZAG[index]);
                    natural[place % 8 * 8 + place / 8] = value * i32::from(quantisers[index]);
                    ours[place] = dequantised(value, scaled[index]);
                }
                let mut plane = [0; 64];
                transform(&mut ours, &mut plane, 8);
                for (found, exact) in plane.iter().zip(exact(&natural)) {
                    prop_assert!((f64::from(*found) - exact.clamp(0.0, 255.0)).abs() <= 2.0, "{found} for {exact}");
                }
            }
        }

    #[test]
    fn a_block_of_one_coefficient_is_uniform() {
        let scaled = scaled(&[16; 64]);
        let mut plane = [0; 64];
        let mut filled = [0; 64];
        for dc in [-64, -20, 0, 13, 63] {
            let mut coefficients = [0; 64];
            coefficients[0] = dequantised(dc, scaled[0]);
            transform(&mut coefficients.clone(), &mut plane, 8);
            fill(coefficients[0], &mut filled, 8);
            assert_eq!(plane, filled);
            assert_eq!(i32::from(plane[9]), 128 + dc * 2);
        }
    }
}
