//! Decodes JPEGs to planes of samples, and encodes them: most of the time for a frame is spent on
//! decoding (`scripts/bench-vision`). The `image` crate decodes only the kinds of JPEG that cameras
//! do not send; it returns half a picture without an error.

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
