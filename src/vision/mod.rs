//! What a behaviour sees: the bytes of a JPEG to pixels, and pixels to blobs. Knows no robot and
//! imports nothing of this crate.
//!
//! [`judge`] looks at a frame's markers before anyone trusts it, [`Decoder`] makes an [`Image`] of
//! it, [`Colour`]s say what to look for, a [`Palette`] is their fast form, and [`BlobFinder`]
//! makes [`Blob`]s of the pixels that match. [`Eyes`] does all of it for one frame after the
//! other, decodes each once and keeps its buffers.
//!
//! Three quarters of the time goes into decoding (`scripts/bench-vision`), so whatever is asked of a
//! frame beyond that is cheap: brightness, sharpness and motion read the decoded brightness as it is,
//! and colours are looked up without ever making red, green and blue.

mod annotate;
mod aslant;
mod baseline;
mod bits;
mod blobs;
mod colour;
mod damage;
mod decoder;
mod eyes;
mod finders;
mod font;
mod frame;
mod huffman;
mod idct;
mod learn;
mod line;
mod measure;
mod moments;
mod motion;
mod palette;
mod picture;
mod qrcode;
mod regions;
mod scans;
mod space;
mod tracker;

pub use annotate::{Mark, annotate, annotate_enlarged};
pub use blobs::{Blob, BlobFinder, BlobOptions, Camera};
pub use colour::{Colour, ColourError, Span};
pub use damage::Damage;
pub use decoder::Decoder;
pub use eyes::Eyes;
pub use finders::{MAX_FILLED, MAX_FINDERS, MAX_STEPS, QrWork};
pub use frame::{FrameError, MAX_HEIGHT, MAX_JPEG_LEN, MAX_WIDTH, Size, judge};
pub use learn::{LearnRefusal, Learned, learn};
pub use line::{Line, find_line};
pub use measure::{brightness, sharpness};
pub use motion::{Motion, MotionDetector, MotionOptions};
pub use palette::{MAX_COLOURS, Palette};
pub use picture::{Image, Roi};
pub use qrcode::{MAX_CODES, QrCode, find_qrcodes, find_qrcodes_counting};
pub use tracker::{Track, Tracker, TrackerOptions};
