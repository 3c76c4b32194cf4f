//! The middleware that every request passes: the check of its origin before it is served, the
//! response headers after. And logging in and out: the page sends the token of a link, once; from
//! then on the browser sends it as a cookie that no script can read.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::body::Body;
use axum::extract::{ConnectInfo, DefaultBodyLimit, Request, State};
use axum::http::header::{self, HeaderMap, HeaderName, HeaderValue};
use axum::http::{Method, StatusCode, Uri};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Json, Router};
use futures_util::StreamExt as _;
use futures_util::stream::unfold;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::time::{Instant, timeout_at};

use super::access::{Access, Refusal, Visitor};
use super::connections::Place;
use super::keyring::Role;
use super::origin_check::{OriginHeaders, Reason};
use super::unknown_host;

const BODY: Duration = Duration::from_secs(15);
pub(super) const COOKIE: &str = "spykee_token";
/// Path of the request that must always get through.
const STOP: &str = "/api/stop";
/// Path of the camera's pictures for tools, whose address may contain a token.
pub const CAMERA: &str = "/api/camera.mjpeg";
const PICTURE: &str = "/api/picture";
/// The page may load only what we serve, and run only our own scripts.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
                      connect-src 'self'; font-src 'self'; manifest-src 'self'; base-uri 'none'; \
                      form-action 'self'; frame-ancestors 'none'";
const HEADERS: [(&str, &str); 6] = [
    ("content-security-policy", POLICY),
    ("x-content-type-options", "nosniff"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-opener-policy", "same-origin"),
    ("cross-origin-resource-policy", "same-origin"),
    (
        "permissions-policy",
        "camera=(), microphone=(), geolocation=(), gamepad=(self)",
    ),
];

/// Middleware: checks a request, identifies the visitor, and adds headers to the response.
pub async fn guard_request(
    State(access): State<Arc<Access>>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    mut request: Request,
    next: Next,
) -> Response {
    let response = match admit(&access, from, &request) {
        Ok(visitor) => {
            identify(&mut request, visitor);
            next.run(request.map(with_body_timeout)).await
        }
        Err(refusal) => {
            let response = refusal.into_response();
            let misdirected = response.status() == StatusCode::MISDIRECTED_REQUEST;
            if misdirected && is_for_people(request.headers()) {
                unknown_host::page(only(request.headers(), &header::HOST))
            } else {
                response
            }
        }
    };
    with_response_headers(response)
}

/// Whether a browser shows the response to a person.
fn is_for_people(headers: &HeaderMap) -> bool {
    only(headers, &header::ACCEPT).is_some_and(|kinds| kinds.contains("text/html"))
}

/// Header with which a program on the private socket gives up the rights of a driver: `viewer`.
pub const ROLE: &str = "spykee-role";

/// Middleware of the private socket, which only programs of the same user can open.
pub(super) async fn admit_local(
    Extension(mut visitor): Extension<Visitor>,
    mut request: Request,
    next: Next,
) -> Response {
    if request.headers().contains_key(ROLE) {
        visitor.role = Role::Viewer;
    }
    identify(&mut request, Some(visitor));
    next.run(request.map(with_body_timeout)).await
}

/// Tells what serves the request, and the limit of connections, who sends it.
fn identify(request: &mut Request, visitor: Option<Visitor>) {
    if let Some(place) = request.extensions().get::<Arc<Place>>()
        && let Some(visitor) = &visitor
    {
        place.identify(visitor, request.uri().path() == STOP);
    }
    request.extensions_mut().insert(visitor);
}

/// Counts the connection of this request among those of a member of a class.
pub fn count_as_member(request: &Request, name: &str) {
    if let Some(place) = request.extensions().get::<Arc<Place>>() {
        place.join(name);
    }
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
    from: SocketAddr,
    request: &Request<Body>,
) -> Result<Option<Visitor>, Refusal> {
    let headers = request.headers();
    let token = only(headers, &header::AUTHORIZATION).and_then(|text| text.strip_prefix("Bearer "));
    let linked = token_in_address(request.uri());
    let token = token.or(linked);
    let upgrade = headers.contains_key(header::UPGRADE);
    // These switch the camera on. Another site's page knows no token.
    let looks = token.is_none() && [CAMERA, PICTURE].contains(&request.uri().path());
    let origin_headers = OriginHeaders {
        host: only(headers, &header::HOST),
        origin: headers
            .get(header::ORIGIN)
            .map(|origin| origin.to_str().unwrap_or_default()),
        site: only(headers, &HeaderName::from_static("sec-fetch-site")),
        changes_state: upgrade || looks || !matches!(*request.method(), Method::GET | Method::HEAD),
    };
    access
        .names
        .validate(origin_headers)
        .map_err(|reason| match reason {
            Reason::Host => Refusal::new(StatusCode::MISDIRECTED_REQUEST, reason.to_string()),
            Reason::Origin => Refusal::new(StatusCode::FORBIDDEN, reason.to_string()),
        })?;
    match token {
        Some(token) => match access.visitor_of_token(token, from.ip()) {
            Some(visitor) if linked.is_some() && visitor.role != Role::Viewer => {
                let why =
                    "a token in an address must be a viewer's: logs and histories keep addresses";
                Err(Refusal::new(StatusCode::FORBIDDEN, why))
            }
            Some(visitor) => Ok(Some(visitor)),
            None => Err(Refusal::wrong_token()),
        },
        None => Ok(access.visitor(cookie(headers, COOKIE))),
    }
}

/// Returns the token of a tool that can send no headers.
fn token_in_address(uri: &Uri) -> Option<&str> {
    if uri.path() != CAMERA {
        return None;
    }
    let mut fields = uri.query()?.split('&');
    fields.find_map(|field| field.strip_prefix("token="))
}

/// Returns the value of a header that must not occur twice.
fn only<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    let mut all = headers.get_all(name).iter();
    let first = all.next()?;
    if all.next().is_some() {
        return None;
    }
    first.to_str().ok()
}

