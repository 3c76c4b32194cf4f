//! The book's page of all settings, from the config's schema.

use std::fmt::Write as _;

use serde_json::{Map, Value as Json};

use crate::api::Page;
use crate::config;
use crate::sanitize::json_text;

const BEGINNING: &str = "# All settings\n\n\
    Every key of a config, from the schema that `spykee config schema` prints for editors. All \
    are optional unless the table says *required*. [Config](../operate/config.md) explains how a config is found and read, \
    `behaviours/spykee.example.yaml` shows each key in place.\n\n\
    `behaviours[].file` is the `file` of each entry of the list `behaviours`; NAME stands for a \
    name of your choice.\n\n";

struct Row {
    key: String,
    kind: String,
    default: String,
    meaning: String,
}

pub(super) fn page() -> Page {
    let schema = Schema(config::schema());
    let mut top = Vec::new();
    let mut sections = String::new();
    for (name, property) in schema.properties(&schema.0).into_iter().flatten() {
        let mut rows = Vec::new();
        schema.collect(name, property, &property["default"], &mut rows);
        if rows.len() == 1 && rows[0].key == *name {
            top.append(&mut rows);
        } else {
            let about = schema.description(property);
            let _ = writeln!(sections, "## {name}\n\n{about}\n");
            table(&mut sections, &rows);
        }
    }
    let mut text = BEGINNING.to_owned();
    text += "## At the top\n\n";
    table(&mut text, &top);
    text += sections.trim_end();
    text.push('\n');
    Page {
        name: "config".to_owned(),
        text,
    }
}

fn table(text: &mut String, rows: &[Row]) {
    text.push_str("| key | value | default | meaning |\n| --- | --- | --- | --- |\n");
    for row in rows {
        let Row {
            key,
            kind,
            default,
            meaning,
        } = row;
        let _ = writeln!(text, "| `{key}` | {kind} | {default} | {meaning} |");
    }
    text.push('\n');
}

struct Schema(Json);

impl Schema {
    /// What a value refers to: the definition behind a reference, and of several the one that is
    /// not null.
    fn resolve<'a>(&'a self, value: &'a Json) -> &'a Json {
        if let Some(reference) = value["$ref"].as_str() {
            let name = reference.rsplit('/').next().unwrap_or_default();
            return self.resolve(&self.0["$defs"][name]);
        }
        for list in ["anyOf", "allOf"] {
            let options = value[list].as_array().into_iter().flatten();
            let options: Vec<&Json> = options.filter(|one| one["type"] != "null").collect();
            if let [one] = options[..] {
                return self.resolve(one);
            }
            let table = options
                .into_iter()
                .map(|one| self.resolve(one))
                .find(|one| one["properties"].is_object());
            if let Some(table) = table {
                return table;
            }
        }
        value
    }

    fn properties<'a>(&'a self, value: &'a Json) -> Option<&'a Map<String, Json>> {
        self.resolve(value)["properties"].as_object()
    }

    fn description(&self, property: &Json) -> String {
        let own = property["description"].as_str();
        let text = own.or_else(|| self.resolve(property)["description"].as_str());
        let text = text.unwrap_or_default().replace('|', "\\|");
        text.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    fn collect(&self, key: &str, property: &Json, default: &Json, rows: &mut Vec<Row>) {
        let value = self.resolve(property);
        let parts = [
            (String::new(), value),
            ("[]".to_owned(), &value["items"]),
            (".NAME".to_owned(), &value["additionalProperties"]),
        ];
        for (behind, part) in parts {
            let Some(properties) = self.properties(part) else {
                continue;
            };
            for (name, property) in properties {
                // The default of the whole table is the one in effect.
                let default = match &default[name] {
                    Json::Null => &property["default"],
                    default => default,
                };
                self.collect(&format!("{key}{behind}.{name}"), property, default, rows);
                let required = self.resolve(part)["required"].as_array();
                let is_required = required.into_iter().flatten().any(|one| one == name);
                if let (true, Some(row)) = (is_required, rows.last_mut()) {
                    row.default = "*required*".to_owned();
                }
            }
            return;
        }
        rows.push(Row {
            key: key.to_owned(),
            kind: self.kind(value),
            default: shown(default),
            meaning: self.description(property),
        });
    }

    /// What a value may be, in words.
    fn kind(&self, value: &Json) -> String {
        let value = self.resolve(value);
        let constants = ["enum", "oneOf"]
            .iter()
            .find_map(|key| value[*key].as_array());
        if let Some(constants) = constants {
            let names = constants.iter().map(|one| match one {
                Json::Object(_) => &one["const"],
                one => one,
            });
            let names: Vec<String> = names
                .filter(|name| !name.is_null())
                .map(|name| format!("`{}`", json_text(name)))
                .collect();
            return names.join(", ");
        }
        let types = match &value["type"] {
            Json::Array(types) => types.clone(),
            one => vec![one.clone()],
        };
        let types = types.iter().filter_map(Json::as_str);
        let words = types.filter_map(|kind| match kind {
            "string" => Some("text".to_owned()),
            "integer" => Some(format!("a whole number{}", bounds(value))),
            "number" => Some(format!("a number{}", bounds(value))),
            "boolean" => Some("`true` or `false`".to_owned()),
            "array" => Some(format!("a list: {}", self.kind(&value["items"]))),
            "object" => Some(format!(
                "a table of names: {}",
                self.kind(&value["additionalProperties"])
            )),
            _ => None,
        });
        let words: Vec<String> = words.collect();
        if words.is_empty() {
            "anything".to_owned()
        } else {
            words.join(" or ")
        }
    }
}

fn bounds(value: &Json) -> String {
    match (&value["minimum"], &value["maximum"]) {
        (Json::Number(least), Json::Number(most)) => format!(" from {least} to {most}"),
        (Json::Number(least), _) => format!(" from {least}"),
        (_, Json::Number(most)) => format!(" up to {most}"),
        _ => String::new(),
    }
}

fn shown(default: &Json) -> String {
    match default {
        Json::Null => String::new(),
        Json::Array(list) if list.is_empty() => String::new(),
        Json::Object(map) if map.is_empty() => String::new(),
        other => format!("`{}`", json_text(other)),
    }
}
