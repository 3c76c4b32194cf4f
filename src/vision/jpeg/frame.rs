//! Validates the markers of a frame before its data is decoded: cameras and links truncate frames,
//! and decoders accept half a file without an error. Nothing is allocated.

use thiserror::Error;

use crate::vision::picture::{MAX_HEIGHT, MAX_WIDTH, Size};

/// Longest JPEG that is accepted, in bytes.
pub const MAX_JPEG_LEN: usize = 4 << 20;
/// Most scans of a progressive picture: each takes a pass over the whole picture.
const MAX_SCANS: usize = 65;
/// Most pixels that all scans of a progressive frame may process in total; ten scans of 640x480 are
/// half of that.
const MAX_SCANNED: usize = 6_500_000;

/// Why the bytes of a frame are not a picture.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The bytes end inside a header; holds their number.
    #[error("the frame is cut short: its {0} bytes end inside a header")]
    TooShort(usize),
    /// More than [`MAX_JPEG_LEN`] bytes; holds their number.
    #[error("the frame has {0} bytes; at most {MAX_JPEG_LEN} are accepted")]
    TooLong(usize),
    /// The bytes do not begin with JPEG's start marker.
    #[error("the frame is not a JPEG: it does not begin with FF D8")]
    NoStart,
    /// JPEG's end marker is missing: the frame was truncated.
    #[error("the frame is cut short: it has no end marker FF D9")]
    NoEnd,
    /// More pixels than the decoder accepts.
    #[error("the frame is {width}x{height}, larger than {MAX_WIDTH}x{MAX_HEIGHT}")]
    TooLarge {
        /// Number of columns in the header.
        width: u32,
        /// Number of rows in the header.
        height: u32,
    },
    /// A kind of JPEG that supported cameras do not make, such as lossless or 12-bit.
    #[error("the frame is an unsupported kind of JPEG: {0}")]
    Unsupported(&'static str),
    /// The markers or the data are inconsistent.
    #[error("the frame is damaged: {0}")]
    Damaged(String),
}

impl FrameError {
    pub(crate) fn damaged(what: &str) -> FrameError {
        FrameError::Damaged(what.to_owned())
    }
}

/// Checks the start, markers, size and end of a JPEG without decoding it. The data
/// between the markers may still be invalid.
pub fn validate_markers(jpeg: &[u8]) -> Result<Size, FrameError> {
    Markers::read(jpeg).map(|markers| markers.size)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Markers {
    pub(crate) size: Size,
    /// One scan, Huffman coded, eight bits, as cameras send it.
    pub(crate) baseline: bool,
}

impl Markers {
    /// Reads the markers up to the first scan, then checks for the end marker.
    pub(crate) fn read(jpeg: &[u8]) -> Result<Markers, FrameError> {
        let (markers, data) = Markers::read_before_data(jpeg)?;
        check_rest(&jpeg[data..], &markers)?;
        Ok(markers)
    }

    /// Reads the markers up to the first scan. Also returns where its data begins.
    pub(crate) fn read_before_data(jpeg: &[u8]) -> Result<(Markers, usize), FrameError> {
        if jpeg.len() > MAX_JPEG_LEN {
            return Err(FrameError::TooLong(jpeg.len()));
        }
        if !b"\xFF\xD8".starts_with(&jpeg[..jpeg.len().min(2)]) {
            return Err(FrameError::NoStart);
        }
        let mut picture = None;
        let mut segments = Segments::new(jpeg);
        loop {
            let segment = segments.next()?;
            match segment.marker {
                0xC4 => {}
                0xC0..=0xC2 => picture = Some(read_size(segment)?),
                0xC3 | 0xC5..=0xC7 | 0xCD..=0xCF => {
                    return Err(FrameError::Unsupported("lossless or hierarchical"));
                }
                0xC9..=0xCB => return Err(FrameError::Unsupported("arithmetic coding")),
                0xD9 => {
                    return Err(FrameError::damaged(
                        "the end marker comes before the picture",
                    ));
                }
                0xDA => break,
                _ => {}
            }
        }
        let markers =
            picture.ok_or_else(|| FrameError::damaged("no size header before the data"))?;
        Ok((markers, segments.at))
    }
}

/// Reads the size, and whether the picture is baseline, from a start-of-frame segment.
fn read_size(segment: Segment<'_>) -> Result<Markers, FrameError> {
    let &[bits, h1, h0, w1, w0, components, ..] = segment.body else {
        return Err(FrameError::damaged("its size header is too short"));
    };
    let width = u32::from(u16::from_be_bytes([w1, w0]));
    let height = u32::from(u16::from_be_bytes([h1, h0]));
    if bits != 8 {
        return Err(FrameError::Unsupported("not 8 bits per sample"));
    }
    if !matches!(components, 1 | 3 | 4) {
        return Err(FrameError::Unsupported("neither grey, colour nor CMYK"));
    }
    if width == 0 || height == 0 {
        return Err(FrameError::damaged("its width or height is 0"));
    }
    if width > MAX_WIDTH || height > MAX_HEIGHT {
        return Err(FrameError::TooLarge { width, height });
    }
    Ok(Markers {
        size: Size { width, height },
        baseline: segment.marker != 0xC2,
    })
}

/// Checks that the end marker follows the data; padding after it is normal.
fn check_rest(data: &[u8], markers: &Markers) -> Result<(), FrameError> {
    if !data.windows(2).rev().any(|pair| pair == [0xFF, 0xD9]) {
        return Err(FrameError::NoEnd);
    }
    if markers.baseline {
        return Ok(());
    }
    // Each scan takes a pass over the whole picture, however few bytes it has.
    let scans = 1 + data.windows(2).filter(|pair| *pair == [0xFF, 0xDA]).count();
    let pixels = markers.size.width as usize * markers.size.height as usize;
    if scans > MAX_SCANS || scans * pixels > MAX_SCANNED {
        Err(FrameError::Unsupported("too many scans"))
    } else {
        Ok(())
    }
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Segment<'a> {
    pub(crate) marker: u8,
    pub(crate) body: &'a [u8],
}

pub(crate) struct Segments<'a> {
    jpeg: &'a [u8],
    pub(crate) at: usize,
}

