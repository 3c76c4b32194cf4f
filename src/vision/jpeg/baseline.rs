//! Decodes baseline JPEGs in one scan, as cameras send them, directly into reusable planes.
//!
//! After the first frames nothing is allocated, and luma and chroma stay in separate planes as in
//! the frame. Data that ends early, is too long or is invalid gives an error, where other decoders
//! return half a picture. Kinds of JPEG that cameras do not send (progressive, CMYK, several scans)
//! are [`DecodeError::Unsupported`]: the `image` crate decodes them.

use super::bits::Scan;
use super::block::BlockQueue;
use super::headers::{Component, DecodeError, Headers, damaged};
use super::mcu::{ComponentDecoder, decode_scan};
use crate::vision::picture::image::{Image, Plane};
use crate::vision::vectors::Vectors;

/// Tables and buffers that are kept from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Baseline {
    pub(super) headers: Headers,
    pub(super) scan: Scan,
    pub(super) vectors: Vectors,
}

impl Baseline {
    /// Decodes a frame whose markers have been validated. After an error, the content of the image
    /// is unspecified.
    pub(super) fn decode(
        &mut self,
        jpeg: &[u8],
        has_tables: bool,
        image: &mut Image,
    ) -> Result<(), DecodeError> {
        let start = self.read_headers(jpeg, has_tables)?;
        if self.scan.load(&jpeg[start..])? != 0xD9 {
            return Err(DecodeError::Unsupported);
        }
        let (mcus, components) = self.shape(image, [0; 3])?;
        let interval = self.headers.restart_interval;
        decode_scan(self.vectors, &self.scan, interval, mcus, components)
    }

    /// Parses everything before the data. Returns where the data begins.
    pub(super) fn read_headers(
        &mut self,
        jpeg: &[u8],
        has_tables: bool,
    ) -> Result<usize, DecodeError> {
        self.scan.clear();
        self.headers.read(jpeg, has_tables)
    }

    /// Sets the layout of the image. Returns the number of MCUs across and down, and the decoders
    /// of the components, which continue from the DC predictors `predictors`.
    pub(super) fn shape<'a>(
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
