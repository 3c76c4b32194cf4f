//! Everything that is asked of one frame, with the frame decoded once.

use super::blobs::{Blob, BlobFinder, BlobOptions};
use super::camera::Camera;
use super::line::{Line, find_line};
use crate::vision::colour::Colour;
use crate::vision::colour::palette::Palette;
use crate::vision::jpeg::decoder::Decoder;
use crate::vision::jpeg::frame::FrameError;
use crate::vision::picture::image::{Image, Roi};

/// Palettes that are kept; a behaviour rarely looks for more sets of colours.
const MAX_PALETTES: usize = 8;

/// Looks at frames: decodes on demand and once, keeps compiled colours and all buffers.
#[derive(Debug, Default)]
pub struct Eyes {
    camera: Camera,
    decoder: Decoder,
    /// The frame that the decoder holds, and how its decoding went.
    seen: Option<(u64, Result<(), FrameError>)>,
    /// Newest use last.
    palettes: Vec<Palette>,
    finder: BlobFinder,
    /// What was asked last, with the newest palette.
    asked: Option<BlobOptions>,
    decoded: u64,
}

impl Eyes {
    /// Eyes behind this camera.
    pub fn new(camera: Camera) -> Eyes {
        Eyes {
            camera,
            ..Eyes::default()
        }
    }

    /// The picture of frame number `key`. Asking again for the same key decodes nothing.
    ///
    /// # Errors
    /// Says what is wrong with the frame; asking again for the same key says it again.
    pub fn look(&mut self, key: u64, jpeg: &[u8]) -> Result<&Image, FrameError> {
        if self.seen.as_ref().is_none_or(|(seen, _)| *seen != key) {
            self.decoded += 1;
            self.seen = Some((key, self.decoder.decode(jpeg).map(|_| ())));
        }
        match &self.seen {
            Some((_, Err(error))) => Err(error.clone()),
            _ => Ok(self.decoder.image()),
        }
    }

    /// Decodes what has come of the next frame; see [`Decoder::look_ahead`].
    pub fn look_ahead(&mut self, beginning: &[u8]) {
        self.decoder.look_ahead(beginning);
    }

    /// Decodes the frame that was looked at last once more, unless the beginning of the next one is
    /// decoded already, and finds its blobs once more. What is found is the same: the use of it is
    /// that code and buffers are in the processor's caches when the next frame comes.
    pub fn rehearse(&mut self, jpeg: &[u8]) {
        let Some((_, Ok(()))) = self.seen else {
            return;
        };
        if !self.decoder.is_ahead() && self.decoder.decode(jpeg).is_err() {
            return;
        }
        if let (Some(options), Some(palette)) = (&self.asked, self.palettes.last_mut()) {
            self.finder
                .find(self.decoder.image(), palette, options, self.camera);
        }
    }

    /// The newest frame that was looked at.
    pub fn seen(&self) -> Option<u64> {
        self.seen.as_ref().map(|(key, _)| *key)
    }

    /// The blobs of frame number `key` in any of the colours, largest first; the list lives until the next call.
    ///
    /// # Errors
    /// As [`Eyes::look`].
    pub fn find_blobs(
        &mut self,
        key: u64,
        jpeg: &[u8],
        colours: &[Colour],
        options: &BlobOptions,
    ) -> Result<&[Blob], FrameError> {
        self.look(key, jpeg)?;
        let palette = newest(&mut self.palettes, colours, options.invert);
        if self.asked.as_ref() != Some(options) {
            self.asked = Some(options.clone());
        }
        Ok(self
            .finder
            .find(self.decoder.image(), palette, options, self.camera))
    }

    /// The line of frame number `key` in any of the colours, in a part of it; nothing when there is none.
    ///
    /// # Errors
    /// As [`Eyes::look`].
    pub fn find_line(
        &mut self,
        key: u64,
        jpeg: &[u8],
        colours: &[Colour],
        roi: Option<Roi>,
    ) -> Result<Option<Line>, FrameError> {
        self.look(key, jpeg)?;
        let palette = newest(&mut self.palettes, colours, false);
        Ok(find_line(
            &mut self.finder,
            self.decoder.image(),
            palette,
            roi,
        ))
    }

    /// How many frames were decoded so far.
    pub fn decoded(&self) -> u64 {
        self.decoded
    }
}

/// The palette of these colours, compiled if it is not among those kept.
fn newest<'a>(palettes: &'a mut Vec<Palette>, colours: &[Colour], invert: bool) -> &'a mut Palette {
    match palettes
        .iter()
        .position(|palette| palette.is_of(colours, invert))
    {
        Some(index) => palettes[index..].rotate_left(1),
        None => {
            if palettes.len() == MAX_PALETTES {
                palettes.remove(0);
            }
            palettes.push(Palette::compile(colours, invert));
        }
    }
    let last = palettes.len() - 1;
    &mut palettes[last]
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: &[u8] = include_bytes!("../../tests/fixtures/ball-420.jpg");
    const SECOND: &[u8] = include_bytes!("../../tests/fixtures/ball-444.jpg");

    #[test]
    fn a_rehearsal_changes_nothing_that_is_seen_before_or_after_it() {
        let colours = [Colour::named("red").unwrap()];
        let options = BlobOptions::default();
        let find = |eyes: &mut Eyes, key, jpeg| {
            eyes.find_blobs(key, jpeg, &colours, &options)
                .unwrap()
                .to_vec()
        };
        let mut plain = Eyes::default();
        let expected = [find(&mut plain, 1, FIRST), find(&mut plain, 2, SECOND)];
        let mut eyes = Eyes::default();
        eyes.rehearse(FIRST);
        assert_eq!(find(&mut eyes, 1, FIRST), expected[0]);
        eyes.rehearse(FIRST);
        assert_eq!(find(&mut eyes, 1, FIRST), expected[0]);
        eyes.look_ahead(&SECOND[..SECOND.len() / 2]);
        eyes.rehearse(FIRST);
        assert!(eyes.decoder.is_ahead(), "what has come stays decoded");
        assert_eq!(find(&mut eyes, 2, SECOND), expected[1]);
        assert_eq!(eyes.decoded(), 2);
    }
}
