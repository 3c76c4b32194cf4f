//! The events of a run, each one line of an event log. They do not depend on real time or on the
//! machine.

use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use serde::ser::{Serialize, SerializeMap, Serializer};
use serde_json::Value;
use tracing::field::{Field, Visit};
use tracing::{Level, Metadata};

/// Kinds of events.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// The robot received a command; repeated setpoints are omitted.
    Heard,
    /// The robot sent a report; pictures and sound are omitted.
    Said,
    /// A behaviour wrote a line: `behaviour`, `line`.
    Log,
    /// The watchdog acted: `action`.
    Safety,
    /// A behaviour has ended: `behaviour`, `reason`.
    Ended,
    /// Any other log message of agent or simulator.
    Note,
    /// The end of the run: `x`, `y`, `heading`, `battery`, `docked`, `distance` (metres driven),
    /// `collisions`.
    End,
}

/// One line of an event log.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Time since the start, in virtual time if there is any.
    pub at: Duration,
    /// The kind of event.
    pub kind: EventKind,
    /// The log level: `debug`, `info`, `warn` or `error`.
    pub level: &'static str,
    /// The message.
    pub text: String,
    /// Additional data; see [`EventKind`].
    pub fields: BTreeMap<&'static str, Value>,
}

impl Event {
    /// Whether events of this `tracing` callsite are recorded.
    pub(super) fn is_wanted(metadata: &Metadata<'_>) -> bool {
        let target = metadata.target();
        let heard_or_said = matches!(
            target,
            "spykee::sim::heard" | "spykee::sim::said" | "spykee::simulation::end"
        );
        heard_or_said || (target.starts_with("spykee") && *metadata.level() <= Level::INFO)
    }

    pub(super) fn from_tracing(at: Duration, event: &tracing::Event<'_>) -> Event {
        let mut visitor = FieldVisitor::default();
        event.record(&mut visitor);
        let metadata = event.metadata();
        Event {
            at,
            kind: visitor.kind(metadata.target()),
            level: level(*metadata.level()),
            text: visitor.text,
            fields: visitor.fields,
        }
    }

    /// Returns the text of a field, if it exists and is a string.
    pub fn field(&self, name: &str) -> Option<&str> {
        self.fields.get(name).and_then(Value::as_str)
    }
}

/// Serializes as one flat JSON object: `t` in seconds, `kind`, `level`, the fields, `text`.
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

/// Collects the message and the fields of a `tracing` event.
#[derive(Default)]
struct FieldVisitor {
    text: String,
    fields: BTreeMap<&'static str, Value>,
}

impl FieldVisitor {
    fn kind(&self, target: &str) -> EventKind {
        let has = |name| self.fields.contains_key(name);
        match target {
            "spykee::sim::heard" => EventKind::Heard,
            "spykee::sim::said" => EventKind::Said,
            "spykee::script" => EventKind::Log,
            "spykee::simulation::end" => EventKind::End,
            _ if has("action") => EventKind::Safety,
            _ if has("behaviour") && has("reason") => EventKind::Ended,
            _ => EventKind::Note,
        }
    }

    fn put(&mut self, field: &Field, value: Value) {
        self.fields.insert(field.name(), value);
    }
}

impl Visit for FieldVisitor {
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

    /// Rounds to four decimals, which is enough for a pose in metres.
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.put(field, ((value * 1e4).round() / 1e4).into());
    }
}
