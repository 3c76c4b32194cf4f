//! The requests over HTTP: one router for the private socket and the network, and its description
//! for programs.

use std::fmt;

use axum::Router;
use axum::body::Bytes;
use axum::extract::rejection::BytesRejection;
use axum::extract::{DefaultBodyLimit, FromRequest as _, Query, Request, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse as _, Response};
use axum::routing::any;
use schemars::{JsonSchema as _, SchemaGenerator};
use serde::de::{Error as _, MapAccess};
use serde::{Deserialize, Deserializer};
use serde_json::{Map, Value, json};

use super::request::{MAX_SPEECH, ROUTES, Route, RunRequest, TAG};
use super::response::RunResponse;
use super::run::Run;
use crate::http::{Refusal, Role, Visitor};

/// Maximum length of a JSON body, in bytes.
const MAX_BODY: usize = 16 * 1024;
const NO_SUCH_REQUEST: &str = "there is no such request: /api/openapi.json lists them";
const TOO_LONG_TO_SAY: &str = "that is too long to say at once: at most 30 s";

/// The routes of a run's requests. Who sends one must be known (see [`Visitor`]).
pub fn routes(run: Run) -> Router {
    Router::new()
        .route("/api/{name}", any(handle))
        .layer(DefaultBodyLimit::max(MAX_BODY))
        .route(
            "/api/say",
            any(handle).layer(DefaultBodyLimit::max(MAX_SPEECH)),
        )
        .with_state(run)
}

async fn handle(
    State(run): State<Run>,
    visitor: Visitor,
    http_request: Request,
) -> Result<Response, Refusal> {
    let path = http_request.uri().path();
    let route = Route::find(path.strip_prefix("/api/").unwrap_or_default())
        .ok_or_else(|| Refusal::new(StatusCode::NOT_FOUND, NO_SUCH_REQUEST))?;
    if http_request.method() != route.method() {
        let why = format!("send it with {}", route.method());
        return Err(Refusal::new(StatusCode::METHOD_NOT_ALLOWED, why));
    }
    visitor.require(route.role)?;
    let request = parse(route, http_request).await?;
    let by = visitor.describe("the API");
    Ok(run.perform(request, &by).await.into_response())
}

async fn parse(route: &Route, request: Request) -> Result<RunRequest, Refusal> {
    if route.reads {
        return from_fields(route, query(&request)?);
    }
    let content_type = request.headers().get(CONTENT_TYPE);
    let is_json = content_type.is_some_and(|kind| kind.as_bytes().starts_with(b"application/json"));
    let body = Bytes::from_request(request, &())
        .await
        .map_err(|error| unreadable(route, &error))?;
    if route.takes_samples() {
        return Ok(RunRequest::Say {
            samples: body.to_vec(),
        });
    }
    if body.is_empty() {
        return from_fields(route, Map::new());
    }
    if !is_json {
        let why = "the content type must be application/json";
        return Err(Refusal::new(StatusCode::UNSUPPORTED_MEDIA_TYPE, why));
    }
    let Fields(fields) = serde_json::from_slice(&body)
        .map_err(|error| Refusal::new(StatusCode::BAD_REQUEST, error.to_string()))?;
    from_fields(route, fields)
}

fn unreadable(route: &Route, error: &BytesRejection) -> Refusal {
    let status = error.status();
    if route.takes_samples() && status == StatusCode::PAYLOAD_TOO_LARGE {
        return Refusal::new(status, TOO_LONG_TO_SAY);
    }
    Refusal::new(status, error.body_text())
}

/// The fields of a JSON object, each once.
struct Fields(Map<String, Value>);

impl<'de> Deserialize<'de> for Fields {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Fields, D::Error> {
        from.deserialize_map(Fields(Map::new()))
    }
}

impl<'de> serde::de::Visitor<'de> for Fields {
    type Value = Fields;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(mut self, mut from: A) -> Result<Fields, A::Error> {
        while let Some((name, value)) = from.next_entry::<String, Value>()? {
            if self.0.contains_key(&name) {
                return Err(A::Error::custom(format_args!("duplicate field `{name}`")));
            }
            self.0.insert(name, value);
        }
        Ok(self)
    }
}

