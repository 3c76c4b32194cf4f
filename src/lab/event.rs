//! What happens in a run, one line each of an event log. Nothing in it depends on real time or on
//! the machine.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::Value;
use tracing::field::{Field, Visit};
use tracing::{Level, Metadata};

/// What kind of thing has happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The robot has heard a command; a setpoint that is only repeated is left out.
    Heard,
    /// The robot has said something; pictures and sound are left out.
    Said,
    /// A behaviour wrote a line: `behaviour`, `line`.
    Log,
    /// The watchdog acted: `action`.
    Safety,
    /// A behaviour has ended: `behaviour`, `reason`.
    Ended,
    /// Anything else that agent or simulator found worth a line.
    Note,
    /// The end of all: `x`, `y`, `heading`, `battery`, `docked`, `distance` (metres driven), `collisions`.
    End,
}

/// One line of an event log.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Since the start, in virtual time if there is any.
    pub at: Duration,
    /// What kind of thing.
    pub kind: EventKind,
    /// How bad it is, as in a log: `debug`, `info`, `warn` or `error`.
    pub level: &'static str,
    /// A sentence.
    pub text: String,
    /// What else belongs to it; see [`EventKind`].
    pub fields: BTreeMap<&'static str, Value>,
}

impl Event {
    /// Whether a callsite of `tracing` is one whose events are recorded.
    pub(super) fn is_wanted(metadata: &Metadata<'_>) -> bool {
        let target = metadata.target();
        let heard_or_said = matches!(
            target,
            "spykee::sim::heard" | "spykee::sim::said" | "spykee::lab::end"
        );
        heard_or_said || (target.starts_with("spykee") && *metadata.level() <= Level::INFO)
    }

    pub(super) fn of(at: Duration, event: &tracing::Event<'_>) -> Event {
        let mut reading = Reading::default();
        event.record(&mut reading);
        let metadata = event.metadata();
        Event {
            at,
            kind: reading.kind(metadata.target()),
            level: level(*metadata.level()),
            text: reading.text,
            fields: reading.fields,
        }
    }

    /// The text of a field, or nothing.
    pub fn field(&self, name: &str) -> Option<&str> {
        self.fields.get(name).and_then(Value::as_str)
    }
}

/// One flat JSON object: `t` in seconds, `kind`, `level`, the fields, `text`.
impl Serialize for Event {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("t", &(self.at.as_millis() as f64 / 1000.0))?;
        map.serialize_entry("kind", &self.kind)?;
        map.serialize_entry("level", self.level)?;
        for (name, value) in &self.fields {
            map.serialize_entry(name, value)?;
        }
        map.serialize_entry("text", &self.text)?;
        map.end()
    }
}

fn level(level: Level) -> &'static str {
    match level {
        Level::ERROR => "error",
        Level::WARN => "warn",
        Level::INFO => "info",
        _ => "debug",
    }
}

/// What an event of `tracing` holds.
#[derive(Default)]
struct Reading {
    text: String,
    fields: BTreeMap<&'static str, Value>,
}

impl Reading {
    fn kind(&self, target: &str) -> EventKind {
        let has = |name| self.fields.contains_key(name);
        match target {
            "spykee::sim::heard" => EventKind::Heard,
            "spykee::sim::said" => EventKind::Said,
            "spykee::script" => EventKind::Log,
            "spykee::lab::end" => EventKind::End,
            _ if has("action") => EventKind::Safety,
            _ if has("behaviour") && has("reason") => EventKind::Ended,
            _ => EventKind::Note,
        }
    }

    fn put(&mut self, field: &Field, value: Value) {
        self.fields.insert(field.name(), value);
    }
}

impl Visit for Reading {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        let text = format!("{value:?}");
        match field.name() {
            "message" => self.text = text,
            _ => self.put(field, text.into()),
        }
    }

    fn record_str(&mut self, field: &Field, value: &str) {
        match field.name() {
            "message" => self.text = value.to_owned(),
            _ => self.put(field, value.into()),
        }
    }

    fn record_i64(&mut self, field: &Field, value: i64) {
        self.put(field, value.into());
    }

    fn record_u64(&mut self, field: &Field, value: u64) {
        self.put(field, value.into());
    }

    fn record_bool(&mut self, field: &Field, value: bool) {
        self.put(field, value.into());
    }

    /// To a tenth of a thousandth: enough for a pose in metres.
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.put(field, ((value * 1e4).round() / 1e4).into());
    }
}
