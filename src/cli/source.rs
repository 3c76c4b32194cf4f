//! The files of behaviours.

use std::io::Read;
use std::path::Path;

use super::Failure;
use crate::script::MAX_SOURCE;

/// One byte more than a script may have, so that a longer one is told as such.
pub(super) fn read_source(path: &Path) -> Result<Vec<u8>, Failure> {
    let cannot = |error: std::io::Error| {
        Failure::usage(format_args!(
            "cannot read the behaviour {}: {error}",
            path.display()
        ))
        .help("ready-made behaviours are in behaviours/")
    };
    let mut source = Vec::new();
    let file = std::fs::File::open(path).map_err(cannot)?;
    file.take(MAX_SOURCE as u64 + 1)
        .read_to_end(&mut source)
        .map_err(cannot)?;
    Ok(source)
}
