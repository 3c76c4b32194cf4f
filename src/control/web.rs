//! A run on another computer, reached through its JSON API: each request is one of the calls that
//! `/api/openapi.json` describes, and has the same answer as through the private socket.

use std::io;
use std::time::Duration;

use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use serde::Deserialize;
use serde_json::{Value, json};
use ureq::http::{HeaderValue, Request};

use super::client::AskError;
use super::report::{Report, StopReport};
use super::request::{BehaviourListing, Change, RunRequest, RunResponse};
use crate::clock::Span;
use crate::config::ServiceUrl;
use crate::robot::{DockEnd, EndReason, Priority};
use crate::sanitize;

/// Maximum length of a reply, in bytes: that of a picture.
const LONGEST: u64 = 4 << 20;
/// Maximum length of a refusal that is shown, in characters.
const SHOWN: usize = 300;

/// The address of a service, and the token for access to it.
#[derive(Debug, Clone)]
pub struct Remote {
    url: ServiceUrl,
    token: Option<HeaderValue>,
}

/// The token is not valid in a header field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the token contains characters that are not allowed in a token")]
pub struct TokenError;

impl Remote {
    /// A service at this address, with this token.
    ///
    /// # Errors
    /// See [`TokenError`].
    pub fn new(url: ServiceUrl, token: Option<&str>) -> Result<Remote, TokenError> {
        let token = token.map(|token| {
            let field = HeaderValue::from_str(&format!("Bearer {token}"));
            field.map(|mut field| {
                field.set_sensitive(true);
                field
            })
        });
        let token = token.transpose().map_err(|_| TokenError)?;
        Ok(Remote { url, token })
    }

    /// The address.
    pub fn url(&self) -> &ServiceUrl {
        &self.url
    }

    /// Sends one request and waits for the answer at most this long. Blocks the calling thread.
    ///
    /// # Errors
    /// See [`AskError`].
    pub fn ask(&self, request: &RunRequest, limit: Duration) -> Result<RunResponse, AskError> {
        let call = Call::new(request);
        let method = if call.body.is_some() { "POST" } else { "GET" };
        let (kind, body) = call.body.unwrap_or_default();
        let http_request = Request::builder()
            .method(method)
            .uri(format!("{}{}", self.url, call.path))
            .header("content-type", kind)
            .body(body);
        // Scheme, host and path were checked, and names in the path are percent-encoded.
        let mut http_request =
            http_request.map_err(|error| AskError::Io(io::Error::other(error)))?;
        if let Some(token) = &self.token {
            http_request
                .headers_mut()
                .insert("authorization", token.clone());
        }
        let agent: ureq::Agent = ureq::Agent::config_builder()
            .timeout_global(Some(limit))
            .http_status_as_error(false)
            .max_redirects(0)
            .user_agent(concat!("spykee/", env!("CARGO_PKG_VERSION")))
            .build()
            .into();
        let failed = |error: ureq::Error| match error {
            ureq::Error::Timeout(_) => AskError::TimedOut(limit),
            ureq::Error::Io(error) => AskError::Io(error),
            other => AskError::Io(io::Error::other(other)),
        };
        let mut answer = agent.run(http_request).map_err(failed)?;
        let status = answer.status().as_u16();
        let body = answer.body_mut().with_config().limit(LONGEST);
        let body = body.read_to_vec().map_err(failed)?;
        parse_answer(request, status, body)
    }
}

