//! Logs: what `tracing` records, as text for people or JSON for programs, through the console.

use std::fmt;
use std::time::Instant;

use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};

use super::{Console, LogFormat};
use crate::config::{Level, Time};
use crate::lab;

/// Without `RUST_LOG`: our own doings from the config's level on, and what worries others.
fn usual(level: Level) -> &'static str {
    match level {
        Level::Error => "error",
        Level::Warn => "warn",
        Level::Info => "warn,spykee=info",
        Level::Debug => "warn,spykee=debug",
    }
}

/// Logs from now on. `RUST_LOG` chooses what is logged; one that cannot be read is named and the
/// default taken. A second call changes nothing.
pub(super) fn start(console: &Console, format: LogFormat, level: Level, time: Time) {
    let wanted = std::env::var("RUST_LOG")
        .ok()
        .filter(|text| !text.is_empty());
    let parsed = wanted.as_deref().map(EnvFilter::try_new).transpose();
    let complaint = parsed.as_ref().err().map(ToString::to_string);
    let filter = parsed
        .ok()
        .flatten()
        .unwrap_or_else(|| EnvFilter::new(usual(level)));
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_timer(Clock::new(time, console.has_status_line()))
        .with_writer(console.clone())
        .with_ansi(console.colour());
    let started = match format {
        LogFormat::Text => {
            tracing::subscriber::set_global_default(subscriber.with_target(false).finish())
        }
        LogFormat::Json => {
            tracing::subscriber::set_global_default(subscriber.json().flatten_event(true).finish())
        }
    };
    if let (Ok(()), Some(complaint)) = (started, complaint) {
        tracing::warn!(
            "RUST_LOG is ignored: {complaint}; try RUST_LOG=debug or {}",
            usual(level)
        );
    }
}

/// Virtual time where there is any, such as `+3725.040s`; else the time of the config's choice.
struct Clock {
    started: Instant,
    time: Time,
}

impl Clock {
    fn new(time: Time, terminal: bool) -> Clock {
        let time = match (time, terminal) {
            (Time::Auto, true) => Time::Run,
            (Time::Auto, false) => Time::Utc,
            (time, _) => time,
        };
        let started = Instant::now();
        Clock { started, time }
    }
}

impl FormatTime for Clock {
    fn format_time(&self, writer: &mut Writer<'_>) -> fmt::Result {
        let run = lab::now().or_else(|| (self.time == Time::Run).then(|| self.started.elapsed()));
        match run {
            Some(time) => write!(writer, "+{:.3}s", time.as_secs_f64()),
            None if self.time == Time::Local => {
                let now = chrono::Local::now();
                write!(writer, "{}", now.format("%Y-%m-%dT%H:%M:%S%.3f%:z"))
            }
            None => SystemTime.format_time(writer),
        }
    }
}
