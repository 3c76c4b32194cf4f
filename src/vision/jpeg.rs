//! Decodes JPEGs to planes of samples, and encodes them: most of the time for a frame is spent on
//! decoding (`scripts/bench-vision`). The `image` crate decodes only the kinds of JPEG that cameras
//! do not send; it returns half a picture without an error.

mod bits;
pub(crate) mod encoder;
pub(crate) mod frame;
mod headers;
mod huffman;
mod idct;
mod machine;
mod mcu;

use image::ImageDecoder;
use image::codecs::jpeg::JpegDecoder;

use self::bits::{Cursor, Scan};
use self::frame::{FrameError, Markers, check_scans};
use self::headers::{Component, DecodeError, Headers, damaged};
use self::mcu::{BlockQueue, ComponentDecoder, decode_ahead, decode_interval, decode_scan};
use crate::vision::Vectors;
use crate::vision::picture::{Image, Plane, Size};

/// Decodes one frame after another into the same buffers.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    image: Image,
    next_image: Image,
    baseline: Baseline,
    pixels: Vec<u8>,
}

impl Decoder {
    /// Decodes a frame: baseline or progressive, colour, grey or CMYK, with or without Huffman
    /// tables.
    pub fn decode(&mut self, jpeg: &[u8]) -> Result<&Image, FrameError> {
        let result = self.try_decode(jpeg);
        if result.is_err() {
            self.image.size = Size::default();
        }
        result.map(|()| &self.image)
    }

