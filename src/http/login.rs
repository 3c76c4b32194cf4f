//! Logging in and out.

use std::sync::Arc;

use axum::extract::{ConnectInfo, DefaultBodyLimit, State};
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::access::Access;
use super::listener::Peer;
use super::middleware::{COOKIE, Identity, denied, session};
use super::refusal::Refusal;
use super::role::{Role, Visitor};
use super::sessions::LIFE;

/// Maximum length of a request body with a password, in bytes.
const MAX_BODY: usize = 8 * 1024;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Credentials {
    password: String,
}

/// The visitor's role, and whether a login is possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Me {
    /// The visitor's role; null: a login is required.
    pub role: Option<Role>,
    /// Whether no login is needed.
    pub open: bool,
    /// Whether there is a password to log in with.
    pub password: bool,
}

/// Returns the routes `/api/me`, `/api/login` and `/api/logout`.
pub fn routes(access: Arc<Access>) -> Router {
    Router::new()
        .route("/api/me", get(me))
        .route("/api/login", post(log_in))
        .route("/api/logout", post(log_out))
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .with_state(access)
}

async fn me(
    State(access): State<Arc<Access>>,
    axum::Extension(Identity(visitor)): axum::Extension<Identity>,
) -> Json<Me> {
    Json(Me {
        role: visitor.map(|visitor: Visitor| visitor.role),
        open: access.is_open(),
        password: access.has_passwords(),
    })
}

async fn log_in(
    State(access): State<Arc<Access>>,
    ConnectInfo(peer): ConnectInfo<Peer>,
    headers: HeaderMap,
    Json(Credentials { password }): Json<Credentials>,
) -> Result<Response, Refusal> {
    let (session, role) = access
        .log_in(peer.address.ip(), &password)
        .map_err(denied)?;
    tracing::info!(from = %peer.address.ip(), role = role.name(), "a visitor logs in to the page");
    let origin = headers
        .get(header::ORIGIN)
        .and_then(|origin| origin.to_str().ok());
    // The page is behind a TLS proxy.
    let secure = origin.is_some_and(|origin| origin.starts_with("https://"));
    let me = Me {
        role: Some(role),
        open: access.is_open(),
        password: access.has_passwords(),
    };
    Ok(with_cookie(
        Json(me).into_response(),
        &session,
        LIFE.as_secs(),
        secure,
    ))
}

async fn log_out(State(access): State<Arc<Access>>, headers: HeaderMap) -> Response {
    if let Some(session) = session(&headers) {
        access.log_out(session);
    }
    with_cookie(().into_response(), "", 0, false)
}

fn with_cookie(mut response: Response, session: &str, age: u64, secure: bool) -> Response {
    let secure = if secure { "; Secure" } else { "" };
    let cookie =
        format!("{COOKIE}={session}; HttpOnly; SameSite=Strict; Path=/; Max-Age={age}{secure}");
    // Always a valid header value: it consists of hexadecimal digits and fixed text.
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    response
}
