//! Sanitises text from a robot, a script, a file or the network for a terminal, a text log, XML or
//! JSON. All text output passes through here. Control sequences are removed; characters that are
//! invisible or reverse the direction of text are shown as escapes such as `\u202e`.

use std::fmt::Write as _;

use serde_json::Value;

/// Sanitises text for a terminal or for a file that replaces it. Keeps line breaks and tabs and,
/// with `colour`, the sequences that set colours; other escape sequences lose their escape
/// character and thus their effect.
pub fn text(text: &str, colour: bool) -> String {
    let mut cleaned = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let sequence = colour_sequence_len(rest);
        let length = sequence.unwrap_or(c.len_utf8());
        let (head, tail) = rest.split_at(length);
        match sequence {
            Some(_) if colour => cleaned.push_str(head),
            Some(_) => {}
            None => push(c, &mut cleaned),
        }
        rest = tail;
    }
    cleaned
}

/// Like [`text`], but without colours and on one line.
pub fn line(line: &str) -> String {
    text(line, false).replace(['\n', '\t'], " ")
}

/// Sanitises text for XML 1.0; characters that XML does not allow are shown as escapes too.
pub fn xml(xml: &str) -> String {
    let mut cleaned = String::with_capacity(xml.len());
    for c in xml.chars() {
        match c {
            '\n' | '\t' => cleaned.push(c),
            c if c.is_control() || matches!(c, '\u{FFFE}' | '\u{FFFF}') => escape(c, &mut cleaned),
            c => push(c, &mut cleaned),
        }
    }
    cleaned
}

/// A JSON value for people: a text without its quotes.
pub fn json_text(value: &Value) -> String {
    let text = value.as_str().map(str::to_owned);
    text.unwrap_or_else(|| value.to_string())
}

/// The same JSON with each of its texts changed, but not the names of fields.
pub fn with_texts(json: Value, change: &impl Fn(&str) -> String) -> Value {
    match json {
        Value::String(text) => change(&text).into(),
        Value::Array(list) => list
            .into_iter()
            .map(|one| with_texts(one, change))
            .collect(),
        Value::Object(fields) => fields
            .into_iter()
            .map(|(name, value)| (name, with_texts(value, change)))
            .collect(),
        other => other,
    }
}

/// Formats a value after `name=` in a text log: unchanged if it is one plain word, otherwise in
/// quotes, so that no part of it can be mistaken for another field.
pub fn value(value: &str) -> String {
    let plain = |c: char| {
        c.is_alphanumeric()
            || matches!(
                c,
                '.' | '_' | ':' | '/' | '-' | '+' | ',' | '%' | '[' | ']' | '@'
            )
    };
    if !value.is_empty() && value.chars().all(plain) {
        value.to_owned()
    } else {
        quoted(value)
    }
}

/// Formats a message that precedes these fields in a text log: in quotes if part of it looks like
/// one of them.
pub fn message<'a>(message: &str, fields: impl IntoIterator<Item = &'a str>) -> String {
    let mut names = fields.into_iter();
    if names.any(|name| names_field(message, name)) {
        quoted(message)
    } else {
        message.to_owned()
    }
}