    /// Decodes as much as possible of a frame that is still being received, so that little work is
    /// left when [`Decoder::decode`] gets the complete frame. The newest picture stays unchanged.
    pub fn decode_ahead(&mut self, beginning: &[u8]) {
        if let Ok((markers, _)) = Markers::read_before_data(beginning)
            && markers.baseline
        {
            self.baseline.decode_ahead(beginning, &mut self.next_image);
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
                None => self.baseline.decode(jpeg, &mut self.image),
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
        check_scans(jpeg)?;
        let decoder = JpegDecoder::new(std::io::Cursor::new(jpeg)).map_err(short)?;
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

fn short(error: image::ImageError) -> FrameError {
    FrameError::Damaged(error.to_string().chars().take(120).collect())
}

/// Decodes baseline JPEGs in one scan, as cameras send them, directly into reusable planes: after the
/// first frames nothing is allocated. Data that ends early, is too long or is invalid gives an error,
/// where other decoders return half a picture. A frame that is still being received is decoded as far
/// as it goes.
#[derive(Debug, Clone, Default)]
struct Baseline {
    headers: Headers,
    scan: Scan,
    vectors: Vectors,
    /// How far a frame that is still being received has been decoded.
    progress: Option<Progress>,
    beginning: Vec<u8>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    /// Number of bytes of the frame that the scan has consumed.
    taken: usize,
    cursor: Cursor,
    mcu: usize,
    predictors: [i32; 3],
}

impl Baseline {
    /// Decodes a complete frame whose markers have been validated; ignores a partly decoded one.
    /// After an error, the content of the image is unspecified.
    fn decode(&mut self, jpeg: &[u8], image: &mut Image) -> Result<(), DecodeError> {
        self.progress = None;
        let start = self.read_headers(jpeg)?;
        if self.scan.load(&jpeg[start..])? != 0xD9 {
            return Err(DecodeError::Unsupported);
        }
        let ((across, down), components) = self.shape(image, [0; 3])?;
        let interval = self.headers.restart_interval;
        decode_scan(self.vectors, &self.scan, interval, across, down, components)
    }

    /// Decodes as much as possible of a frame that is still being received and whose markers before
    /// the data have been validated. The rest is left for later.
    fn decode_ahead(&mut self, jpeg: &[u8], image: &mut Image) {
        let progress = match self.progress.take() {
            Some(progress) if jpeg.starts_with(&self.beginning) => Ok(progress),
            _ => self.read_headers(jpeg).map(|start| Progress {
                taken: start,
                ..Progress::default()
            }),
        };
        self.progress = progress
            .and_then(|progress| self.advance(jpeg, progress, image))
            .ok();
        self.beginning.clear();
        self.beginning.extend_from_slice(jpeg);
    }

    fn advance(
        &mut self,
        jpeg: &[u8],
        mut progress: Progress,
        image: &mut Image,
    ) -> Result<Progress, DecodeError> {
        if self.headers.restart_interval != 0 {
            return Err(DecodeError::Unsupported);
        }
        progress.taken += self.scan.take(&jpeg[progress.taken..]);
        let ((across, down), mut components) = self.shape(image, progress.predictors)?;
        let bits = self.scan.bits_from(progress.cursor);
        let rest = progress.mcu..across * down;
        (progress.cursor, progress.mcu) =
            decode_ahead(self.vectors, bits, rest, across, &mut components)?;
        progress.predictors = components.each_ref().map(|part| part.predictor);
        Ok(progress)
    }

    /// Decodes the rest of a partly decoded frame into the same image; `None` if this is another
    /// frame.
    fn finish(&mut self, jpeg: &[u8], image: &mut Image) -> Option<Result<(), DecodeError>> {
        let progress = self.progress.take()?;
        if !jpeg.starts_with(&self.beginning) {
            return None;
        }
        Some(self.decode_rest(jpeg, progress, image))
    }

    fn decode_rest(
        &mut self,
        jpeg: &[u8],
        progress: Progress,
        image: &mut Image,
    ) -> Result<(), DecodeError> {
        if self.scan.load(&jpeg[progress.taken..])? != 0xD9 {
            return Err(DecodeError::Unsupported);
        }
        if self.scan.intervals() != 1 {
            return Err(damaged("a part of its data is missing"));
        }
        let ((across, down), mut components) = self.shape(image, progress.predictors)?;
        let bits = self.scan.bits_from(progress.cursor);
        let rest = progress.mcu..across * down;
        decode_interval(self.vectors, bits, rest, across, &mut components)
    }

    /// Parses everything before the data. Returns where the data begins.
    fn read_headers(&mut self, jpeg: &[u8]) -> Result<usize, DecodeError> {
        self.scan.clear();
        self.headers.read(jpeg)
    }

    /// Sets the layout of the image. Returns the number of MCUs across and down, and the decoders
    /// of the components, which continue from the DC predictors `predictors`.
    fn shape<'a>(
        &'a self,
        image: &'a mut Image,
        predictors: [i32; 3],
    ) -> Result<((usize, usize), [ComponentDecoder<'a>; 3]), DecodeError> {
        let (Some(size), Some(&finest)) = (self.headers.size, self.headers.components.first())
        else {
            return Err(damaged("no size header before the data"));
        };
        let across = size.width.div_ceil(8 * finest.h) as usize;
        let down = size.height.div_ceil(8 * finest.v) as usize;
        image.size = size;
        image.grey = self.headers.components.len() == 1;
        for (plane, component) in image.planes.iter_mut().zip(&self.headers.components) {
            plane.shape(
                across * component.h as usize * 8,
                down * component.v as usize * 8,
                (finest.h / component.h).ilog2(),
                (finest.v / component.v).ilog2(),
            );
        }
        Ok((
            (across, down),
            self.component_decoders(&mut image.planes, predictors)?,
        ))
    }

    /// The decoder of each component; unused ones have no blocks in an MCU.
    fn component_decoders<'a>(
        &'a self,
        planes: &'a mut [Plane; 3],
        predictors: [i32; 3],
    ) -> Result<[ComponentDecoder<'a>; 3], DecodeError> {
        let quantisers = &self.headers.quantisers;
        let missing = |component: &Component| !quantisers[component.quantiser].present;
        if self.headers.components.iter().any(missing) {
            return Err(damaged("a quantisation table is missing"));
        }
        let mut components = self.headers.components.iter().copied();
        let mut predictors = predictors.into_iter();
        Ok(planes.each_mut().map(|plane| {
            let component = components.next().unwrap_or_default();
            ComponentDecoder {
                h: component.h as usize,
                v: component.v as usize,
                quantiser: &quantisers[component.quantiser].scaled,
                dc_table: &self.headers.dc_tables[component.dc_table],
                ac_table: &self.headers.ac_tables[component.ac_table],
                predictor: predictors.next().unwrap_or_default(),
                queue: BlockQueue::default(),
                plane,
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use image::codecs::jpeg::JpegEncoder;
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    use super::*;

    const FILES: [&[u8]; 7] = [
        include_bytes!("../../tests/fixtures/ball-422.jpg"),
        include_bytes!("../../tests/fixtures/ball-444.jpg"),
        include_bytes!("../../tests/fixtures/ball-420.jpg"),
        include_bytes!("../../tests/fixtures/ball-440.jpg"),
        include_bytes!("../../tests/fixtures/ball-grey.jpg"),
        include_bytes!("../../tests/fixtures/ball-restart.jpg"),
        include_bytes!("../../tests/fixtures/ball-cmyk.jpg"),
    ];

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
        Baseline::default().decode(jpeg, &mut image).unwrap();
        decoder.decode_unusual(jpeg, size).unwrap();
        difference(&image.to_rgb(), &decoder.image().to_rgb())
    }

    #[test]
    fn no_frame_shows_pixels_of_the_previous_one() {
        let whole = include_bytes!("../../tests/fixtures/ball-cmyk.jpg");
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
        let (mean, most) = both(include_bytes!("../../tests/fixtures/ball-444.jpg"));
        assert!(mean < 1.0 && most <= 8, "{mean} {most}");
        let (mean, most) = both(include_bytes!("../../tests/fixtures/ball-grey.jpg"));
        assert!(mean < 0.5 && most <= 2, "{mean} {most}");
    }

    /// The `image` crate smooths subsampled Cb and Cr and this decoder does not, which shows only
    /// at sharp edges.
    #[test]
    fn pixels_nearly_equal_those_of_the_image_crate_with_subsampled_chroma() {
        for jpeg in [
            include_bytes!("../../tests/fixtures/ball-422.jpg").as_slice(),
            include_bytes!("../../tests/fixtures/ball-420.jpg"),
            include_bytes!("../../tests/fixtures/ball-440.jpg"),
            include_bytes!("../../tests/fixtures/ball-restart.jpg"),
        ] {
            let (mean, _) = both(jpeg);
            assert!(mean < 4.0, "{mean}");
        }
    }
}
