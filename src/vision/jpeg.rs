//! Decodes JPEGs to planes of samples, and encodes them: most of the time for a frame is spent on
//! decoding (`scripts/bench-vision`). The `image` crate takes three times as long, and returns half a
//! picture without an error.

mod bits;
pub(crate) mod encoder;
pub(crate) mod frame;
mod headers;
mod huffman;
mod idct;
mod machine;
mod mcu;

use self::bits::Scan;
use self::frame::{FrameError, validate_markers};
use self::headers::{Component, Headers};
use self::mcu::{BlockQueue, ComponentDecoder, decode_scan};
use crate::Vectors;
use crate::picture::{Image, Plane, Size};

/// Decodes one frame after another into the same planes, so that after the first frames nothing is
/// allocated. Data that ends early, is too long or is invalid gives an error, where other decoders
/// return half a picture.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    image: Image,
    headers: Headers,
    scan: Scan,
    vectors: Vectors,
}

impl Decoder {
    /// Decodes a baseline JPEG in one scan, as cameras send it, in colour or grey, with or without
    /// Huffman tables.
    pub fn decode(&mut self, jpeg: &[u8]) -> Result<&Image, FrameError> {
        let result = self.try_decode(jpeg);
        if result.is_err() {
            self.image.size = Size::default();
        }
        result.map(|()| &self.image)
    }

    /// The newest picture; 0x0 before the first one and after an error.
    pub fn image(&self) -> &Image {
        &self.image
    }

    fn try_decode(&mut self, jpeg: &[u8]) -> Result<(), FrameError> {
        let size = validate_markers(jpeg)?;
        let start = self.headers.read(jpeg)?;
        if self.scan.load(&jpeg[start..])? != 0xD9 {
            return Err(FrameError::damaged("a marker interrupts its data"));
        }
        let headers = &self.headers;
        let Some(&finest) = headers.components.first() else {
            return Err(FrameError::damaged("no size header before the data"));
        };
        let across = size.width.div_ceil(8 * finest.h) as usize;
        let down = size.height.div_ceil(8 * finest.v) as usize;
        self.image.size = size;
        self.image.grey = headers.components.len() == 1;
        for (plane, component) in self.image.planes.iter_mut().zip(&headers.components) {
            plane.shape(
                across * component.h as usize * 8,
                down * component.v as usize * 8,
                (finest.h / component.h).ilog2(),
                (finest.v / component.v).ilog2(),
            );
        }
        let components = component_decoders(headers, &mut self.image.planes)?;
        let interval = headers.restart_interval;
        decode_scan(self.vectors, &self.scan, interval, across, down, components)
    }
}

/// The decoder of each component; unused ones have no blocks in an MCU.
fn component_decoders<'a>(
    headers: &'a Headers,
    planes: &'a mut [Plane; 3],
) -> Result<[ComponentDecoder<'a>; 3], FrameError> {
    let quantisers = &headers.quantisers;
    let missing = |component: &Component| !quantisers[component.quantiser].present;
    if headers.components.iter().any(missing) {
        return Err(FrameError::damaged("a quantisation table is missing"));
    }
    let mut components = headers.components.iter().copied();
    Ok(planes.each_mut().map(|plane| {
        let component = components.next().unwrap_or_default();
        ComponentDecoder {
            h: component.h as usize,
            v: component.v as usize,
            quantiser: &quantisers[component.quantiser].scaled,
            dc_table: &headers.tables[0][component.dc_table],
            ac_table: &headers.tables[1][component.ac_table],
            predictor: 0,
            queue: BlockQueue::default(),
            plane,
        }
    }))
}

#[cfg(test)]
mod tests {
    use image::RgbImage;
    use proptest::prelude::*;

    use super::*;

    const FILES: [&[u8]; 6] = [
        include_bytes!("../../tests/fixtures/ball-422.jpg"),
        include_bytes!("../../tests/fixtures/ball-444.jpg"),
        include_bytes!("../../tests/fixtures/ball-420.jpg"),
        include_bytes!("../../tests/fixtures/ball-440.jpg"),
        include_bytes!("../../tests/fixtures/ball-grey.jpg"),
        include_bytes!("../../tests/fixtures/ball-restart.jpg"),
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
        let ours = decoded_rgb(&mut Decoder::default(), jpeg).unwrap();
        let theirs = image::load_from_memory(jpeg).unwrap().to_rgb8();
        difference(&ours, &theirs)
    }

    fn decoded_rgb(decoder: &mut Decoder, jpeg: &[u8]) -> Result<RgbImage, FrameError> {
        decoder.decode(jpeg).map(Image::to_rgb)
    }

    /// A decoder that does not use this processor's vector instructions.
    fn plain() -> Decoder {
        Decoder {
            vectors: Vectors::Plain,
            ..Decoder::default()
        }
    }

    proptest! {
        /// However a frame is damaged, vector instructions and the frames before change no result.
        #[test]
        fn a_frame_is_the_same_whatever_decodes_it(
            file in 0..FILES.len(),
            other in 0..FILES.len(),
            damage in prop::option::of((0.0..1.0, any::<u8>())),
        ) {
            let mut jpeg = FILES[file].to_vec();
            if let Some((place, byte)) = damage {
                let at = (place * jpeg.len() as f64) as usize;
                jpeg[at] = byte;
            }
            let fresh = decoded_rgb(&mut Decoder::default(), &jpeg);
            prop_assert_eq!(decoded_rgb(&mut plain(), &jpeg), fresh.clone());
            let mut warm = Decoder::default();
            warm.decode(FILES[other]).unwrap();
            prop_assert_eq!(decoded_rgb(&mut warm, &jpeg), fresh);
        }
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
