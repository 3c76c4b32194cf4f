//! Selects the vector instructions at run time, by asking the processor.
//!
//! Code that is compiled for several instruction sets gives bit-identical results with each.

/// The instruction set to use.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Vectors {
    /// The baseline of the architecture; vectorisation is left to the compiler.
    Plain,
    /// AVX2 and the extensions that came with it.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
}

impl Default for Vectors {
    /// The best instruction set that this processor supports.
    fn default() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = pulp::x86::V3::try_new() {
            return Vectors::Avx2(v3);
        }
        Vectors::Plain
    }
}
