//! The requests of persons and programs to a run: of the command line, the page, the API and the
//! broker.

use axum::http::header::CONTENT_TYPE;
use axum::http::{Method, Request};
use jiff::Timestamp;
use percent_encoding::{NON_ALPHANUMERIC, utf8_percent_encode};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::world_change::WorldChange;
use crate::agent::Change;
use crate::clock::Span;
use crate::http::Role;
use crate::robot::{ParamValue, Percent};
use crate::timetable::TimetableChange;
use crate::wire::{Led, Sound};

/// Maximum length of speech in one request, in bytes: half a minute of s16, mono, 16 kHz.
pub const MAX_SPEECH: usize = 30 * 32_000;
/// The field that tells the requests apart.
pub(super) const TAG: &str = "do";

/// One request. Over HTTP, it is `/api/NAME` with its other fields in a JSON object, or of a GET in
/// the query.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
#[schemars(rename = "Request")]
pub enum RunRequest {
    /// The state of the run, as `spykee status --json` prints it.
    Status,
    /// All behaviours that are known or running.
    Behaviours,
    /// A picture taken by the camera after the request.
    Picture {
        /// How long to wait for it, from 1 to 600 s; 5 unless given.
        seconds: Option<u64>,
    },
    /// STOP: nothing moves the robot until a person releases it. A single run ends then, a service
    /// goes on. The answer comes when the robot has confirmed it, or after two seconds.
    Stop,
    /// Release STOP: the robot may move again.
    ResetStop,
    /// Drive to the station, and end the behaviours that drive: a person starts them again. The answer
    /// comes when the robot is there, or the docking has failed. With more than two retries the rescue
    /// behaviour drives the robot elsewhere between two searches.
    Dock {
        /// Maximum duration of one search, from 1 to 3600 s; 180 unless given.
        seconds: Option<u64>,
        /// Number of retries, from 0 to 20; 8 unless given.
        retries: Option<u32>,
    },
    /// Leave the station. The answer comes when the robot has left, or has not.
    Undock {
        /// How long to wait for the robot's confirmation, from 1 to 600 s; 15 unless given.
        seconds: Option<u64>,
    },
    /// Switch a light.
    Led {
        /// `flash`, `left` or `right`.
        #[schemars(with = "String")]
        light: Led,
        /// On or off.
        on: bool,
    },
    /// Play a sound, such as `laser`; `spykee robot play --help` lists them.
    Play {
        /// Its name.
        #[schemars(with = "String")]
        sound: Sound,
    },
    /// Stop the music.
    StopSound,
    /// Set the volume.
    Volume {
        /// From 0 to 100.
        percent: Percent,
    },
    /// Speak: the body is s16 little-endian, mono, 16 kHz, at most 30 s.
    Say {
        /// The body.
        #[serde(skip)]
        samples: Vec<u8>,
    },
    /// Start, stop or restart a behaviour.
    Behaviour {
        /// Its name.
        name: String,
        /// The change.
        change: Change,
        /// With `start`: end it after this time, such as `30m`, or a number of seconds.
        #[serde(rename = "for")]
        lasts: Option<Span>,
    },
    /// Change a parameter that a running behaviour has declared as live.
    Param {
        /// The behaviour.
        name: String,
        /// The parameter.
        param: String,
        /// Its new value.
        value: ParamValue,
    },
    /// Leave out the next start of the timetable, or start nothing until a time. What is changed holds
    /// also after a restart of the service. What people start is started all the same.
    Timetable {
        /// `skip` or `unskip` the next start; `pause` or `resume` the timetable.
        change: TimetableChange,
        /// With `pause`: the end of it, such as `2026-05-04T16:00:00Z`, or in the service's time zone
        /// `2026-05-04 18:00`.
        until: Option<String>,
        /// With `skip`: the start that is meant, as in `next`; refused if another one is the next.
        #[schemars(with = "Option<String>", extend("format" = "date-time"))]
        start: Option<Timestamp>,
    },
    /// Change the simulated world.
    Sim {
        /// The change.
        change: WorldChange,
    },
}

/// How a request is sent over HTTP, and who may send it.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Route {
    /// The last part of the path: the request's tag, with `-` for `_`.
    pub(super) name: &'static str,
    /// Whether it only reads: sent with GET, else with POST.
    pub(super) reads: bool,
    pub(super) role: Role,
    pub(super) answer: &'static str,
}

pub(super) const ROUTES: [Route; 16] = [
    Route::get("status", "status"),
    Route::get("behaviours", "behaviours"),
    Route::get("picture", "picture"),
    Route {
        name: "stop",
        reads: false,
        role: Role::Viewer,
        answer: "stopped",
    },
    Route::post("reset-stop", "done"),
    Route::post("dock", "docked"),
    Route::post("undock", "undocked"),
    Route::post("led", "done"),
    Route::post("play", "done"),
    Route::post("stop-sound", "done"),
    Route::post("volume", "done"),
    Route::post("say", "done"),
    Route::post("behaviour", "done"),
    Route::post("param", "done"),
    Route::post("timetable", "done"),
    Route::post("sim", "done"),
];

impl Route {
    const fn get(name: &'static str, answer: &'static str) -> Route {
        Route {
            name,
            reads: true,
            role: Role::Viewer,
            answer,
        }
    }

    const fn post(name: &'static str, answer: &'static str) -> Route {
        Route {
            name,
            reads: false,
            role: Role::Driver,
            answer,
        }
    }

