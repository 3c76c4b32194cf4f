//! Looks up thirty-two chroma samples at a time in cells; see [`super::palette`].

use pulp::cast;
use pulp::x86::V3;
use std::arch::x86_64::{__m128i, __m256i};

use crate::vision::picture::Spans;

/// Finds the groups of a row that contain live cells, if each Cb and Cr applies to `N` pixels.
pub(super) struct LiveSpans<'a, const N: usize> {
    pub(super) v3: V3,
    /// The end of the first cell, minus its eight levels.
    pub(super) lowest: u8,
    /// One bit per cell of Cr, indexed by the cell of Cb: the lower eight and the upper eight.
    pub(super) live: &'a [[u8; 16]; 2],
    pub(super) cbs: &'a [u8],
    pub(super) crs: &'a [u8],
}

impl<const N: usize> pulp::NullaryFnOnce for LiveSpans<'_, N> {
    type Output = Spans;

    #[inline(always)]
    fn call(self) -> Spans {
        let tables = self.live.map(|half| twice(self.v3, half));
        let mut spans = Spans::NONE;
        let chunks = self.cbs.chunks(32).zip(self.crs.chunks(32));
        for (index, (cbs, crs)) in chunks.enumerate() {
            // A remainder at the end of a row counts as live.
            let live = match (cbs.first_chunk(), crs.first_chunk()) {
                (Some(cbs), Some(crs)) => eights(self.v3, self.lowest, tables, cbs, crs),
                _ => 0b1111,
            };
            match N {
                1 => {
                    let pairs = live | live >> 1;
                    spans.add_bits(2 * index, pairs & 1 | pairs >> 1 & 2);
                }
                _ => spans.add_bits(4 * index, live),
            }
        }
        spans
    }
}

#[inline(always)]
fn twice(v3: V3, half: [u8; 16]) -> __m256i {
    v3.avx2
        ._mm256_broadcastsi128_si256(cast::<[u8; 16], __m128i>(half))
}

/// For each eight pairs of Cb and Cr, one bit that is set if any of their cells is live.
#[inline(always)]
fn eights(v3: V3, lowest: u8, [lower, upper]: [__m256i; 2], cbs: &[u8; 32], crs: &[u8; 32]) -> u32 {
    let avx2 = v3.avx2;
    let all = |byte: u8| -> __m256i { cast([byte; 32]) };
    let index = |levels: &[u8; 32]| {
        let above = avx2._mm256_subs_epu8(cast(*levels), all(lowest));
        let bounded = avx2._mm256_min_epu8(above, all(127));
        avx2._mm256_and_si256(avx2._mm256_srli_epi16::<3>(bounded), all(15))
    };
    let cb = index(cbs);
    let cr = index(crs);
    let lower = avx2._mm256_shuffle_epi8(lower, cb);
    let upper = avx2._mm256_shuffle_epi8(upper, cb);
    // The fourth bit of the index selects the half: shifted to each byte's highest bit.
    let half = avx2._mm256_blendv_epi8(lower, upper, avx2._mm256_slli_epi16::<4>(cr));
    let bits: [u8; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
    let bits = twice(v3, cast([bits; 2]));
    let bit = avx2._mm256_shuffle_epi8(bits, cr);
    let dead = avx2._mm256_cmpeq_epi64(avx2._mm256_and_si256(half, bit), all(0));
    !v3.avx._mm256_movemask_pd(cast(dead)) as u32 & 0b1111
}