impl<'a> Segments<'a> {
    pub(crate) fn new(jpeg: &'a [u8]) -> Self {
        Segments { jpeg, at: 2 }
    }

    /// The next segment; the end marker has an empty body.
    pub(crate) fn next(&mut self) -> Result<Segment<'a>, FrameError> {
        let short = || FrameError::TooShort(self.jpeg.len());
        let rest = self.jpeg.get(self.at..).ok_or_else(short)?;
        let fill = rest.iter().take_while(|&&byte| byte == 0xFF).count();
        if fill == 0 && !rest.is_empty() {
            return Err(FrameError::damaged(
                "a marker is missing where one is required",
            ));
        }
        let marker = *rest.get(fill).ok_or_else(short)?;
        if marker == 0xD9 {
            self.at += fill + 1;
            return Ok(Segment { marker, body: &[] });
        }
        let &[high, low, ..] = &rest[fill + 1..] else {
            return Err(short());
        };
        let len = usize::from(u16::from_be_bytes([high, low]));
        let body = rest[fill + 1..].get(2..len.max(2)).ok_or_else(short)?;
        self.at += fill + 1 + len.max(2);
        Ok(Segment { marker, body })
    }
}

#[derive(Default)]
struct Walk {
    progressive: bool,
    /// Whether a restart interval is set: the data then has restart markers.
    restarts: bool,
    seen: Vec<u8>,
}

/// Checks that the data of each scan of a JPEG that is not single-scan baseline ends where it may. The
/// `image` crate takes a marker inside the data as its end and returns half a picture without an error.
pub(crate) fn check_scans(jpeg: &[u8]) -> Result<(), FrameError> {
    let mut walk = Walk::default();
    let mut segments = Segments::new(jpeg);
    loop {
        let segment = segments.next()?;
        match segment.marker {
            0xC2 => walk.progressive = true,
            0xDD => walk.restarts = segment.body.iter().any(|&byte| byte != 0),
            0xDA => {
                walk.scan(segment.body)?;
                segments.at += walk.data(&jpeg[segments.at..])?;
            }
            0xD9 => return nothing_follows(&jpeg[segments.at..]),
            0x01..=0xBF | 0xD0..=0xD8 => {
                return Err(FrameError::damaged("a marker is at an invalid position"));
            }
            _ => {}
        }
    }
}

impl Walk {
    /// Checks a scan header. Unless the picture is progressive, each component may occur once.
    fn scan(&mut self, body: &[u8]) -> Result<(), FrameError> {
        let short = || FrameError::damaged("a scan's header is too short");
        let (&count, rest) = body.split_first().ok_or_else(short)?;
        let parts = rest.get(..2 * usize::from(count)).ok_or_else(short)?;
        for part in parts.chunks_exact(2) {
            if self.seen.contains(&part[0]) && !self.progressive {
                return Err(FrameError::damaged("a component is coded twice"));
            }
            self.seen.push(part[0]);
        }
        Ok(())
    }