/// One API call: a POST if it has a content type and body, else a GET.
struct Call {
    path: String,
    body: Option<(&'static str, Vec<u8>)>,
}

impl Call {
    fn new(request: &RunRequest) -> Call {
        let get = |path: &str| Call {
            path: path.to_owned(),
            body: None,
        };
        let post = |path: String, body: Value| Call {
            path,
            body: Some(("application/json", body.to_string().into_bytes())),
        };
        let bare = |path: &str| post(path.to_owned(), json!({}));
        match request {
            RunRequest::Overview => get("/api/run"),
            RunRequest::Behaviours => get("/api/behaviours"),
            RunRequest::Picture(limit) => get(&format!("/api/picture?seconds={}", seconds(*limit))),
            RunRequest::Dock(plan) => {
                let body = json!({ "seconds": seconds(plan.timeout), "retries": plan.retries });
                post("/api/dock".to_owned(), body)
            }
            RunRequest::Undock(limit) => post(
                "/api/undock".to_owned(),
                json!({ "seconds": seconds(*limit) }),
            ),
            RunRequest::Stop => bare("/api/stop"),
            RunRequest::ResetStop => bare("/api/reset-stop"),
            RunRequest::StopSound => bare("/api/stop-sound"),
            RunRequest::Led { led, on } => post(
                "/api/led".to_owned(),
                json!({ "light": led.name(), "on": on }),
            ),
            RunRequest::Play(sound) => {
                post("/api/play".to_owned(), json!({ "sound": sound.name() }))
            }
            RunRequest::Volume(percent) => post(
                "/api/volume".to_owned(),
                json!({ "percent": percent.get() }),
            ),
            RunRequest::Say(samples) => Call {
                path: "/api/say".to_owned(),
                body: Some(("application/octet-stream", samples.clone())),
            },
            RunRequest::Behaviour { name, change } => {
                let body = match change {
                    Change::Start => json!({ "change": "start" }),
                    Change::StartFor(lasts) => {
                        let lasts = Span::at_most_a_year(*lasts).to_string();
                        json!({ "change": "start", "for": lasts })
                    }
                    Change::Stop => json!({ "change": "stop" }),
                    Change::Restart => json!({ "change": "restart" }),
                };
                let name = utf8_percent_encode(name, NON_ALPHANUMERIC);
                post(format!("/api/behaviours/{name}"), body)
            }
        }
    }
}

/// Rounds up to whole seconds, at least one.
fn seconds(time: Duration) -> u64 {
    time.as_secs_f64().ceil().max(1.0) as u64
}

/// The result of a docking or undocking, successful or not.
#[derive(Deserialize)]
struct Docking {
    end: DockEnd,
    #[serde(default)]
    attempts: u32,
    #[serde(default)]
    seconds: f64,
}

#[derive(Deserialize)]
struct Behaviour {
    name: String,
    priority: i16,
    state: String,
    running: Option<u64>,
    exit: Option<End>,
}

#[derive(Deserialize)]
struct End {
    reason: EndReason,
    text: String,
}

fn parse_answer(request: &RunRequest, status: u16, body: Vec<u8>) -> Result<RunResponse, AskError> {
    match (request, status) {
        (RunRequest::Dock(_) | RunRequest::Undock(_), 200 | 409) => match read::<Docking>(&body) {
            Ok(docking) => Ok(docking.answer(request)),
            Err(_) if status == 409 => Ok(RunResponse::Refused(why(&body))),
            Err(error) => Err(error),
        },
        (RunRequest::Overview, 200) => {
            let report: Report = read(&body)?;
            Ok(RunResponse::Overview(Box::new(report.into())))
        }
        (RunRequest::Behaviours, 200) => {
            let all: Vec<Behaviour> = read(&body)?;
            Ok(RunResponse::Behaviours(
                all.into_iter().map(Behaviour::listed).collect(),
            ))
        }
        (RunRequest::Stop, 200) => {
            let mut report: StopReport = read(&body)?;
            report.why_not_kept = report.why_not_kept.map(|why| sanitize::line(&why));
            Ok(RunResponse::Stopped {
                outcome: report.into(),
                ends: false,
            })
        }
        (RunRequest::Picture(_), 200) => Ok(RunResponse::Picture(body)),
        (_, 200) => Ok(RunResponse::Done),
        (_, 409) => Ok(RunResponse::Refused(why(&body))),
        (_, 503) => Ok(RunResponse::Offline),
        (RunRequest::Picture(_), 504) => Ok(RunResponse::NoPicture),
        (_, 401 | 403 | 421) => Err(AskError::Denied(why(&body))),
        _ => Err(AskError::UnexpectedStatus(status)),
    }
}

fn read<'a, T: Deserialize<'a>>(body: &'a [u8]) -> Result<T, AskError> {
    let strange = |error: serde_json::Error| {
        AskError::Io(io::Error::other(format!("invalid reply: {error}")))
    };
    serde_json::from_slice(body).map_err(strange)
}

/// Returns the sentence of a refusal, sanitised for a terminal.
fn why(body: &[u8]) -> String {
    let body: Result<Value, _> = serde_json::from_slice(body);
    let sentence = body
        .ok()
        .and_then(|body| body["error"].as_str().map(sanitize::line));
    let sentence = sentence.unwrap_or_else(|| "no reason given".to_owned());
    sentence.chars().take(SHOWN).collect()
}

impl Docking {
    fn answer(self, request: &RunRequest) -> RunResponse {
        let Docking {
            end,
            attempts,
            seconds,
        } = self;
        match request {
            RunRequest::Undock(_) => RunResponse::Undocked(end),
            _ => RunResponse::Docked {
                end,
                attempts,
                took: Duration::try_from_secs_f64(seconds).unwrap_or_default(),
            },
        }
    }
}

impl Behaviour {
    fn listed(self) -> BehaviourListing {
        BehaviourListing {
            name: sanitize::line(&self.name),
            priority: Priority(self.priority),
            state: sanitize::line(&self.state),
            running: self.running.map(Duration::from_secs),
            exit: self.exit.map(|end| (end.reason, sanitize::line(&end.text))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_token_is_checked_and_never_shown() {
        let url: ServiceUrl = "http://10.0.0.7:7788".parse().unwrap();
        let remote = Remote::new(url.clone(), Some("s3cr3t")).unwrap();
        assert!(!format!("{remote:?}").contains("s3cr3t"));
        assert_eq!(Remote::new(url, Some("a\nb")).unwrap_err(), TokenError);
    }

    #[test]
    fn a_name_stays_within_its_segment_of_the_path() {
        let request = RunRequest::Behaviour {
            name: "a/../b?c".to_owned(),
            change: Change::Start,
        };
        let path = Call::new(&request).path;
        assert_eq!(path, "/api/behaviours/a%2F%2E%2E%2Fb%3Fc");
    }

    #[test]
    fn replies_map_to_the_same_answers_as_on_the_socket() {
        let overview = |status, body: &str| {
            parse_answer(&RunRequest::StopSound, status, body.as_bytes().to_vec())
        };
        assert_eq!(overview(200, "{}").unwrap(), RunResponse::Done);
        assert_eq!(overview(503, "").unwrap(), RunResponse::Offline);
        let refused = overview(409, r#"{"error":"no\u001b[2J"}"#).unwrap();
        assert!(matches!(refused, RunResponse::Refused(why) if !why.contains('\u{1b}')));
        assert!(matches!(overview(401, "{}"), Err(AskError::Denied(_))));
        assert!(matches!(
            overview(404, ""),
            Err(AskError::UnexpectedStatus(404))
        ));
        let dock = |status, body: &str| {
            let plan = crate::robot::DockPlan::DEFAULT;
            parse_answer(&RunRequest::Dock(plan), status, body.as_bytes().to_vec()).unwrap()
        };
        let body = r#"{"error":"x","end":"base_not_found","attempts":3,"seconds":1.5}"#;
        let docked = RunResponse::Docked {
            end: DockEnd::BaseNotFound,
            attempts: 3,
            took: Duration::from_millis(1500),
        };
        assert_eq!(dock(409, body), docked);
        assert_eq!(
            dock(409, r#"{"error":"x"}"#),
            RunResponse::Refused("x".into())
        );
    }
}
