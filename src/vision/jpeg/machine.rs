//! Compiles everything between a frame's bits and its samples once for each vector instruction set.

use super::idct;
use crate::vision::Vectors;

/// Code that is compiled for each machine. Its [`run`](Work::run) and all functions on its hot path
/// must be `#[inline(always)]`: a function that is not inlined is compiled without the machine's
/// instructions.
pub(super) trait Work {
    type Output;
    fn run<M: Machine>(self, machine: M) -> Self::Output;
}

pub(super) fn run<W: Work>(vectors: Vectors, work: W) -> W::Output {
    match vectors {
        Vectors::Plain => work.run(Plain),
        #[cfg(target_arch = "x86_64")]
        Vectors::Avx2(v3) => v3.vectorize(OnV3(v3, work)),
    }
}

/// Runs work with AVX2 enabled. This is not a closure, because a closure might not be inlined.
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
