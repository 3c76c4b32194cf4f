//! Reads worlds, faults and firmware settings from YAML: size limits, and errors with line, column
//! and a suggestion for misspelt names.

pub(crate) mod number;

use std::fmt;
use std::path::Path;

use serde::de::{
    DeserializeOwned, DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess,
    Visitor,
};

use crate::files::ReadError;
use crate::{files, yaml};

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
        [line, column]: [usize; 2],
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

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Step {
    Key(&'static str),
    /// An entry of a list, counted from 0.
    Index(usize),
}

/// Returns line and column, from 1, of the value at a path, or of the document's start if no part
/// of the path exists.
pub(crate) fn find(text: &str, path: &[Step]) -> [usize; 2] {
    let document = serde_yaml::Deserializer::from_str(text);
    match Walk(path).deserialize(document) {
        Err(error) => place_of(&error),
        Ok(()) => [1, 1],
    }
}

pub(crate) fn read<T: DeserializeOwned>(text: &str, name: &str) -> Result<T, DocumentError> {
    yaml::examine(text)
        .map_err(|no| DocumentError::invalid(name, [no.line, no.column], no.what))?;
    serde_yaml::from_str(text).map_err(|found| error(&found, name))
}

/// Returns an error of the parser in the text `name`.
pub(crate) fn error(error: &serde_yaml::Error, name: &str) -> DocumentError {
    DocumentError::invalid(name, place_of(error), explain(error))
}

/// Returns line and column, from 1, of an error; without them, the document's start.
pub(crate) fn place_of(error: &serde_yaml::Error) -> [usize; 2] {
    error
        .location()
        .map_or([1, 1], |place| [place.line(), place.column()])
}

/// Returns an error in plain words, without its place, with a suggestion for a misspelt name.
fn explain(error: &serde_yaml::Error) -> String {
    let mut text = error.to_string();
    if let Some(place) = error.location() {
        let suffix = format!(" at line {} column {}", place.line(), place.column());
        text = text.replace(&suffix, "");
    }
    match suggested_name(&text) {
        Some(name) => format!("{text}; did you mean `{name}`?"),
        None => yaml::in_plain_words(&text),
    }
}

/// Returns the known name nearest to the unknown one. serde quotes the unknown name first, then the
/// known ones.
fn suggested_name(text: &str) -> Option<&str> {
    if !text.contains("unknown ") {
        return None;
    }
    let mut quoted = text.split('`').skip(1).step_by(2);
    let found = quoted.next()?;
    let near = quoted
        .map(|name| (strsim::damerau_levenshtein(found, name), name))
        .min()?;
    if near.0 <= 2 { Some(near.1) } else { None }
}

/// Follows a path and deliberately fails at its end, because the error contains the place.
struct Walk<'a>(&'a [Step]);

impl<'de> DeserializeSeed<'de> for Walk<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, from: D) -> Result<(), D::Error> {
        from.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Walk<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the place")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let Some((Step::Key(wanted), rest)) = self.0.split_first() else {
            return Err(A::Error::custom("here"));
        };
        while let Some(key) = map.next_key::<String>()? {
            if key == *wanted {
                return map.next_value_seed(Walk(rest));
            }
            map.next_value::<IgnoredAny>()?;
        }
        Err(A::Error::custom("here"))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        let Some((Step::Index(wanted), rest)) = self.0.split_first() else {
            return Err(A::Error::custom("here"));
        };
        for _ in 0..*wanted {
            list.next_element::<IgnoredAny>()?;
        }
        list.next_element_seed(Walk(rest)).map(|_| ())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "a: 1\nlist:\n  - { x: 1 }\n  - x: 2\n    y: [3, 4]\n";

    #[test]
    fn find_returns_line_and_column() {
        assert_eq!(find(TEXT, &[Step::Key("a")]), [1, 4]);
        assert_eq!(
            find(TEXT, &[Step::Key("list"), Step::Index(0), Step::Key("x")]),
            [3, 10]
        );
        assert_eq!(
            find(TEXT, &[Step::Key("list"), Step::Index(1), Step::Key("y")]),
            [5, 8]
        );
    }

    #[test]
    fn find_returns_the_nearest_parent_of_a_missing_value() {
        let [line, _] = find(TEXT, &[Step::Key("list"), Step::Index(1), Step::Key("z")]);
        assert_eq!(line, 4);
    }
}
