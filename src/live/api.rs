//! The page's part of the HTTP interface: health, metrics, history, timetable and scripts. The
//! requests to the run are those of [`control`](crate::control).

use std::sync::Arc;

use axum::extract::{Path, Query, State, WebSocketUpgrade};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get};
use axum::{Json, Router};
use jiff::Timestamp;
use schemars::generate::SchemaGenerator;
use schemars::{JsonSchema, Schema};
use serde::{Deserialize, Serialize};

use super::broadcast::Broadcast;
use super::history::{self, History};
use super::scripts::{self, Text};
use super::viewer::Viewer;
use super::{connection, messages, openapi};
use crate::http::{Me, Refusal, Visitor};
use crate::pilot::LinkState;

/// Maximum number of days of history in one response.
const MAX_DAYS: u16 = 366;

type Shared = State<Arc<Broadcast>>;
type Reply<T> = Result<Json<T>, Refusal>;

/// The health of the program and the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
struct Health {
    /// Whether the pilot responds.
    live: bool,
    /// Whether the robot is connected.
    ready: bool,
}

/// What a path gives.
pub(super) enum Gives {
    Json(fn(&mut SchemaGenerator) -> Schema),
    Kind(&'static str),
}

/// One path of the interface.
pub(super) struct Get {
    pub(super) path: &'static str,
    pub(super) summary: &'static str,
    /// Whether the visitor must be known.
    pub(super) private: bool,
    pub(super) gives: Gives,
    handler: Option<MethodRouter<Arc<Broadcast>>>,
}

impl Get {
    fn new(path: &'static str, summary: &'static str, gives: Gives) -> Get {
        Get {
            path,
            summary,
            private: true,
            gives,
            handler: None,
        }
    }

    fn public(self) -> Get {
        Get {
            private: false,
            ..self
        }
    }

    fn served_by(self, handler: MethodRouter<Arc<Broadcast>>) -> Get {
        Get {
            handler: Some(handler),
            ..self
        }
    }
}

fn json<T: JsonSchema>() -> Gives {
    Gives::Json(SchemaGenerator::subschema_for::<T>)
}

/// Everything that programs can read here, the requests apart.
pub(super) fn gets() -> Vec<Get> {
    vec![
        Get::new(
            "/healthz",
            "Whether the program and the robot are up.",
            json::<Health>(),
        )
        .public()
        .served_by(get(healthz)),
        // Served with the login.
        Get::new("/api/me", "Role of the caller.", json::<Me>()).public(),
        Get::new(
            "/metrics",
            "Metrics for Prometheus.",
            Gives::Kind("application/openmetrics-text"),
        )
        .served_by(get(metrics)),
        Get::new(
            "/api/behaviours/{name}/script",
            "The text of a behaviour's script.",
            json::<Text>(),
        )
        .served_by(get(script)),
        Get::new(
            "/api/behaviours/{name}/pictures/{file}",
            "A picture that a behaviour has saved.",
            Gives::Kind("image/jpeg"),
        )
        .served_by(get(saved_picture)),
        Get::new(
            "/api/history",
            "Battery, runs, dockings and alarms of the last day in 288 parts, or of the last week \
             with `?days=7`, at most 366 days; and the newest events. Null without a journal.",
            json::<Option<History>>(),
        )
        .served_by(get(history)),
        Get::new(
            "/api/schedule",
            "The next starts of a service's timetable; null without one.",
            json::<Option<Vec<history::ScheduledStart>>>(),
        )
        .served_by(get(schedule)),
    ]
}

pub(super) fn routes(broadcast: Arc<Broadcast>) -> Router {
    let own = Router::new()
        .route("/live", get(live))
        .route("/api/openapi.json", get(async || Json(openapi::document())))
        .route("/api/messages.json", get(async || Json(messages::schema())));
    let add = |router: Router<Arc<Broadcast>>, get: Get| match get.handler {
        Some(handler) => router.route(get.path, handler),
        None => router,
    };
    gets().into_iter().fold(own, add).with_state(broadcast)
}

/// Needs no login, since it reveals nothing private.
async fn healthz(State(broadcast): Shared) -> Response {
    let live = broadcast.is_alive();
    let ready = live && broadcast.run.status.borrow().link == LinkState::Up;
    let status = if live {
        StatusCode::OK
    } else {
        StatusCode::SERVICE_UNAVAILABLE
    };
    (status, Json(Health { live, ready })).into_response()
}

async fn metrics(State(broadcast): Shared, _: Visitor) -> impl IntoResponse {
    let text = broadcast.metrics.text(
        &broadcast.run,
        broadcast.viewer_count(),
        broadcast.camera.bytes(),
    );
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    ([(header::CONTENT_TYPE, kind)], text)
}

async fn live(
    State(broadcast): Shared,
    visitor: Visitor,
    upgrade: WebSocketUpgrade,
) -> Result<Response, Refusal> {
    let full = || Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "too many viewers");
    let viewer = Viewer::admit(&broadcast, visitor).ok_or_else(full)?;
    let upgrade = upgrade
        .max_message_size(connection::MAX_MESSAGE)
        .max_frame_size(connection::MAX_MESSAGE);
    Ok(upgrade.on_upgrade(move |socket| connection::serve(socket, viewer)))
}

