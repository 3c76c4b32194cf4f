//! The description of the HTTP interface for programs (OpenAPI 3.1), from the tables of what is
//! served and from the types.

use schemars::generate::SchemaSettings;
use serde_json::{Value, json};

use super::api::{Gives, gets};
use crate::control;
use crate::http::Role;

pub(super) fn document() -> Value {
    let settings = SchemaSettings::draft2020_12().with(|settings| {
        settings.definitions_path = "/components/schemas".into();
        settings.meta_schema = None;
    });
    let mut generator = settings.into_generator();
    let mut paths = control::paths(&mut generator);
    for get in gets() {
        let content = match get.gives {
            Gives::Json(schema) => {
                let schema = Value::from(schema(&mut generator));
                json!({ "application/json": { "schema": schema } })
            }
            Gives::Kind(kind) => json!({ kind: {} }),
        };
        let role = if get.private {
            Some(Role::Viewer)
        } else {
            None
        };
        let mut operation = control::described(&get.summary.into(), role, content);
        let parts = ["name", "file"].into_iter();
        let parameters: Vec<Value> = parts
            .filter(|part| get.path.contains(&format!("{{{part}}}")))
            .map(|part| {
                let schema = json!({ "type": "string" });
                json!({ "name": part, "in": "path", "required": true, "schema": schema })
            })
            .collect();
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
        let document = document();
        let paths = document["paths"].as_object().unwrap();
        assert_eq!(paths.len(), 22);
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
