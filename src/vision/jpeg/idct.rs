//! The inverse discrete cosine transform: from a block's coefficients to its 64 samples.
//!
//! The transform of Arai, Agui and Nakajima: part of its factors go into the quantisation table,
//! five multiplications a row are left. Eight columns are worked on at once in 16 bits, in a form
//! that compilers turn into vector instructions; results are within two levels of exact ones,
//! mostly within one. Sums wrap, so damaged data gives wrong samples and no panic.

/// Bits behind the point while transforming.
const FRACTION: u32 = 3;
/// More of them in the quantisation tables, whose smallest values would suffer otherwise.
const FINER: u32 = 8;

/// Where the coefficients of a frame's zigzag order stand: columns of the block as rows here,
/// because the first pass goes along them.
pub(crate) const ZIGZAG: [u8; 64] = {
    let mut places = [0; 64];
    let (mut row, mut column, mut index) = (0i32, 0i32, 0);
    let mut upwards = true;
    while index < 64 {
        places[index] = (column * 8 + row) as u8;
        index += 1;
        let (next_row, next_column) = if upwards {
            (row - 1, column + 1)
        } else {
            (row + 1, column - 1)
        };
        if next_row < 0 || next_row > 7 || next_column < 0 || next_column > 7 {
            // At the border the zigzag turns: along it, away from the corner where it began.
            if upwards {
                if next_column > 7 {
                    row += 1
                } else {
                    column += 1
                }
            } else if next_row > 7 {
                column += 1;
            } else {
                row += 1;
            }
            upwards = !upwards;
        } else {
            (row, column) = (next_row, next_column);
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

/// A quantisation table (zigzag order) with the transform's factors in it.
pub(crate) fn scaled(quantisers: &[u16; 64]) -> [i32; 64] {
    std::array::from_fn(|index| {
        let place = usize::from(ZIGZAG[index]);
        let factor =
            FACTORS[place / 8] * FACTORS[place % 8] * f64::from(1u32 << (FRACTION + FINER));
        (f64::from(quantisers[index]) * factor).round() as i32
    })
}

/// A coefficient as it stands in the frame, times its entry of a [`scaled`] table.
#[inline(always)]
pub(crate) fn dequantised(coefficient: i32, quantiser: i32) -> i16 {
    (coefficient
        .wrapping_mul(quantiser)
        .wrapping_add(1 << (FINER - 1))
        >> FINER) as i16
}

/// Half a level, and the 128 that JPEG takes off, at the scale of the first coefficient.
const BIAS: i16 = (128 << (FRACTION + 3)) + (1 << (FRACTION + 2));

/// Eight rows of eight, one after the other.
type Block = [i16; 64];

/// Times a fraction in 1/65536, below a half.
#[inline(always)]
fn times(value: i16, fraction: i16) -> i16 {
    ((i32::from(value) * i32::from(fraction)) >> 16) as i16
}

/// Times the square root of two.
#[inline(always)]
fn root(value: i16) -> i16 {
    value.wrapping_add(times(value, 27_146))
}

/// Transforms every column. Kept out of line: within a larger function the compiler takes it apart
/// before it sees that the eight columns can go together.
#[inline(never)]
fn pass(block: &mut Block) {
    let plus = i16::wrapping_add;
    let minus = i16::wrapping_sub;
    for column in 0..8 {
        // One by one: a closure may stay a call of its own, and nothing goes together any more.
        let (i0, i1) = (block[column], block[8 + column]);
        let (i2, i3) = (block[16 + column], block[24 + column]);
        let (i4, i5) = (block[32 + column], block[40 + column]);
        let (i6, i7) = (block[48 + column], block[56 + column]);
        // Even coefficients.
        let (sum, difference) = (plus(i0, i4), minus(i0, i4));
        let outer = plus(i2, i6);
        let inner = minus(root(minus(i2, i6)), outer);
        let (e0, e3) = (plus(sum, outer), minus(sum, outer));
        let (e1, e2) = (plus(difference, inner), minus(difference, inner));
        // Odd ones, by 1.84776 = 2 - 0.15224, by 2.61313 = 3 - 0.38687 and by 1.08239.
        let (z13, z10) = (plus(i5, i3), minus(i5, i3));
        let (z11, z12) = (plus(i1, i7), minus(i1, i7));
        let o7 = plus(z11, z13);
        let crossed = plus(z10, z12);
        let z5 = minus(plus(crossed, crossed), times(crossed, 9_977));
        let tripled = plus(plus(z10, z10), z10);
        let o6 = minus(minus(z5, minus(tripled, times(z10, 25_354))), o7);
        let o5 = minus(root(minus(z11, z13)), o6);
        let o4 = plus(minus(plus(z12, times(z12, 5_400)), z5), o5);
        block[column] = plus(e0, o7);
        block[8 + column] = plus(e1, o6);
        block[16 + column] = plus(e2, o5);
        block[24 + column] = minus(e3, o4);
        block[32 + column] = plus(e3, o4);
        block[40 + column] = minus(e2, o5);
        block[48 + column] = minus(e1, o6);
        block[56 + column] = minus(e0, o7);
    }
}

/// Shuffles the halves of a block into each other; done three times, rows have become columns.
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
        *byte = (value >> (FRACTION + 3)).clamp(0, 255) as u8;
    }
}

/// Samples of a block whose coefficients, [`dequantised`], stand at [`ZIGZAG`]. Writes eight
/// samples into each of eight rows of the plane, which begin `stride` apart.
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

/// As [`transform`] for a block that has its first coefficient only.
pub(crate) fn fill(coefficient: i16, plane: &mut [u8], stride: usize) {
    let level = (coefficient.wrapping_add(BIAS) >> (FRACTION + 3)).clamp(0, 255) as u8;
    plane
        .chunks_mut(stride)
        .take(8)
        .for_each(|row| row[..8].fill(level));
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
            let (y, x) = (index / 8, index % 8);
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
    fn the_zigzag_is_that_of_the_standard() {
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
            let (mut natural, mut ours) = ([0i32; 64], [0i16; 64]);
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
    fn a_block_of_one_coefficient_is_even() {
        let scaled = scaled(&[16; 64]);
        let (mut plane, mut filled) = ([0; 64], [0; 64]);
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
