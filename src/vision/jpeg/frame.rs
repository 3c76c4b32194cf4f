//! Validates the markers of a frame before its data is decoded: cameras and links truncate frames,
//! and decoders accept half a file without an error. Nothing is allocated.

use thiserror::Error;

use crate::picture::{MAX_HEIGHT, MAX_WIDTH, Size};

/// Longest JPEG that is accepted, in bytes.
pub const MAX_JPEG_LEN: usize = 4 << 20;
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
    if jpeg.len() > MAX_JPEG_LEN {
        return Err(FrameError::TooLong(jpeg.len()));
    }
    if !b"\xFF\xD8".starts_with(&jpeg[..jpeg.len().min(2)]) {
        return Err(FrameError::NoStart);
    }
    let mut size = None;
    let mut segments = Segments::new(jpeg);
    loop {
        let segment = segments.next()?;
        match segment.marker {
            0xC4 => {}
            0xC0 | 0xC1 => size = Some(read_size(segment.body)?),
            0xC2 => return Err(FrameError::Unsupported("progressive")),
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
    let size = size.ok_or_else(|| FrameError::damaged("no size header before the data"))?;
    // Padding after the end marker is normal.
    let mut pairs = jpeg[segments.at..].windows(2).rev();
    if pairs.any(|pair| pair == [0xFF, 0xD9]) {
        Ok(size)
    } else {
        Err(FrameError::NoEnd)
    }
}

fn read_size(body: &[u8]) -> Result<Size, FrameError> {
    let &[bits, h1, h0, w1, w0, components, ..] = body else {
        return Err(FrameError::damaged("its size header is too short"));
    };
    let width = u32::from(u16::from_be_bytes([w1, w0]));
    let height = u32::from(u16::from_be_bytes([h1, h0]));
    if bits != 8 {
        return Err(FrameError::Unsupported("not 8 bits per sample"));
    }
    if !matches!(components, 1 | 3) {
        return Err(FrameError::Unsupported("neither grey nor colour"));
    }
    if width == 0 || height == 0 {
        return Err(FrameError::damaged("its width or height is 0"));
    }
    if width > MAX_WIDTH || height > MAX_HEIGHT {
        return Err(FrameError::TooLarge { width, height });
    }
    Ok(Size { width, height })
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Decoder;

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
    fn padding_after_the_end_is_accepted() {
        let mut bytes = skeleton(320, 240, 0xC0);
        bytes.extend([0; 700]);
        let size = Size {
            width: 320,
            height: 240,
        };
        assert_eq!(validate_markers(&bytes), Ok(size));
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
        for kind in [0xC2, 0xC3, 0xC5, 0xC9, 0xCB, 0xCF] {
            assert!(matches!(
                validate_markers(&skeleton(320, 240, kind)),
                Err(FrameError::Unsupported(_))
            ));
        }
        assert_eq!(validate_markers(b"GIF89a"), Err(FrameError::NoStart));
    }

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
    fn data_interrupted_by_a_marker_is_an_error() {
        let whole = include_bytes!("../../../tests/fixtures/ball-420.jpg");
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
        for marker in markers {
            for at in [10, 100, 300] {
                let half = cut(whole, at, marker);
                let seen = Decoder::default().decode(&half).map(|image| image.size());
                assert!(seen.is_err(), "cut by {marker:02X?} at {at}: {seen:?}");
            }
        }
    }
}