async fn script(State(broadcast): Shared, _: Visitor, Path(name): Path<String>) -> Reply<Text> {
    let found = scripts::find(&broadcast.definition.borrow().scripts, &name).cloned();
    let unknown = || Refusal::new(StatusCode::NOT_FOUND, "there is no script of that name");
    let script = found.ok_or_else(unknown)?;
    read(&broadcast, move |_| scripts::text(&script))
        .await
        .map(Json)
}

/// Runs work that blocks on the disk on another thread.
async fn read<T: Send + 'static>(
    broadcast: &Broadcast,
    work: impl FnOnce(&std::path::Path) -> T + Send + 'static,
) -> Result<T, Refusal> {
    let broken = || Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, "it cannot be read");
    let _permit = broadcast.reading.acquire().await.map_err(|_| broken())?;
    let data = broadcast.data.clone();
    let read = tokio::task::spawn_blocking(move || work(&data)).await;
    read.map_err(|_| broken())
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Days {
    days: Option<u16>,
}

/// `None` without a journal.
async fn history(
    State(broadcast): Shared,
    _: Visitor,
    Query(asked): Query<Days>,
) -> Reply<Option<History>> {
    let days = asked.days.unwrap_or(1).clamp(1, MAX_DAYS);
    let running = broadcast.running_behaviours();
    let history =
        move |data: &std::path::Path| history::read(data, days, Timestamp::now(), &running);
    let history = read(&broadcast, history).await?;
    history.map(Json).map_err(|error| {
        tracing::warn!("the page cannot read the journal: {error}");
        let words = "the journal cannot be read";
        Refusal::new(StatusCode::INTERNAL_SERVER_ERROR, words)
    })
}

/// `None` without a timetable.
async fn schedule(
    State(broadcast): Shared,
    _: Visitor,
) -> Json<Option<Vec<history::ScheduledStart>>> {
    let definition = broadcast.definition.borrow();
    let names: Vec<String> = definition
        .scripts
        .iter()
        .map(|one| one.name.clone())
        .collect();
    let starts = |(table, clock): &(_, _)| history::starts(table, &names, *clock);
    Json(definition.timetable.as_ref().map(starts))
}

async fn saved_picture(
    State(broadcast): Shared,
    _: Visitor,
    Path((behaviour, name)): Path<(String, String)>,
) -> Result<Response, Refusal> {
    let found = read(&broadcast, move |data| {
        history::picture(data, &behaviour, &name)
    })
    .await?;
    let unknown = || Refusal::new(StatusCode::NOT_FOUND, "there is no such picture");
    let jpeg = found.ok_or_else(unknown)?;
    Ok(([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response())
}
