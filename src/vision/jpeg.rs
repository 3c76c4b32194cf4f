//! Decodes JPEGs to planes of samples, and encodes them.
//!
//! This is a separate implementation because most of the time for a frame is spent on decoding
//! (`scripts/bench-vision`). It returns the planes directly, reuses its buffers and reports data
//! that ends early. The `image` crate, still used for kinds of JPEG that cameras do not send,
//! returns half a picture without an error.

#[cfg(target_arch = "x86_64")]
mod avx2;
mod bits;
pub(crate) mod decoder;
pub(crate) mod encoder;
pub(crate) mod frame;
mod headers;
mod huffman;
mod idct;
mod machine;
mod mcu;
