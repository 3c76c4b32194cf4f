//! Checks untrusted YAML before it is parsed, so that the work is bounded by its length. The
//! parser's time grows with the square of the depth of nesting, so a text that nests deeper than
//! any valid one is refused. Also reads texts so that errors have their position, and puts the
//! parser's errors into plain words.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

use std::fmt;
use std::ops::RangeInclusive;

pub use serde::de::Deserializer;
use serde::de::{Error, Unexpected, Visitor};

/// Maximum length of a text, in bytes: more than a thousand lines. Nesting that the check below
/// does not detect costs time proportional to the square of this.
pub const MAX_LEN: u64 = 128 * 1024;
/// Maximum nesting depth of brackets and braces, or of items and keys on one line.
const MAX_DEPTH: usize = 64;

/// Why a text is not parsed: it would take the parser too long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{what} at line {line} column {column}")]
pub struct Refused {
    pub what: &'static str,
    /// Counted from 1.
    pub line: usize,
    /// Counted from 1.
    pub column: usize,
}

pub fn examine(text: &str) -> Result<(), Refused> {
    if text.len() as u64 > MAX_LEN {
        return Err(refused("the text is too long", 1, 1));
    }
    let mut scan = Scan::default();
    for (number, line) in (1..).zip(text.split('\n')) {
        if let Some(column) = scan.line(line) {
            return Err(refused("nested too deeply", number, column));
        }
    }
    Ok(())
}

/// Replaces the names of types in a parser's message, and adds what to do about an error of syntax.
pub fn in_plain_words(message: &str) -> String {
    if let Some(unknown) = unknown_name(message) {
        return unknown;
    }
    let address = "expected IP:PORT, such as 127.0.0.1:7788";
    let mut message = message
        .replace("invalid socket address syntax", address)
        .replace("expected socket address", address);
    if let Some((before, expected)) = message.rsplit_once("expected ")
        && let Some((plain, rest)) = plain_type(expected)
    {
        message = format!("{before}expected {plain}{rest}");
    }
    if message.contains("while scanning an alias") {
        message.push_str("; put a text that begins with * in quotes");
    } else if message.contains("found a tab character") {
        message.push_str("; indent with spaces, not with tabs");
    } else if message.contains("cannot start any token") {
        message.push_str(
            "; indent with spaces, not with tabs, and put a text that begins with @, % or ` in \
             quotes",
        );
    }
    message
}

/// The message for a key or a word that no type knows, with the nearest valid one, or with all.
fn unknown_name(message: &str) -> Option<String> {
    let found = |kind| Some((kind, message.split_once(&format!("unknown {kind} `"))?));
    let (kind, (before, rest)) = found("field").or_else(|| found("variant"))?;
    let (name, rest) = rest.split_once("`, expected ")?;
    let (valid, place) = rest.split_at(rest.rfind(" at line ").unwrap_or(rest.len()));
    let names: Vec<&str> = valid.split('`').skip(1).step_by(2).collect();
    let kind = if kind == "field" { "key" } else { "word" };
    let near = match suggestion(name, names.iter().copied()) {
        none if none.is_empty() => format!("; valid are {}", names.join(", ")),
        near => near,
    };
    Some(format!("{before}unknown {kind} `{name}`{place}{near}"))
}

/// Returns `; did you mean 'x'?`, or an empty text if no name is near.
pub fn suggestion<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    nearest(wrong, known).map_or_else(String::new, |name| format!("; did you mean '{name}'?"))
}

/// The nearest of `known`, if a person could have meant it: it may differ by one edit, or by one
/// edit per three letters; letter case does not count.
pub fn nearest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    // Known names are short, but a script can ask for a name of any length.
    if wrong.chars().count() > 40 {
        return None;
    }
    let lower = wrong.to_lowercase();
    let most = (lower.chars().count() / 3).max(1);
    known
        .into_iter()
        .map(|name| (strsim::osa_distance(&lower, &name.to_lowercase()), name))
        .filter(|(distance, _)| *distance <= most)
        .min()
        .map(|(_, name)| name)
}

/// What a text must be that begins with the name of a type, and the rest of the text.
fn plain_type(text: &str) -> Option<(&'static str, &str)> {
    let split = |text: &str| text.find(|c: char| !c.is_ascii_alphanumeric());
    let (name, rest) = text.split_at(split(text).unwrap_or(text.len()));
    let plain = match name {
        "struct" => {
            let named = rest.trim_start();
            let end = split(named).unwrap_or(named.len());
            return Some(("keys with values, such as `key: value`", &named[end..]));
        }
        "u8" => "a whole number from 0 to 255",
        "u16" => "a whole number from 0 to 65535",
        "u32" | "u64" | "usize" => "a whole number from 0",
        "i16" => "a whole number from -32768 to 32767",
        "i8" | "i32" | "i64" | "isize" => "a whole number",
        "f32" | "f64" => "a number",
        _ => return None,
    };
    Some((plain, rest))
}

fn refused(what: &'static str, line: usize, column: usize) -> Refused {
    Refused { what, line, column }
}

