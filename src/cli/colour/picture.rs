//! Reads pictures named on the command line, and the part of them to search.

use std::path::Path;

use crate::cli::Failure;
use crate::cli::argument::ArgumentError;
use crate::files;
use crate::vision::{FrameError, MAX_JPEG_LEN, Roi, Size};

const NO_JPEG_HELP: &str = "only JPEG is supported, as the robot's camera sends it and scripts save \
                            it; convert other pictures";
const TOO_LARGE_HELP: &str = "scale it down; the robot's own pictures are 320x240";

/// Reads a file, at most one byte more than the maximum length of a JPEG, so that a longer one can
/// be reported as too long.
pub(in crate::cli) fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    files::read_beginning(path, MAX_JPEG_LEN as u64 + 1).map_err(|error| {
        Failure::usage(format_args!(
            "cannot read the picture {}: {error}",
            path.display()
        ))
    })
}

/// The failure for a file that is not a usable picture.
pub(in crate::cli) fn unusable(path: &Path, error: &FrameError) -> Failure {
    let failure = Failure::usage(format_args!("cannot use {}: {error}", path.display()));
    match error {
        FrameError::NoStart => failure.help(NO_JPEG_HELP),
        FrameError::TooLarge { .. } | FrameError::TooLong(_) => failure.help(TOO_LARGE_HELP),
        _ => failure,
    }
}

/// The part of a picture to search.
pub(super) fn part(roi: Roi, size: Size, path: &Path) -> Result<Roi, Failure> {
    roi.within(size).ok_or_else(|| {
        let Roi { x, y, w, h } = roi;
        let Size { width, height } = size;
        let path = path.display();
        Failure::usage(format_args!(
            "the part {x},{y},{w},{h} is outside {path}, which is {width}x{height}"
        ))
        .help("--roi is left column, top row, width, height; 0,0 is the top left")
    })
}

/// Parses `x,y,w,h`, as for `--roi`.
pub(super) fn parse_roi(text: &str) -> Result<Roi, ArgumentError> {
    let numbers: Option<Vec<u32>> = text
        .split(',')
        .map(|number| number.trim().parse().ok())
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, w, h]) if w > 0 && h > 0 => Ok(Roi { x, y, w, h }),
        _ => Err(ArgumentError::Roi),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_part_is_four_numbers_and_not_empty() {
        let roi = Roi {
            x: 1,
            y: 2,
            w: 30,
            h: 4,
        };
        assert_eq!(parse_roi("1,2, 30,4"), Ok(roi));
        for wrong in ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "-1,2,3,4", "a,b,c,d"] {
            assert!(parse_roi(wrong).is_err(), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[-0-9, x]{0,40}", width in 1u32..2000) {
            if let Ok(roi) = parse_roi(&text) {
                let size = Size { width, height: 240 };
                let inside = part(roi, size, Path::new("a.jpg"));
                prop_assert!(inside.map_or(true, |part| part.x + part.w <= width));
            }
        }
    }
}
