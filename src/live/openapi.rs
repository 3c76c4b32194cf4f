//! The JSON types of the API's requests and responses, and its description for programs (OpenAPI
//! 3.1), with schemas derived from them.

use schemars::JsonSchema;
use schemars::generate::{SchemaGenerator, SchemaSettings};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::command::{BehaviourAction, Light};
use super::history::{History, Start};
use super::scripts::{Behaviour, Text};
use super::state::State;
use crate::clock::Span;
use crate::control::{Report, StopReport};
use crate::http::Me;
use crate::robot::{ParamValue, Percent};

/// The health of the program and the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Health {
    /// Whether the pilot responds.
    pub live: bool,
    /// Whether the robot is connected.
    pub ready: bool,
}

/// The result of a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Outcome {
    /// Whether it was executed.
    pub ok: bool,
    /// The result in words, such as how a docking ended.
    pub text: String,
}

/// A light and its new state.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SetLight {
    /// The light.
    pub light: Light,
    /// On or off.
    pub on: bool,
}

/// A sound.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct PlaySound {
    /// Its name, such as `laser`.
    pub sound: String,
}

/// The volume.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Volume {
    /// From 0 to 100.
    pub percent: Percent,
}

/// A parameter of a behaviour and its new value.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct SetParam {
    /// Its name.
    pub param: String,
    /// Its new value.
    pub value: ParamValue,
}

/// A change of a behaviour's state.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct BehaviourChange {
    /// The change.
    pub change: BehaviourAction,
    /// With `start`: end it after this time, such as `30m`, or a number of seconds.
    #[serde(rename = "for")]
    pub lasts: Option<Span>,
}

/// A docking; the defaults are those of `robot.dock`.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Dock {
    /// Maximum duration of one search, from 1 to 3600 s.
    pub seconds: Option<u64>,
    /// Number of retries, from 0 to 20.
    pub retries: Option<u32>,
}

/// A timeout.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TimeLimit {
    /// In whole seconds, from 1 to 600.
    pub seconds: Option<u64>,
}

/// The result of a docking or undocking, successful or not.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Docking {
    /// Whether it succeeded.
    pub ok: bool,
    /// The same as `end`.
    pub text: String,
    /// The same as `end`, if it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// `done`, `already_docked`, `not_docked`, `base_not_found`, `timeout`, and so on, as in
    /// scripts.
    pub end: &'static str,
    /// Attempts made; absent for an undocking.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attempts: Option<u32>,
    /// Time taken; absent for an undocking.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}

enum Body {
    Nothing,
    Json(Value),
    /// An optional JSON body.
    Optional(Value),
    Samples,
}

