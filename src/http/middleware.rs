//! The middleware that every request passes: the guard before it is served, the response headers
//! after.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{ConnectInfo, FromRequestParts, Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::request::Parts;
use axum::http::{Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt as _;
use futures_util::stream::unfold;
use tokio::time::{Instant, timeout_at};

use super::access::{Access, Denied};
use super::guard::{OriginHeaders, Reason};
use super::listener::Peer;
use super::refusal::Refusal;
use super::role::{Role, Visitor};

/// Timeout for the body of a request.
const BODY: Duration = Duration::from_secs(15);
/// Name of the session's cookie.
pub(super) const COOKIE: &str = "spykee_session";
/// The page may load only what we serve, and run only our own scripts.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; font-src 'self'; manifest-src 'self'; base-uri 'none'; \
                      form-action 'self'; frame-ancestors 'none'";
const HEADERS: [(HeaderName, &str); 6] = [
    (header::CONTENT_SECURITY_POLICY, POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (
        HeaderName::from_static("cross-origin-opener-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("cross-origin-resource-policy"),
        "same-origin",
    ),
    (
        HeaderName::from_static("permissions-policy"),
        "camera=(), microphone=(), geolocation=(), gamepad=(self)",
    ),
];

/// Middleware: checks a request, identifies the visitor, and adds headers to the response.
pub async fn guard_request(
    State(access): State<Arc<Access>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    mut request: Request,
    next: Next,
) -> Response {
    peer.mark_head_received();
    let response = match admit(&access, &peer, &request) {
        Ok(visitor) => {
            request.extensions_mut().insert(Identity(visitor));
            next.run(request.map(with_body_timeout)).await
        }
        Err(refusal) => refusal.into_response(),
    };
    with_response_headers(response)
}

/// Adds the timeout to a body. Without it, a few clients that send endless bodies could lock out
/// all others.
fn with_body_timeout(body: Body) -> Body {
    let until = Instant::now() + BODY;
    let pieces = unfold(Some(body.into_data_stream()), move |pieces| async move {
        let mut pieces = pieces?;
        match timeout_at(until, pieces.next()).await {
            Ok(piece) => Some((piece?, Some(pieces))),
            Err(_) => Some((
                Err(axum::Error::new(io::Error::from(io::ErrorKind::TimedOut))),
                None,
            )),
        }
    });
    Body::from_stream(pieces)
}

fn admit(
    access: &Access,
    peer: &Peer,
    request: &Request<Body>,
) -> Result<Option<Visitor>, Refusal> {
    let headers = request.headers();
    let upgrade = headers.contains_key(header::UPGRADE);
    let origin_headers = OriginHeaders {
        host: only(headers, &header::HOST),
        origin: headers
            .get(header::ORIGIN)
            .map(|origin| origin.to_str().unwrap_or_default()),
        site: only(headers, &HeaderName::from_static("sec-fetch-site")),
        changes_state: upgrade || !matches!(*request.method(), Method::GET | Method::HEAD),
    };
    access
        .validate(origin_headers)
        .map_err(|reason| match reason {
            Reason::Host => Refusal::new(StatusCode::MISDIRECTED_REQUEST, reason.to_string()),
            Reason::Origin => Refusal::new(StatusCode::FORBIDDEN, reason.to_string()),
        })?;
    let token = only(headers, &header::AUTHORIZATION).and_then(|text| text.strip_prefix("Bearer "));
    match token {
        Some(token) => access
            .of_token(peer.address.ip(), token)
            .map(Some)
            .map_err(denied),
        None => Ok(access.of_session(session(headers))),
    }
}

/// Returns the value of a header that must not occur twice.
fn only<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    let mut all = headers.get_all(name).iter();
    let first = all.next()?.to_str().ok();
    first.filter(|_| all.next().is_none())
}

/// Returns the session cookie.
pub(super) fn session(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok());
    let mut pairs = cookies.flat_map(|value| value.split(';'));
    pairs.find_map(|pair| pair.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

pub(super) fn denied(denied: Denied) -> Refusal {
    let status = match denied {
        Denied::Wrong => StatusCode::UNAUTHORIZED,
        Denied::TooMany(_) => StatusCode::TOO_MANY_REQUESTS,
    };
    Refusal::new(status, denied.to_string())
}

fn with_response_headers(mut response: Response) -> Response {
    let switches = response.status() == StatusCode::SWITCHING_PROTOCOLS;
    let headers = response.headers_mut();
    for (name, value) in HEADERS {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if !headers.contains_key(header::CACHE_CONTROL) {
        headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-store"));
    }
    if !switches {
        headers.insert(header::CONNECTION, HeaderValue::from_static("close"));
    }
    response
}

/// The visitor who sends a request, if known.
#[derive(Debug, Clone)]
pub(super) struct Identity(pub(super) Option<Visitor>);

impl<S: Sync> FromRequestParts<S> for Visitor {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Visitor, Refusal> {
        let identity = parts.extensions.get::<Identity>();
        identity
            .and_then(|Identity(visitor)| visitor.clone())
            .ok_or_else(Refusal::unknown)
    }
}

/// A visitor with the role of a driver.
#[derive(Debug, Clone)]
pub struct Driver(pub Visitor);

impl<S: Sync> FromRequestParts<S> for Driver {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<Driver, Refusal> {
        let visitor = Visitor::from_request_parts(parts, state).await?;
        match visitor.role {
            Role::Driver => Ok(Driver(visitor)),
            Role::Viewer => Err(Refusal::viewer_only()),
        }
    }
}
