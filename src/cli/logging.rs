//! Writes `tracing` records to the console, as text for people or JSON for programs.

use std::fmt;
use std::time::Instant;

use tracing::Dispatch;
use tracing::dispatcher::DefaultGuard;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::field::RecordFields;
use tracing_subscriber::fmt::FormatFields;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};
use tracing_subscriber::layer::SubscriberExt as _;

use super::Console;
use super::console::LogFormat;
use crate::live::{EventFields, LIGHTS_AND_SOUNDS, LogTap};
use crate::sanitize;
use crate::simulation;

/// The default filter: of other crates only warnings and errors.
const DEFAULT_FILTER: &str = "warn,spykee=info";

/// What is logged unless `RUST_LOG` says otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Detail {
    /// Everything that a person beside the robot would see and hear, too.
    Full,
    /// What a log of weeks needs: like the page's, without each light and sound.
    Service,
}

impl Detail {
    fn filter(self) -> EnvFilter {
        EnvFilter::new(match self {
            Detail::Full => DEFAULT_FILTER.to_owned(),
            Detail::Service => format!("{DEFAULT_FILTER},{LIGHTS_AND_SOUNDS}=warn"),
        })
    }
}

/// Starts logging. `RUST_LOG` overrides the filter; an invalid value is reported and the default
/// used. A second call changes nothing.
pub(super) fn start(console: &Console, format: LogFormat, detail: Detail) {
    let wanted = std::env::var("RUST_LOG")
        .ok()
        .filter(|text| !text.is_empty());
    let parsed = wanted.as_deref().map(EnvFilter::try_new).transpose();
    let complaint = parsed.as_ref().err().map(ToString::to_string);
    let filter = parsed.ok().flatten();
    let filter = filter.unwrap_or_else(|| detail.filter());
    let started = tracing::dispatcher::set_global_default(dispatch(console, format, filter));
    if let (Ok(()), Some(complaint)) = (started, complaint) {
        tracing::warn!("RUST_LOG is ignored: {complaint}; try RUST_LOG=debug or {DEFAULT_FILTER}");
    }
}

/// Logs only what this thread and its simulations do, until the guard is dropped.
pub(super) fn start_on_this_thread(
    console: &Console,
    format: LogFormat,
    detail: Detail,
) -> DefaultGuard {
    tracing::dispatcher::set_default(&dispatch(console, format, detail.filter()))
}

fn dispatch(console: &Console, format: LogFormat, filter: EnvFilter) -> Dispatch {
    let since = if console.has_status_line() {
        Some(Instant::now())
    } else {
        None
    };
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_timer(Clock { since })
        .with_writer(console.clone())
        .with_ansi(console.colour());
    match format {
        LogFormat::Text => subscriber
            .with_target(false)
            .fmt_fields(Plain)
            .finish()
            .with(LogTap)
            .into(),
        LogFormat::Json => subscriber
            .json()
            .flatten_event(true)
            .finish()
            .with(LogTap)
            .into(),
    }
}

/// The timestamps: virtual time inside a simulation, such as `+3725.040s`; on a terminal the time
/// since the start; UTC elsewhere.
struct Clock {
    since: Option<Instant>,
}

impl FormatTime for Clock {
    fn format_time(&self, writer: &mut Writer<'_>) -> fmt::Result {
        let since_start = || self.since.map(|start| start.elapsed());
        match simulation::now().or_else(since_start) {
            Some(time) => write!(writer, "+{:.3}s", time.as_secs_f64()),
            None => SystemTime.format_time(writer),
        }
    }
}

/// Fields that the agent adds to records: no message may look as if it had them.
const RESERVED: [&str; 3] = ["behaviour", "line", "reason"];

/// Formats the message, then `name=value` for each field, quoted so that neither can imitate the
/// other.
struct Plain;

impl<'writer> FormatFields<'writer> for Plain {
    fn format_fields<R: RecordFields>(
        &self,
        mut writer: Writer<'writer>,
        fields: R,
    ) -> fmt::Result {
        let mut event = EventFields::default();
        fields.record(&mut event);
        let names = event.fields.iter().map(|field| field.name);
        let mut parts = Vec::new();
        if let Some(message) = &event.message {
            let message = sanitize::text(message, false);
            parts.push(sanitize::message(&message, names.chain(RESERVED)));
        }
        let dimmed = |name: &str| {
            if writer.has_ansi_escapes() {
                format!("\x1b[3m{name}\x1b[0m\x1b[2m=\x1b[0m")
            } else {
                format!("{name}=")
            }
        };
        for field in &event.fields {
            let value = if field.is_text {
                format!("{:?}", field.value)
            } else {
                sanitize::value(&sanitize::text(&field.value, false))
            };
            parts.push(format!("{}{value}", dimmed(field.name)));
        }
        writer.write_str(&parts.join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::console::Collected;

    fn logged(log: impl FnOnce()) -> String {
        let output = Collected::default();
        let written = output.clone();
        let subscriber = tracing_subscriber::fmt()
            .with_writer(move || written.clone())
            .with_ansi(false)
            .with_target(false)
            .without_time()
            .fmt_fields(Plain)
            .finish();
        tracing::subscriber::with_default(subscriber, log);
        output.into_text().trim().to_owned()
    }

    #[test]
    fn plain_messages_and_values_are_not_quoted() {
        let line = logged(|| tracing::info!(behaviour = "a", line = Some(3), "speed=40"));
        assert_eq!(line, "INFO speed=40 behaviour=\"a\" line=3");
        let line = logged(|| tracing::info!(address = %"10.0.0.1:9000", battery = 7, "connected"));
        assert_eq!(line, "INFO connected address=10.0.0.1:9000 battery=7");
    }

    #[test]
    fn neither_a_message_nor_a_value_forges_a_field() {
        let forged = "hi behaviour=\"b\" line=1";
        let line = logged(|| tracing::info!(behaviour = "a", line = 3, "{forged}"));
        let quoted = "INFO \"hi behaviour=\\\"b\\\" line=1\"";
        assert_eq!(line, format!("{quoted} behaviour=\"a\" line=3"));
        assert_eq!(logged(|| tracing::info!("{forged}")), quoted);
        let line = logged(|| tracing::info!(uid = %"S battery=100", battery = 7, "connected"));
        assert_eq!(line, "INFO connected uid=\"S battery=100\" battery=7");
    }
}
