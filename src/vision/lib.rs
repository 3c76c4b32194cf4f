//! Computer vision for small JPEG frames: decodes them to planes and finds blobs, lines, QR codes and
//! motion in them. Independent of the robot. Most of the time is spent on decoding, so every other
//! operation works on the decoded planes, without a conversion to RGB.
//!
//! ```
//! use image::{ImageFormat, Rgb, RgbImage};
//! use vision::{BlobOptions, Camera, Colour, FrameAnalyser};
//!
//! // A frame with a red square on grey, as JPEG.
//! let mut picture = RgbImage::from_pixel(320, 240, Rgb([150, 150, 150]));
//! for (x, y) in (100..140).flat_map(|x| (60..100).map(move |y| (x, y))) {
//!     picture.put_pixel(x, y, Rgb([200, 20, 20]));
//! }
//! let mut jpeg = std::io::Cursor::new(Vec::new());
//! picture.write_to(&mut jpeg, ImageFormat::Jpeg)?;
//!
//! let mut analyser = FrameAnalyser::new(Camera::default());
//! let red = Colour::named("red").expect("a built-in colour");
//! let blobs = analyser.find_blobs(1, jpeg.get_ref(), &[red], &BlobOptions::default())?;
//! assert_eq!(blobs.len(), 1);
//! assert!((blobs[0].cx - 119.5).abs() < 1.0 && (blobs[0].cy - 79.5).abs() < 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#![warn(missing_docs)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod annotate;
mod blobs;
mod camera;
mod colour;
mod frame_analyser;
mod glance;
mod jpeg;
mod motion;
mod picture;
mod qrcode;
mod sheet;
mod standstill;
mod tracker;
mod turn;

pub use annotate::{Annotation, annotate, annotate_enlarged};
pub use blobs::{Blob, BlobFinder, BlobOptions};
pub use camera::{Camera, Direction, FloorPosition};
pub use colour::learn::{LearnRefusal, Learned, learn};
pub use colour::palette::{MAX_COLOURS, Palette};
pub use colour::{Colour, ColourError, NamedColour, Span};

pub use frame_analyser::{FrameAnalyser, Line, find_line};
pub use glance::{Glance, drove_forwards, moved_right};
pub use jpeg::Decoder;
pub use jpeg::encoder::{Encoder as JpegEncoder, Subsampling};
pub use jpeg::frame::{FrameError, MAX_JPEG_LEN, validate_markers};
pub use motion::{Motion, MotionDetector, MotionOptions};
pub use picture::{Image, MAX_HEIGHT, MAX_WIDTH, Roi, Size, brightness, sharpness};
pub use qrcode::{MAX_CODES, MAX_QR_STEPS, QrCode, find_qrcodes, find_qrcodes_counting};
pub use sheet::{Paper, Sheet, SheetError, SheetPose, pose_from_sheets};
pub use standstill::{Drive, Profiles, Verdict, compare as compare_profiles};
pub use tracker::{Track, Tracker, TrackerOptions};
pub use turn::{Skyline, SkylineReader};

/// The vector instructions to use, selected at run time. Code that is compiled for several
/// instruction sets gives bit-identical results with each.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Vectors {
    /// The baseline of the architecture; vectorisation is left to the compiler.
    Plain,
    /// AVX2 and the extensions that came with it.
    #[cfg(target_arch = "x86_64")]
    Avx2(pulp::x86::V3),
}

impl Default for Vectors {
    fn default() -> Self {
        #[cfg(target_arch = "x86_64")]
        if let Some(v3) = pulp::x86::V3::try_new() {
            return Vectors::Avx2(v3);
        }
        Vectors::Plain
    }
}