fn from_fields(route: &Route, fields: Map<String, Value>) -> Result<RunRequest, Refusal> {
    RunRequest::from_fields(route, fields)
        .map_err(|error| Refusal::new(StatusCode::UNPROCESSABLE_ENTITY, error.to_string()))
}

/// The fields in the query: numbers, or else texts.
fn query(request: &Request) -> Result<Map<String, Value>, Refusal> {
    let pairs = Query::<Vec<(String, String)>>::try_from_uri(request.uri())
        .map_err(|error| Refusal::new(StatusCode::BAD_REQUEST, error.body_text()))?;
    let field = |(name, value): (String, String)| {
        let number = value.parse::<u64>().map(Value::from);
        (name, number.unwrap_or_else(|_| value.into()))
    };
    Ok(pairs.0.into_iter().map(field).collect())
}

/// The requests as paths of an OpenAPI description.
pub fn paths(generator: &mut SchemaGenerator) -> Map<String, Value> {
    let requests = RunRequest::json_schema(generator).to_value();
    let answers = RunResponse::json_schema(generator).to_value();
    let path = |route: &Route| {
        let request = variant(&requests, TAG, &route.tag());
        let answer = variant(&answers, "answer", route.answer);
        let method = if route.reads { "get" } else { "post" };
        let operation = operation(route, request, answer);
        (format!("/api/{}", route.name), json!({ method: operation }))
    };
    ROUTES.iter().map(path).collect()
}

/// The variant with this tag of an enum's schema.
fn variant(schema: &Value, field: &str, tag: &str) -> Value {
    let variants = schema["oneOf"].as_array().into_iter().flatten();
    let mut tagged = variants.filter(|one| one["properties"][field]["const"] == tag);
    tagged.next().cloned().unwrap_or_default()
}

fn operation(route: &Route, mut request: Value, answer: Value) -> Value {
    if let Some(properties) = request["properties"].as_object_mut() {
        properties.remove(TAG);
    }
    if let Some(required) = request["required"].as_array_mut() {
        required.retain(|name| name != TAG);
    }
    let content = if route.answer == "picture" {
        json!({ "image/jpeg": {} })
    } else {
        json!({ "application/json": { "schema": answer } })
    };
    let mut operation = described(&request["description"], Some(route.role), content);
    let fields = request["properties"].as_object();
    if route.takes_samples() {
        let content = json!({ "application/octet-stream": {} });
        operation["requestBody"] = json!({ "required": true, "content": content });
    } else if route.reads {
        let parameter = |(name, schema): (&String, &Value)| {
            json!({
                "name": name, "in": "query", "required": false,
                "description": schema["description"], "schema": schema,
            })
        };
        let parameters: Vec<Value> = fields.into_iter().flatten().map(parameter).collect();
        operation["parameters"] = parameters.into();
    } else if fields.is_some_and(|fields| !fields.is_empty()) {
        let needed = request["required"]
            .as_array()
            .is_some_and(|required| !required.is_empty());
        operation["requestBody"] = json!({
            "required": needed, "content": { "application/json": { "schema": request } },
        });
    }
    operation
}

/// An operation of an OpenAPI description: what it is for, the role of those who may call it (`None`:
/// anyone), and what it responds.
pub fn described(summary: &Value, role: Option<Role>, content: Value) -> Value {
    let mut operation = json!({
        "summary": summary,
        "responses": {
            "200": { "description": "Done.", "content": content },
            "default": {
                "description": "The reason for the failure.",
                "content": { "application/json": { "schema": {
                    "type": "object", "properties": { "error": { "type": "string" } },
                    "required": ["error"],
                } } },
            },
        },
    });
    if let Some(role) = role {
        operation["description"] = format!("For a {}.", role.name()).into();
        operation["security"] = json!([{ "token": [] }]);
    }
    operation
}