/// Whether `name=` occurs in the text as a word.
fn names_field(text: &str, name: &str) -> bool {
    text.match_indices(name).any(|(at, _)| {
        let before = text[..at].chars().next_back();
        let after = text[at + name.len()..].trim_start_matches(|c: char| c.is_control());
        after.starts_with('=') && !before.is_some_and(|c| c.is_alphanumeric() || c == '_')
    })
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

fn push(c: char, to: &mut String) {
    match c {
        '\n' | '\t' => to.push(c),
        // Single bytes that control a terminal.
        '\0'..='\u{1F}' => {}
        c if c.is_control() || hides(c) => escape(c, to),
        c => to.push(c),
    }
}

/// Escapes a character; all characters passed here have four hexadecimal digits.
fn escape(c: char, to: &mut String) {
    // Writing to a string cannot fail.
    let _ = write!(to, "\\u{:04x}", u32::from(c));
}

/// Whether a character changes the reading direction of text or invisibly breaks a line.
fn hides(c: char) -> bool {
    matches!(
        c,
        '\u{061C}' | '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}'
            | '\u{2028}' | '\u{2029}' | '\u{FEFF}'
    )
}

/// Length of `ESC [ digits and semicolons m` at the start of `text`.
pub fn colour_sequence_len(text: &str) -> Option<usize> {
    let parameters = text.strip_prefix("\x1b[")?;
    let end = parameters.find(|c: char| !(c.is_ascii_digit() || c == ';'))?;
    if !parameters[end..].starts_with('m') {
        return None;
    }
    Some("\x1b[".len() + end + 1)
}

/// Characters that start a formula; some programs also accept their East Asian wide forms.
const FORMULAS: [char; 8] = [
    '=', '+', '-', '@', '\u{ff1d}', '\u{ff0b}', '\u{ff0d}', '\u{ff20}',
];

/// A CSV cell: quoted if necessary, and never read as a formula, since the text is untrusted.
pub fn csv_cell(text: &str) -> String {
    let mut text = self::text(text, false).replace(['\n', '\r', '\t'], " ");
    if text.starts_with(FORMULAS) {
        text.insert(0, '\'');
    }
    if text.contains([',', '"', ';']) {
        text = format!("\"{}\"", text.replace('"', "\"\""));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_csv_cell_is_one_cell_and_not_a_formula() {
        for (text, cell) in [
            ("Ada", "Ada"),
            ("a, b", "\"a, b\""),
            ("it \"drives\"\naway", "\"it \"\"drives\"\" away\""),
            ("=HYPERLINK(1)", "'=HYPERLINK(1)"),
            ("\u{ff1d}1", "'\u{ff1d}1"),
        ] {
            assert_eq!(csv_cell(text), cell);
        }
    }

    #[test]
    fn colours_pass_to_a_terminal_and_no_other_control_sequence_does() {
        let dirty = "\x1b[1;31mred\x1b[0m \x1b]0;title\x07 \x1b[2J \u{9b}2J \rover \u{202e}txt";
        let clean = "\x1b[1;31mred\x1b[0m ]0;title [2J \\u009b2J over \\u202etxt";
        assert_eq!(text(dirty, true), clean);
        assert_eq!(line("a\nb\tc\x1b[31m"), "a b c");
    }

    #[test]
    fn sanitised_json_has_the_same_value() {
        let value = serde_json::json!({ "a\u{202e}": "\u{9b}\u{2028}\u{7f}\x1b[2J\n\"" });
        let shown = text(&value.to_string(), false);
        assert!(shown.is_ascii(), "{shown}");
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&shown).unwrap(),
            value
        );
    }

    #[test]
    fn xml_has_no_character_that_xml_forbids() {
        assert_eq!(
            xml("a\x1b\0\r\u{FFFF}\u{202e}<"),
            "a\\u001b\\u0000\\u000d\\uffff\\u202e<"
        );
    }

    #[test]
    fn a_message_cannot_forge_fields() {
        let fields = ["behaviour", "line"];
        for forged in [
            "hi behaviour=\"x\" line=1",
            "behaviour=x",
            "a\tline=2",
            "(line=2",
        ] {
            let shown = message(forged, fields);
            assert!(shown.starts_with('"') && shown.ends_with('"'), "{shown}");
            assert!(
                !shown[1..shown.len() - 1].replace("\\\"", "").contains('"'),
                "{shown}"
            );
        }
        for honest in ["speed=40", "outline=3", "the line is = 3", "behaviour: x"] {
            assert_eq!(message(honest, fields), honest);
        }
        assert_eq!(value("10.0.0.1:9000"), "10.0.0.1:9000");
        assert_eq!(value("x battery=100"), "\"x battery=100\"");
        assert_eq!(value("a\" b=\\"), "\"a\\\" b=\\\\\"");
        assert_eq!(value(""), "\"\"");
    }

    proptest! {
        #[test]
        fn no_terminal_control_sequence_is_left(dirty in "\\PC*|[\\x00-\\xff\u{1b}\u{202e}\\[m0-9;]{0,60}") {
            let plain = text(&dirty, false);
            prop_assert!(!plain.chars().any(|c| hides(c) || c.is_control() && !matches!(c, '\n' | '\t')), "{plain:?}");
            let coloured = text(&dirty, true);
            for (at, _) in coloured.match_indices('\u{1b}') {
                prop_assert!(colour_sequence_len(&coloured[at..]).is_some(), "{coloured:?}");
            }
            prop_assert!(!xml(&dirty).chars().any(|c| c.is_control() && !matches!(c, '\n' | '\t')));
        }
    }
}
