//! The response to a request that is refused: a status and one sentence, as JSON.

use axum::Json;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::Serialize;

/// Why a request is refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{error}")]
pub struct Refusal {
    status: StatusCode,
    error: String,
}

/// The JSON body.
#[derive(Debug, Serialize, JsonSchema)]
struct Body<'a> {
    error: &'a str,
}

impl Refusal {
    /// Creates a refusal with a sentence for people.
    pub fn new(status: StatusCode, error: impl Into<String>) -> Refusal {
        Refusal {
            status,
            error: error.into(),
        }
    }

    /// The visitor is not logged in.
    pub fn unknown() -> Refusal {
        Refusal::new(StatusCode::UNAUTHORIZED, "log in first, or send a token")
    }

    /// The visitor's role does not permit the request.
    pub fn viewer_only() -> Refusal {
        Refusal::new(
            StatusCode::FORBIDDEN,
            "viewers may only watch and stop the robot",
        )
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.status, Json(Body { error: &self.error })).into_response()
    }
}
