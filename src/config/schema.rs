//! The config's JSON Schema, for editors.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde_json::Value;

use super::{Config, Start};

/// The schema of an entry of `behaviours:`, for editors; [`super::Entry`] reads it.
#[derive(JsonSchema)]
#[schemars(deny_unknown_fields)]
#[allow(dead_code, reason = "only its shape is used")]
pub(super) struct Behaviour {
    /// The script, relative to the config.
    file: PathBuf,
    /// Its name in the log and of its data folder [default: the file's name].
    name: Option<String>,
    /// The behaviour with the highest priority drives [default: 0].
    #[schemars(range(min = -32768, max = 32767))]
    priority: Option<i32>,
    /// Whether it is restarted after a failure: `never`, `on-failure`, or a table with `policy` and
    /// its numbers [default: never].
    restart: Option<Value>,
    /// When `spykee serve` starts it: `always`, or only when `asked` [default: always; asked if it
    /// is in the timetable].
    start: Option<Start>,
    /// Values of its parameters, by name: true, false, a number or a text.
    params: Option<BTreeMap<String, Value>>,
}

/// The schema of a whole config file (JSON Schema 2020-12).
pub fn schema() -> Value {
    schemars::schema_for!(Config).to_value()
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXAMPLE: &str = include_str!("../../behaviours/spykee.example.yaml");

    fn example() -> serde_yaml::Value {
        serde_yaml::from_str(EXAMPLE).unwrap()
    }

    #[test]
    fn the_example_names_every_setting() {
        let text = example();
        for setting in super::super::Effective::default().settings() {
            let key = setting.key;
            let found = key.split('.').try_fold(&text, |tree, name| tree.get(name));
            assert!(found.is_some(), "{key} is not in the example");
        }
        let entry = &text["behaviours"][1];
        let schema = schema();
        let keys = schema["$defs"]["Behaviour"]["properties"]
            .as_object()
            .unwrap();
        for key in keys.keys().filter(|key| *key != "params") {
            assert!(entry.get(key).is_some(), "{key} is not in the example");
        }
    }

    #[test]
    fn the_example_is_valid_and_has_the_defaults() {
        let config = Config::parse(EXAMPLE, "example").unwrap();
        let usual = Config::default();
        assert_eq!(config.watchdog, usual.watchdog);
        assert_eq!(config.streams, usual.streams);
        assert_eq!(config.limits, usual.limits);
        assert_eq!(config.calibration, usual.calibration);
        assert_eq!(config.logging, usual.logging);
        assert_eq!(config.journal, usual.journal);
        assert_eq!(config.camera, usual.camera);
        assert_eq!((config.behaviours.len(), config.colours.len()), (2, 2));
    }

    /// Whether the schema knows every key of a value, as far as it closes its objects.
    fn knows(root: &Value, schema: &Value, value: &serde_yaml::Value, at: &str) {
        let schema = match schema["$ref"].as_str() {
            Some(path) => root.pointer(path.trim_start_matches('#')).unwrap(),
            None => schema,
        };
        let Some(map) = value.as_mapping() else {
            let items = value.as_sequence().into_iter().flatten();
            return items.for_each(|item| knows(root, &schema["items"], item, at));
        };
        for (key, value) in map {
            let key = key.as_str().unwrap();
            let inner = match schema["properties"].get(key) {
                Some(inner) => inner,
                None => &schema["additionalProperties"],
            };
            assert!(inner.is_object() || inner == true, "{at}.{key}: {schema}");
            knows(root, inner, value, &format!("{at}.{key}"));
        }
    }

    #[test]
    fn the_schema_has_all_keys_of_the_example_and_refuses_others() {
        let schema = schema();
        knows(&schema, &schema, &example(), "");
        for closed in [
            "/additionalProperties",
            "/$defs/Limits/additionalProperties",
        ] {
            assert_eq!(schema.pointer(closed), Some(&false.into()), "{closed}");
        }
        let lasts = schema.pointer("/$defs/Rule/properties/for/type").unwrap();
        assert_eq!(lasts, &serde_json::json!(["string", "number", "null"]));
        let low = schema.pointer("/$defs/Limits/properties/low").unwrap();
        assert_eq!(
            (&low["maximum"], low["type"].as_str()),
            (&100.into(), Some("integer"))
        );
    }
}
