//! Sends a notification to a webhook, as a text, JSON, a picture, or a form with text and picture.

use std::borrow::Cow;

use serde_json::Value;
use ureq::http::{HeaderName, HeaderValue, Request};

use super::options::{PictureMode, Target};
use super::sender::DELIVERY_TIMEOUT;
use super::template::{Slot, fill, fill_json};
use super::{Delivery, Notice};
use crate::http;
use crate::sanitize::json_text;

/// Sends the request and waits for the response. Errors do not contain the address, which may
/// include a secret.
pub(super) fn send(
    target: &Target,
    url: &str,
    token: &str,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Delivery {
    match request(target, url, token, notice, picture) {
        Ok(request) => ask(request),
        Err(why) => Delivery::Refused(why),
    }
}

/// Builds the request to a webhook, with all placeholders replaced. The error contains neither
/// the address nor the token.
pub fn request(
    target: &Target,
    url: &str,
    token: &str,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Result<Request<Vec<u8>>, String> {
    let content = content(target, token, notice, picture);
    let url = fill(url, notice, token, Slot::Url);
    let request = Request::post(url);
    let mut request = request
        .header("content-type", content.kind.as_ref())
        .body(content.bytes)
        .map_err(|_| "its url is not valid")?;
    for (name, value) in &target.headers {
        let value = fill(value, notice, token, Slot::Header);
        let field = HeaderName::from_bytes(name.as_bytes());
        let (Ok(field), Ok(value)) = (field, HeaderValue::from_str(&value)) else {
            return Err(format!("its header field `{name}` is not valid"));
        };
        request.headers_mut().insert(field, value);
    }
    Ok(request)
}

fn ask(request: Request<Vec<u8>>) -> Delivery {
    match http::agent(DELIVERY_TIMEOUT).run(request) {
        Ok(answer) => delivery_of(answer.status().as_u16()),
        Err(error) => failed(&error),
    }
}

/// Interprets the status: failures that a retry cannot fix are final; a wrong token may still be
/// corrected.
fn delivery_of(status: u16) -> Delivery {
    match status {
        200..=299 => Delivery::Done,
        300..=399 => Delivery::Later(format!(
            "it redirects to another address (status {status}): name that one as its url"
        )),
        400 | 405 | 411 | 413 | 415 | 422 => {
            Delivery::Refused(format!("it responds with the status {status}"))
        }
        401 | 403 => Delivery::Later(format!(
            "it responds with the status {status}: is the token right?"
        )),
        status => Delivery::Later(format!("it responds with the status {status}")),
    }
}

fn failed(error: &ureq::Error) -> Delivery {
    use ureq::Error::{BadUri, HostNotFound, Io, Timeout};
    Delivery::Later(match error {
        Timeout(_) => format!("it does not answer within {} s", DELIVERY_TIMEOUT.as_secs()),
        HostNotFound => "its host name cannot be resolved".to_owned(),
        Io(error) => format!("no connection: {error}"),
        BadUri(_) => return Delivery::Refused("its url is not valid".to_owned()),
        ureq::Error::ConnectionFailed => "no connection".to_owned(),
        _ => "no connection, or no HTTP server there".to_owned(),
    })
}

/// What is sent to a webhook or a broker: a text, JSON, a picture, or a form with text and picture.
#[derive(Debug, PartialEq)]
pub(super) struct Content {
    pub(super) kind: Cow<'static, str>,
    pub(super) bytes: Vec<u8>,
}

pub(super) fn content(
    target: &Target,
    token: &str,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Content {
    let json = target
        .json
        .as_ref()
        .map(|json| fill_json(json, notice, token));
    let body = target.body.as_deref().unwrap_or("{text}");
    let text = || fill(body, notice, token, Slot::Plain);
    match (picture, target.picture, json) {
        (Some(picture), PictureMode::Body, _) => Content {
            kind: "image/jpeg".into(),
            bytes: picture.to_vec(),
        },
        (Some(picture), PictureMode::Form, json) => {
            let name = notice.picture.as_ref().and_then(|path| path.file_name());
            let name = name.unwrap_or_default().to_string_lossy();
            let boundary = boundary();
            Content {
                kind: format!("multipart/form-data; boundary={boundary}").into(),
                bytes: form(&boundary, &fields(json, text), &name, picture),
            }
        }
        (_, _, Some(json)) => Content {
            kind: "application/json".into(),
            bytes: json.to_string().into_bytes(),
        },
        _ => Content {
            kind: "text/plain; charset=utf-8".into(),
            bytes: text().into_bytes(),
        },
    }
}

fn fields(json: Option<Value>, text: impl Fn() -> String) -> Vec<(String, String)> {
    let Some(Value::Object(map)) = json else {
        return vec![("body".to_owned(), text())];
    };
    map.into_iter()
        .map(|(key, value)| (key, json_text(&value)))
        .collect()
}

/// Returns the separator of a form's parts. It is random, so that no text or picture of a script or
/// robot can contain it and add a part.
fn boundary() -> String {
    format!("spykee-{:032x}", rand::random::<u128>())
}

/// Encodes a form. The field names come from the config, their texts from any source.
fn form(boundary: &str, fields: &[(String, String)], name: &str, picture: &[u8]) -> Vec<u8> {
    let quoted = |text: &str| text.replace(['"', '\r', '\n', '\\'], "_");
    let mut bytes = Vec::new();
    for (key, value) in fields {
        let key = quoted(key);
        let part = format!(
            "--{boundary}\r\nContent-Disposition: form-data; name=\"{key}\"\r\n\
             Content-Type: text/plain; charset=utf-8\r\n\r\n{value}\r\n"
        );
        bytes.extend_from_slice(part.as_bytes());
    }
    let name = quoted(name);
    let head = format!(
        "--{boundary}\r\nContent-Disposition: form-data; name=\"attachment\"; filename=\"{name}\"\r\n\
         Content-Type: image/jpeg\r\n\r\n"
    );
    bytes.extend_from_slice(head.as_bytes());
    bytes.extend_from_slice(picture);
    bytes.extend_from_slice(format!("\r\n--{boundary}--\r\n").as_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::notify::Rule;
    use serde_json::json;

    fn notice() -> Notice {
        Notice {
            rule: Rule::Moved,
            text: "somebody is there".to_owned(),
            robot: "Rover".to_owned(),
            at: 0,
            time: String::new(),
            picture: Some("data/guard/1.jpg".into()),
        }
    }

    fn of(target: Target, picture: Option<&[u8]>) -> (String, Request<Vec<u8>>) {
        let made = request(&target, "https://h/{token}", "s3 cret", &notice(), picture).unwrap();
        (String::from_utf8_lossy(made.body()).into_owned(), made)
    }

    #[test]
    fn text_json_and_pictures_match_the_format_of_each_service() {
        let (body, request) = of(Target::default(), Some(b"jpeg"));
        assert_eq!(body, "somebody is there");
        assert_eq!(
            (request.uri().path(), request.method().as_str()),
            ("/s3%20cret", "POST")
        );
        let ntfy = Target {
            picture: PictureMode::Body,
            headers: [("Message".to_owned(), "{text}".to_owned())].into(),
            ..Target::default()
        };
        let (body, request) = of(ntfy.clone(), Some(b"jpeg"));
        assert_eq!(
            (body.as_str(), &request.headers()["content-type"]),
            ("jpeg", &HeaderValue::from_static("image/jpeg"))
        );
        assert_eq!(request.headers()["message"], "somebody is there");
        assert_eq!(of(ntfy, None).0, "somebody is there");
        let apprise = Target {
            json: Some(json!({ "title": "{robot}", "body": "{text}" })),
            picture: PictureMode::Form,
            ..Target::default()
        };
        let (body, _) = of(apprise.clone(), Some(b"jpeg"));
        for part in [
            "name=\"title\"",
            "\r\n\r\nRover\r\n",
            "filename=\"1.jpg\"",
            "\r\n\r\njpeg\r\n--",
        ] {
            assert!(body.contains(part), "{part}:\n{body}");
        }
        let json: Value = serde_json::from_str(&of(apprise, None).0).unwrap();
        assert_eq!(
            json,
            json!({ "title": "Rover", "body": "somebody is there" })
        );
    }

    #[test]
    fn an_invalid_header_field_is_refused_without_showing_its_value() {
        let target = Target {
            headers: [("no header".to_owned(), "{token}".to_owned())].into(),
            ..Target::default()
        };
        let error = request(&target, "https://h", "s3cret", &notice(), None)
            .unwrap_err()
            .to_string();
        assert!(error.contains("no header") && !error.contains("s3cret"));
    }
}
