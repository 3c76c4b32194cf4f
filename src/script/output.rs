//! What a host sends to the agent: the script's output and the host's own messages.

use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use super::failure::{ScriptExit, printable};
use super::modules::ModuleName;
use super::options::{Limits, NOTICES_A_DAY};
use crate::rate_limit::TokenBucket;
use crate::robot::{DeclaredParam, Detection, HostReport, Intent};

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

/// The script's daily limits for what it sends to people besides its log: journal entries with the
/// names of pictures, and messages. The agent enforces the same limits.
#[derive(Debug)]
pub(crate) struct DailyLimits {
    bytes: TokenBucket,
    notices: TokenBucket,
}

impl DailyLimits {
    pub(crate) fn new(limits: &Limits) -> DailyLimits {
        DailyLimits {
            bytes: TokenBucket::a_day(limits.journal_bytes_a_day()),
            notices: TokenBucket::a_day(NOTICES_A_DAY),
        }
    }

    /// Takes the share of a journal entry with texts of this many bytes; `false` if too little is
    /// left today.
    pub(crate) fn take_entry(&mut self, length: usize, now: Instant) -> bool {
        self.bytes.take((OVERHEAD + length) as f64, now)
    }

    /// Takes the share of one message; `false` if none is left.
    pub(crate) fn take_notice(&mut self, now: Instant) -> bool {
        self.notices.take(1.0, now)
    }
}
