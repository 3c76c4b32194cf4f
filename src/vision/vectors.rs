//! Which vector instructions are used: asked of the processor when the program runs.
//!
//! What is compiled for several of them gives the same results, bit by bit, in each form.

/// The instructions that this processor has.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Vectors {
    /// Those that every processor of its kind has; the compiler makes the best of them.
    Plain,
    /// AVX2 and what came with it.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
}

impl Default for Vectors {
    /// The best that this processor has.
    fn default() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = pulp::x86::V3::try_new() {
            return Vectors::Avx2(v3);
        }
        Vectors::Plain
    }
}
