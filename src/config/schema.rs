//! The config's JSON Schema, for editors.

use std::collections::BTreeMap;
use std::path::PathBuf;

use schemars::JsonSchema;
use serde_json::Value;

use super::Config;

/// The shape of one entry of `behaviours:`, as editors see it; [`super::Entry`] reads it.
#[derive(JsonSchema)]
#[schemars(deny_unknown_fields)]
#[allow(dead_code, reason = "only its shape is used")]
pub(super) struct Behaviour {
    /// The script, relative to the config.
    file: PathBuf,
    /// What it is called, in the log and as a folder; the file's own name unless given.
    name: Option<String>,
    /// Who wins when several want to drive; 0 unless given.
    #[schemars(range(min = -32768, max = 32767))]
    priority: Option<i32>,
    /// What is done when it fails: `never`, `on-failure`, or a table with `policy` and its numbers.
    restart: Option<Value>,
    /// Values of its parameters, by name: true, false, a number or a text.
    params: Option<BTreeMap<String, Value>>,
}

/// The schema of a whole config file (JSON Schema 2020-12).
pub fn schema() -> Value {
    schemars::schema_for!(Config).to_value()
}
