//! Reads behaviour scripts.

use std::path::Path;

use super::Failure;
use crate::behaviour;

/// Reads a script; the error has help for the user.
pub(super) fn read_source(path: &Path) -> Result<Vec<u8>, Failure> {
    behaviour::read_source(path).map_err(|error| {
        Failure::usage(format_args!(
            "cannot read the behaviour {}: {error}",
            path.display()
        ))
        .help("ready-made behaviours are in behaviours/")
    })
}
