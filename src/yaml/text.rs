//! Values that YAML contains as a text. They are parsed while the text is visited: only then does
//! the error have its position.

use std::fmt;

use serde::de::{Deserializer, Error, Unexpected, Visitor};

/// Reads a text and parses it; `expected` describes the valid ones.
///
/// # Errors
/// If the value is not a text, or the error of `parse`.
pub fn parsed_text<'de, D: Deserializer<'de>, T, W: fmt::Display>(
    from: D,
    expected: &str,
    parse: impl FnOnce(&str) -> Result<T, W>,
) -> Result<T, D::Error> {
    from.deserialize_str(TextVisitor { expected, parse })
}

/// As [`parsed_text`], for a `parse` that gives no reason.
///
/// # Errors
/// If the value is not a text, or `parse` returns `None`.
pub fn known_text<'de, D: Deserializer<'de>, T>(
    from: D,
    expected: &str,
    parse: impl FnOnce(&str) -> Option<T>,
) -> Result<T, D::Error> {
    parsed_text(from, expected, |text| {
        let found = Unexpected::Str(text);
        parse(text).ok_or_else(|| format!("invalid value: {found}, expected {expected}"))
    })
}

struct TextVisitor<'a, P> {
    expected: &'a str,
    parse: P,
}

impl<T, W: fmt::Display, P: FnOnce(&str) -> Result<T, W>> Visitor<'_> for TextVisitor<'_, P> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.expected)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<T, E> {
        (self.parse)(text).map_err(E::custom)
    }
}
