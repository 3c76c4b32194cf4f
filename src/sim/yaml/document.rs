//! The documents of the simulator: a loader with a size limit, and an error that names the place.

use std::fmt;
use std::path::Path;

use crate::files::{self, ReadError};
use crate::yaml;

/// What a document describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DocumentKind {
    /// A simulated world.
    World,
    /// The behaviour of a simulated robot's firmware.
    Firmware,
    /// A list of faults.
    Faults,
}

impl DocumentKind {
    fn question(self) -> &'static str {
        match self {
            DocumentKind::World => "is it a world?",
            DocumentKind::Firmware => "does it describe a firmware?",
            DocumentKind::Faults => "is it a list of faults?",
        }
    }
}

impl fmt::Display for DocumentKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DocumentKind::World => "world",
            DocumentKind::Firmware => "firmware",
            DocumentKind::Faults => "faults",
        })
    }
}

/// A document that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DocumentError {
    /// The file cannot be read.
    #[error("cannot read the {kind} {name}: {source}")]
    Read {
        /// The expected content of the file.
        kind: DocumentKind,
        /// The file.
        name: String,
        /// The cause.
        source: std::io::Error,
    },
    /// The file is too long.
    #[error("{name} is longer than {} bytes: {}", yaml::MAX_LEN, .kind.question())]
    TooLong {
        /// The expected content of the file.
        kind: DocumentKind,
        /// The file.
        name: String,
    },
    /// The YAML is not a valid document of the expected kind.
    #[error("{name}:{line}:{column}: {message}")]
    Invalid {
        /// The file, or another source of the text.
        name: String,
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What was found, what was expected, what to do.
        message: String,
    },
}

impl DocumentError {
    /// Creates an error in the text `name` at a line and column.
    pub(crate) fn invalid(
        name: &str,
        (line, column): (usize, usize),
        message: impl Into<String>,
    ) -> DocumentError {
        DocumentError::Invalid {
            name: name.to_owned(),
            line,
            column,
            message: message.into(),
        }
    }

    /// Returns the message without the place, for texts that are not from a file.
    pub fn into_message(self) -> String {
        match self {
            DocumentError::Invalid { message, .. } => message,
            other => other.to_string(),
        }
    }
}

/// Reads a file of limited length and passes its text and its name to `parse`.
///
/// # Errors
/// As `parse`, or the file cannot be read or is too long.
pub(crate) fn load<T>(
    path: &Path,
    kind: DocumentKind,
    parse: impl FnOnce(&str, &str) -> Result<T, DocumentError>,
) -> Result<T, DocumentError> {
    let name = path.display().to_string();
    match files::read_text(path, yaml::MAX_LEN) {
        Ok(text) => parse(&text, &name),
        Err(ReadError::TooLong { .. }) => Err(DocumentError::TooLong { kind, name }),
        Err(error) => Err(DocumentError::Read {
            kind,
            name,
            source: error.into(),
        }),
    }
}
