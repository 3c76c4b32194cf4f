//! Decodes JPEGs to pixels, with bounds on every allocation.

use image::ImageDecoder;
use image::codecs::jpeg::JpegDecoder;
use std::io::Cursor;

use super::baseline::Baseline;
use super::frame::{FrameError, Markers};
use super::headers::DecodeError;
use super::scans;
use crate::vision::picture::image::Image;
use crate::vision::picture::size::Size;

/// Decodes one frame after another into the same buffers.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    image: Image,
    /// The partly decoded next frame.
    next_image: Image,
    baseline: Baseline,
    /// Pixels of a frame decoded by the `image` crate.
    pixels: Vec<u8>,
}

impl Decoder {
    /// Decodes a frame: baseline or progressive, colour, grey or CMYK, with or without Huffman
    /// tables.
    ///
    /// # Errors
    /// The reason why the bytes cannot be decoded.
    pub fn decode(&mut self, jpeg: &[u8]) -> Result<&Image, FrameError> {
        let result = self.try_decode(jpeg);
        if result.is_err() {
            self.image.size = Size {
                width: 0,
                height: 0,
            };
        }
        result.map(|()| &self.image)
    }

    /// Decodes as much as possible of a frame that is still being received, so that little work is
    /// left when [`Decoder::decode`] gets the complete frame. The newest picture stays unchanged.
    pub fn decode_ahead(&mut self, beginning: &[u8]) {
        if let Ok((markers, _)) = Markers::read_before_data(beginning)
            && markers.baseline
        {
            self.baseline
                .decode_ahead(beginning, markers.has_tables, &mut self.next_image);
        }
    }

    /// The newest picture; 0x0 before the first one and after an error.
    pub fn image(&self) -> &Image {
        &self.image
    }

    fn try_decode(&mut self, jpeg: &[u8]) -> Result<(), FrameError> {
        let markers = Markers::read(jpeg)?;
        if markers.baseline {
            let decoded = match self.baseline.finish(jpeg, &mut self.next_image) {
                Some(finished) => {
                    std::mem::swap(&mut self.image, &mut self.next_image);
                    finished
                }
                None => self
                    .baseline
                    .decode(jpeg, markers.has_tables, &mut self.image),
            };
            match decoded {
                Ok(()) => return Ok(()),
                Err(DecodeError::Damaged(error)) => return Err(error),
                Err(DecodeError::Unsupported) => {}
            }
        }
        self.decode_unusual(jpeg, markers.size)
    }

    /// Decodes kinds of JPEG that cameras do not send: progressive pictures, CMYK, several scans.
    fn decode_unusual(&mut self, jpeg: &[u8], size: Size) -> Result<(), FrameError> {
        scans::check(jpeg)?;
        let decoder = JpegDecoder::new(Cursor::new(jpeg)).map_err(short)?;
        if decoder.dimensions() != (size.width, size.height) {
            return Err(FrameError::damaged("its headers give two different sizes"));
        }
        let channels = match decoder.color_type() {
            image::ColorType::Rgb8 => 3,
            image::ColorType::L8 => 1,
            _ => return Err(FrameError::Unsupported("neither grey, colour nor CMYK")),
        };
        // Cleared, because data that ends early leaves the remaining pixels unchanged.
        self.pixels.clear();
        self.pixels
            .resize(size.width as usize * size.height as usize * channels, 0);
        decoder.read_image(&mut self.pixels).map_err(short)?;
        match channels {
            1 => self.image.set_luma(size, &self.pixels),
            _ => self.image.set_rgb(size, &self.pixels),
        }
        Ok(())
    }
}

