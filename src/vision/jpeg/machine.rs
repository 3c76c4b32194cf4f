//! Everything between a frame's bits and its samples is compiled once for each kind of vector instructions.

use super::idct;
use crate::vision::vectors::Vectors;

/// What is compiled for each machine. Its [`run`](Work::run) and all that this calls in earnest must be
/// `#[inline(always)]`: a function that stays on its own is compiled without the machine's instructions.
pub(super) trait Work {
    type Output;
    fn run<M: Machine>(self, machine: M) -> Self::Output;
}

/// Runs the work as it was compiled for these instructions.
pub(super) fn run<W: Work>(vectors: Vectors, work: W) -> W::Output {
    match vectors {
        Vectors::Plain => work.run(Plain),
        #[cfg(target_arch = "x86_64")]
        Vectors::Avx2(v3) => v3.vectorize(OnV3(v3, work)),
    }
}

/// Work that is called where AVX2 is on. No closure: that may stay a function on its own.
#[cfg(target_arch = "x86_64")]
struct OnV3<W>(pulp::x86::V3, W);

#[cfg(target_arch = "x86_64")]
impl<W: Work> pulp::NullaryFnOnce for OnV3<W> {
    type Output = W::Output;

    #[inline(always)]
    fn call(self) -> W::Output {
        self.1.run(self.0)
    }
}

/// Coefficients of a block, and places that are written to but never read: see [`super::block`].
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

/// How two blocks are transformed.
pub(super) trait Machine: Copy {
    /// Writes the samples of two blocks into eight rows of a plane each, from `at` on, `stride` apart.
    fn transform_two(
        self,
        blocks: &[Coefficients; 2],
        samples: &mut [u8],
        at: [usize; 2],
        stride: usize,
    );
}

/// [`Vectors::Plain`].
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
        let four = super::avx2::transform_two(self, blocks.each_ref().map(Coefficients::block));
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