enum Gives {
    Json(Value),
    Kind(&'static str),
}

struct Call {
    path: &'static str,
    about: &'static str,
    /// The required role, `viewer` or `driver`; `None`: anyone.
    role: Option<&'static str>,
    /// `None` for a GET request.
    takes: Option<Body>,
    gives: Gives,
}

pub(super) fn document() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| {
        settings.definitions_path = "/components/schemas".into();
        settings.meta_schema = None;
    });
    let mut generator = settings.into_generator();
    let mut paths = Map::new();
    for call in calls(&mut generator) {
        let method = if call.takes.is_some() { "post" } else { "get" };
        let entry = paths.entry(call.path).or_insert_with(|| json!({}));
        entry[method] = operation(call);
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

fn calls(generator: &mut SchemaGenerator) -> Vec<Call> {
    let mut calls = Vec::new();
    macro_rules! shape {
        ($kind:ty) => {
            Value::from(generator.subschema_for::<$kind>())
        };
    }
    let mut get = |path, about, role, gives| {
        calls.push(Call {
            path,
            about,
            role,
            takes: None,
            gives,
        });
    };
    get(
        "/healthz",
        "Whether the program and the robot are up.",
        None,
        Gives::Json(shape!(Health)),
    );
    get(
        "/metrics",
        "Metrics for Prometheus.",
        Some("viewer"),
        Gives::Kind("application/openmetrics-text"),
    );
    get(
        "/api/me",
        "Role of the caller.",
        None,
        Gives::Json(shape!(Me)),
    );
    get(
        "/api/status",
        "The state of the run.",
        Some("viewer"),
        Gives::Json(shape!(State)),
    );
    get(
        "/api/run",
        "The state of the run, as `spykee status --json` prints it.",
        Some("viewer"),
        Gives::Json(shape!(Report)),
    );
    get(
        "/api/behaviours",
        "All behaviours.",
        Some("viewer"),
        Gives::Json(shape!(Vec<Behaviour>)),
    );
    get(
        "/api/behaviours/{name}/script",
        "The text of a behaviour's script.",
        Some("viewer"),
        Gives::Json(shape!(Text)),
    );
    get(
        "/api/behaviours/{name}/pictures/{file}",
        "A picture that a behaviour has saved.",
        Some("viewer"),
        Gives::Kind("image/jpeg"),
    );
    get(
        "/api/history",
        "Battery, runs, dockings and alarms of the last day in 288 parts, or of the last week with `?days=7`, at most 366 days; and the newest events. Null without a journal.",
        Some("viewer"),
        Gives::Json(shape!(Option<History>)),
    );
    get(
        "/api/schedule",
        "The next starts of a service's timetable; null without one.",
        Some("viewer"),
        Gives::Json(shape!(Option<Vec<Start>>)),
    );
    get(
        "/api/picture",
        "A new picture from the camera.",
        Some("viewer"),
        Gives::Kind("image/jpeg"),
    );
    let mut post = |path, about, role, takes| {
        let gives = Gives::Json(shape!(Outcome));
        calls.push(Call {
            path,
            about,
            role: Some(role),
            takes: Some(takes),
            gives,
        });
    };
    post(
        "/api/reset-stop",
        "Release STOP: the robot may move again.",
        "driver",
        Body::Nothing,
    );
    post(
        "/api/stop-sound",
        "Stop the music.",
        "driver",
        Body::Nothing,
    );
    post(
        "/api/say",
        "Speak: s16 little-endian, mono, 16 kHz, at most 30 s.",
        "driver",
        Body::Samples,
    );
    calls.push(Call {
        path: "/api/stop",
        about: "STOP: nothing moves the robot until it is released. Responds when the robot has confirmed it, or after two seconds.",
        role: Some("viewer"),
        takes: Some(Body::Nothing),
        gives: Gives::Json(shape_of::<StopReport>(generator)),
    });
    let bodies = [
        (
            "/api/led",
            "Switch a light.",
            shape_of::<SetLight>(generator),
        ),
        (
            "/api/play",
            "Play a sound.",
            shape_of::<PlaySound>(generator),
        ),
        (
            "/api/volume",
            "Set the volume.",
            shape_of::<Volume>(generator),
        ),
        (
            "/api/behaviours/{name}",
            "Start, stop or restart a behaviour; with `for` it is ended after that time.",
            shape_of::<BehaviourChange>(generator),
        ),
        (
            "/api/behaviours/{name}/params",
            "Change a parameter that the behaviour has declared as live.",
            shape_of::<SetParam>(generator),
        ),
    ];
    for (path, about, body) in bodies {
        let gives = Gives::Json(shape_of::<Outcome>(generator));
        let role = Some("driver");
        let takes = Some(Body::Json(body));
        calls.push(Call {
            path,
            about,
            role,
            takes,
            gives,
        });
    }
    let dockings = [
        (
            "/api/dock",
            "Drive to the station. Responds when the robot is there, or with 409 if the docking failed.",
            shape_of::<Dock>(generator),
        ),
        (
            "/api/undock",
            "Leave the station. Responds when the robot has left, or with 409 if it has not.",
            shape_of::<TimeLimit>(generator),
        ),
    ];
    for (path, about, body) in dockings {
        calls.push(Call {
            path,
            about,
            role: Some("driver"),
            takes: Some(Body::Optional(body)),
            gives: Gives::Json(shape_of::<Docking>(generator)),
        });
    }
    calls
}

fn shape_of<T: schemars::JsonSchema>(generator: &mut SchemaGenerator) -> Value {
    Value::from(generator.subschema_for::<T>())
}

fn operation(call: Call) -> Value {
    let content = match call.gives {
        Gives::Json(schema) => json!({ "application/json": { "schema": schema } }),
        Gives::Kind(kind) => json!({ kind: {} }),
    };
    let failure = json!({
        "description": "The reason for the failure.",
        "content": { "application/json": { "schema": {
            "type": "object", "properties": { "error": { "type": "string" } }, "required": ["error"],
        } } },
    });
    let mut operation = json!({
        "summary": call.about,
        "responses": { "200": { "description": "Done.", "content": content }, "default": failure },
    });
    if let Some(role) = call.role {
        operation["description"] = format!("For a {role}.").into();
        operation["security"] = json!([{ "token": [] }]);
    }
    let parts = ["name", "file"];
    let parts = parts
        .iter()
        .filter(|part| call.path.contains(&format!("{{{part}}}")));
    let parameters: Vec<Value> = parts
        .map(|part| json!({ "name": part, "in": "path", "required": true, "schema": { "type": "string" } }))
        .collect();
    if !parameters.is_empty() {
        operation["parameters"] = parameters.into();
    }
    if call.path == "/api/picture" {
        operation["parameters"] = json!([
            { "name": "seconds", "in": "query", "required": false,
              "description": "How long to wait for it, from 1 to 600; 5 unless given.",
              "schema": { "type": "integer" } },
        ]);
    }
    match call.takes {
        Some(Body::Json(schema)) => {
            let content = json!({ "application/json": { "schema": schema } });
            operation["requestBody"] = json!({ "required": true, "content": content });
        }
        Some(Body::Optional(schema)) => {
            let content = json!({ "application/json": { "schema": schema } });
            operation["requestBody"] = json!({ "required": false, "content": content });
        }
        Some(Body::Samples) => {
            let content = json!({ "application/octet-stream": {} });
            operation["requestBody"] = json!({ "required": true, "content": content });
        }
        Some(Body::Nothing) | None => {}
    }
    operation
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

    /// Extracts the paths and methods of the routes from the source.
    fn routes(source: &str) -> std::collections::BTreeSet<(String, &'static str)> {
        let routes = source.split(".route(").skip(1).map(|route| {
            let path = route.split('"').nth(1).unwrap().to_owned();
            let method = if route.contains("post(") {
                "post"
            } else {
                "get"
            };
            // Ignore the method of the next route.
            let post = route.find("post(").unwrap_or(usize::MAX);
            let get = route.find("get(").unwrap_or(usize::MAX);
            (path, if get < post { "get" } else { method })
        });
        routes.collect()
    }

    #[test]
    fn the_description_and_the_routes_agree() {
        let mut served = routes(include_str!("api.rs"));
        served.extend(routes(include_str!("../http/login.rs")));
        let own = [
            "/live",
            "/api/openapi.json",
            "/api/messages.json",
            "/api/login",
            "/api/logout",
        ];
        served.retain(|(path, _)| !own.contains(&path.as_str()));
        let document = document();
        let described = document["paths"].as_object().unwrap().iter();
        let described = described.flat_map(|(path, methods)| {
            let methods = methods.as_object().unwrap().keys();
            methods.map(move |method| (path.clone(), if method == "post" { "post" } else { "get" }))
        });
        assert_eq!(described.collect::<std::collections::BTreeSet<_>>(), served);
    }

    #[test]
    fn all_references_in_the_description_resolve() {
        let document = document();
        let mut found = Vec::new();
        references(&document, &mut found);
        assert!(!found.is_empty());
        for path in found {
            let place = path.trim_start_matches('#');
            assert!(document.pointer(place).is_some(), "{path} does not resolve");
        }
    }
}
