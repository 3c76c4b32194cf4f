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
use super::door::Peer;
use super::gate::{COOKIE, Somebody, denied, session};
use super::refusal::Refusal;
use super::role::{Role, Visitor};
use super::sessions::LIFE;

/// Bytes of a password with its wrapping.
const MAX_BODY: usize = 8 * 1024;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Credentials {
    password: String,
}

/// Who asks, and whether he could log in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Me {
    /// What he may do; null: he has to log in first.
    pub role: Option<Role>,
    /// No login is needed here.
    pub open: bool,
    /// There is a password to log in with.
    pub password: bool,
}

/// `/api/me`, `/api/login`, `/api/logout`.
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
    axum::Extension(Somebody(visitor)): axum::Extension<Somebody>,
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
    tracing::info!(from = %peer.address.ip(), role = role.name(), "somebody logs in to the page");
    let origin = headers
        .get(header::ORIGIN)
        .and_then(|origin| origin.to_str().ok());
    // Behind a proxy that speaks TLS.
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
    // Hexadecimal digits and our own words: always a header.
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    response
}
