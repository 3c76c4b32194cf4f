//! Arbitrary webhook templates, filled with arbitrary texts of robots and scripts and any picture:
//! the result is one request to the configured host, with exactly the configured header fields and
//! body parts.
#![no_main]

use libfuzzer_sys::fuzz_target;
use serde_json::Value;
use spykee::notify::{Notice, Options, PictureMode, Rule, Target, request};

const TOKEN: &str = "t0ken&/ \r\n\"";

fuzz_target!(|bytes: &[u8]| {
    let Some((&how, rest)) = bytes.split_first() else {
        return;
    };
    let mut parts = rest.split(|byte| *byte == 0);
    let mut part = || parts.next().unwrap_or_default();
    let mut text = || String::from_utf8_lossy(part()).into_owned();
    let path = text();
let field = text();
let body = text();
let words = text();
let robot = text();
    let picture = part();
    let json = (how & 1 != 0).then(|| serde_json::from_str(&body).ok()).flatten();
    let ways = [PictureMode::None, PictureMode::Body, PictureMode::Form];
    let url = format!("http://hook.example:81/{path}?t={{token}}");
    let target = Target {
        url: Some(url.clone()),
        headers: [("x-words".to_owned(), field.clone())].into(),
        body: json.is_none().then_some(body),
        json,
        picture: ways[usize::from(how >> 1) % ways.len()],
        token_file: Some("token".into()),
        ..Target::default()
    };
    let mut options = Options::default();
    options.targets.insert("hook".to_owned(), target.clone());
    if options.check().is_err() {
        return;
    }
    let notice = Notice {
        rule: Rule::Script,
        text: words,
        robot,
        at: i64::from(how) << 40,
        picture: Some("data/guard/seen.jpg".into()),
    };
    let picture = (how & 0x80 != 0).then_some(picture);
    let made = match request(&target, &url, TOKEN, &notice, picture) {
        Ok(made) => made,
        Err(error) => {
            let why = error.to_string();
            return assert!(!why.contains(TOKEN) && why.len() < 200, "{why}");
        }
    };
    assert_eq!(made.uri().authority().map(|place| place.as_str()), Some("hook.example:81"));
    assert_eq!(made.method().as_str(), "POST");
    assert_eq!(made.headers().len(), 2, "{:?}", made.headers());
    let value = made.headers()["x-words"].as_bytes();
    assert!(value.iter().all(|byte| (0x20..0x7f).contains(byte)), "{value:?}");
    let kind = made.headers()["content-type"].to_str().expect("set by the program");
    match (kind.split_once("boundary="), picture) {
        (Some((_, boundary)), Some(picture)) => form(made.body(), boundary, &target, picture),
        _ if kind == "application/json" => {
            let sent: Value = serde_json::from_slice(made.body()).expect("valid JSON");
            let template = target.json.as_ref().expect("set in the config");
            assert!(alike(template, &sent), "{template} became {sent}");
        }
        _ => {}
    }
});

/// Checks that a form has one part for each configured field, and the unchanged picture.
fn form(body: &[u8], boundary: &str, target: &Target, picture: &[u8]) {
    let fields = match &target.json {
        Some(Value::Object(map)) => map.len(),
        _ => 1,
    };
    let line = format!("--{boundary}");
    let found = body.windows(line.len()).filter(|part| *part == line.as_bytes()).count();
    assert_eq!(found, fields + 2, "a field that is not in the config");
    let end = format!("\r\n{line}--\r\n");
    assert!(body.ends_with(&[picture, end.as_bytes()].concat()), "the picture was changed");
}

/// Whether two values are equal except for the content of strings.
fn alike(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::String(_), Value::String(_)) => true,
        (Value::Array(one), Value::Array(other)) => {
            one.len() == other.len() && one.iter().zip(other).all(|(one, other)| alike(one, other))
        }
        (Value::Object(one), Value::Object(other)) => {
            one.len() == other.len()
                && one.iter().all(|(key, value)| other.get(key).is_some_and(|with| alike(value, with)))
        }
        (one, other) => one == other,
    }
}