/// Tracks brackets outside quotes and comments, for texts that are not crafted to deceive it.
#[derive(Default)]
struct Scan {
    depth: usize,
    quote: Option<char>,
}

impl Scan {
    /// Scans a line; returns the column where the nesting is too deep.
    fn line(&mut self, line: &str) -> Option<usize> {
        let mut before = ' ';
        let mut indicators = 0;
        let mut leading = true;
        let mut chars = (1..).zip(line.chars()).peekable();
        while let Some((column, c)) = chars.next() {
            match self.quote {
                Some('"') if c == '\\' => {
                    chars.next();
                }
                Some(quote) if c == quote => self.quote = None,
                Some(_) => {}
                None => match c {
                    '#' if before.is_whitespace() => return None,
                    // Within a plain scalar a quote is an ordinary character.
                    '"' | '\'' if !before.is_alphanumeric() => self.quote = Some(c),
                    '[' | '{' => self.depth += 1,
                    ']' | '}' => self.depth = self.depth.saturating_sub(1),
                    // Each indicator in `- - - ? ? a` nests what follows.
                    '-' | '?' | ':' if leading => indicators += 1,
                    c if !c.is_whitespace() => leading = false,
                    _ => {}
                },
            }
            if self.depth.max(indicators) > MAX_DEPTH && !is_rule(line) {
                return Some(column);
            }
            before = c;
        }
        None
    }
}

/// Whether a line consists of dashes only, such as a horizontal rule in a text.
fn is_rule(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && line.chars().all(|c| c == '-')
}

/// Reads a text and parses it; `expected` describes the valid ones.
pub fn parsed_text<'de, D: Deserializer<'de>, T, W: fmt::Display>(
    from: D,
    expected: &str,
    parse: impl FnOnce(&str) -> Result<T, W>,
) -> Result<T, D::Error> {
    from.deserialize_str(text(expected, parse))
}

/// As [`parsed_text`], for a `parse` that gives no reason.
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

/// Makes a value of a text, or says what was expected.
pub fn text<T, W: fmt::Display>(
    expected: &str,
    parse: impl FnOnce(&str) -> Result<T, W>,
) -> impl for<'de> Visitor<'de, Value = T> {
    TextVisitor { expected, parse }
}

/// Reads `null` as none, and anything else as the visitor does, which must know every form in
/// which a value may be written.
pub fn optional<'de, D: Deserializer<'de>, V: Visitor<'de>>(
    from: D,
    visitor: V,
) -> Result<Option<V::Value>, D::Error> {
    from.deserialize_option(OptionalVisitor(visitor))
}

struct OptionalVisitor<V>(V);

impl<'de, V: Visitor<'de>> Visitor<'de> for OptionalVisitor<V> {
    type Value = Option<V::Value>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.expecting(f)
    }

    fn visit_none<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_unit<E: Error>(self) -> Result<Self::Value, E> {
        Ok(None)
    }

    fn visit_some<D: Deserializer<'de>>(self, from: D) -> Result<Self::Value, D::Error> {
        from.deserialize_any(self.0).map(Some)
    }
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

/// A number of a document, which may also be one that it can leave out.
pub trait Ranged: Sized {
    /// Reads the number with this visitor.
    fn read<'de, D: Deserializer<'de>>(
        from: D,
        number: impl Visitor<'de, Value = f64>,
    ) -> Result<Self, D::Error>;
}

impl Ranged for f64 {
    fn read<'de, D: Deserializer<'de>>(
        from: D,
        number: impl Visitor<'de, Value = f64>,
    ) -> Result<f64, D::Error> {
        from.deserialize_f64(number)
    }
}

impl Ranged for Option<f64> {
    fn read<'de, D: Deserializer<'de>>(
        from: D,
        number: impl Visitor<'de, Value = f64>,
    ) -> Result<Self, D::Error> {
        optional(from, number)
    }
}

