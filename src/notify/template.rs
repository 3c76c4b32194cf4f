//! Texts with placeholders in braces. Values are escaped for their context: a part of a URL, a
//! header field, a text in JSON.

use data_encoding::BASE64;
use percent_encoding::{AsciiSet, NON_ALPHANUMERIC, utf8_percent_encode};
use serde_json::Value;

use super::Notice;
use crate::sanitize;

const NAMES: &[&str] = &[
    "text", "title", "event", "robot", "time", "picture", "token",
];
/// What is encoded in a URL (RFC 3986).
const RESERVED: &AsciiSet = &NON_ALPHANUMERIC
    .remove(b'-')
    .remove(b'.')
    .remove(b'_')
    .remove(b'~');

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Slot {
    /// Plain text, not escaped.
    Plain,
    /// A URL: values are percent-encoded.
    Url,
    /// A header field: one line; non-ASCII text is encoded according to RFC 2047.
    Header,
}

pub(super) fn check(template: &str) -> Result<(), String> {
    match parts(template).find_map(|part| part.err().filter(|name| !NAMES.contains(name))) {
        Some(name) => {
            let known: Vec<String> = NAMES.iter().map(|name| format!("{{{name}}}")).collect();
            let known = known.join(", ");
            Err(format!("unknown placeholder {{{name}}}; valid are {known}"))
        }
        None => Ok(()),
    }
}

pub(super) fn fill(template: &str, notice: &Notice, token: &str, place: Slot) -> String {
    let mut filled = String::new();
    for part in parts(template) {
        match part {
            Ok(text) => filled.push_str(text),
            Err(name) => {
                let value = value(name, notice, token);
                match place {
                    Slot::Url => filled.extend(utf8_percent_encode(&value, RESERVED)),
                    Slot::Plain | Slot::Header => filled.push_str(&value),
                }
            }
        }
    }
    match place {
        Slot::Header => header(&filled),
        Slot::Plain | Slot::Url => filled,
    }
}

pub(super) fn fill_json(template: &Value, notice: &Notice, token: &str) -> Value {
    sanitize::with_texts(template.clone(), &|text| {
        fill(text, notice, token, Slot::Plain)
    })
}

pub(super) fn texts<'a>(value: &'a Value, found: &mut Vec<&'a str>) {
    match value {
        Value::String(text) => found.push(text),
        Value::Array(list) => list.iter().for_each(|one| texts(one, found)),
        Value::Object(map) => map.values().for_each(|one| texts(one, found)),
        _ => {}
    }
}

/// Splits a template into literal text (`Ok`) and names in braces (`Err`). Braces without a valid
/// name are literal text.
fn parts(template: &str) -> impl Iterator<Item = Result<&str, &str>> {
    let mut rest = template;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        if let Some((name, behind)) = name_at(rest) {
            rest = behind;
            return Some(Err(name));
        }
        let from_second = rest.char_indices().skip(1);
        let mut braces = from_second.filter(|(_, letter)| *letter == '{');
        let end = braces.find(|(at, _)| name_at(&rest[*at..]).is_some());
        let (text, behind) = rest.split_at(end.map_or(rest.len(), |(at, _)| at));
        rest = behind;
        Some(Ok(text))
    })
}

fn name_at(text: &str) -> Option<(&str, &str)> {
    let (name, behind) = text.strip_prefix('{')?.split_once('}')?;
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    (!name.is_empty() && name.chars().all(word)).then_some((name, behind))
}

fn value(name: &str, notice: &Notice, token: &str) -> String {
    match name {
        "text" => notice.text.clone(),
        "event" => notice.rule.name().to_owned(),
        "robot" => notice.robot.clone(),
        "title" => notice.rule.title().to_owned(),
        "time" => notice.time.clone(),
        "picture" => {
            let name = notice.picture.as_ref().and_then(|path| path.file_name());
            name.unwrap_or_default().to_string_lossy().into_owned()
        }
        "token" => token.to_owned(),
        _ => String::new(),
    }
}

/// Converts a text to one line of ASCII.
fn header(text: &str) -> String {
    let line: String = text
        .chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    if line.is_ascii() {
        line.trim().to_owned()
    } else {
        format!("=?UTF-8?B?{}?=", BASE64.encode(line.trim().as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::notify::Rule;
    use proptest::prelude::*;
    use serde_json::json;

    fn notice(text: &str) -> Notice {
        Notice {
            rule: Rule::NotDocked,
            text: text.to_owned(),
            robot: "Rover".to_owned(),
            at: 0,
            time: "2026-05-04 21:00:00 +02:00".to_owned(),
            picture: Some("data/guard/1.jpg".into()),
        }
    }

    fn filled(template: &str, place: Slot) -> String {
        fill(template, &notice("a b&c \"q\" ä\r\nX: y"), "s3", place)
    }

    #[test]
    fn names_in_braces_are_filled_in_and_other_braces_stay() {
        let text = filled(
            "{robot} {title} {event} {time} {picture} {token} {} {no word} {",
            Slot::Plain,
        );
        assert_eq!(
            text,
            "Rover Not on its station not_docked 2026-05-04 21:00:00 +02:00 1.jpg s3 {} {no word} {"
        );
        assert!(check("{text} {a b}").is_ok() && check("{texts}").is_err());
    }

    #[test]
    fn values_are_escaped_for_their_context() {
        assert_eq!(
            filled("http://h/{text}?q=1", Slot::Url),
            "http://h/a%20b%26c%20%22q%22%20%C3%A4%0D%0AX%3A%20y?q=1"
        );
        let header = filled("{text}", Slot::Header);
        assert!(header.starts_with("=?UTF-8?B?") && header.is_ascii());
        assert!(!header.contains(['\r', '\n']));
        let json = fill_json(
            &json!({ "a": ["{text}", 1, {"b": "{robot}"}] }),
            &notice("\"}"),
            "",
        );
        assert_eq!(json, json!({ "a": ["\"}", 1, {"b": "Rover"}] }));
    }

    #[test]
    fn a_header_beyond_ascii_is_encoded_in_base64() {
        assert_eq!(header("ä"), "=?UTF-8?B?w6Q=?=");
    }

    proptest! {
        #[test]
        fn no_template_panics_and_text_without_braces_stays(template in "\\PC{0,40}") {
            let _ = check(&template);
            let text = filled(&template, Slot::Plain);
            if !template.contains('{') {
                prop_assert_eq!(text, template);
            }
        }
    }
}
