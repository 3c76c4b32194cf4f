//! From the bytes of a JPEG to planes of samples.
//!
//! Own code, because a decoder that gives the planes as they are, reuses its buffers and reports
//! data that ends early is what a frame's time depends on: three quarters of a frame's time goes
//! into decoding (`scripts/bench-vision`), and the `image` crate, which is still used for what
//! cameras do not send, shows half a picture without an error.

mod baseline;
mod bits;
pub(crate) mod decoder;
pub(crate) mod encoder;
pub(crate) mod frame;
mod headers;
mod huffman;
mod idct;
mod incremental;
mod mcu;
mod scans;
