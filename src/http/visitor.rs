//! Who sends a request, and the answer to one that this visitor may not make: a status and one
//! sentence, as JSON.

use axum::Json;
use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Response};

use super::keyring::{Key, Role};

/// A visitor with access.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Visitor {
    /// The visitor's role.
    pub role: Role,
    /// The token used; `None` if none is needed.
    pub key: Option<Key>,
}

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

/// Why a request is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{error}")]
pub struct Refusal {
    status: StatusCode,
    error: String,
}

impl Refusal {
    /// Creates a refusal with a sentence for people.
    pub fn new(status: StatusCode, error: impl Into<String>) -> Refusal {
        Refusal {
            status,
            error: error.into(),
        }
    }

    fn unknown() -> Refusal {
        Refusal::new(StatusCode::UNAUTHORIZED, "log in first, or send a token")
    }

    pub(super) fn wrong_token() -> Refusal {
        Refusal::new(StatusCode::UNAUTHORIZED, "wrong token")
    }

    fn viewer_only() -> Refusal {
        Refusal::new(
            StatusCode::FORBIDDEN,
            "viewers may only watch and stop the robot",
        )
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        let body = serde_json::json!({ "error": self.error });
        (self.status, Json(body)).into_response()
    }
}