    /// Length of a scan's data, up to a marker that is not a restart marker.
    fn data(&self, data: &[u8]) -> Result<usize, FrameError> {
        let mut markers = data.windows(2).enumerate();
        let marker = markers.find_map(|(at, pair)| match *pair {
            [0xFF, 0x00 | 0xFF] => None,
            [0xFF, 0xD0..=0xD7] if self.restarts => None,
            [0xFF, _] => Some(at),
            _ => None,
        });
        marker.ok_or(FrameError::NoEnd)
    }
}

/// Padding may follow the end marker, but not a second end marker.
fn nothing_follows(rest: &[u8]) -> Result<(), FrameError> {
    if rest.windows(2).any(|pair| pair == [0xFF, 0xD9]) {
        return Err(FrameError::damaged("it has two end markers"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Decoder;

    /// A frame with markers only: size, scan header, one byte of data, end.
    fn skeleton(width: u16, height: u16, kind: u8) -> Vec<u8> {
        let mut bytes = vec![0xFF, 0xD8, 0xFF, kind, 0, 11, 8];
        bytes.extend(height.to_be_bytes());
        bytes.extend(width.to_be_bytes());
        bytes.extend([
            1, 1, 0x11, 0, 0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0, 0x55, 0xFF, 0xD9,
        ]);
        bytes
    }

    #[test]
    fn a_valid_skeleton_gives_its_size() {
        assert_eq!(
            validate_markers(&skeleton(320, 240, 0xC0)),
            Ok(Size {
                width: 320,
                height: 240
            })
        );
    }

    #[test]
    fn padding_after_the_end_is_accepted() {
        let mut bytes = skeleton(320, 240, 0xC0);
        bytes.extend([0; 700]);
        assert!(validate_markers(&bytes).is_ok());
    }

    #[test]
    fn every_truncation_is_refused() {
        let bytes = skeleton(320, 240, 0xC0);
        for len in 0..bytes.len() {
            assert!(
                validate_markers(&bytes[..len]).is_err(),
                "accepted {len} of {} bytes",
                bytes.len()
            );
        }
    }

    #[test]
    fn sizes_out_of_bounds_are_refused_before_anything_is_allocated() {
        assert_eq!(
            validate_markers(&skeleton(65_535, 65_535, 0xC0)),
            Err(FrameError::TooLarge {
                width: 65_535,
                height: 65_535
            })
        );
        assert!(matches!(
            validate_markers(&skeleton(0, 240, 0xC0)),
            Err(FrameError::Damaged(_))
        ));
    }

    #[test]
    fn other_kinds_of_jpeg_are_refused_as_unsupported() {
        for kind in [0xC3, 0xC5, 0xC9, 0xCB, 0xCF] {
            assert!(matches!(
                validate_markers(&skeleton(320, 240, kind)),
                Err(FrameError::Unsupported(_))
            ));
        }
        assert_eq!(validate_markers(b"GIF89a"), Err(FrameError::NoStart));
    }

    const RARER: [&[u8]; 2] = [
        include_bytes!("../../../tests/fixtures/ball-cmyk.jpg"),
        include_bytes!("../../../tests/fixtures/ball-progressive.jpg"),
    ];

    /// A picture with bytes inserted into the data of its first scan.
    fn cut(whole: &[u8], at: usize, marker: &[u8]) -> Vec<u8> {
        let data = whole.windows(2).position(|pair| pair == [0xFF, 0xDA]);
        // Not between a data byte FF and the stuffed 00 that follows it.
        let mut at = data.unwrap() + 20 + at;
        while whole[at - 1] == 0xFF {
            at += 1;
        }
        let (top, bottom) = whole.split_at(at);
        [top, marker, bottom].concat()
    }

    #[test]
    fn undamaged_pictures_pass() {
        for whole in RARER {
            assert_eq!(check_scans(whole), Ok(()));
            let padded = [whole, &[0; 700]].concat();
            assert_eq!(check_scans(&padded), Ok(()));
            assert!(Decoder::default().decode(whole).is_ok());
        }
    }

    #[test]
    fn data_interrupted_by_a_marker_is_an_error() {
        let markers: [&[u8]; 8] = [
            b"\xFF\xC4\0\x02",
            b"\xFF\xDB\0\x02",
            b"\xFF\xE0\0\x02",
            b"\xFF\xDA\0\x02",
            b"\xFF\xD8",
            b"\xFF\xD9",
            b"\xFF\xD3",
            b"\xFF\x01",
        ];
        for whole in RARER {
            for marker in markers {
                for at in [10, 100, 300] {
                    let half = cut(whole, at, marker);
                    let seen = Decoder::default().decode(&half).map(|image| image.size());
                    assert!(seen.is_err(), "cut by {marker:02X?} at {at}: {seen:?}");
                }
            }
        }
    }
}
