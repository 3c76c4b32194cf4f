//! The requests of the pages. A request is checked like one of the live page (`Host`, `Origin`); then
//! a cookie tells whose it is. A learner's requests concern the learner's own files and run only; the
//! teacher may name any learner in the path, and has the routes of `of_teacher`.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{Message, WebSocket};
use axum::extract::{
    ConnectInfo, DefaultBodyLimit, FromRequestParts, Path, Query, RawPathParams, Request, State,
    WebSocketUpgrade,
};
use axum::http::header::{self, HeaderMap, HeaderValue};
use axum::http::request::Parts;
use axum::http::{Method, StatusCode};
use axum::middleware::{Next, from_fn, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::{MethodRouter, get, post};
use axum::{Json, Router};
use data_encoding::HEXLOWER;
use qrcode::{Color, EcLevel, QrCode};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;

use super::children::{no_run, pass_on};
use super::files::{MAX_TEXT, Text, Written};
use super::members::{Device, TEACHER};
use super::queue::TurnError;
use super::{
    Caller, Class, MARKS, MARKS_RATE, POINTS, RunOrder, internal, no_robot, not_found, unknown_name,
};
use crate::clock::every;
use crate::http::{self, Access, Refusal, Role, Visitor};
use crate::live::{installed, page_files, served};
use crate::sim::World;
use crate::{api, files};

type Shared = State<Arc<Class>>;
type Reply<T = ()> = Result<T, Refusal>;

/// Name of the cookie of a learner's device.
const COOKIE: &str = "spykee_class";
/// How long a browser keeps it, in seconds: a school year.
const COOKIE_AGE: u32 = 400 * 24 * 60 * 60;
/// Maximum length of a request's body: a text whose characters are all escaped in JSON.
const MAX_BODY: usize = 2 * MAX_TEXT;
/// A page's state is sent at most this often.
const STATE_PAUSE: Duration = Duration::from_millis(200);
/// A page that answers no ping for this long is gone.
const PING: Duration = Duration::from_secs(2);
const SILENCE_TIMEOUT: Duration = Duration::from_secs(6);
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// Where the bundles of the editor are, seen from the program's folder: see `live/book.rs`.
const BUNDLES: [&str; 2] = ["../share/spykee/editor", "../editor"];
const MAX_BUNDLE: u64 = 8 << 20;
const HTML: &str = "text/html; charset=utf-8";
const CSS: &str = "text/css; charset=utf-8";
const JS: &str = "text/javascript; charset=utf-8";
const PAGE: &[u8] = include_bytes!("page/index.html");
const FILES: &[(&str, &str, &str)] = &[
    ("/class/style.css", CSS, include_str!("page/style.css")),
    ("/class/start.js", JS, include_str!("page/start.js")),
    ("/class/turns.js", JS, include_str!("page/turns.js")),
    ("/class/robots.js", JS, include_str!("page/robots.js")),
    ("/class/workspace.js", JS, include_str!("page/workspace.js")),
    ("/class/wall.js", JS, include_str!("page/wall.js")),
    ("/class/texts.js", JS, include_str!("page/texts.js")),
    ("/class/script.js", JS, include_str!("page/script.js")),
    ("/class/server.js", JS, include_str!("page/server.js")),
    ("/class/robot.js", JS, include_str!("page/robot.js")),
    ("/class/lesson.js", JS, include_str!("page/lesson.js")),
    ("/class/plain.js", JS, include_str!("page/plain.js")),
];

pub(super) fn routes(class: Arc<Class>, access: Arc<Access>) -> Router {
    let add = |router: Router<_>, &(path, kind, text): &(_, _, &'static str)| {
        router.route(path, served(kind, text.as_bytes()))
    };
    let pages = FILES.iter().fold(Router::new(), add).merge(page_files());
    let pages = pages
        .route("/", served(HTML, PAGE))
        .route("/wall", served(HTML, PAGE));
    let of_teacher = of_teacher().route_layer(from_fn(teacher_only));
    let all = Router::new()
        .nest("/class", workspace().merge(of_teacher))
        .nest("/class/of/{name}", workspace())
        .route("/class/join", post(join))
        .route("/class/me", get(me))
        .route("/class/events", get(events))
        .route("/class/marks", post(marks))
        .route("/class/completions.json", get(completions))
        .route("/class/lessons", get(lessons))
        .route("/class/editor.js", bundle("editor.js"))
        .route("/class/blocks.js", bundle("blocks.js"))
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .layer(from_fn_with_state(class.clone(), recognise))
        .with_state(class);
    all.merge(pages)
        .merge(http::routes(access.clone()))
        .layer(from_fn_with_state(access, http::guard_request))
}

/// What only the teacher may do.
fn of_teacher() -> Router<Arc<Class>> {
    Router::new()
        .route("/admit", post(admit))
        .route("/dismiss", post(dismiss))
        .route("/freeze", switch(super::State::freeze))
        .route("/show", switch(super::State::show))
        .route("/lock", switch(|state, on| state.locked = on))
        .route("/lesson", post(lesson_for_all))
        .route("/minutes", post(minutes))
        .route("/robots/{robot}/stop", post(stop_robot))
        .route("/robots/{robot}/live", get(robot_live))
        .route("/points.csv", get(points))
        .route("/qr", get(qr))
}

/// What there is in each workspace: see [`Target`].
fn workspace() -> Router<Arc<Class>> {
    Router::new()
        .route("/script", get(script).put(write_script))
        .route("/run", post(run))
        .route("/stop", post(stop))
        .route("/check", post(check))
        .route("/live", get(live))
        .route("/turn", post(turn))
        .route("/turn/run", post(turn_run))
        .route("/turn/stop", post(turn_stop))
        .route("/turn/live", get(turn_live))
}

/// A bundle that `scripts/editor` has built, where it is installed.
fn bundle(name: &'static str) -> MethodRouter<Arc<Class>> {
    let missing = "The editor is not installed here. In a checkout, scripts/editor builds it.\n";
    get(move || async move {
        let read = move || files::read(&installed(BUNDLES, name)?.join(name), MAX_BUNDLE).ok();
        match tokio::task::spawn_blocking(read).await {
            Ok(Some(bytes)) => ([(header::CONTENT_TYPE, JS)], bytes).into_response(),
            _ => (StatusCode::NOT_FOUND, missing).into_response(),
        }
    })
}

/// Middleware: finds out whose a request is.
async fn recognise(State(class): Shared, mut request: Request, next: Next) -> Response {
    let visitor = request.extensions().get::<Option<Visitor>>();
    let is_teacher = matches!(visitor, Some(Some(visitor)) if visitor.role == Role::Driver);
    let caller = match http::cookie(request.headers(), COOKIE) {
        _ if is_teacher => Caller::Teacher,
        Some(cookie) => {
            if let Device::Admitted(name) = class.state.lock().members.device(cookie) {
                http::count_as_member(&request, &name);
            }
            Caller::Device(cookie.to_owned())
        }
        None => Caller::Nobody,
    };
    request.extensions_mut().insert(caller);
    next.run(request).await
}

impl<S: Sync> FromRequestParts<S> for Caller {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, _: &S) -> Result<Caller, Refusal> {
        let caller = parts.extensions.get::<Caller>().cloned();
        Ok(caller.unwrap_or(Caller::Nobody))
    }
}

