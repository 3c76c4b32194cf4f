//! Decodes baseline JPEGs in one scan, as cameras send them, directly into reusable planes.
//!
//! After the first frames nothing is allocated, and luma and chroma stay in separate planes as in
//! the frame. Data that ends early, is too long or is invalid gives an error, where other decoders
//! return half a picture. A frame that is still being received is decoded as far as it goes, so
//! that little work is left when it is complete. Kinds of JPEG that cameras do not send
//! (progressive, CMYK, several scans) are [`DecodeError::Unsupported`]: the `image` crate decodes
//! them.

use super::bits::{Cursor, Scan};
use super::block::BlockQueue;
use super::headers::{Component, DecodeError, Headers, damaged};
use super::mcu::{ComponentDecoder, decode_ahead, decode_interval, decode_scan};
use crate::vision::picture::image::{Image, Plane};
use crate::vision::vectors::Vectors;

/// Tables and buffers that are kept from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Baseline {
    headers: Headers,
    scan: Scan,
    pub(super) vectors: Vectors,
    /// How far a frame that is still being received has been decoded.
    progress: Option<Progress>,
    /// All received bytes of that frame.
    beginning: Vec<u8>,
}

/// How far a frame has been decoded.
#[derive(Debug, Clone, Copy, Default)]
struct Progress {
    /// Number of bytes of the frame that the scan has consumed.
    taken: usize,
    cursor: Cursor,
    /// Index of the next MCU.
    mcu: usize,
    /// The last DC coefficient of each component.
    predictors: [i32; 3],
}

impl Baseline {
    /// Decodes a complete frame whose markers have been validated; ignores a partly decoded one.
    /// After an error, the content of the image is unspecified.
    pub(super) fn decode(
        &mut self,
        jpeg: &[u8],
        has_tables: bool,
        image: &mut Image,
    ) -> Result<(), DecodeError> {
        self.progress = None;
        let start = self.read_headers(jpeg, has_tables)?;
        if self.scan.load(&jpeg[start..])? != 0xD9 {
            return Err(DecodeError::Unsupported);
        }
        let (mcus, components) = self.shape(image, [0; 3])?;
        let interval = self.headers.restart_interval;
        decode_scan(self.vectors, &self.scan, interval, mcus, components)
    }

    /// Decodes as much as possible of a frame that is still being received and whose markers before
    /// the data have been validated. The rest is left for later.
    pub(super) fn decode_ahead(&mut self, jpeg: &[u8], has_tables: bool, image: &mut Image) {
        let progress = match self.progress.take() {
            Some(progress) if jpeg.starts_with(&self.beginning) => Ok(progress),
            _ => {
                let start = self.read_headers(jpeg, has_tables);
                start.map(|start| Progress {
                    taken: start,
                    ..Progress::default()
                })
            }
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
    pub(super) fn finish(
        &mut self,
        jpeg: &[u8],
        image: &mut Image,
    ) -> Option<Result<(), DecodeError>> {
        let progress = self.progress.take()?;
        let known = jpeg.starts_with(&self.beginning);
        known.then(|| self.decode_rest(jpeg, progress, image))
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
    fn read_headers(&mut self, jpeg: &[u8], has_tables: bool) -> Result<usize, DecodeError> {
        self.scan.clear();
        self.headers.read(jpeg, has_tables)
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
            let shifts = (finest.h / component.h, finest.v / component.v);
            let blocks = (across * component.h as usize, down * component.v as usize);
            plane.shape(
                (blocks.0 * 8, blocks.1 * 8),
                (shifts.0.ilog2(), shifts.1.ilog2()),
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
