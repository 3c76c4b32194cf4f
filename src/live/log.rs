//! The program's log for people at the page: captured where it is written, and kept for a while in
//! bounded memory. Writing to the log never waits for this: lines that do not fit are dropped and
//! counted.

use std::collections::VecDeque;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::Serialize;
use tokio::sync::{broadcast, mpsc};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

const MAX_WAITING: usize = 512;
/// Number of lines kept for later viewers.
const KEPT: usize = 400;
/// Number of lines that a viewer may lag behind.
const BEHIND: usize = 256;
/// Maximum length of a line, in characters.
const LONGEST: usize = 2000;

/// Receives the lines, once the page is tapped into the log. The program has one log.
static TAP: OnceLock<mpsc::Sender<Line>> = OnceLock::new();
static DROPPED: AtomicU64 = AtomicU64::new(0);

/// A line of the log.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Line {
    /// Milliseconds since 1970.
    pub at: u64,
    /// `error`, `warn`, `info`, `debug` or `trace`.
    pub level: String,
    /// The behaviour, if a behaviour logged it.
    pub behaviour: Option<String>,
    /// The line of its script.
    pub line: Option<u64>,
    /// The text.
    pub text: String,
    /// Whether the log for later viewers begins with it.
    #[serde(skip)]
    begins: bool,
}

/// A tracing layer that copies log lines for the page.
#[derive(Debug, Clone, Copy, Default)]
pub struct LogTap;

/// Starts to copy log lines and returns them. Works once per process: `None` afterwards.
pub fn tap() -> Option<mpsc::Receiver<Line>> {
    let (lines, received) = mpsc::channel(MAX_WAITING);
    TAP.set(lines).ok().map(|()| received)
}

/// The module that logs lights and sounds. A patrol switches its light at every picture: of 4,196
/// lines, most were of these. The page draws them instead, and a service's log leaves them out.
pub const LIGHTS_AND_SOUNDS: &str = "spykee::pilot::status";
/// The target of a line with which the log begins anew: later viewers see nothing from before it.
pub const LOG_BEGINS: &str = "spykee::log_begins";

impl<S: Subscriber> Layer<S> for LogTap {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let Some(lines) = TAP.get() else {
            return;
        };
        if event.metadata().target() == LIGHTS_AND_SOUNDS {
            return;
        }
        let mut fields = EventFields::default();
        event.record(&mut fields);
        let mut line = Line::new(fields, *event.metadata().level());
        line.begins = event.metadata().target() == LOG_BEGINS;
        if lines.try_send(line).is_err() {
            DROPPED.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The message and the fields of a log event, as they were given.
#[derive(Default)]
pub struct EventFields {
    pub message: Option<String>,
    pub fields: Vec<EventField>,
}

pub struct EventField {
    pub name: &'static str,
    pub value: String,
    /// Whether the value is a text, not a number or something else with a form of its own.
    pub is_text: bool,
}

impl EventFields {
    fn add(&mut self, name: &'static str, value: String, is_text: bool) {
        if name == "message" {
            self.message = Some(value);
        } else {
            self.fields.push(EventField {
                name,
                value,
                is_text,
            });
        }
    }
}

impl Visit for EventFields {
    fn record_str(&mut self, field: &Field, value: &str) {
        self.add(field.name(), value.to_owned(), true);
    }

    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        self.add(field.name(), format!("{value:?}"), false);
    }
}

impl Line {
    fn new(event: EventFields, level: Level) -> Line {
        let mut line = Line {
            at: now(),
            level: level.as_str().to_lowercase(),
            behaviour: None,
            line: None,
            text: event.message.unwrap_or_default(),
            begins: false,
        };
        for EventField { name, value, .. } in event.fields {
            match name {
                "behaviour" => line.behaviour = Some(value),
                "line" => line.line = value.parse().ok(),
                _ if line.text.len() < 4 * LONGEST => line.text += &format!(" {name}={value}"),
                _ => {}
            }
        }
        if let Some((at, _)) = line.text.char_indices().nth(LONGEST) {
            line.text.truncate(at);
        }
        line
    }
}

/// Returns the time in milliseconds since 1970, for display.
pub(super) fn now() -> u64 {
    let since = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}

/// Keeps the newest lines and distributes new ones.
#[derive(Debug)]
pub(super) struct LogBuffer {
    kept: Mutex<VecDeque<Line>>,
    news: broadcast::Sender<Line>,
}

impl LogBuffer {
    pub(super) fn new() -> LogBuffer {
        LogBuffer {
            kept: Mutex::default(),
            news: broadcast::Sender::new(BEHIND),
        }
    }

    pub(super) async fn collect(&self, mut lines: mpsc::Receiver<Line>) {
        while let Some(line) = lines.recv().await {
            self.write(line);
            let missed = DROPPED.swap(0, Ordering::Relaxed);
            if missed > 0 {
                let text = format!("{missed} lines were dropped: they came too fast for the page");
                self.write(Line {
                    at: now(),
                    level: "warn".to_owned(),
                    behaviour: None,
                    line: None,
                    text,
                    begins: false,
                });
            }
        }
        std::future::pending().await
    }

    fn write(&self, line: Line) {
        let mut kept = self.kept.lock();
        if line.begins {
            kept.clear();
        } else if kept.len() == KEPT {
            kept.pop_front();
        }
        kept.push_back(line.clone());
        // Fails without viewers. Sent under the lock, so that no viewer sees a line twice or misses
        // one.
        let _ = self.news.send(line);
    }

    pub(super) fn read(&self) -> (Vec<Line>, broadcast::Receiver<Line>) {
        let kept = self.kept.lock();
        (kept.iter().cloned().collect(), self.news.subscribe())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(text: &str) -> Line {
        Line {
            at: 0,
            level: "info".to_owned(),
            behaviour: None,
            line: None,
            text: text.to_owned(),
            begins: false,
        }
    }

    #[test]
    fn the_newest_lines_are_kept_and_slow_viewers_learn_how_many_they_missed() {
        let log_buffer = LogBuffer::new();
        let (none, mut slow) = log_buffer.read();
        assert!(none.is_empty());
        (0..KEPT + 7).for_each(|number| log_buffer.write(line(&number.to_string())));
        let (kept, _) = log_buffer.read();
        assert_eq!((kept.len(), &*kept[0].text), (KEPT, "7"));
        let lagged = slow.try_recv().unwrap_err();
        let missed = (KEPT + 7 - BEHIND) as u64;
        assert_eq!(lagged, broadcast::error::TryRecvError::Lagged(missed));
        let begins = Line {
            begins: true,
            ..line("of another person")
        };
        log_buffer.write(begins.clone());
        assert_eq!(log_buffer.read().0, [begins]);
    }

    #[test]
    fn a_line_has_behaviour_position_and_fields_and_is_bounded() {
        let mut event = EventFields::default();
        event.add("message", "hello".to_owned(), false);
        event.add("behaviour", "patrol".to_owned(), true);
        event.add("line", "12".to_owned(), false);
        event.add("legs", "3".to_owned(), false);
        let read = Line::new(event, Level::WARN);
        assert_eq!(
            (&*read.level, read.line, &*read.text),
            ("warn", Some(12), "hello legs=3")
        );
        assert_eq!(read.behaviour.as_deref(), Some("patrol"));
        let mut event = EventFields::default();
        event.add("message", "ä".repeat(3 * LONGEST), false);
        assert_eq!(Line::new(event, Level::INFO).text.chars().count(), LONGEST);
    }
}
