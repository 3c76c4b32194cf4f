//! From the bytes of a JPEG to pixels, with bounds on every allocation.

use image::ImageDecoder;
use image::codecs::jpeg::JpegDecoder;
use std::io::Cursor;

use super::frame::{FrameError, Markers};
use super::headers::DecodeError;
use super::incremental::Incremental;
use super::scans;
use crate::vision::picture::image::Image;
use crate::vision::picture::size::Size;

/// Decodes one frame after the other into the same buffers.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    image: Image,
    /// The part of the next one that has arrived.
    coming: Image,
    baseline: Incremental,
    /// Pixels of a frame that the `image` crate has decoded.
    pixels: Vec<u8>,
}

impl Decoder {
    /// Decodes a frame: baseline and progressive, colour, grey and CMYK, with Huffman tables or
    /// without.
    ///
    /// # Errors
    /// Says what is wrong with the bytes.
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

    /// Decodes as much as there is of a frame that is still coming in, so that little is left to do
    /// when it is whole and [`Decoder::decode`] gets all of it. The newest picture stays as it is.
    pub fn look_ahead(&mut self, beginning: &[u8]) {
        if let Ok((markers, _)) = Markers::read_before_data(beginning)
            && markers.baseline
        {
            self.baseline
                .look_ahead(beginning, markers.has_tables, &mut self.coming);
        }
    }

    /// Whether the beginning of the next frame is decoded.
    pub fn is_ahead(&self) -> bool {
        self.baseline.is_ahead()
    }

    /// The newest picture; 0x0 before the first and after a failure.
    pub fn image(&self) -> &Image {
        &self.image
    }

    fn try_decode(&mut self, jpeg: &[u8]) -> Result<(), FrameError> {
        let markers = Markers::read(jpeg)?;
        if markers.baseline {
            let decoded = match self.baseline.finish(jpeg, &mut self.coming) {
                Some(finished) => {
                    std::mem::swap(&mut self.image, &mut self.coming);
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

    /// Decodes what cameras do not send: progressive pictures, CMYK, several scans.
    fn decode_unusual(&mut self, jpeg: &[u8], size: Size) -> Result<(), FrameError> {
        scans::check(jpeg)?;
        let decoder = JpegDecoder::new(Cursor::new(jpeg)).map_err(short)?;
        if decoder.dimensions() != (size.width, size.height) {
            return Err(FrameError::damaged("it has two sizes"));
        }
        let channels = match decoder.color_type() {
            image::ColorType::Rgb8 => 3,
            image::ColorType::L8 => 1,
            _ => return Err(FrameError::Unsupported("neither grey, colour nor CMYK")),
        };
        // Cleared, because what ends early leaves the rest as it finds it.
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

/// A decoder's error as one short line.
fn short(error: image::ImageError) -> FrameError {
    FrameError::Damaged(error.to_string().chars().take(120).collect())
}

#[cfg(test)]
mod tests {
    use super::super::baseline::Baseline;
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

    /// Mean and largest difference of any channel of any pixel.
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
    fn no_frame_shines_through_from_one_before() {
        let whole = include_bytes!("../../../tests/fixtures/ball-cmyk.jpg");
        let data = whole.windows(2).position(|pair| pair == [0xFF, 0xDA]);
        let (top, bottom) = whole.split_at(data.unwrap() + 300);
        // Other data of the same length: the picture is another one from there on.
        let other = [top, &[0x55; 40], &bottom[40..]].concat();
        let (mut warm, mut fresh) = (Decoder::default(), Decoder::default());
        warm.decode(whole).unwrap();
        let seen = warm.decode(&other).map(Image::to_rgb);
        assert_eq!(seen, fresh.decode(&other).map(Image::to_rgb));
    }

    fn told(decoder: &mut Decoder, jpeg: &[u8]) -> Result<RgbImage, FrameError> {
        decoder.decode(jpeg).map(Image::to_rgb)
    }

    /// A decoder without the vector instructions of this processor.
    fn plain() -> Decoder {
        let mut decoder = Decoder::default();
        decoder.baseline.use_vectors(Vectors::Plain);
        decoder
    }

    proptest! {
        /// However a frame is cut, damaged or followed by another one, looking ahead changes no result, and
        /// neither do vector instructions.
        #[test]
        fn a_frame_looked_at_ahead_is_the_same_frame(
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
            let before = told(&mut ahead, FILES[other]);
            for cut in cuts {
                ahead.look_ahead(&jpeg[..(cut * jpeg.len() as f64) as usize]);
                prop_assert_eq!(Ok(ahead.image().to_rgb()), before.clone());
            }
            let fresh = told(&mut Decoder::default(), &jpeg);
            prop_assert_eq!(told(&mut plain(), &jpeg), fresh.clone());
            let mut elsewhere = ahead.clone();
            prop_assert_eq!(told(&mut ahead, &jpeg), fresh);
            prop_assert_eq!(told(&mut elsewhere, FILES[other]), before);
        }
    }

    /// With the last bytes there is next to nothing left to decode.
    #[test]
    fn most_of_a_frame_is_decoded_before_its_end_has_come() {
        let noise = RgbImage::from_fn(320, 240, |x, y| Rgb([(x * y % 251) as u8; 3]));
        let mut jpeg = Vec::new();
        JpegEncoder::new(&mut jpeg).encode_image(&noise).unwrap();
        let mut decoder = Decoder::default();
        decoder.look_ahead(&jpeg[..jpeg.len() - 100]);
        decoder.decode(&jpeg).unwrap();
        let whole = decoder.image().to_rgb();
        decoder.look_ahead(&jpeg[..jpeg.len() - 100]);
        let coming = decoder.coming.to_rgb();
        let rows = coming.rows().zip(whole.rows());
        let done = rows
            .take_while(|(one, other)| one.clone().eq(other.clone()))
            .count();
        assert!(done > 200, "{done} rows of {}", whole.height());
    }

    #[test]
    fn pixels_are_those_of_the_image_crate() {
        let (mean, most) = both(include_bytes!("../../../tests/fixtures/ball-444.jpg"));
        assert!(mean < 1.0 && most <= 8, "{mean} {most}");
        let (mean, most) = both(include_bytes!("../../../tests/fixtures/ball-grey.jpg"));
        assert!(mean < 0.5 && most <= 2, "{mean} {most}");
    }

    /// Shared Cb and Cr are smoothed there and not here, which shows at sharp borders
    /// only.
    #[test]
    fn pixels_are_nearly_those_of_the_image_crate_where_colour_is_coarse() {
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