/// A decoder's error, shortened to 120 characters.
fn short(error: image::ImageError) -> FrameError {
    FrameError::Damaged(error.to_string().chars().take(120).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::vectors::Vectors;
    use image::codecs::jpeg::JpegEncoder;
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    const FILES: [&[u8]; 7] = [
        include_bytes!("../../../tests/fixtures/ball-422.jpg"),
        include_bytes!("../../../tests/fixtures/ball-444.jpg"),
        include_bytes!("../../../tests/fixtures/ball-420.jpg"),
        include_bytes!("../../../tests/fixtures/ball-440.jpg"),
        include_bytes!("../../../tests/fixtures/ball-grey.jpg"),
        include_bytes!("../../../tests/fixtures/ball-restart.jpg"),
        include_bytes!("../../../tests/fixtures/ball-cmyk.jpg"),
    ];

    /// Mean and largest difference over all channels of all pixels.
    fn difference(ours: &RgbImage, theirs: &RgbImage) -> (f64, u8) {
        let differences = ours.iter().zip(theirs.iter()).map(|(a, b)| a.abs_diff(*b));
        let sum: u32 = differences.clone().map(u32::from).sum();
        (
            f64::from(sum) / ours.len() as f64,
            differences.max().unwrap_or(0),
        )
    }

    fn both(jpeg: &[u8]) -> (f64, u8) {
        let mut decoder = Decoder::default();
        let size = Markers::read(jpeg).unwrap().size;
        let mut image = Image::default();
        Baseline::default().decode(jpeg, true, &mut image).unwrap();
        decoder.decode_unusual(jpeg, size).unwrap();
        difference(&image.to_rgb(), &decoder.image().to_rgb())
    }

    #[test]
    fn no_frame_shows_pixels_of_the_previous_one() {
        let whole = include_bytes!("../../../tests/fixtures/ball-cmyk.jpg");
        let data = whole.windows(2).position(|pair| pair == [0xFF, 0xDA]);
        let (top, bottom) = whole.split_at(data.unwrap() + 300);
        // Different data of the same length: the picture differs from there on.
        let other = [top, &[0x55; 40], &bottom[40..]].concat();
        let mut warm = Decoder::default();
        let mut fresh = Decoder::default();
        warm.decode(whole).unwrap();
        let seen = warm.decode(&other).map(Image::to_rgb);
        assert_eq!(seen, fresh.decode(&other).map(Image::to_rgb));
    }

    fn decoded_rgb(decoder: &mut Decoder, jpeg: &[u8]) -> Result<RgbImage, FrameError> {
        decoder.decode(jpeg).map(Image::to_rgb)
    }

    /// A decoder that does not use this processor's vector instructions.
    fn plain() -> Decoder {
        let mut decoder = Decoder::default();
        decoder.baseline.vectors = Vectors::Plain;
        decoder
    }

    proptest! {
        /// However a frame is split, damaged or followed by another one, decoding ahead and vector
        /// instructions change no result.
        #[test]
        fn a_frame_decoded_ahead_is_the_same_frame(
            file in 0..FILES.len(),
            other in 0..FILES.len(),
            mut cuts in prop::collection::vec(0.0..1.0, 0..8),
            damage in prop::option::of((0.0..1.0, any::<u8>())),
        ) {
            let mut jpeg = FILES[file].to_vec();
            if let Some((place, byte)) = damage {
                let at = (place * jpeg.len() as f64) as usize;
                jpeg[at] = byte;
            }
            cuts.sort_by(f64::total_cmp);
            let mut ahead = Decoder::default();
            let before = decoded_rgb(&mut ahead, FILES[other]);
            for cut in cuts {
                ahead.decode_ahead(&jpeg[..(cut * jpeg.len() as f64) as usize]);
                prop_assert_eq!(Ok(ahead.image().to_rgb()), before.clone());
            }
            let fresh = decoded_rgb(&mut Decoder::default(), &jpeg);
            prop_assert_eq!(decoded_rgb(&mut plain(), &jpeg), fresh.clone());
            let mut elsewhere = ahead.clone();
            prop_assert_eq!(decoded_rgb(&mut ahead, &jpeg), fresh);
            prop_assert_eq!(decoded_rgb(&mut elsewhere, FILES[other]), before);
        }
    }

    /// When the last bytes arrive, almost nothing is left to decode.
    #[test]
    fn most_of_a_frame_is_decoded_before_its_end_is_received() {
        let noise = RgbImage::from_fn(320, 240, |x, y| Rgb([(x * y % 251) as u8; 3]));
        let mut jpeg = Vec::new();
        JpegEncoder::new(&mut jpeg).encode_image(&noise).unwrap();
        let mut decoder = Decoder::default();
        decoder.decode_ahead(&jpeg[..jpeg.len() - 100]);
        decoder.decode(&jpeg).unwrap();
        let whole = decoder.image().to_rgb();
        decoder.decode_ahead(&jpeg[..jpeg.len() - 100]);
        let next_image = decoder.next_image.to_rgb();
        let rows = next_image.rows().zip(whole.rows());
        let done = rows
            .take_while(|(one, other)| one.clone().eq(other.clone()))
            .count();
        assert!(done > 200, "{done} rows of {}", whole.height());
    }

    #[test]
    fn pixels_equal_those_of_the_image_crate() {
        let (mean, most) = both(include_bytes!("../../../tests/fixtures/ball-444.jpg"));
        assert!(mean < 1.0 && most <= 8, "{mean} {most}");
        let (mean, most) = both(include_bytes!("../../../tests/fixtures/ball-grey.jpg"));
        assert!(mean < 0.5 && most <= 2, "{mean} {most}");
    }

    /// The `image` crate smooths subsampled Cb and Cr and this decoder does not, which shows only
    /// at sharp edges.
    #[test]
    fn pixels_nearly_equal_those_of_the_image_crate_with_subsampled_chroma() {
        for jpeg in [
            include_bytes!("../../../tests/fixtures/ball-422.jpg").as_slice(),
            include_bytes!("../../../tests/fixtures/ball-420.jpg"),
            include_bytes!("../../../tests/fixtures/ball-440.jpg"),
            include_bytes!("../../../tests/fixtures/ball-restart.jpg"),
        ] {
            let (mean, _) = both(jpeg);
            assert!(mean < 4.0, "{mean}");
        }
    }
}
