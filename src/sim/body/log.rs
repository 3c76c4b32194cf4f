//! The robot's own log, the content of LOG.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;

use crate::wire::Command;

/// Maximum number of lines kept.
const MAX_LINES: usize = 64;

/// The most recent lines, oldest first.
#[derive(Debug, Default)]
pub(super) struct RobotLog {
    lines: VecDeque<String>,
}

impl RobotLog {
    /// Adds a line.
    pub(super) fn write(&mut self, time: Duration, line: &str) {
        let seconds = time.as_secs_f64();
        tracing::debug!(target: "spykee::sim", seconds, "{line}");
        if self.lines.len() == MAX_LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(format!("[{seconds:.1}] {line}"));
    }

    /// Removes all lines.
    pub(super) fn clear(&mut self) {
        self.lines.clear();
    }

    /// Returns all lines in the format of LOG.
    pub(super) fn text(&self) -> Bytes {
        let lines: Vec<&str> = self.lines.iter().map(String::as_str).collect();
        Bytes::from(lines.join("\n"))
    }
}

/// Describes a command in one short line, without payloads, which may be long or secret.
pub(crate) fn describe(command: &Command) -> String {
    match command {
        Command::MotorSpeed(payload) => format!("motor speed ({} bytes)", payload.len()),
        Command::Mute(payload) => format!("mute ({} bytes)", payload.len()),
        Command::Unknown(packet) => {
            format!("type {} ({} bytes)", packet.kind, packet.payload.len())
        }
        other => format!("{other:?}"),
    }
}
