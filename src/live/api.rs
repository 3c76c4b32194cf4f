//! The HTTP API: health, metrics, and the functions of `spykee status`, `behaviour` and `robot`.

use std::sync::Arc;
use std::time::Duration;

use axum::extract::{DefaultBodyLimit, Path, Query, State, WebSocketUpgrade};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use jiff::Timestamp;
use serde::Deserialize;

use super::broadcast::Broadcast;
use super::command::{
    BehaviourAction, Done, PageCommand, UNDOCK, perform, succeeded, to_message, to_request,
};
use super::history::{self, History};
use super::openapi::{
    self, BehaviourChange, Dock, Docking, Health, Outcome, PlaySound, SetLight, SetParam,
    TimeLimit, Volume,
};
use super::scripts::{self, Behaviour, Text};
use super::state::{self, Rate};
use super::viewer::Viewer;
use super::{connection, messages};
use crate::control::{Change, MAX_SPEECH, Report, RunRequest, RunResponse, StopReport};
use crate::http::{Driver, Refusal, Visitor};
use crate::pilot::LinkState;
use crate::robot::DockPlan;

/// Maximum length of a request body, in bytes; speech may be longer.
const MAX_BODY: usize = 16 * 1024;
/// Maximum number of days of history in one response.
const MAX_DAYS: u16 = 366;
/// Timeout for a picture: default and maximum.
const PICTURE: Duration = Duration::from_secs(5);
const LONGEST_PICTURE: Duration = Duration::from_secs(600);
/// Maximum duration of one search for the station, and maximum number of retries.
const LONGEST_SEARCH: Duration = Duration::from_secs(3600);
const MAX_RETRIES: u32 = 20;
/// Maximum timeout for an undocking.
const LONGEST_UNDOCKING: Duration = Duration::from_secs(600);

type Shared = State<Arc<Broadcast>>;
type Reply<T> = Result<Json<T>, Refusal>;

