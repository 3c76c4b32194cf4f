//! Records the program's log events of one thread, independent of the log level shown elsewhere.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use parking_lot::Mutex;
use serde::{Serialize, Serializer};
use serde_json::Value;
use tokio::time::Instant;
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::span::{Attributes, Id, Record};
use tracing::subscriber::Interest;
use tracing::{Dispatch, Level, Metadata, Subscriber};

thread_local! {
    /// When this thread's simulation was set up.
    static BEGAN: Cell<Option<Instant>> = const { Cell::new(None) };
}

/// Returns the virtual time on the thread of a simulation; `None` on any other thread.
pub fn now() -> Option<Duration> {
    BEGAN.get().map(|began| began.elapsed())
}

pub(super) fn begin() -> Instant {
    let began = Instant::now();
    BEGAN.set(Some(began));
    began
}

/// Wants every event of the process. While there is one dispatcher only, `tracing` asks the default one
/// of the thread that comes to a callsite first: a thread that records nothing would switch it off for
/// the one that does.
static WANTS_ALL: LazyLock<Dispatch> = LazyLock::new(|| {
    Dispatch::new(Tee {
        recorder: Recorder::new(|_| ()),
        parent: Dispatch::none(),
    })
});

/// Receives each event when it happens, on the simulation's thread. Cheap to clone.
#[derive(Clone)]
pub struct Recorder {
    take: Arc<Mutex<dyn FnMut(Event) + Send>>,
}

impl Recorder {
    /// `take` must neither block nor write to the program's log.
    pub fn new(take: impl FnMut(Event) + Send + 'static) -> Recorder {
        Recorder {
            take: Arc::new(Mutex::new(take)),
        }
    }

    /// Creates a recorder that keeps all events, for reading after the run.
    pub fn keeping() -> (Recorder, Arc<Mutex<Vec<Event>>>) {
        let kept = Arc::new(Mutex::new(Vec::new()));
        let keep = kept.clone();
        let recorder = Recorder::new(move |event| {
            keep.lock().push(event);
        });
        (recorder, kept)
    }

    fn take(&self, event: Event) {
        let mut take = self.take.lock();
        take(event);
    }
}

/// Runs `work` on this thread, with its log events going to `parent` and to the recorder.
pub(super) fn with_recorder<T>(
    parent: Dispatch,
    recorder: Option<Recorder>,
    work: impl FnOnce() -> T,
) -> T {
    let dispatch = match recorder {
        Some(recorder) => {
            LazyLock::force(&WANTS_ALL);
            Dispatch::new(Tee { recorder, parent })
        }
        None => parent,
    };
    tracing::dispatcher::with_default(&dispatch, work)
}

/// A subscriber that forwards events to the recorder and to the parent.
struct Tee {
    recorder: Recorder,
    parent: Dispatch,
}

impl Subscriber for Tee {
    fn register_callsite(&self, _: &'static Metadata<'static>) -> Interest {
        // The parent's interest may change.
        Interest::sometimes()
    }

    fn max_level_hint(&self) -> Option<LevelFilter> {
        // The parent's hint is not available here; a higher one only costs extra checks.
        Some(LevelFilter::TRACE)
    }

    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        Event::is_wanted(metadata) || self.parent.enabled(metadata)
    }

    fn event(&self, event: &tracing::Event<'_>) {
        if Event::is_wanted(event.metadata()) {
            self.recorder
                .take(Event::from_tracing(now().unwrap_or_default(), event));
        }
        if self.parent.enabled(event.metadata()) {
            self.parent.event(event);
        }
    }

    fn new_span(&self, span: &Attributes<'_>) -> Id {
        self.parent.new_span(span)
    }

    fn record(&self, span: &Id, values: &Record<'_>) {
        self.parent.record(span, values);
    }

    fn record_follows_from(&self, span: &Id, follows: &Id) {
        self.parent.record_follows_from(span, follows);
    }

    fn enter(&self, span: &Id) {
        self.parent.enter(span);
    }

    fn exit(&self, span: &Id) {
        self.parent.exit(span);
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
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

/// One line of an event log: one flat JSON object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Event {
    /// Time since the start, in virtual time if there is any.
    #[serde(rename = "t", serialize_with = "seconds")]
    pub at: Duration,
    pub kind: EventKind,
    /// The log level: `debug`, `info`, `warn` or `error`.
    pub level: &'static str,
    /// Additional data; see [`EventKind`].
    #[serde(flatten)]
    pub fields: BTreeMap<&'static str, Value>,
    pub text: String,
}

fn seconds<S: Serializer>(at: &Duration, to: S) -> Result<S::Ok, S::Error> {
    to.serialize_f64(at.as_millis() as f64 / 1000.0)
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
