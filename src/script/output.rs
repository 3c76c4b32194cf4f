//! What a script sends out: intents and log lines, both bounded.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use super::Script;
use super::failure::printable;
use super::modules::ModuleName;
use crate::robot::{Intent, Knob, Remark};

/// Intents that may wait to be taken.
const MAX_INTENTS: usize = 256;
/// Bytes of `Intent::Say` that may wait to be taken.
const MAX_SPEECH: usize = 256 * 1024;
/// Log lines of one [`WINDOW`]; further ones are counted.
const MAX_LINES: u32 = 100;
/// See [`MAX_LINES`].
const WINDOW: Duration = Duration::from_secs(1);
/// The longest log text, in characters.
const LONGEST_TEXT: usize = 1024;

/// What a script sends out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Output {
    /// Something that the robot is to do.
    Intent(Intent),
    /// A line for the log.
    Log(LogLine),
    /// What it has done or wants that is not the robot's.
    Remark(Remark),
    /// Its parameters as they are now.
    Params(Vec<Knob>),
    /// What became of the line that a person typed.
    Evaluated(Evaluated),
    /// The file of this module is wanted: see [`Script::deliver_module`](super::Script::deliver_module).
    Module(ModuleName),
}

/// What became of a line that a person typed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Evaluated {
    /// It ran; its values in the order of Lua, as text for people. None for a statement.
    Values(Vec<String>),
    /// It is the beginning of something: the next line belongs to it.
    Incomplete,
    /// It is wrong, or it failed; in words.
    Failed(String),
    /// It was interrupted.
    Cancelled,
}

/// How much a log line matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Level {
    /// `log.debug`
    Debug,
    /// `log.info` and `print`
    Info,
    /// `log.warn`
    Warn,
    /// `log.error`
    Error,
}

/// A line for the log. Its texts have no control characters but line feed and tab, and at most a
/// few kilobytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LogLine {
    /// How much it matters.
    pub level: Level,
    /// What it says.
    pub text: String,
    /// Further values, by name.
    pub fields: Vec<(String, String)>,
    /// The script's line that wrote it.
    pub line: Option<u32>,
}

impl LogLine {
    pub(super) fn new(level: Level, text: &str) -> LogLine {
        LogLine {
            level,
            text: printable(text, LONGEST_TEXT),
            fields: Vec::new(),
            line: None,
        }
    }
}

impl Script {
    /// What the script wants said and done since the last call, in order. Bounded: a script that
    /// floods gets errors, and its log lines are folded.
    pub fn take_output(&mut self) -> Vec<Output> {
        self.state.borrow_mut().output.take()
    }
}

/// What waits to be taken.
#[derive(Debug)]
pub(super) struct OutputQueue {
    waiting: Vec<Output>,
    intents: usize,
    speech: usize,
    window: Instant,
    lines: u32,
    folded: u32,
}

/// So much had been sent when a slice began.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark(usize);

impl OutputQueue {
    pub(super) fn new(now: Instant) -> OutputQueue {
        OutputQueue {
            waiting: Vec::new(),
            intents: 0,
            speech: 0,
            window: now,
            lines: 0,
            folded: 0,
        }
    }

    /// Whether there is room for one more intent with `speech` bytes.
    pub(super) fn has_room(&self, speech: usize) -> bool {
        self.intents < MAX_INTENTS && self.speech + speech <= MAX_SPEECH
    }

    /// Sends, also where there is no room: for what the runtime itself has to say.
    pub(super) fn send(&mut self, intent: Intent) {
        self.intents += 1;
        if let Intent::Say(samples) = &intent {
            self.speech += samples.len();
        }
        self.waiting.push(Output::Intent(intent));
    }

    /// Sends a stop, however many intents wait; one directly behind another says nothing new.
    pub(super) fn send_stop(&mut self) {
        if self.waiting.last() != Some(&Output::Intent(Intent::Stop)) {
            self.send(Intent::Stop);
        }
    }

    /// Asks for a module; of those there are few.
    pub(super) fn ask(&mut self, name: ModuleName) {
        self.waiting.push(Output::Module(name));
    }

    /// Logs, or counts if there were too many lines this second.
    pub(super) fn log(&mut self, line: LogLine, now: Instant) {
        self.unfold(now);
        if self.lines < MAX_LINES {
            self.lines += 1;
            self.waiting.push(Output::Log(line));
        } else {
            self.folded += 1;
        }
    }

    /// For those who want to know; the caller has bounded it.
    pub(super) fn remark(&mut self, remark: Remark) {
        self.waiting.push(Output::Remark(remark));
    }

    /// For those who want to know; only the newest counts.
    pub(super) fn params(&mut self, knobs: Vec<Knob>) {
        self.waiting
            .retain(|output| !matches!(output, Output::Params(_)));
        self.waiting.push(Output::Params(knobs));
    }

    /// Tells what became of a person's line.
    pub(super) fn answer(&mut self, evaluated: Evaluated) {
        self.waiting.push(Output::Evaluated(evaluated));
    }

    /// Says how many lines were left out, once their second is over.
    pub(super) fn unfold(&mut self, now: Instant) {
        if now.saturating_duration_since(self.window) >= WINDOW {
            self.window = now;
            self.lines = 0;
            self.say_folded();
        }
    }

    /// When [`OutputQueue::unfold`] has something to say.
    pub(super) fn unfolds_at(&self) -> Option<Instant> {
        (self.folded > 0).then(|| self.window + WINDOW)
    }

    /// Says how many lines were left out.
    pub(super) fn say_folded(&mut self) {
        if self.folded > 0 {
            let text = format!("... and {} more lines", self.folded);
            let line = LogLine::new(Level::Warn, &text);
            self.waiting.push(Output::Log(line));
            self.folded = 0;
        }
    }

    pub(super) fn mark(&self) -> Mark {
        Mark(self.waiting.len())
    }

    /// Takes back the intents sent since `mark`.
    pub(super) fn withdraw_since(&mut self, mark: Mark) {
        let mut index = 0;
        self.waiting.retain(|output| {
            index += 1;
            let happened = matches!(
                output,
                Output::Log(_) | Output::Params(_) | Output::Remark(Remark::Picture { .. })
            );
            index <= mark.0 || happened
        });
    }

    pub(super) fn take(&mut self) -> Vec<Output> {
        self.intents = 0;
        self.speech = 0;
        std::mem::take(&mut self.waiting)
    }
}
