//! The page's part of the HTTP interface: health, metrics, history, timetable and scripts. The
//! requests to the run are those of [`control`](crate::control).

use std::sync::Arc;
use std::sync::atomic::Ordering;

use axum::extract::{Path, Query, State, WebSocketUpgrade};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get};
use axum::{Json, Router};
use jiff::Timestamp;
use schemars::JsonSchema;
use schemars::generate::{SchemaGenerator, SchemaSettings};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use super::broadcast::Broadcast;
use super::history::{self, Gallery, History};
use super::scripts::{self, Text};
use super::viewer::Viewer;
use super::{connection, messages, mjpeg};
use crate::control;
use crate::http::{CAMERA, Me, Refusal, Role, Visitor};
use crate::journal::JournalError;
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

/// One path of the interface.
struct Get {
    path: &'static str,
    summary: &'static str,
    /// Whether the visitor must be known.
    private: bool,
    /// What it gives, by content type.
    content: fn(&mut SchemaGenerator) -> Value,
    handler: MethodRouter<Arc<Broadcast>>,
}

fn schema_of<T: JsonSchema>(generator: &mut SchemaGenerator) -> Value {
    let schema = Value::from(generator.subschema_for::<T>());
    json!({ "application/json": { "schema": schema } })
}

impl Get {
    /// A path for known visitors.
    fn new(
        path: &'static str,
        summary: &'static str,
        content: fn(&mut SchemaGenerator) -> Value,
        handler: MethodRouter<Arc<Broadcast>>,
    ) -> Get {
        Get {
            path,
            summary,
            private: true,
            content,
            handler,
        }
    }
}

const HEALTH: &str = "Whether the program and the robot are up.";
const MJPEG: &str = "The camera's pictures as MJPEG, at least one each second, for tools. One that \
                     can send no headers adds `?token=` with a viewer's token.";
const HISTORY: &str = "Battery, runs, dockings and alarms of the last day in 288 parts, or of the last \
                       week with `?days=7`, at most 366 days; and the newest events. Null without a \
                       journal.";
const PICTURES: &str = "The saved pictures from `?since=` to `&until=`, in milliseconds since 1970: \
                        those that were sent to people, and the others by run. Null without a journal.";

/// Everything that programs can read here, the requests apart.
fn gets() -> [Get; 8] {
    [
        Get {
            private: false,
            ..Get::new("/healthz", HEALTH, schema_of::<Health>, get(healthz))
        },
        Get::new(
            "/metrics",
            "Metrics for Prometheus.",
            |_| json!({ "application/openmetrics-text": {} }),
            get(metrics),
        ),
        Get::new(
            "/api/behaviours/{name}/script",
            "The text of a behaviour's script.",
            schema_of::<Text>,
            get(script),
        ),
        Get::new(
            "/api/behaviours/{name}/pictures/{file}",
            "A picture that a behaviour has saved.",
            |_| json!({ "image/jpeg": {} }),
            get(saved_picture),
        ),
        Get::new(
            CAMERA,
            MJPEG,
            |_| json!({ mjpeg::CONTENT_TYPE: {} }),
            get(mjpeg::camera),
        ),
        Get::new(
            "/api/history",
            HISTORY,
            schema_of::<Option<History>>,
            get(history),
        ),
        Get::new(
            "/api/pictures",
            PICTURES,
            schema_of::<Option<Gallery>>,
            get(pictures),
        ),
        Get::new(
            "/api/schedule",
            "The next starts of a service's timetable; null without one.",
            schema_of::<Option<Vec<history::ScheduledStart>>>,
            get(schedule),
        ),
    ]
}

