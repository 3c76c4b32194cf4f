//! Logging in and out. The page sends the token of a link, once; from then on the browser sends it
//! as a cookie that no script can read.

use std::net::SocketAddr;
use std::sync::Arc;

use axum::extract::{ConnectInfo, DefaultBodyLimit, State};
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Json, Router};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::access::Access;
use super::keyring::Role;
use super::middleware::COOKIE;
use super::visitor::{Identity, Refusal};

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
            post(async || with_cookie(().into_response(), "", 0, false)),
        )
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .with_state(access)
}

async fn me(
    State(access): State<Arc<Access>>,
    Extension(Identity(visitor)): Extension<Identity>,
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
    let role = visitor.ok_or_else(Refusal::wrong_token)?.role;
    tracing::info!(from = %from.ip(), role = role.name(), "a visitor logs in to the page");
    let me = Me {
        role: Some(role),
        open: false,
    };
    // With an origin of https, the page is behind a TLS proxy.
    let origin = headers.get(header::ORIGIN);
    let secure = origin.is_some_and(|origin| origin.as_bytes().starts_with(b"https://"));
    Ok(with_cookie(
        Json(me).into_response(),
        &token,
        COOKIE_AGE,
        secure,
    ))
}

fn with_cookie(mut response: Response, token: &str, age: u32, secure: bool) -> Response {
    let secure = if secure { "; Secure" } else { "" };
    let cookie =
        format!("{COOKIE}={token}; HttpOnly; SameSite=Strict; Path=/; Max-Age={age}{secure}");
    // Always a valid header value: a token of ours consists of letters and digits.
    if let Ok(cookie) = HeaderValue::from_str(&cookie) {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    response
}
