//! Decodes a frame while it is still being received, so that little work is left when it is
//! complete.

use super::baseline::Baseline;
use super::bits::Cursor;
use super::headers::{DecodeError, damaged};
use super::mcu::{decode_ahead, decode_interval};
use crate::vision::picture::image::Image;

/// The decoder of baseline frames, with the state of a partly received frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Incremental {
    baseline: Baseline,
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

impl Incremental {
    /// Selects the instruction set for further frames.
    #[cfg(test)]
    pub(super) fn use_vectors(&mut self, vectors: crate::vision::vectors::Vectors) {
        self.baseline.vectors = vectors;
    }

    /// Decodes a complete frame, ignoring any partly decoded one; see [`Baseline::decode`].
    pub(super) fn decode(
        &mut self,
        jpeg: &[u8],
        has_tables: bool,
        image: &mut Image,
    ) -> Result<(), DecodeError> {
        self.progress = None;
        self.baseline.decode(jpeg, has_tables, image)
    }

    /// Decodes as much as possible of a frame that is still being received and whose markers before
    /// the data have been validated. The rest is left for later.
    pub(super) fn decode_ahead(&mut self, jpeg: &[u8], has_tables: bool, image: &mut Image) {
        let before = self.progress.take();
        let known = before.filter(|_| jpeg.starts_with(&self.beginning));
        let progress = match known {
            Some(progress) => Ok(progress),
            None => {
                let start = self.baseline.read_headers(jpeg, has_tables);
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
        let baseline = &mut self.baseline;
        if baseline.headers.restart_interval != 0 {
            return Err(DecodeError::Unsupported);
        }
        progress.taken += baseline.scan.take(&jpeg[progress.taken..]);
        let ((across, down), mut components) = baseline.shape(image, progress.predictors)?;
        let bits = baseline.scan.bits_from(progress.cursor);
        let rest = progress.mcu..across * down;
        (progress.cursor, progress.mcu) =
            decode_ahead(baseline.vectors, bits, rest, across, &mut components)?;
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
        let baseline = &mut self.baseline;
        if baseline.scan.load(&jpeg[progress.taken..])? != 0xD9 {
            return Err(DecodeError::Unsupported);
        }
        if baseline.scan.intervals() != 1 {
            return Err(damaged("a part of its data is missing"));
        }
        let ((across, down), mut components) = baseline.shape(image, progress.predictors)?;
        let bits = baseline.scan.bits_from(progress.cursor);
        let rest = progress.mcu..across * down;
        decode_interval(baseline.vectors, bits, rest, across, &mut components)
    }
}