    pub(super) fn find(name: &str) -> Option<&'static Route> {
        ROUTES.iter().find(|route| route.name == name)
    }

    pub(super) fn tag(&self) -> String {
        self.name.replace('-', "_")
    }

    pub(super) fn method(&self) -> Method {
        if self.reads {
            Method::GET
        } else {
            Method::POST
        }
    }

    /// Whether the body is speech instead of JSON.
    pub(super) fn takes_samples(&self) -> bool {
        self.name == "say"
    }
}

impl RunRequest {
    pub(super) fn from_fields(
        route: &Route,
        mut fields: Map<String, Value>,
    ) -> serde_json::Result<RunRequest> {
        fields.insert(TAG.to_owned(), route.tag().into());
        serde_json::from_value(Value::Object(fields))
    }

    pub fn role(&self) -> Role {
        self.route().map_or(Role::Driver, |route| route.role)
    }

    fn fields(&self) -> Map<String, Value> {
        match serde_json::to_value(self) {
            Ok(Value::Object(fields)) => fields,
            // A request is always an object.
            _ => Map::new(),
        }
    }

    /// Each request has one; a test proves it.
    fn route(&self) -> Option<&'static Route> {
        Route::find(&self.fields()[TAG].as_str()?.replace('_', "-"))
    }

    pub(super) fn to_http(&self, url: &str) -> axum::http::Result<Request<Vec<u8>>> {
        let mut fields = self.fields();
        fields.remove(TAG);
        fields.retain(|_, value| !value.is_null());
        let route = self.route();
        let method = route.map_or(Method::POST, Route::method);
        let mut uri = format!("{url}/api/{}", route.map_or("", |route| route.name));
        if method == Method::GET {
            let mut separator = '?';
            for (field, value) in &fields {
                let value = value.to_string();
                let value = utf8_percent_encode(&value, NON_ALPHANUMERIC);
                uri.push_str(&format!("{separator}{field}={value}"));
                separator = '&';
            }
        }
        let (content_type, body) = match self {
            RunRequest::Say { samples } => ("application/octet-stream", samples.clone()),
            _ if method == Method::GET => ("application/json", vec![]),
            _ => ("application/json", Value::Object(fields).to_string().into()),
        };
        let request = Request::builder().method(method).uri(uri);
        request.header(CONTENT_TYPE, content_type).body(body)
    }
}

/// The request in words, for the log: JSON without what is long.
impl std::fmt::Display for RunRequest {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut fields = self.fields();
        fields.retain(|_, value| !value.is_null());
        write!(f, "{}", Value::Object(fields))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> Vec<RunRequest> {
        let name = || "a/../b?c".to_owned();
        vec![
            RunRequest::Status,
            RunRequest::Behaviours,
            RunRequest::Picture { seconds: Some(7) },
            RunRequest::Stop,
            RunRequest::ResetStop,
            RunRequest::Dock {
                seconds: None,
                retries: Some(2),
            },
            RunRequest::Undock { seconds: Some(9) },
            RunRequest::Led {
                light: Led::Left,
                on: true,
            },
            RunRequest::Play {
                sound: Sound::Laser,
            },
            RunRequest::StopSound,
            RunRequest::Volume {
                percent: Percent::saturating(30),
            },
            RunRequest::Say { samples: vec![] },
            RunRequest::Behaviour {
                name: name(),
                change: Change::Start,
                lasts: Some("90s".parse().unwrap()),
            },
            RunRequest::Param {
                name: name(),
                param: "speed".to_owned(),
                value: ParamValue::Number(3.0),
            },
            RunRequest::Timetable {
                change: TimetableChange::Pause,
                until: Some("2026-05-04 18:00".to_owned()),
                start: None,
            },
            RunRequest::Sim {
                change: WorldChange::Step,
            },
        ]
    }

    #[test]
    fn each_request_has_a_route_and_arrives_as_it_was_sent() {
        let requests = all();
        assert_eq!(requests.len(), ROUTES.len());
        for (request, route) in requests.iter().zip(&ROUTES) {
            assert_eq!(request.route(), Some(route));
            let mut fields = request.fields();
            fields.remove(TAG);
            assert_eq!(RunRequest::from_fields(route, fields).unwrap(), *request);
        }
    }

    #[test]
    fn a_name_is_in_the_body_and_a_number_in_the_query() {
        let http = |number: usize| all()[number].to_http("").unwrap();
        assert_eq!(http(12).uri(), "/api/behaviour");
        let body = r#"{"change":"start","for":"1m30s","name":"a/../b?c"}"#;
        assert_eq!(String::from_utf8(http(12).into_body()).unwrap(), body);
        assert_eq!(http(2).uri(), "/api/picture?seconds=7");
        assert_eq!(http(0).uri(), "/api/status");
    }

    #[test]
    fn viewers_may_look_and_stop() {
        let may = |route: &&Route| route.role == Role::Viewer;
        let names: Vec<&str> = ROUTES.iter().filter(may).map(|route| route.name).collect();
        assert_eq!(names, ["status", "behaviours", "picture", "stop"]);
    }

    #[test]
    fn unknown_and_missing_fields_are_named() {
        let error = |name: &str, fields: Value| {
            let Value::Object(fields) = fields else {
                panic!("{fields}")
            };
            let route = Route::find(name).unwrap();
            RunRequest::from_fields(route, fields)
                .unwrap_err()
                .to_string()
        };
        let unknown = error("dock", serde_json::json!({ "speed": 3 }));
        assert!(unknown.contains("unknown field `speed`"), "{unknown}");
        let missing = error("volume", serde_json::json!({}));
        assert!(missing.contains("missing field `percent`"), "{missing}");
        let sound = error("play", serde_json::json!({ "sound": "moo" }));
        assert!(sound.contains("no `moo` among: alarm,"), "{sound}");
    }
}
