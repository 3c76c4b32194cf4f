//! Extracts the samples of a WAV file in the format of the robot's speaker. Pure. The crate `hound`
//! (3.5.1) refuses files that play well: those with a chunk of odd length before the samples, and
//! those that ffmpeg writes to a pipe, whose length is unknown.

/// Format of the robot's audio (`PROTOCOL.md`, AUDIO): one channel, 16 kHz, s16 little-endian.
const CHANNELS: u16 = 1;
const RATE: u32 = 16_000;
const BITS: u16 = 16;
/// Format tag of integer samples.
const PCM: u16 = 1;
/// Format tag of samples whose kind is in an extension of the header.
const EXTENSIBLE: u16 = 0xFFFE;

/// Why a file cannot be played.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum WavError {
    /// Not a WAV file.
    #[error("it is not a WAV file")]
    NoWav,
    /// Samples in another format.
    #[error(
        "it has {channels} channels, {rate} samples per second of {bits} bits; the robot takes 1, 16000 and 16"
    )]
    Other {
        /// Number of channels.
        channels: u16,
        /// Samples per second.
        rate: u32,
        /// Bits per sample.
        bits: u16,
    },
    /// No samples.
    #[error("it has no samples")]
    Empty,
}

/// Returns the samples. Of a truncated file, returns the samples that are there.
///
/// # Errors
/// See [`WavError`].
pub(super) fn samples(file: &[u8]) -> Result<&[u8], WavError> {
    let (head, mut rest) = file.split_at_checked(12).ok_or(WavError::NoWav)?;
    if !head.starts_with(b"RIFF") || !head.ends_with(b"WAVE") {
        return Err(WavError::NoWav);
    }
    let mut known = false;
    while let Some((head, behind)) = rest.split_first_chunk::<8>() {
        let [a, b, c, d, length @ ..] = *head;
        let length = usize::try_from(u32::from_le_bytes(length)).unwrap_or(usize::MAX);
        let (chunk, next) = behind.split_at(length.min(behind.len()));
        match &[a, b, c, d] {
            b"fmt " => {
                format(chunk)?;
                known = true;
            }
            b"data" if known => {
                let whole = chunk.len() - chunk.len() % 2;
                return match whole {
                    0 => Err(WavError::Empty),
                    _ => Ok(&chunk[..whole]),
                };
            }
            _ => {}
        }
        // Chunks begin at even offsets.
        rest = next.get(length % 2..).unwrap_or_default();
    }
    Err(if known {
        WavError::Empty
    } else {
        WavError::NoWav
    })
}

fn format(chunk: &[u8]) -> Result<(), WavError> {
    let Some(&[a, b, c, d, r0, r1, r2, r3, _, _, _, _, _, _, e, f]) = chunk.first_chunk() else {
        return Err(WavError::NoWav);
    };
    let kind = u16::from_le_bytes([a, b]);
    let channels = u16::from_le_bytes([c, d]);
    let rate = u32::from_le_bytes([r0, r1, r2, r3]);
    let bits = u16::from_le_bytes([e, f]);
    if matches!(kind, PCM | EXTENSIBLE) && (channels, rate, bits) == (CHANNELS, RATE, BITS) {
        return Ok(());
    }
    Err(WavError::Other {
        channels,
        rate,
        bits,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn wav(channels: u16, rate: u32, bits: u16, samples: &[u8]) -> Vec<u8> {
        let mut file = b"RIFF\0\0\0\0WAVE".to_vec();
        file.extend(b"LIST\x03\0\0\0abc\0fmt \x10\0\0\0\x01\0");
        file.extend(channels.to_le_bytes());
        file.extend(rate.to_le_bytes());
        file.extend([0; 6]);
        file.extend(bits.to_le_bytes());
        file.extend(b"data");
        file.extend(u32::try_from(samples.len()).unwrap().to_le_bytes());
        file.extend(samples);
        file
    }

    #[test]
    fn samples_are_found_after_other_chunks() {
        assert_eq!(
            samples(&wav(1, 16_000, 16, &[1, 2, 3, 4])),
            Ok(&[1, 2, 3, 4][..])
        );
        let mut cut = wav(1, 16_000, 16, &[1, 2, 3, 4]);
        cut.pop();
        assert_eq!(samples(&cut), Ok(&[1, 2][..]));
        let mut piped = wav(1, 16_000, 16, &[1, 2, 3, 4]);
        let length = piped.len() - 8..piped.len() - 4;
        piped[length].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(samples(&piped), Ok(&[1, 2, 3, 4][..]));
    }

    #[test]
    fn unsupported_formats_are_refused_with_a_reason() {
        let stereo = samples(&wav(2, 44_100, 16, &[0; 8])).unwrap_err();
        assert!(stereo.to_string().contains("2 channels, 44100"), "{stereo}");
        assert_eq!(samples(b"RIFF"), Err(WavError::NoWav));
        assert_eq!(samples(&[0; 100]), Err(WavError::NoWav));
        assert_eq!(samples(&wav(1, 16_000, 16, &[])), Err(WavError::Empty));
    }

    proptest! {
        #[test]
        fn no_file_causes_a_panic(mut file in prop::collection::vec(any::<u8>(), 0..200), whole: bool) {
            if whole && file.len() > 12 {
                file[..12].copy_from_slice(b"RIFF\0\0\0\0WAVE");
            }
            let _ = samples(&file);
        }
    }
}
