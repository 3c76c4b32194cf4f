//! The inverse transform of two blocks, with the vector instructions of each machine.

use super::idct;

/// Coefficients of a block, followed by padding that is written but never read; see
/// [`super::mcu`].
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(super) struct Coefficients(pub(super) [i16; 72]);

impl Coefficients {
    pub(super) const ZERO: Coefficients = Coefficients([0; 72]);

    #[inline(always)]
    fn block(&self) -> &[i16; 64] {
        let [block @ .., _, _, _, _, _, _, _, _] = &self.0;
        block
    }
}

pub(super) trait Machine: Copy {
    /// Writes the samples of two blocks to a plane: eight rows of each, starting at `at`, `stride`
    /// apart.
    fn transform_two(
        self,
        blocks: &[Coefficients; 2],
        samples: &mut [u8],
        at: [usize; 2],
        stride: usize,
    );
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Plain;

impl Machine for Plain {
    #[inline(always)]
    fn transform_two(
        self,
        blocks: &[Coefficients; 2],
        samples: &mut [u8],
        at: [usize; 2],
        stride: usize,
    ) {
        for (block, at) in blocks.iter().zip(at) {
            idct::transform(&mut block.block().clone(), &mut samples[at..], stride);
        }
    }
}

#[cfg(target_arch = "x86_64")]
impl Machine for pulp::x86::V3 {
    #[inline(always)]
    fn transform_two(
        self,
        blocks: &[Coefficients; 2],
        samples: &mut [u8],
        at: [usize; 2],
        stride: usize,
    ) {
        let four = avx2::transform_two(self, blocks.each_ref().map(Coefficients::block));
        for (index, from) in at.into_iter().enumerate() {
            let area = &mut samples[from..][..7 * stride + 8];
            for (two, rows) in four.iter().enumerate() {
                let start = 2 * two * stride;
                area[start..][..8].copy_from_slice(&rows[2 * index]);
                area[start + stride..][..8].copy_from_slice(&rows[2 * index + 1]);
            }
        }
    }
}

/// The inverse transform of two blocks at once with AVX2; see [`super::idct`].
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use pulp::cast;
    use pulp::x86::V3;
    use std::arch::x86_64::{__m128i, __m256i};

    use crate::jpeg::idct::{Arithmetic, BIAS, SHIFT, butterfly};

    /// The lower half of each register belongs to one block, the upper half to the other.
    impl Arithmetic for V3 {
        type Lanes = __m256i;

        #[inline(always)]
        fn plus(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_add_epi16(a, b)
        }

        #[inline(always)]
        fn minus(self, a: __m256i, b: __m256i) -> __m256i {
            self.avx2._mm256_sub_epi16(a, b)
        }

        #[inline(always)]
        fn times(self, value: __m256i, fraction: i16) -> __m256i {
            let fractions = self.avx._mm256_set1_epi16(fraction);
            self.avx2._mm256_mulhi_epi16(value, fractions)
        }
    }

    /// Like [`super::idct::transform`] for both blocks, but returns their samples: for each pair of
    /// rows, the eight samples of each row of the first block, then those of the second block.
    #[inline(always)]
    pub(super) fn transform_two(v3: V3, blocks: [&[i16; 64]; 2]) -> [[[u8; 8]; 4]; 4] {
        let [first, second] = blocks.map(|block| block.as_chunks::<8>().0);
        let row = |row: usize| -> __m256i {
            let low = v3
                .avx
                ._mm256_castsi128_si256(cast::<[i16; 8], __m128i>(first[row]));
            v3.avx2
                ._mm256_inserti128_si256::<1>(low, cast::<[i16; 8], __m128i>(second[row]))
        };
        let bias: __m256i = cast([BIAS, 0, 0, 0, 0, 0, 0, 0, BIAS, 0, 0, 0, 0, 0, 0, 0]);
        let rows = [
            v3.plus(row(0), bias),
            row(1),
            row(2),
            row(3),
            row(4),
            row(5),
            row(6),
            row(7),
        ];
        let values = butterfly(v3, turned(v3, butterfly(v3, rows)));
        let two = |row: usize| -> [[u8; 8]; 4] {
            let shifted = |value| v3.avx2._mm256_srai_epi16::<{ SHIFT as i32 }>(value);
            let upper = shifted(values[row]);
            let lower = shifted(values[row + 1]);
            // Saturates at 0 and 255.
            cast(v3.avx2._mm256_packus_epi16(upper, lower))
        };
        [two(0), two(2), two(4), two(6)]
    }

    #[inline(always)]
    fn turned(v3: V3, r: [__m256i; 8]) -> [__m256i; 8] {
        let avx2 = v3.avx2;
        let words = |a: usize, b: usize| {
            let low = avx2._mm256_unpacklo_epi16(r[a], r[b]);
            (low, avx2._mm256_unpackhi_epi16(r[a], r[b]))
        };
        let (a0, a1) = words(0, 1);
        let (a2, a3) = words(2, 3);
        let (a4, a5) = words(4, 5);
        let (a6, a7) = words(6, 7);
        let pairs = |a, b| {
            let low = avx2._mm256_unpacklo_epi32(a, b);
            (low, avx2._mm256_unpackhi_epi32(a, b))
        };
        let (b0, b1) = pairs(a0, a2);
        let (b2, b3) = pairs(a1, a3);
        let (b4, b5) = pairs(a4, a6);
        let (b6, b7) = pairs(a5, a7);
        let low = |a, b| avx2._mm256_unpacklo_epi64(a, b);
        let high = |a, b| avx2._mm256_unpackhi_epi64(a, b);
        [
            low(b0, b4),
            high(b0, b4),
            low(b1, b5),
            high(b1, b5),
            low(b2, b6),
            high(b2, b6),
            low(b3, b7),
            high(b3, b7),
        ]
    }

    #[cfg(test)]
    mod tests {
        use super::*;
        use crate::jpeg::idct::transform;
        use proptest::prelude::*;

        proptest! {
            /// For any coefficients, including those of damaged data.
            #[test]
            fn two_blocks_at_once_give_the_samples_of_each_alone(
                first in proptest::collection::vec(any::<i16>(), 64),
                second in proptest::collection::vec(-300i16..300, 64),
            ) {
                let Some(v3) = V3::try_new() else { return Ok(()) };
                let blocks = [first, second].map(|block| <[i16; 64]>::try_from(block).unwrap());
                let four = transform_two(v3, blocks.each_ref());
                for (index, mut block) in blocks.into_iter().enumerate() {
                    let mut plane = [0; 64];
                    transform(&mut block, &mut plane, 8);
                    let rows = four.iter().flat_map(|rows| [rows[2 * index], rows[2 * index + 1]]);
                    prop_assert_eq!(rows.flatten().collect::<Vec<u8>>(), plane);
                }
            }
        }
    }
}
