//! From a block's frequencies to its 64 samples.
//!
//! The transform of Arai, Agui and Nakajima: part of its factors go into the quantisation table,
//! five multiplications a row are left. Eight columns are worked on at once in 16 bits, in a form
//! that compilers turn into vector instructions; results are within two levels of exact ones.
//! Sums wrap, so damaged data gives wrong samples and no panic.

/// Bits behind the point while transforming.
const FRACTION: u32 = 2;

/// Where the frequencies of a frame's zigzag order stand: columns of the block as rows here, because
/// the first pass goes along them.
pub(super) const PLACES: [u8; 64] = {
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

/// The transform's factor of the n-th frequency: cos(n pi / 16) times the square root of two, but 1 for the first.
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
pub(super) fn scaled(quantisers: &[u16; 64]) -> [i16; 64] {
    std::array::from_fn(|index| {
        let place = usize::from(PLACES[index]);
        let factor = FACTORS[place / 8] * FACTORS[place % 8] * f64::from(1u32 << FRACTION);
        // Saturates for tables that no camera has.
        (f64::from(quantisers[index]) * factor).round() as i16
    })
}

/// Half a level, and the 128 that JPEG takes off, at the scale of the first frequency.
const BIAS: i16 = (128 << (FRACTION + 3)) + (1 << (FRACTION + 2));

/// Eight values of one row.
#[derive(Clone, Copy)]
struct Lanes([i16; 8]);

impl Lanes {
    #[inline(always)]
    fn each(self, other: Lanes, op: impl Fn(i16, i16) -> i16) -> Lanes {
        let mut result = [0; 8];
        for lane in 0..8 {
            result[lane] = op(self.0[lane], other.0[lane]);
        }
        Lanes(result)
    }

    #[inline(always)]
    fn plus(self, other: Lanes) -> Lanes {
        self.each(other, i16::wrapping_add)
    }

    #[inline(always)]
    fn minus(self, other: Lanes) -> Lanes {
        self.each(other, i16::wrapping_sub)
    }

    /// Times a fraction in 1/65536, below a half.
    #[inline(always)]
    fn times(self, fraction: i16) -> Lanes {
        self.each(Lanes([fraction; 8]), |value, fraction| {
            ((i32::from(value) * i32::from(fraction)) >> 16) as i16
        })
    }
}

/// One pass along the rows' index: eight columns at once.
#[inline(always)]
fn pass(input: [Lanes; 8]) -> [Lanes; 8] {
    let [i0, i1, i2, i3, i4, i5, i6, i7] = input;
    // Even frequencies. Multiplying by the square root of two is adding 0.41421.
    let root = |value: Lanes| value.plus(value.times(27_146));
    let (sum, difference) = (i0.plus(i4), i0.minus(i4));
    let outer = i2.plus(i6);
    let inner = root(i2.minus(i6)).minus(outer);
    let (e0, e3) = (sum.plus(outer), sum.minus(outer));
    let (e1, e2) = (difference.plus(inner), difference.minus(inner));
    // Odd ones, by 1.84776 = 2 - 0.15224, 1.08239 and 2.61313 = 3 - 0.38687.
    let (z13, z10) = (i5.plus(i3), i5.minus(i3));
    let (z11, z12) = (i1.plus(i7), i1.minus(i7));
    let o7 = z11.plus(z13);
    let crossed = z10.plus(z12);
    let z5 = crossed.plus(crossed).minus(crossed.times(9_977));
    let o6 = z5
        .minus(z10.plus(z10).plus(z10).minus(z10.times(25_354)))
        .minus(o7);
    let o5 = root(z11.minus(z13)).minus(o6);
    let o4 = z12.plus(z12.times(5_400)).minus(z5).plus(o5);
    [
        e0.plus(o7),
        e1.plus(o6),
        e2.plus(o5),
        e3.minus(o4),
        e3.plus(o4),
        e2.minus(o5),
        e1.minus(o6),
        e0.minus(o7),
    ]
}

/// Rows become columns, by interleaving three times.
#[inline(always)]
fn transpose(mut rows: [Lanes; 8]) -> [Lanes; 8] {
    for _ in 0..3 {
        let mut woven = rows;
        for pair in 0..4 {
            let (a, b) = (rows[pair].0, rows[pair + 4].0);
            woven[2 * pair] = Lanes([a[0], b[0], a[1], b[1], a[2], b[2], a[3], b[3]]);
            woven[2 * pair + 1] = Lanes([a[4], b[4], a[5], b[5], a[6], b[6], a[7], b[7]]);
        }
        rows = woven;
    }
    rows
}

/// Samples of a block whose frequencies, multiplied by a [`scaled`] table, stand at [`PLACES`]. Writes eight
/// samples into each of eight rows of the plane, which begin `stride` apart.
#[inline]
pub(super) fn transform(frequencies: &mut [i16; 64], plane: &mut [u8], stride: usize) {
    frequencies[0] = frequencies[0].wrapping_add(BIAS);
    let rows = frequencies.as_chunks::<8>().0;
    let columns = std::array::from_fn(|row| Lanes(rows[row]));
    let samples = pass(transpose(pass(columns)));
    for (row, Lanes(values)) in plane.chunks_mut(stride).zip(samples) {
        let mut bytes = [0; 8];
        for lane in 0..8 {
            bytes[lane] = (values[lane] >> (FRACTION + 3)).clamp(0, 255) as u8;
        }
        row[..8].copy_from_slice(&bytes);
    }
}

/// As [`transform`] for a block that has its first frequency only.
#[inline]
pub(super) fn fill(frequency: i16, plane: &mut [u8], stride: usize) {
    let level = (frequency.wrapping_add(BIAS) >> (FRACTION + 3)).clamp(0, 255) as u8;
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
        // Row and column of the first frequencies, T.81 figure A.6.
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
            assert_eq!(usize::from(PLACES[index]), column * 8 + row);
        }
        let mut sorted = PLACES;
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..64));
        assert_eq!(PLACES[63], 63);
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
                let place = usize::from(PLACES[index]);
                natural[place % 8 * 8 + place / 8] = value * i32::from(quantisers[index]);
                ours[place] = value as i16 * scaled[index];
            }
            let mut plane = [0; 64];
            transform(&mut ours, &mut plane, 8);
            for (found, exact) in plane.iter().zip(exact(&natural)) {
                prop_assert!((f64::from(*found) - exact.clamp(0.0, 255.0)).abs() <= 2.0, "{found} for {exact}");
            }
        }
    }

    #[test]
    fn a_block_of_one_frequency_is_even() {
        let scaled = scaled(&[16; 64]);
        let (mut plane, mut filled) = ([0; 64], [0; 64]);
        for dc in [-64, -20, 0, 13, 63] {
            let mut frequencies = [0; 64];
            frequencies[0] = dc * scaled[0];
            transform(&mut frequencies.clone(), &mut plane, 8);
            fill(frequencies[0], &mut filled, 8);
            assert_eq!(plane, filled);
            assert_eq!(i16::from(plane[9]), 128 + dc * 2);
        }
    }
}
