//! From the bytes of a JPEG to planes of samples.
//!
//! Own code, because a decoder that gives the planes as they are, reuses its buffers and reports
//! data that ends early is what a frame's time depends on: most of a frame's time goes into
//! decoding (`scripts/bench-vision`), and the `image` crate, which is still used for what
//! cameras do not send, shows half a picture without an error.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod baseline;
mod bits;
mod block;
pub(crate) mod decoder;
pub(crate) mod encoder;
pub(crate) mod frame;
mod headers;
mod huffman;
mod idct;
mod incremental;
mod machine;
mod mcu;
mod scans;
mod steps;
