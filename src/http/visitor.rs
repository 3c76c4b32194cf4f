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
    /// The user ID of a program on this computer that uses the private socket.
    pub user: Option<u32>,
}

impl Visitor {
    /// A program of this user on this computer: what it may do to the process it may do here.
    pub(super) fn local(user: u32) -> Visitor {
        Visitor {
            role: Role::Driver,
            key: None,
            user: Some(user),
        }
    }

    /// Whether the visitor may do what needs this role.
    ///
    /// # Errors
    /// The refusal.
    pub fn require(&self, role: Role) -> Result<(), Refusal> {
        if role == Role::Driver && self.role != Role::Driver {
            return Err(Refusal::viewer_only());
        }
        Ok(())
    }

    /// Who this is, for the journal; `way` is what a visitor from the network uses.
    pub fn describe(&self, way: &str) -> String {
        match (self.user, &self.key) {
            (Some(user), _) => format!("the command line, user ID {user}"),
            (None, Some(key)) => format!("{way}, token {}", key.name),
            (None, None) => format!("{way}, without a token"),
        }
    }
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
