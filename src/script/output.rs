//! What a host sends to the agent: the script's output, intents and log lines, both bounded, and
//! the host's own messages.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use super::failure::{ScriptExit, printable};
use super::modules::ModuleName;
use super::options::{Limits, NOTICES_A_DAY};
use crate::rate_limit::Budget;
use crate::robot::{DeclaredParam, Detection, HostReport, Intent};

const MAX_INTENTS: usize = 256;
/// Largest number of bytes of `Intent::Say` in the queue.
const MAX_SPEECH: usize = 256 * 1024;
/// Largest number of log lines in one [`WINDOW`]; further ones are dropped and counted.
const MAX_LINES: u32 = 100;
/// The period of [`MAX_LINES`].
const WINDOW: Duration = Duration::from_secs(1);
const LONGEST_TEXT: usize = 1024;

/// The longest `kind` of an entry, in bytes.
pub(crate) const MAX_KIND: usize = 40;
/// The longest entry, in bytes of JSON.
pub(crate) const MAX_ENTRY: usize = 4096;
/// The longest message, in bytes.
pub(crate) const MAX_NOTICE: usize = 1000;
/// Bytes of a journal entry besides its texts.
const OVERHEAD: usize = 100;

/// From the host to the agent. Each of them is a sign of life. Those from [`FromHost::Intent`] to
/// [`FromHost::Module`] are the script's output, the others the host's own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum FromHost {
    /// A command for the robot.
    Intent(Intent),
    Log(LogLine),
    /// Something that the script has done or wants and that does not concern the robot.
    HostReport(HostReport),
    Params(Vec<DeclaredParam>),
    /// The result of a line that a person typed.
    Evaluated(Evaluated),
    /// A request for the file of this module: see
    /// [`Script::deliver_module`](super::Script::deliver_module).
    Module(ModuleName),
    /// Loaded without an error.
    Ready,
    /// A sign of life, without further content.
    Alive,
    /// Requests one frame newer than the last, as soon as there is one.
    WantFrame {
        /// The last frame was damaged: the one before it is also acceptable.
        damaged: bool,
    },
    /// The objects that the script found in a frame, for viewers.
    Found {
        frame: u64,
        list: Vec<Detection>,
    },
    Ended(ScriptExit),
}

/// The result of a line that a person typed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Evaluated {
    /// It ran; its values in their order in Lua, as text for people. Empty for a statement.
    Values(Vec<String>),
    /// It is incomplete: the next line continues it.
    Incomplete,
    /// It does not compile, or it failed; with the message.
    Failed(String),
    Cancelled,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Level {
    Debug,
    Info,
    Warn,
    Error,
}

/// A line for the log. Its texts have no control characters except line feed and tab, and at most a
/// few kilobytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogLine {
    pub level: Level,
    pub text: String,
    /// Further values, by name.
    pub fields: Vec<(String, String)>,
    pub line: Option<u32>,
}

impl LogLine {
    pub(crate) fn new(level: Level, text: &str) -> LogLine {
        LogLine {
            level,
            text: printable(text, LONGEST_TEXT),
            fields: Vec::new(),
            line: None,
        }
    }
}

#[derive(Debug)]
pub(super) struct OutputQueue {
    waiting: Vec<FromHost>,
    intents: usize,
    speech: usize,
    window: Instant,
    lines: u32,
    dropped: u32,
}

impl OutputQueue {
    pub(super) fn new(now: Instant) -> OutputQueue {
        OutputQueue {
            waiting: Vec::new(),
            intents: 0,
            speech: 0,
            window: now,
            lines: 0,
            dropped: 0,
        }
    }

    /// Whether there is room for one more intent with `speech` bytes.
    pub(super) fn has_room(&self, speech: usize) -> bool {
        self.intents < MAX_INTENTS && self.speech + speech <= MAX_SPEECH
    }

    /// Queues an intent even if the queue is full: for intents of the runtime itself.
    pub(super) fn send(&mut self, intent: Intent) {
        self.intents += 1;
        if let Intent::Say(samples) = &intent {
            self.speech += samples.len();
        }
        self.waiting.push(FromHost::Intent(intent));
    }

    /// Queues a stop, even if the queue is full; a second stop directly after another is dropped.
    pub(super) fn send_stop(&mut self) {
        if self.waiting.last() != Some(&FromHost::Intent(Intent::Stop)) {
            self.send(Intent::Stop);
        }
    }

    /// Queues output whose number the caller bounds.
    pub(super) fn push(&mut self, output: FromHost) {
        self.waiting.push(output);
    }

    /// Queues a log line, or counts it if there were too many lines this second.
    pub(super) fn log(&mut self, line: LogLine, now: Instant) {
        self.roll_window(now);
        if self.lines < MAX_LINES {
            self.lines += 1;
            self.waiting.push(FromHost::Log(line));
        } else {
            self.dropped += 1;
        }
    }

    pub(super) fn params(&mut self, params: Vec<DeclaredParam>) {
        self.waiting
            .retain(|output| !matches!(output, FromHost::Params(_)));
        self.waiting.push(FromHost::Params(params));
    }

    /// Starts a new period once the last one is over, and reports how many lines were dropped in
    /// it.
    pub(super) fn roll_window(&mut self, now: Instant) {
        if now.saturating_duration_since(self.window) >= WINDOW {
            self.window = now;
            self.lines = 0;
            self.report_dropped();
        }
    }

    /// When [`OutputQueue::roll_window`] has something to report.
    pub(super) fn window_end(&self) -> Option<Instant> {
        (self.dropped > 0).then(|| self.window + WINDOW)
    }

    pub(super) fn report_dropped(&mut self) {
        if self.dropped > 0 {
            let text = format!("... and {} more lines", self.dropped);
            let line = LogLine::new(Level::Warn, &text);
            self.waiting.push(FromHost::Log(line));
            self.dropped = 0;
        }
    }

    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Removes all but the first `kept` items, except log lines, parameters and saved pictures: those
    /// have already happened.
    pub(super) fn withdraw_after(&mut self, kept: usize) {
        let mut index = 0;
        self.waiting.retain(|output| {
            index += 1;
            let happened = matches!(
                output,
                FromHost::Log(_)
                    | FromHost::Params(_)
                    | FromHost::HostReport(HostReport::Picture { .. })
            );
            index <= kept || happened
        });
    }

    pub(super) fn take(&mut self) -> Vec<FromHost> {
        self.intents = 0;
        self.speech = 0;
        std::mem::take(&mut self.waiting)
    }
}

/// The script's daily limits for what it sends to people besides its log: journal entries with the
/// names of pictures, and messages. The agent enforces the same limits.
#[derive(Debug)]
pub(crate) struct DailyLimits {
    bytes: Budget,
    notices: Budget,
}

impl DailyLimits {
    pub(crate) fn new(limits: &Limits) -> DailyLimits {
        DailyLimits {
            bytes: Budget::new(limits.journal_bytes_a_day()),
            notices: Budget::new(NOTICES_A_DAY),
        }
    }

    /// Takes the share of a journal entry with texts of this many bytes; `false` if too little is
    /// left today.
    pub(crate) fn take_entry(&mut self, length: usize, now: Instant) -> bool {
        self.bytes.take((OVERHEAD + length) as u64, now)
    }

    /// Takes the share of one message; `false` if none is left.
    pub(crate) fn take_notice(&mut self, now: Instant) -> bool {
        self.notices.take(1, now)
    }
}
