//! Answers all queries about one frame and decodes the frame only once.

use std::time::Duration;

use tokio::time::Instant;

use super::blobs::{Blob, BlobFinder, BlobOptions};
use super::camera::Camera;
use super::colour::Colour;
use super::colour::palette::Palette;
use super::jpeg::decoder::Decoder;
use super::jpeg::frame::FrameError;
use super::line::{Line, find_line};
use super::picture::{Image, Roi};

/// Most palettes that are kept; a behaviour rarely looks for more sets of colours.
const MAX_PALETTES: usize = 8;

/// Analyses frames: decodes each on demand and once; keeps compiled palettes and all buffers.
#[derive(Debug, Default)]
pub struct FrameAnalyser {
    camera: Camera,
    decoder: Decoder,
    /// The frame that the decoder holds and the result of its decoding.
    last: Option<(u64, Result<(), FrameError>)>,
    /// The most recently used palette is last.
    palettes: Vec<Palette>,
    finder: BlobFinder,
    decoded: u64,
}

impl FrameAnalyser {
    /// Creates an analyser for this camera.
    pub fn new(camera: Camera) -> FrameAnalyser {
        FrameAnalyser {
            camera,
            ..FrameAnalyser::default()
        }
    }

    /// Returns the picture of frame number `key`. Further calls with the same key decode nothing.
    /// An error is returned again too.
    pub fn decode(&mut self, key: u64, jpeg: &[u8]) -> Result<&Image, FrameError> {
        if self.last.as_ref().is_none_or(|(last, _)| *last != key) {
            self.decoded += 1;
            self.last = Some((key, self.decoder.decode(jpeg).map(|_| ())));
        }
        match &self.last {
            Some((_, Err(error))) => Err(error.clone()),
            _ => Ok(self.decoder.image()),
        }
    }

    /// Decodes the part of the next frame that has been received; see [`Decoder::decode_ahead`].
    pub fn decode_ahead(&mut self, beginning: &[u8]) {
        self.decoder.decode_ahead(beginning);
    }

    /// The number of the last frame that was decoded, successfully or not.
    pub fn last_frame(&self) -> Option<u64> {
        self.last.as_ref().map(|(key, _)| *key)
    }

    /// Finds the blobs of frame number `key` in any of the colours, largest first. The list is
    /// valid until the next call.
    pub fn find_blobs(
        &mut self,
        key: u64,
        jpeg: &[u8],
        colours: &[Colour],
        options: &BlobOptions,
    ) -> Result<&[Blob], FrameError> {
        self.decode(key, jpeg)?;
        let palette = newest(&mut self.palettes, colours, options.invert);
        Ok(self
            .finder
            .find(self.decoder.image(), palette, options, self.camera))
    }

    /// Finds the line of frame number `key` in any of the colours, in a part of the picture; `None`
    /// if there is none.
    pub fn find_line(
        &mut self,
        key: u64,
        jpeg: &[u8],
        colours: &[Colour],
        roi: Option<Roi>,
    ) -> Result<Option<Line>, FrameError> {
        self.decode(key, jpeg)?;
        let palette = newest(&mut self.palettes, colours, false);
        let line = find_line(&mut self.finder, self.decoder.image(), palette, roi);
        Ok(line.map(|line| line.levelled(self.camera.roll)))
    }

    /// The number of frames decoded so far.
    pub fn decoded(&self) -> u64 {
        self.decoded
    }
}

/// Returns the palette of these colours; compiles it if it is not cached.
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

/// Least time between two log lines about damaged frames.
const PAUSE: Duration = Duration::from_secs(10);

/// The damaged frames so far.
#[derive(Debug, Default)]
pub struct Damage {
    count: u64,
    newest: Option<u64>,
    reported: u64,
    said_at: Option<Instant>,
    why: String,
}

impl Damage {
    /// Counts frame number `seq`, once even if it is noted repeatedly. Returns a log message if one
    /// is due.
    pub fn record(&mut self, seq: u64, why: &str, now: Instant) -> Option<String> {
        if self.newest == Some(seq) {
            return None;
        }
        self.newest = Some(seq);
        self.count += 1;
        why.clone_into(&mut self.why);
        let lately = |at: Instant| now.saturating_duration_since(at) < PAUSE;
        if self.said_at.is_some_and(lately) {
            return None;
        }
        self.said_at = Some(now);
        self.rest()
    }

    /// Returns a log message if there are unreported damaged frames.
    pub fn rest(&mut self) -> Option<String> {
        if self.reported == self.count {
            return None;
        }
        self.reported = self.count;
        Some(match self.count {
            1 => format!("a damaged frame: {}", self.why),
            count => format!("{count} damaged frames so far; the newest: {}", self.why),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_is_reported_at_once_and_further_ones_together() {
        let mut damage = Damage::default();
        let start = Instant::now();
        let first = damage.record(1, "cut short", start);
        assert_eq!(first.as_deref(), Some("a damaged frame: cut short"));
        for seq in 2..=5 {
            assert_eq!(damage.record(seq, "torn", start + PAUSE / 2), None);
        }
        let text = damage.record(6, "torn", start + PAUSE).unwrap();
        assert!(text.starts_with("6 damaged frames"), "{text}");
        assert_eq!(damage.rest(), None);
    }

    #[test]
    fn a_frame_is_counted_once_even_if_noted_repeatedly() {
        let mut damage = Damage::default();
        let start = Instant::now();
        for seq in [7, 7, 7, 9, 9] {
            damage.record(seq, "torn", start);
        }
        assert!(damage.rest().unwrap().starts_with("2 damaged frames"));
    }
}