pub(super) fn routes(broadcast: Arc<Broadcast>) -> Router {
    let own = Router::new()
        .route("/live", get(live))
        .route("/api/openapi.json", get(async || Json(openapi())))
        .route("/api/messages.json", get(async || Json(messages::schema())));
    let add = |router: Router<_>, get: Get| router.route(get.path, get.handler);
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
        broadcast.lock_viewers().open.len(),
        broadcast.camera.bytes.load(Ordering::Relaxed),
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
    let running = broadcast.running_behaviours().into_iter();
    let running: Vec<String> = running.map(|one| one.name).collect();
    // A simulated service may have a date of its own.
    let timetable = broadcast.definition.borrow().timetable.clone();
    let now = timetable.map(|(_, clock)| clock).unwrap_or_default().now();
    let history = move |data: &std::path::Path| history::read(data, days, now, &running);
    answer_of_journal(read(&broadcast, history).await?)
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Period {
    since: i64,
    until: i64,
}

/// `None` without a journal.
async fn pictures(
    State(broadcast): Shared,
    _: Visitor,
    Query(period): Query<Period>,
) -> Reply<Option<Gallery>> {
    let moment = |at: i64| {
        let wrong = |_| Refusal::new(StatusCode::BAD_REQUEST, "there is no such time");
        Timestamp::from_millisecond(at).map_err(wrong)
    };
    let since = moment(period.since)?;
    let until = moment(period.until)?;
    let gallery = move |data: &std::path::Path| history::gallery(data, since, until);
    answer_of_journal(read(&broadcast, gallery).await?)
}

fn answer_of_journal<T>(read: Result<T, JournalError>) -> Reply<T> {
    read.map(Json).map_err(|error| {
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
    let hold = broadcast.run.view.borrow().hold.clone();
    let starts = |(table, clock): &(_, _)| history::starts(table, &hold, &names, *clock);
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

/// The description of the HTTP interface for programs (OpenAPI 3.1), from the tables of what is
/// served and from the types.
fn openapi() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| {
        settings.definitions_path = "/components/schemas".into();
        settings.meta_schema = None;
    });
    let mut generator = settings.into_generator();
    let mut paths = control::paths(&mut generator);
    let me = schema_of::<Me>(&mut generator);
    let me = control::described(&"Role of the caller.".into(), None, me);
    paths.insert("/api/me".to_owned(), json!({ "get": me }));
    for get in gets() {
        let content = (get.content)(&mut generator);
        let role = if get.private {
            Some(Role::Viewer)
        } else {
            None
        };
        let mut operation = control::described(&get.summary.into(), role, content);
        let mut parameters = Vec::new();
        for part in ["name", "file"] {
            if get.path.contains(&format!("{{{part}}}")) {
                let schema = json!({ "type": "string" });
                parameters.push(json!({
                    "name": part, "in": "path", "required": true, "schema": schema,
                }));
            }
        }
        if !parameters.is_empty() {
            operation["parameters"] = parameters.into();
        }
        paths.insert(get.path.to_owned(), json!({ "get": operation }));
    }
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "spykee", "version": env!("CARGO_PKG_VERSION"),
            "description": "The API of a run of spykee. Off loopback, or as soon as there is a token, one is \
                            required: `spykee token new NAME`.",
        },
        "paths": paths,
        "components": {
            "schemas": generator.take_definitions(true),
            "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } },
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn references(value: &Value, found: &mut Vec<String>) {
        match value {
            Value::Object(map) => map.iter().for_each(|(key, value)| match value.as_str() {
                Some(path) if key == "$ref" => found.push(path.to_owned()),
                _ => references(value, found),
            }),
            Value::Array(list) => list.iter().for_each(|value| references(value, found)),
            _ => {}
        }
    }

    #[test]
    fn every_request_is_described_with_its_fields_and_its_answer() {
        let document = openapi();
        let paths = document["paths"].as_object().unwrap();
        assert_eq!(paths.len(), 25);
        for (path, methods) in paths {
            for operation in methods.as_object().unwrap().values() {
                let summary = operation["summary"].as_str().unwrap_or_default();
                assert!(!summary.is_empty(), "{path}");
                let content = operation["responses"]["200"]["content"].as_object();
                let json = content.unwrap().get("application/json");
                assert!(json.is_none_or(|json| !json["schema"].is_null()), "{path}");
            }
        }
        let body = &paths["/api/led"]["post"]["requestBody"];
        assert_eq!(body["required"], true);
        let fields = &body["content"]["application/json"]["schema"]["properties"];
        let names: Vec<&String> = fields.as_object().unwrap().keys().collect();
        assert_eq!(names, ["light", "on"]);
        assert_eq!(paths["/api/dock"]["post"]["requestBody"]["required"], false);
        let picture = &paths["/api/picture"]["get"];
        assert_eq!(picture["parameters"][0]["name"], "seconds");
        assert_eq!(paths["/api/stop"]["post"]["description"], "For a viewer.");
    }

    #[test]
    fn all_references_in_the_description_resolve() {
        let document = openapi();
        let mut found = Vec::new();
        references(&document, &mut found);
        assert!(!found.is_empty());
        for path in found {
            let place = path.trim_start_matches('#');
            assert!(document.pointer(place).is_some(), "{path} does not resolve");
        }
    }
}
