//! The answers to requests.

use axum::Json;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::run_status::{BehaviourListing, RunStatus};
use crate::robot::{DockEnd, StopOutcome};

/// The answer to a request. Over HTTP it is a JSON object, a picture a JPEG. If the request was not
/// carried out, the status says why, and the field `error` in words.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "answer", rename_all = "snake_case")]
#[schemars(rename = "Answer")]
pub enum RunResponse {
    /// The state of the run.
    Status(Box<RunStatus>),
    /// All behaviours that are known or running.
    Behaviours {
        /// Each.
        behaviours: Vec<BehaviourListing>,
    },
    /// How a docking ended.
    Docked {
        /// The outcome: `done`, `already_docked`, `base_not_found`, and so on, as in scripts.
        end: DockEnd,
        /// Attempts made.
        attempts: u32,
        /// Time taken.
        seconds: f64,
    },
    /// How an undocking ended.
    Undocked {
        /// The outcome: `done`, `not_docked`, and so on, as in scripts.
        end: DockEnd,
    },
    /// STOP holds.
    Stopped {
        /// What is known of it.
        #[serde(flatten)]
        outcome: StopOutcome,
        /// Whether the run ends now; a service goes on.
        ends: bool,
    },
    /// The request was passed to the pilot.
    Done,
    /// A JPEG.
    Picture {
        /// Its bytes.
        #[serde(skip)]
        jpeg: Vec<u8>,
    },
    /// No picture arrived in time.
    NoPicture,
    /// The robot is not connected; the run is reconnecting.
    Offline,
    /// The request was refused.
    Refused {
        /// The reason.
        error: String,
    },
}

impl RunResponse {
    pub(super) fn refused(error: impl ToString) -> RunResponse {
        RunResponse::Refused {
            error: error.to_string(),
        }
    }

    /// Done, or refused for this reason.
    pub(super) fn from_result<E: ToString>(done: Result<(), E>) -> RunResponse {
        match done {
            Ok(()) => RunResponse::Done,
            Err(error) => RunResponse::refused(error),
        }
    }

    /// Why the request was not carried out; `None` if it was.
    pub fn error(&self) -> Option<String> {
        match self {
            RunResponse::Docked { end, .. } | RunResponse::Undocked { end } => {
                let good = matches!(
                    end,
                    DockEnd::Done | DockEnd::AlreadyDocked | DockEnd::NotDocked
                );
                if good {
                    None
                } else {
                    Some(end.name().to_owned())
                }
            }
            RunResponse::NoPicture => Some("no picture arrived in time".to_owned()),
            RunResponse::Offline => Some("the robot is out of reach".to_owned()),
            RunResponse::Refused { error } => Some(error.clone()),
            RunResponse::Status(_)
            | RunResponse::Behaviours { .. }
            | RunResponse::Stopped { .. }
            | RunResponse::Done
            | RunResponse::Picture { .. } => None,
        }
    }

    pub fn dock_end(&self) -> Option<DockEnd> {
        match self {
            RunResponse::Docked { end, .. } | RunResponse::Undocked { end } => Some(*end),
            _ => None,
        }
    }

    /// A failure is a conflict with the present state of the robot, unless waiting may help.
    fn status(&self) -> StatusCode {
        match self {
            RunResponse::Offline => StatusCode::SERVICE_UNAVAILABLE,
            RunResponse::NoPicture => StatusCode::GATEWAY_TIMEOUT,
            _ if self.error().is_some() => StatusCode::CONFLICT,
            _ => StatusCode::OK,
        }
    }
}

impl IntoResponse for RunResponse {
    fn into_response(self) -> Response {
        if let RunResponse::Picture { jpeg } = self {
            return ([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response();
        }
        let status = self.status();
        let error = self.error();
        let mut body = serde_json::to_value(&self).unwrap_or_default();
        if let (Value::Object(body), Some(error)) = (&mut body, error) {
            body.insert("error".to_owned(), error.into());
        }
        (status, Json(body)).into_response()
    }
}