/// Returns the value of a cookie. By hand: the crate for cookies brings dates and a jar.
pub fn cookie<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    let cookies = headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok());
    let mut pairs = cookies.flat_map(|value| value.split(';'));
    pairs.find_map(|pair| pair.trim().strip_prefix(name)?.strip_prefix('='))
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

/// Maximum length of a request body with a token, in bytes.
const MAX_BODY: usize = 8 * 1024;
/// How long a browser keeps the cookie, in seconds: 400 days, the longest that browsers allow.
/// Revoking the token ends it earlier.
const COOKIE_AGE: u32 = 400 * 24 * 60 * 60;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Credentials {
    token: String,
}

/// The visitor's role, and whether a login is needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Me {
    /// The visitor's role; null: a login is required.
    pub role: Option<Role>,
    /// Whether no login is needed.
    pub open: bool,
}

/// Returns the routes `/api/me`, `/api/login` and `/api/logout`.
pub fn routes(access: Arc<Access>) -> Router {
    Router::new()
        .route("/api/me", get(me))
        .route("/api/login", post(log_in))
        .route(
            "/api/logout",
            post(async |headers: HeaderMap| {
                with_cookie(().into_response(), set_cookie(COOKIE, "", 0, &headers))
            }),
        )
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .with_state(access)
}

async fn me(
    State(access): State<Arc<Access>>,
    Extension(visitor): Extension<Option<Visitor>>,
) -> Json<Me> {
    Json(Me {
        role: visitor.map(|visitor| visitor.role),
        open: access.is_open(),
    })
}

async fn log_in(
    State(access): State<Arc<Access>>,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    headers: HeaderMap,
    Json(Credentials { token }): Json<Credentials>,
) -> Result<Response, Refusal> {
    let visitor = access.visitor_of_token(&token, from.ip());
    let visitor = visitor.ok_or_else(Refusal::wrong_token)?;
    let role = visitor.role;
    let token_name = visitor.key.map_or_else(String::new, |key| key.name);
    tracing::info!(
        from = %from.ip(), role = role.name(), token = token_name, "a visitor logs in to the page"
    );
    let me = Me {
        role: Some(role),
        open: false,
    };
    let cookie = set_cookie(COOKIE, &token, COOKIE_AGE, &headers);
    Ok(with_cookie(Json(me).into_response(), cookie))
}

/// The header value that sets a cookie, which no script can read and no other site's page sends.
/// `headers` are those of the request: with an origin of https, the page is behind a TLS proxy.
pub fn set_cookie(name: &str, value: &str, age: u32, headers: &HeaderMap) -> Option<HeaderValue> {
    let origin = headers.get(header::ORIGIN);
    let secure = origin.is_some_and(|origin| origin.as_bytes().starts_with(b"https://"));
    let secure = if secure { "; Secure" } else { "" };
    let cookie =
        format!("{name}={value}; HttpOnly; SameSite=Strict; Path=/; Max-Age={age}{secure}");
    // Always valid: a token of ours consists of letters and digits.
    HeaderValue::from_str(&cookie).ok()
}

fn with_cookie(mut response: Response, cookie: Option<HeaderValue>) -> Response {
    if let Some(cookie) = cookie {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    response
}
