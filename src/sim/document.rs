//! Reads worlds, faults and firmware settings from YAML: size limits, and errors with line, column
//! and a suggestion for misspelt names.

use std::fmt;
use std::path::Path;

use files::ReadError;
use serde::de::{
    DeserializeOwned, DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, SeqAccess,
    Visitor,
};

/// Why a file or text cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum DocumentError {
    /// The file cannot be read.
    #[error("cannot read the {kind} {name}: {source}")]
    Read {
        /// What it should be, such as "world".
        kind: &'static str,
        /// The path.
        name: String,
        /// Why.
        source: ReadError,
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

/// Reads a file of limited length, such as a "world", and passes its text and its name to `parse`.
pub(crate) fn load<T>(
    path: &Path,
    kind: &'static str,
    parse: impl FnOnce(&str, &str) -> Result<T, DocumentError>,
) -> Result<T, DocumentError> {
    let name = path.display().to_string();
    let read = files::read_text(path, yaml::MAX_LEN);
    let text = read.map_err(|source| DocumentError::Read {
        kind,
        name: name.clone(),
        source,
    })?;
    parse(&text, &name)
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
    yaml::in_plain_words(&text)
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

/// Range checks for numbers in the YAML of worlds, faults and firmware: applied during parsing, so
/// that errors have line and column. NaN and infinities are always rejected.
pub(crate) mod number {
    /// The default of a share or a chance.
    pub(crate) fn one() -> f64 {
        1.0
    }

    yaml::ranges! {
        room_side = 1.0..=30.0, "metres";
        coordinate = 0.0..=30.0, "metres";
        /// Height of a thing.
        height = 0.25..=5.0, "metres";
        /// Height of a rug's edge or of a sill.
        bump = 0.0..=0.03, "metres";
        /// Length or width of furniture.
        side = 0.02..=10.0, "metres";
        thickness = 0.02..=0.5, "metres";
        /// Radius of a ball or a post.
        radius = 0.02..=0.5, "metres";
        degrees = -360.0..=360.0, "degrees";
        /// Height of the camera: below the station's top; the world is checked for lower things.
        lens_height = 0.05..=0.33, "metres";
        pitch = -45.0..=30.0, "degrees, up is positive";
        roll = -30.0..=30.0, "degrees, positive when the horizon falls to the right";
        /// Horizontal field of view of the camera.
        view_degrees = 20.0..=120.0, "degrees";
        /// Distortion coefficient of a lens.
        distortion = -2.0..=2.0, "0 is no distortion";
        /// Brightness.
        share = 0.0..=1.0, "1 is full";
        percent = 0.0..=100.0, "percent";
        percent_per_minute = 0.0..=6000.0, "percent a minute";
        frames = 1.0..=60.0, "frames a second";
        /// Range of the station's beacon, or of the Wi-Fi.
        reach = 0.0..=50.0, "metres";
        /// Width of a line on the floor.
        tape = 0.005..=0.3, "metres";
        /// Radius of a line's rounded corners.
        rounding = 0.0..=15.0, "metres";
        speed = 0.0..=2.0, "metres a second";
        sign_height = 0.05..=4.0, "metres";
        sign_side = 0.05..=2.0, "metres";
        lamp_reach = 0.2..=30.0, "metres";
        hertz = 40.0..=7000.0, "hertz";
        quality = 1.0..=100.0, "100 is best";
        moment = 0.0..=2.0, "seconds";
        /// Standard deviation of a blur.
        softness = 0.0..=2.0, "pixels";
        /// Share of the light that is lost.
        lost = 0.0..=0.95, "0 is none";
        /// Share by which tracks differ or slip.
        slip = 0.0..=0.5, "1 is all";
        /// Least power that moves a track.
        dead_zone = 0.0..=90.0, "percent of full power";
        /// Share of its speed that a robot reaches.
        response = 0.1..=1.0, "1 is all";
        /// A time or duration of a fault, of a schedule or of the firmware.
        span = 0.0..=86_400.0, "seconds";
        hours = 0.01..=100.0, "hours";
        chance = 0.0..=1.0, "1 is always";
        bytes = 0.0..=65_535.0, "bytes";
        commands = 1.0..=4096.0, "commands";
        commands_per_second = 0.1..=1000.0, "commands a second";
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
