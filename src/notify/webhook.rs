//! Sends a notification to a webhook.

use ureq::http::{HeaderName, HeaderValue, Request};

use super::content::content;
use super::notice::Delivery;
use super::notice::Notice;
use super::options::Target;
use super::sender::DELIVERY_TIMEOUT;
use super::template::{Slot, fill};

const REDIRECTS: u32 = 3;

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
        Err(error) => Delivery::Refused(error.to_string()),
    }
}

/// Why no valid request results after the placeholders are replaced.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RequestError {
    #[error("its url is not valid")]
    Url,
    #[error("its header field `{0}` is not valid")]
    Header(String),
}

/// Builds the request to a webhook, with all placeholders replaced. The error contains neither
/// the address nor the token.
pub fn request(
    target: &Target,
    url: &str,
    token: &str,
    notice: &Notice,
    picture: Option<&[u8]>,
) -> Result<Request<Vec<u8>>, RequestError> {
    let content = content(target, token, notice, picture);
    let url = fill(url, notice, token, Slot::Url);
    let request = Request::post(url);
    let mut request = request
        .header("content-type", content.kind.as_ref())
        .body(content.bytes)
        .map_err(|_| RequestError::Url)?;
    for (name, value) in &target.headers {
        let value = fill(value, notice, token, Slot::Header);
        let field = HeaderName::from_bytes(name.as_bytes());
        let (Ok(field), Ok(value)) = (field, HeaderValue::from_str(&value)) else {
            return Err(RequestError::Header(name.clone()));
        };
        request.headers_mut().insert(field, value);
    }
    Ok(request)
}

fn ask(request: Request<Vec<u8>>) -> Delivery {
    let agent: ureq::Agent = ureq::Agent::config_builder()
        .timeout_global(Some(DELIVERY_TIMEOUT))
        .http_status_as_error(false)
        .max_redirects(REDIRECTS)
        .user_agent(concat!("spykee/", env!("CARGO_PKG_VERSION")))
        .build()
        .into();
    match agent.run(request) {
        Ok(answer) => delivery_of(answer.status().as_u16()),
        Err(error) => failed(&error),
    }
}

/// Interprets the status: failures that a retry cannot fix are final; a wrong token may still be
/// corrected.
fn delivery_of(status: u16) -> Delivery {
    match status {
        200..=299 => Delivery::Done,
        400 | 405 | 411 | 413 | 415 | 422 => {
            Delivery::Refused(format!("it responds with the status {status}"))
        }
        401 | 403 => Delivery::Later(format!(
            "it responds with the status {status}: is the token right?"
        )),
        status => Delivery::Later(format!("it responds with the status {status}")),
    }
}

/// Describes an error without the address.
fn failed(error: &ureq::Error) -> Delivery {
    use ureq::Error::{BadUri, HostNotFound, Io, Timeout, TooManyRedirects};
    Delivery::Later(match error {
        Timeout(_) => format!("it does not answer within {} s", DELIVERY_TIMEOUT.as_secs()),
        HostNotFound => "its host name cannot be resolved".to_owned(),
        Io(error) => format!("no connection: {error}"),
        TooManyRedirects => "too many redirects".to_owned(),
        BadUri(_) => return Delivery::Refused("its url is not valid".to_owned()),
        ureq::Error::ConnectionFailed => "no connection".to_owned(),
        _ => "no connection, or no HTTP server there".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::notify::{PictureMode, Rule};
    use serde_json::{Value, json};

    fn notice() -> Notice {
        Notice {
            rule: Rule::Moved,
            text: "somebody is there".to_owned(),
            robot: "Rover".to_owned(),
            at: 0,
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
