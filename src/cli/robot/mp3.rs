//! Checks whether a file is an MP3 by its frame headers, without decoding. Pure.

use std::time::Duration;

/// Properties of an MP3 file from its headers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Mp3 {
    /// Number of contiguous frames.
    pub(super) frames: usize,
    /// Playing time of the frames.
    pub(super) duration: Duration,
}

/// Why a file is not an MP3 that can be sent.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum Mp3Error {
    /// No frame where the first one should be.
    #[error("there is no MP3 frame at byte {0}")]
    NoFrame(usize),
    /// Some frames, then other data.
    #[error("there is no MP3 frame at byte {at}, after {frames} frames: the file is damaged")]
    Damaged {
        /// Number of good frames before.
        frames: usize,
        /// Position where the next frame should be.
        at: usize,
    },
}

/// Kilobits per second of layer III, by index; the indices 0 and 15 are not supported.
const MPEG1_KBPS: [u32; 16] = [
    0, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 320, 0,
];
/// The same for MPEG 2 and 2.5.
const MPEG2_KBPS: [u32; 16] = [
    0, 8, 16, 24, 32, 40, 48, 56, 64, 80, 96, 112, 128, 144, 160, 0,
];
/// Samples per second of MPEG 1, by index; MPEG 2 has half of it, 2.5 a quarter.
const RATES: [u32; 3] = [44_100, 48_000, 32_000];
/// Minimum number of contiguous frames: fewer may match by chance.
const MIN_FRAMES: usize = 2;
const ID3V2_LEN: usize = 10;

#[derive(Debug, Clone, Copy)]
struct Header {
    length: usize,
    samples: u32,
    rate: u32,
}

/// Walks from frame to frame. Skips tags before and after the frames, and accepts an incomplete
/// last frame, as encoders may write one.
///
/// # Errors
/// See [`Mp3Error`].
pub(super) fn check(file: &[u8]) -> Result<Mp3, Mp3Error> {
    let start = tag_length(file);
    let (mut at, mut frames, mut seconds) = (start, 0, 0.0);
    while let Some(header) = file.get(at..).and_then(parse) {
        if at + header.length > file.len() {
            at = file.len();
            break;
        }
        at += header.length;
        frames += 1;
        seconds += f64::from(header.samples) / f64::from(header.rate);
    }
    if frames < MIN_FRAMES {
        return Err(Mp3Error::NoFrame(start));
    }
    let rest = &file[at..];
    let tag = rest.starts_with(b"TAG") || rest.starts_with(b"APETAGEX");
    if !tag && rest.iter().any(|&byte| byte != 0) {
        return Err(Mp3Error::Damaged { frames, at });
    }
    let duration = Duration::from_secs_f64(seconds);
    Ok(Mp3 { frames, duration })
}

/// The length of an ID3v2 tag at the beginning, encoded in four bytes of seven bits each; 0 without
/// a tag.
fn tag_length(file: &[u8]) -> usize {
    let Some(head) = file
        .get(..ID3V2_LEN)
        .filter(|head| head.starts_with(b"ID3"))
    else {
        return 0;
    };
    let size = head[6..]
        .iter()
        .fold(0, |size, &byte| size << 7 | usize::from(byte & 0x7F));
    let footer = if head[5] & 0x10 != 0 { ID3V2_LEN } else { 0 };
    ID3V2_LEN + size + footer
}

fn parse(bytes: &[u8]) -> Option<Header> {
    let &[sync, kind, rates, _, ..] = bytes else {
        return None;
    };
    const LAYER_3: u8 = 1;
    if sync != 0xFF || kind & 0xE0 != 0xE0 || kind >> 1 & 3 != LAYER_3 {
        return None;
    }
    let (table, samples, slow) = match kind >> 3 & 3 {
        3 => (&MPEG1_KBPS, 1152, 0),
        2 => (&MPEG2_KBPS, 576, 1),
        0 => (&MPEG2_KBPS, 576, 2),
        _ => return None,
    };
    let bits = table[usize::from(rates >> 4)] * 1000;
    let rate = RATES.get(usize::from(rates >> 2 & 3))? >> slow;
    if bits == 0 {
        return None;
    }
    let padding = u32::from(rates >> 1 & 1);
    let length = samples / 8 * bits / rate + padding;
    Some(Header {
        length: usize::try_from(length).ok()?,
        samples,
        rate,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// MPEG 1 layer III, 128 kbit/s, 44.1 kHz: 417 bytes a frame.
    fn frames(count: usize) -> Vec<u8> {
        let mut frame = vec![0; 417];
        frame[..4].copy_from_slice(&[0xFF, 0xFB, 0x90, 0x00]);
        frame.repeat(count)
    }

    #[test]
    fn contiguous_frames_between_tags_are_an_mp3() {
        let tag = [b'I', b'D', b'3', 4, 0, 0, 0, 0, 1, 2];
        let file = [&tag[..], &[7; 130], &frames(100), b"TAG title"].concat();
        let mp3 = check(&file).unwrap();
        assert_eq!(mp3.frames, 100);
        assert!((mp3.duration.as_secs_f64() - 2.612).abs() < 0.001);
    }

    #[test]
    fn other_files_and_damaged_ones_are_refused() {
        assert_eq!(check(b"RIFF....WAVE"), Err(Mp3Error::NoFrame(0)));
        assert_eq!(check(b""), Err(Mp3Error::NoFrame(0)));
        assert_eq!(check(&frames(1)), Err(Mp3Error::NoFrame(0)));
        let spoilt = [&frames(3)[..], b"garbage"].concat();
        assert_eq!(
            check(&spoilt),
            Err(Mp3Error::Damaged {
                frames: 3,
                at: 1251
            })
        );
        assert_eq!(check(&frames(3)[..1000]).unwrap().frames, 2);
    }

    proptest! {
        #[test]
        fn no_bytes_cause_a_panic(
            start in prop::sample::select(vec![vec![], frames(2), b"ID3\x04\0\x10\x7F\x7F\x7F\x7F".to_vec()]),
            bytes in prop::collection::vec(any::<u8>(), 0..600),
        ) {
            let _ = check(&[start, bytes].concat());
        }
    }
}
