//! Checks all scans of a JPEG that is not single-scan baseline, from the first one to the end
//! marker. The `image` crate's decoder takes a marker inside the data as the data's end and returns
//! half a picture without an error; this check reports it as damage.

use super::frame::{FrameError, Segments};

/// What has been parsed so far and is needed later.
#[derive(Default)]
struct Walk {
    progressive: bool,
    /// Whether a restart interval is set: the data then has restart markers.
    restarts: bool,
    /// Components whose scan has been seen.
    seen: Vec<u8>,
}

/// Checks that the data of each scan ends where it may.
///
/// # Errors
/// [`FrameError::Damaged`] if a marker interrupts the data or a header is truncated.
pub(crate) fn check(jpeg: &[u8]) -> Result<(), FrameError> {
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
            assert_eq!(check(whole), Ok(()));
            let padded = [whole, &[0; 700]].concat();
            assert_eq!(check(&padded), Ok(()));
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
