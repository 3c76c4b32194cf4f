//! From the bytes of a JPEG to pixels, with bounds on every allocation.

use image::ImageDecoder;
use image::codecs::jpeg::JpegDecoder;
use std::io::Cursor;

use super::frame::{FrameError, Size, Survey};
use super::huffman::STANDARD_TABLES;
use super::picture::Image;

/// Decodes one frame after the other into the same buffers.
#[derive(Debug)]
pub struct Decoder {
    image: Image,
    /// The frame with tables put in, for cameras that leave them out.
    completed: Vec<u8>,
    /// Samples of a grey picture.
    grey: Vec<u8>,
}

impl Default for Decoder {
    fn default() -> Self {
        let size = Size {
            width: 0,
            height: 0,
        };
        Decoder {
            image: Image {
                size,
                rgb: Vec::new(),
            },
            completed: Vec::new(),
            grey: Vec::new(),
        }
    }
}

impl Decoder {
    /// Decodes a frame: baseline and progressive, colour, grey and CMYK, with Huffman tables or without.
    ///
    /// # Errors
    /// Says what is wrong with the bytes.
    pub fn decode(&mut self, jpeg: &[u8]) -> Result<&Image, FrameError> {
        self.image.size = Size {
            width: 0,
            height: 0,
        };
        let survey = Survey::of(jpeg)?;
        let jpeg = if survey.has_tables {
            jpeg
        } else {
            complete(&mut self.completed, jpeg)
        };
        let decoder = JpegDecoder::new(Cursor::new(jpeg)).map_err(short)?;
        if decoder.dimensions() != (survey.size.width, survey.size.height) {
            return Err(FrameError::damaged("it has two sizes"));
        }
        let pixels = survey.size.width as usize * survey.size.height as usize;
        match decoder.color_type() {
            image::ColorType::Rgb8 => {
                self.image.rgb.resize(pixels * 3, 0);
                decoder.read_image(&mut self.image.rgb).map_err(short)?;
            }
            image::ColorType::L8 => {
                self.grey.resize(pixels, 0);
                decoder.read_image(&mut self.grey).map_err(short)?;
                self.image.rgb.clear();
                self.image
                    .rgb
                    .extend(self.grey.iter().flat_map(|value| [*value; 3]));
            }
            _ => return Err(FrameError::Unsupported("neither grey, colour nor CMYK")),
        }
        self.image.size = survey.size;
        Ok(&self.image)
    }

    /// The newest picture; 0x0 before the first and after a failure.
    pub fn image(&self) -> &Image {
        &self.image
    }
}

/// Puts the standard tables behind the start marker.
fn complete<'a>(buffer: &'a mut Vec<u8>, jpeg: &[u8]) -> &'a [u8] {
    let (start, rest) = jpeg.split_at(2);
    buffer.clear();
    buffer.extend_from_slice(start);
    buffer.extend_from_slice(&STANDARD_TABLES);
    buffer.extend_from_slice(rest);
    buffer
}

/// What a decoder says, in one short line.
fn short(error: image::ImageError) -> FrameError {
    FrameError::Damaged(error.to_string().chars().take(120).collect())
}