pub(super) fn routes(broadcast: Arc<Broadcast>) -> Router {
    Router::new()
        .route("/healthz", get(healthz))
        .route("/metrics", get(metrics))
        .route("/live", get(live))
        .route("/api/openapi.json", get(async || Json(openapi::document())))
        .route("/api/messages.json", get(async || Json(messages::schema())))
        .route("/api/status", get(status))
        .route("/api/run", get(run))
        .route("/api/behaviours", get(behaviours))
        .route("/api/behaviours/{name}", post(change))
        .route("/api/behaviours/{name}/params", post(tune))
        .route("/api/behaviours/{name}/script", get(script))
        .route("/api/behaviours/{name}/pictures/{file}", get(saved_picture))
        .route("/api/history", get(history))
        .route("/api/schedule", get(schedule))
        .route("/api/picture", get(picture))
        .route("/api/stop", post(stop))
        .route("/api/reset-stop", post(release_stop))
        .route("/api/dock", post(dock))
        .route("/api/undock", post(undock))
        .route("/api/led", post(led))
        .route("/api/play", post(play))
        .route(
            "/api/stop-sound",
            post(async |broadcast: Shared, who: Driver| {
                execute_command(broadcast, who, PageCommand::StopSound).await
            }),
        )
        .route("/api/volume", post(volume))
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .route(
            "/api/say",
            post(say).layer(DefaultBodyLimit::max(MAX_SPEECH)),
        )
        .with_state(broadcast)
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

async fn status(State(broadcast): Shared, _: Visitor) -> Json<state::State> {
    let robot = broadcast.robot();
    let now = broadcast.now();
    let mut rate = Rate::new(now);
    Json(state::state(
        &broadcast.run,
        robot.as_ref(),
        broadcast.people(),
        &mut rate,
        now,
    ))
}

/// Returns the same data as `spykee status --json`.
async fn run(State(broadcast): Shared, _: Visitor) -> Reply<Report> {
    match broadcast.run.perform(RunRequest::Overview).await {
        RunResponse::Overview(overview) => Ok(Json(Report::from(&*overview))),
        RunResponse::Refused(why) => Err(Refusal::new(StatusCode::CONFLICT, why)),
        _ => Err(out_of_reach()),
    }
}

async fn behaviours(State(broadcast): Shared, _: Visitor) -> Json<Vec<Behaviour>> {
    Json(broadcast.list())
}

async fn change(
    broadcast: Shared,
    who: Driver,
    Path(name): Path<String>,
    Json(BehaviourChange { change, lasts }): Json<BehaviourChange>,
) -> Reply<Outcome> {
    let Some(lasts) = lasts else {
        return execute_command(broadcast, who, PageCommand::Behaviour { name, change }).await;
    };
    if change != BehaviourAction::Start || lasts.get().is_zero() {
        let why = "`for` is allowed only with `start`, and must be above zero";
        return Err(Refusal::new(StatusCode::UNPROCESSABLE_ENTITY, why));
    }
    let change = Change::StartFor(lasts.get());
    done(
        broadcast
            .0
            .run
            .perform(RunRequest::Behaviour { name, change })
            .await,
    )
}

async fn tune(
    broadcast: Shared,
    who: Driver,
    Path(name): Path<String>,
    Json(SetParam { param, value }): Json<SetParam>,
) -> Reply<Outcome> {
    execute_command(broadcast, who, PageCommand::Param { name, param, value }).await
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
async fn schedule(State(broadcast): Shared, _: Visitor) -> Json<Option<Vec<history::Start>>> {
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

async fn picture(
    State(broadcast): Shared,
    _: Visitor,
    Query(TimeLimit { seconds }): Query<TimeLimit>,
) -> Result<Response, Refusal> {
    let limit = seconds.map_or(PICTURE, |seconds| time_limit(seconds, LONGEST_PICTURE));
    match broadcast.run.perform(RunRequest::Picture(limit)).await {
        RunResponse::Picture(jpeg) => {
            Ok(([(header::CONTENT_TYPE, "image/jpeg")], jpeg).into_response())
        }
        RunResponse::Refused(why) => Err(Refusal::new(StatusCode::CONFLICT, why)),
        RunResponse::NoPicture => {
            let why = "no picture arrived in time";
            Err(Refusal::new(StatusCode::GATEWAY_TIMEOUT, why))
        }
        _ => Err(out_of_reach()),
    }
}

async fn dock(State(broadcast): Shared, _: Driver, body: Option<Json<Dock>>) -> Response {
    let asked = body.map_or_else(Dock::default, |Json(asked)| asked);
    let usual = DockPlan::DEFAULT;
    let plan = DockPlan {
        timeout: asked
            .seconds
            .map_or(usual.timeout, |seconds| time_limit(seconds, LONGEST_SEARCH)),
        retries: asked
            .retries
            .map_or(usual.retries, |retries| retries.min(MAX_RETRIES)),
        ..usual
    };
    docking(broadcast.run.perform(RunRequest::Dock(plan)).await)
}

async fn undock(State(broadcast): Shared, _: Driver, body: Option<Json<TimeLimit>>) -> Response {
    let seconds = body.and_then(|Json(asked)| asked.seconds);
    let limit = seconds.map_or(UNDOCK, |seconds| time_limit(seconds, LONGEST_UNDOCKING));
    docking(broadcast.run.perform(RunRequest::Undock(limit)).await)
}

/// Limits a timeout to at least one second and at most `most`.
fn time_limit(seconds: u64, most: Duration) -> Duration {
    Duration::from_secs(seconds.max(1)).min(most)
}

/// Converts the result of a docking or undocking. A failure is a 409 (conflict with the current
/// state), which also contains the result.
fn docking(answer: RunResponse) -> Response {
    let (end, attempts, took) = match answer {
        RunResponse::Docked {
            end,
            attempts,
            took,
        } => (end, Some(attempts), Some(took)),
        RunResponse::Undocked(end) => (end, None, None),
        other => return done(other).into_response(),
    };
    let ok = succeeded(end);
    let docking = Docking {
        ok,
        text: end.name().to_owned(),
        error: (!ok).then(|| end.name().to_owned()),
        end: end.name(),
        attempts,
        seconds: took.map(|took| took.as_secs_f64()),
    };
    let status = if ok {
        StatusCode::OK
    } else {
        StatusCode::CONFLICT
    };
    (status, Json(docking)).into_response()
}

/// Every viewer may stop the robot.
async fn stop(State(broadcast): Shared, visitor: Visitor) -> Json<StopReport> {
    Json(broadcast.stop(&name_of("the API", &visitor)).await.into())
}

async fn release_stop(State(broadcast): Shared, Driver(visitor): Driver) -> Reply<Outcome> {
    let by = name_of("the API", &visitor);
    outcome(match broadcast.run.reset_stop(&by).await {
        Ok(()) => (true, String::new()),
        Err(why) => (false, why),
    })
}

/// Who pressed or released STOP, for the journal.
pub(super) fn name_of(way: &str, visitor: &Visitor) -> String {
    match &visitor.key {
        Some(key) => format!("{way}, token {}", key.name),
        None => format!("{way}, without a token"),
    }
}

async fn led(
    broadcast: Shared,
    who: Driver,
    Json(SetLight { light, on }): Json<SetLight>,
) -> Reply<Outcome> {
    execute_command(broadcast, who, PageCommand::Led { light, on }).await
}

async fn play(
    broadcast: Shared,
    who: Driver,
    Json(PlaySound { sound }): Json<PlaySound>,
) -> Reply<Outcome> {
    execute_command(broadcast, who, PageCommand::Play { sound }).await
}

async fn volume(
    broadcast: Shared,
    who: Driver,
    Json(Volume { percent }): Json<Volume>,
) -> Reply<Outcome> {
    execute_command(broadcast, who, PageCommand::Volume { percent }).await
}

/// s16 little-endian, mono, 16 kHz.
async fn say(State(broadcast): Shared, _: Driver, samples: bytes::Bytes) -> Reply<Outcome> {
    done(
        broadcast
            .run
            .perform(RunRequest::Say(samples.to_vec()))
            .await,
    )
}

async fn execute_command(
    State(broadcast): Shared,
    _: Driver,
    command: PageCommand,
) -> Reply<Outcome> {
    match to_request(command) {
        Ok(request) => done(broadcast.run.perform(request).await),
        Err(command) => outcome(perform(*command, &broadcast.run, broadcast.sim.as_ref()).await),
    }
}

/// Converts an answer. A robot out of reach is a 503, not a conflict, since it is expected to
/// reconnect.
fn done(answer: RunResponse) -> Reply<Outcome> {
    match answer {
        RunResponse::Offline => Err(out_of_reach()),
        answer => outcome(to_message(answer)),
    }
}

fn out_of_reach() -> Refusal {
    Refusal::new(StatusCode::SERVICE_UNAVAILABLE, "the robot is out of reach")
}

/// Converts a result: a failure is a 409 (conflict with the current state).
fn outcome(result: Done) -> Reply<Outcome> {
    let (ok, text) = result;
    if ok {
        Ok(Json(Outcome { ok, text }))
    } else {
        Err(Refusal::new(StatusCode::CONFLICT, text))
    }
}