/// A table of numbers with their ranges and units; each row becomes a function for
/// `deserialize_with`, whose error is placed at the number.
#[macro_export]
macro_rules! ranges {
    ($($(#[$doc:meta])* $name:ident = $min:literal..=$max:literal, $unit:literal;)+) => {$(
        $(#[$doc])*
        pub(crate) fn $name<'de, D: $crate::Deserializer<'de>, T: $crate::Ranged>(
            from: D,
        ) -> Result<T, D::Error> {
            let expected = format_args!("a number from {} to {} ({})", $min, $max, $unit);
            T::read(from, $crate::float(expected, $min..=$max))
        }
    )+};
}

/// Reads a whole number in a range, which must be one of `T`'s.
pub fn whole_within<'de, D: Deserializer<'de>, T: TryFrom<u64>>(
    from: D,
    expected: &str,
    range: RangeInclusive<u64>,
) -> Result<T, D::Error> {
    from.deserialize_u64(whole(expected, range))
}

/// Makes a number of a range.
pub fn float(
    expected: impl fmt::Display,
    range: RangeInclusive<f64>,
) -> impl for<'de> Visitor<'de, Value = f64> {
    number(expected, move |number| {
        Some(number).filter(|number| range.contains(number))
    })
}

/// Makes a whole number of a range, which must be one of `T`'s.
pub fn whole<T: TryFrom<u64>>(
    expected: impl fmt::Display,
    range: RangeInclusive<u64>,
) -> impl for<'de> Visitor<'de, Value = T> {
    number(expected, move |number| {
        let is_inside = number.fract() == 0.0 && number >= 0.0 && range.contains(&(number as u64));
        if is_inside {
            T::try_from(number as u64).ok()
        } else {
            None
        }
    })
}

/// Makes a value of a number, or says what was expected.
pub fn number<T>(
    expected: impl fmt::Display,
    make: impl Fn(f64) -> Option<T>,
) -> impl for<'de> Visitor<'de, Value = T> {
    NumberVisitor { expected, make }
}

struct NumberVisitor<E, F> {
    expected: E,
    make: F,
}

impl<T, E: fmt::Display, F: Fn(f64) -> Option<T>> NumberVisitor<E, F> {
    fn visit<R: Error>(&self, number: f64, found: Unexpected<'_>) -> Result<T, R> {
        (self.make)(number).ok_or_else(|| R::invalid_value(found, self))
    }
}

impl<T, E: fmt::Display, F: Fn(f64) -> Option<T>> Visitor<'_> for NumberVisitor<E, F> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.expected.fmt(f)
    }

    fn visit_f64<R: Error>(self, number: f64) -> Result<T, R> {
        self.visit(number, Unexpected::Float(number))
    }

    fn visit_i64<R: Error>(self, number: i64) -> Result<T, R> {
        self.visit(number as f64, Unexpected::Signed(number))
    }

    fn visit_u64<R: Error>(self, number: u64) -> Result<T, R> {
        self.visit(number as f64, Unexpected::Unsigned(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_yaml::Value;

    #[test]
    fn a_text_nested_too_deeply_is_refused_with_its_position() {
        for (text, at) in [
            ("{a: ".repeat(800), (1, 257)),
            ("[".repeat(800), (1, 65)),
            ("- ".repeat(800), (1, 129)),
            ("? ".repeat(800), (1, 129)),
        ] {
            let refused = examine(&text).unwrap_err();
            assert_eq!((refused.line, refused.column), at);
        }
        let error = examine(&" ".repeat(MAX_LEN as usize + 1)).unwrap_err();
        assert!(error.to_string().contains("too long"), "{error}");
    }

    #[test]
    fn honest_texts_are_parsed() {
        let flat = "- { x: 1, y: [2, 3] } # }]\n".repeat(2000);
        let words = "name: \"{[\"\nsay: don't [ care\nit: 'it''s ['\nrule: a\n";
        let dashes = format!("# {0}\ntext: |\n  {0}\n", "-".repeat(100));
        for text in [flat.as_str(), words, &dashes] {
            assert_eq!(examine(text), Ok(()));
        }
        assert!(serde_yaml::from_str::<Value>(&dashes).is_ok());
    }

    #[test]
    fn errors_name_no_types_of_this_program() {
        for (message, plain) in [
            (
                "a: invalid type: integer `3`, expected struct Room at line 1 column 4",
                "a: invalid type: integer `3`, expected keys with values, such as `key: value` at line 1 \
                 column 4",
            ),
            (
                "expected struct Room",
                "expected keys with values, such as `key: value`",
            ),
            (
                "invalid type: string \"expected u8\", expected u64",
                "invalid type: string \"expected u8\", expected a whole number from 0",
            ),
            (
                "invalid type: integer `7788`, expected socket address",
                "invalid type: integer `7788`, expected IP:PORT, such as 127.0.0.1:7788",
            ),
            ("expected a string", "expected a string"),
            ("expected u640", "expected u640"),
        ] {
            assert_eq!(in_plain_words(message), plain);
        }
    }

    /// The worst texts that pass the check: the maximum length bounds their cost. The times are
    /// printed for information.
    #[test]
    fn texts_with_undetected_nesting_are_still_parsed_in_bounded_time() {
        for unit in ["{\"]\": ", "{'}': ", "{a\": ", "- a\n ", "&a ", "{? "] {
            let text = unit.repeat(MAX_LEN as usize / unit.len());
            let began = std::time::Instant::now();
            let read = examine(&text).is_ok() && serde_yaml::from_str::<Value>(&text).is_ok();
            eprintln!("{unit:?}: {read}, {:?}", began.elapsed());
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[-\\[\\]{}\"'#?:a \n]{0,300}") {
            let _ = examine(&text);
            let _ = in_plain_words(&text);
        }
    }

    #[test]
    fn near_names_are_suggested_and_far_ones_are_not() {
        let known = ["move", "drive", "battery", "docked"];
        assert_eq!(nearest("moev", known), Some("move"));
        assert_eq!(nearest("Battery", known), Some("battery"));
        assert_eq!(nearest("dockd", known), Some("docked"));
        assert_eq!(nearest("fly", known), None);
        assert_eq!(nearest(&"m".repeat(100_000), known), None);
    }
}