/// Middleware: refuses everybody but the teacher.
async fn teacher_only(caller: Caller, request: Request, next: Next) -> Reply<Response> {
    if caller == Caller::Teacher {
        return Ok(next.run(request).await);
    }
    let why = "only the teacher may do this";
    Err(Refusal::new(StatusCode::FORBIDDEN, why))
}

/// The workspace that a request concerns: that in its path, or else the caller's own. Others than
/// the teacher's own are the teacher's to see and to change; the teacher's is for all to see while it
/// is shown.
struct Target {
    name: String,
    looks_only: bool,
}

impl FromRequestParts<Arc<Class>> for Target {
    type Rejection = Refusal;

    async fn from_request_parts(parts: &mut Parts, class: &Arc<Class>) -> Result<Target, Refusal> {
        let caller = Caller::from_request_parts(parts, class).await?;
        let params = RawPathParams::from_request_parts(parts, class).await;
        let params = params.map_err(|_| unknown_name())?;
        let named = params.iter().find(|(key, _)| *key == "name");
        let named = named.map(|(_, name)| name.to_owned());
        let state = class.state.lock();
        let Device::Admitted(own) = state.device(&caller) else {
            let why = "join the class first";
            return Err(Refusal::new(StatusCode::UNAUTHORIZED, why));
        };
        let name = match named {
            None => own,
            Some(name) if name == own => own,
            Some(name) if caller == Caller::Teacher => name,
            Some(name) if name == TEACHER && state.shown && parts.method == Method::GET => {
                let looks_only = true;
                return Ok(Target { name, looks_only });
            }
            Some(_) => {
                let why = "this is another learner's";
                return Err(Refusal::new(StatusCode::FORBIDDEN, why));
            }
        };
        if name != TEACHER && !state.members.learners.contains_key(&name) {
            return Err(unknown_name());
        }
        let looks_only = false;
        Ok(Target { name, looks_only })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Join {
    word: String,
    name: String,
}

async fn join(
    State(class): Shared,
    ConnectInfo(from): ConnectInfo<SocketAddr>,
    headers: HeaderMap,
    Json(join): Json<Join>,
) -> Reply<Response> {
    let cookie = HEXLOWER.encode(&rand::random::<[u8; 32]>());
    let mut state = class.change();
    let joined = state
        .members
        .join(&join.word, &join.name, &cookie, from.ip(), Instant::now());
    joined.map_err(|error| Refusal::new(StatusCode::FORBIDDEN, error.to_string()))?;
    let cookie = http::set_cookie(COOKIE, &cookie, COOKIE_AGE, &headers);
    let cookie = cookie.unwrap_or(HeaderValue::from_static(""));
    Ok([(header::SET_COOKIE, cookie)].into_response())
}

async fn me(State(class): Shared, caller: Caller) -> Json<Option<Value>> {
    Json(class.view(&caller, Instant::now()))
}

async fn events(State(class): Shared, caller: Caller, upgrade: WebSocketUpgrade) -> Response {
    let upgrade = upgrade.max_message_size(1024).max_frame_size(1024);
    upgrade.on_upgrade(move |socket| follow(class, caller, socket))
}

/// Counts an open page while it lives.
struct Presence {
    class: Arc<Class>,
    name: String,
}

impl Presence {
    fn new(class: Arc<Class>, name: String) -> Presence {
        if let Some(member) = class.change().member(&name) {
            member.pages += 1;
            member.act(Instant::now());
        }
        Presence { class, name }
    }
}

impl Drop for Presence {
    fn drop(&mut self) {
        let mut state = self.class.change();
        if let Some(member) = state.member(&self.name) {
            member.pages = member.pages.saturating_sub(1);
        }
        // A robot stands when the page of its driver is closed.
        state.take_turns(Instant::now());
    }
}

/// Sends a page its state, as long as it is there and may see any.
async fn follow(class: Arc<Class>, caller: Caller, mut socket: WebSocket) {
    let mut changed = class.changed.subscribe();
    let mut sent = Value::Null;
    let mut presence: Option<Presence> = None;
    let mut ping = every(PING);
    let mut heard = Instant::now();
    while let Some(view) = class.view(&caller, Instant::now())
        && heard.elapsed() < SILENCE_TIMEOUT
    {
        if presence.is_none() && view["admitted"] == true {
            let name = view["name"].as_str().unwrap_or_default().to_owned();
            presence = Some(Presence::new(class.clone(), name));
        }
        if view != sent {
            let message = Message::Text(view.to_string().into());
            if !send(&mut socket, message).await {
                return;
            }
        }
        sent = view;
        sleep(STATE_PAUSE).await;
        tokio::select! {
            biased;
            message = socket.recv() => match message {
                Some(Ok(_)) => heard = Instant::now(),
                _ => return,
            },
            _ = ping.tick() => if !send(&mut socket, Message::Ping(Default::default())).await {
                return;
            },
            _ = changed.changed() => {}
        }
    }
}

/// Returns whether the page has taken the message.
async fn send(socket: &mut WebSocket, message: Message) -> bool {
    let sent = timeout(SEND_TIMEOUT, socket.send(message)).await;
    matches!(sent, Ok(Ok(())))
}

#[derive(Deserialize)]
struct Which {
    lesson: String,
    /// Whether the state of the blocks is meant instead of the script.
    #[serde(default)]
    blocks: bool,
}

impl Which {
    fn file(&self, class: &Class) -> Result<String, Refusal> {
        let ending = if self.blocks { "blocks.json" } else { "lua" };
        Ok(format!("{}.{ending}", class.place(&self.lesson)?))
    }
}

async fn script(
    State(class): Shared,
    target: Target,
    Query(which): Query<Which>,
) -> Reply<Json<Text>> {
    let file = which.file(&class)?;
    let starter = class
        .lesson(&which.lesson)
        .map_or("", |lesson| lesson.starter);
    let starter = if which.blocks { "" } else { starter };
    let read = class.block(move |class| class.files.read(&target.name, &file));
    let text = read.await?;
    Ok(Json(text.unwrap_or_else(|| Text {
        text: starter.to_owned(),
        version: String::new(),
    })))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NewText {
    text: String,
    version: String,
    /// Whether the present script is kept first: something else than the editor replaces it.
    #[serde(default)]
    keep: bool,
}

async fn write_script(
    State(class): Shared,
    target: Target,
    Query(which): Query<Which>,
    Json(new): Json<NewText>,
) -> Reply<Response> {
    let name = target.name;
    let file = which.file(&class)?;
    if new.text.len() > MAX_TEXT {
        let why = "this text is too long: at most 256 KiB";
        return Err(Refusal::new(StatusCode::PAYLOAD_TOO_LARGE, why));
    }
    let now = Instant::now();
    let writer = name.clone();
    let script = format!("{}.lua", which.lesson);
    let write = move |class: &Class| -> std::io::Result<Written> {
        if new.keep {
            class.files.keep(&writer, &script)?;
        }
        class
            .files
            .write(&writer, &file, &new.text, &new.version, now)
    };
    let written = class.block(write).await?;
    let mut edits = 0;
    if let Some(member) = class.change().member(&name) {
        member.act(now);
        member.place = which.lesson;
        member.edits += u64::from(matches!(written, Written::Done(_)));
        edits = member.edits;
    }
    Ok(match written {
        Written::Done(version) => {
            Json(json!({ "version": version, "edits": edits })).into_response()
        }
        Written::Conflict(newest) => (StatusCode::CONFLICT, Json(newest)).into_response(),
    })
}

async fn run(State(class): Shared, target: Target, Json(order): Json<RunOrder>) -> Reply {
    class.start(&target.name, order).await
}

async fn stop(State(class): Shared, target: Target) -> Reply {
    class.stop(&target.name).await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CheckOrder {
    lesson: String,
}

async fn check(
    State(class): Shared,
    target: Target,
    Json(order): Json<CheckOrder>,
) -> Reply<Json<Value>> {
    // In a task of its own: it goes on when the page is closed.
    let checking = tokio::spawn(async move { class.check(&target.name, &order.lesson).await });
    checking.await.map_err(internal)?.map(Json)
}

/// The camera, the map and the log of a run: the WebSocket of the live page.
async fn live(State(class): Shared, target: Target, request: Request) -> Reply<Response> {
    let mut closed = CancellationToken::new();
    let socket = {
        let state = class.state.lock();
        if target.looks_only {
            closed = state.screen.clone();
        }
        let run = state.runs.get(&target.name).ok_or_else(no_run)?;
        run.child.socket()
    };
    Ok(pass_on(&socket, target.looks_only, closed, request).await)
}

async fn turn(State(class): Shared, target: Target, Json(Switch { on }): Json<Switch>) -> Reply {
    class.want_turn(&target.name, on, Instant::now())
}

async fn turn_run(State(class): Shared, target: Target, Json(order): Json<RunOrder>) -> Reply {
    class.start_turn(&target.name, order).await
}

async fn turn_stop(State(class): Shared, target: Target) -> Reply {
    Ok(class.change().robots.halt(&target.name)?)
}

/// What the driver of a real robot sees, until the turn is over: a viewer cannot drive by hand nor
/// release STOP.
async fn turn_live(State(class): Shared, target: Target, request: Request) -> Reply<Response> {
    let driver = class.state.lock().robots.of_driver(&target.name);
    let (socket, turn_over) = driver.ok_or(TurnError::NoTurn)?;
    Ok(pass_on(&socket, true, turn_over, request).await)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Minutes {
    minutes: u64,
}

async fn minutes(State(class): Shared, Json(new): Json<Minutes>) -> Reply {
    Ok(class.change().robots.queue.set_minutes(new.minutes)?)
}

async fn stop_robot(
    State(class): Shared,
    Path(robot): Path<String>,
    Json(Switch { on }): Json<Switch>,
) -> Reply {
    class.stop_robot(&robot, on).await
}

async fn robot_live(
    State(class): Shared,
    Path(robot): Path<String>,
    request: Request,
) -> Reply<Response> {
    let socket = {
        let state = class.state.lock();
        let index = state.robots.queue.find(&robot);
        index.and_then(|index| state.robots.socket(index))
    };
    let socket = socket.ok_or_else(no_robot)?;
    Ok(pass_on(&socket, true, CancellationToken::new(), request).await)
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Marked {
    text: String,
    lesson: String,
}

async fn marks(
    State(class): Shared,
    target: Target,
    Json(marked): Json<Marked>,
) -> Reply<Json<Value>> {
    let place = class.place(&marked.lesson)?;
    {
        let mut state = class.state.lock();
        state.member(&target.name).ok_or_else(unknown_name)?;
        let key = format!("{}/marks", target.name);
        state.limit(key, MARKS, MARKS_RATE, Instant::now())?;
    }
    let _permit = class.inspections.acquire().await.map_err(internal)?;
    let file = class.files.of(&target.name).join(format!("{place}.lua"));
    let found = class.block(move |class| (class.tools.marks)(&marked.text, &file));
    found.await.map(Json)
}

/// The table of the API for the editor.
async fn completions() -> Json<Value> {
    let entry = |name: &str, kind: &str, signature: &str, doc: &str| json!({ "name": name, "kind": kind, "signature": signature, "doc": doc });
    let function = |one: &api::Function| {
        let kind = if one.is_method() {
            "method"
        } else {
            "function"
        };
        entry(one.path, kind, &one.signature(), one.doc)
    };
    let of_modules = api::modules().flat_map(|module| module.functions);
    let functions = api::functions().chain(api::methods()).chain(of_modules);
    let constants = api::constants().map(|one| entry(one.path, "constant", one.path, one.doc));
    let events = api::events().map(|one| entry(one.name, "event", one.name, one.doc));
    Json(
        functions
            .map(function)
            .chain(constants)
            .chain(events)
            .collect(),
    )
}

async fn lessons(State(class): Shared, _: Target) -> Json<Value> {
    let lesson = |one: &super::Lesson| {
        let text = one.readme;
        json!({ "name": one.name, "title": one.title, "world": one.world, "text": text })
    };
    let lessons: Vec<Value> = class.tools.lessons.iter().map(lesson).collect();
    let worlds: Vec<&str> = World::builtin_names().collect();
    let has = |name| installed(BUNDLES, name).is_some();
    Json(json!({
        "lessons": lessons, "worlds": worlds, "points": POINTS,
        "editor": has("editor.js"), "blocks": has("blocks.js"),
    }))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Decision {
    id: u32,
    admit: bool,
}

async fn admit(State(class): Shared, Json(decision): Json<Decision>) -> Reply {
    if !class.change().members.decide(decision.id, decision.admit) {
        return Err(not_found("this device does not wait any more"));
    }
    class.save().await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Name {
    name: String,
}

async fn dismiss(State(class): Shared, Json(Name { name }): Json<Name>) -> Reply {
    {
        let mut state = class.change();
        if !state.members.dismiss(&name) {
            return Err(unknown_name());
        }
        state.end_run(&name);
        std::mem::take(&mut state.screen).cancel();
        state.robots.queue.withdraw(&name);
        state.take_turns(Instant::now());
    }
    class.save().await
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Switch {
    on: bool,
}

/// Something that the teacher switches on and off.
fn switch(set: fn(&mut super::State, bool)) -> MethodRouter<Arc<Class>> {
    post(
        move |class: Shared, Json(Switch { on }): Json<Switch>| async move {
            set(&mut class.change(), on);
        },
    )
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ForAll {
    name: Option<String>,
}

async fn lesson_for_all(State(class): Shared, Json(all): Json<ForAll>) -> Reply {
    let lesson = all.name.map(|name| class.place(&name)).transpose()?;
    class.change().lesson = lesson;
    Ok(())
}

async fn points(State(class): Shared) -> impl IntoResponse {
    let headers = [
        (header::CONTENT_TYPE, "text/csv; charset=utf-8"),
        (
            header::CONTENT_DISPOSITION,
            "attachment; filename=points.csv",
        ),
    ];
    (headers, class.points())
}

/// The learners' link with the class word as a QR code: rows of `0` and `1`.
async fn qr(State(class): Shared) -> Reply<Json<Value>> {
    let link = format!("{}#{}", class.link, class.word.replace(' ', "-"));
    let code = QrCode::with_error_correction_level(&link, EcLevel::M).map_err(internal)?;
    let dark = |colour: Color| if colour == Color::Dark { '1' } else { '0' };
    let colours = code.to_colors();
    let rows = colours.chunks(code.width());
    let rows: Vec<String> = rows
        .map(|row| row.iter().copied().map(dark).collect())
        .collect();
    Ok(Json(json!({ "link": class.link, "rows": rows })))
}
