//! How a script fails and ends, and messages about it for people: where, what, and what to do.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;
use std::time::Duration;

use mlua::prelude::LuaError;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use crate::robot::EndReason;

/// The longest error text, in characters.
const LONGEST: usize = 1000;

/// The message for a script that has misused a task's coroutine, obtained from
/// `coroutine.running()`.
const RESUMED_BY_OTHERS: &str = "a task's coroutine was resumed or closed by the script; \
    end a task with task:cancel(), and resume only what coroutine.create has made";

/// The prelude's name in stack frames.
pub(super) const PRELUDE: &str = "spykee";

const MARK: &str = ": 0x";
/// Digits of an address: some of Luau's functions print leading zeros, some do not.
const DIGITS: std::ops::RangeInclusive<usize> = 11..=16;
/// Number of places whose failures are counted; failures of further places are logged each time.
const MAX_PLACES: usize = 256;

/// Whether a stack frame does not belong to the script: it is in the prelude, in the VM's binding,
/// or in a built-in module.
pub(super) fn is_runtime_frame(source: &str) -> bool {
    source == PRELUDE || source.starts_with("__mlua") || source.starts_with("@spykee/")
}

/// Why a file cannot be run at all.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
pub enum Failure {
    #[error("{chunk}: the file has {bytes} bytes; a script may have 262144 (256 KiB)")]
    TooLarge { chunk: String, bytes: usize },
    #[error("{chunk}:{line}: this is not UTF-8 text; save the file as UTF-8")]
    NotUtf8 {
        chunk: String,
        /// The line of the first wrong byte.
        line: usize,
    },
    #[error(
        "{chunk}:{line}: control character {byte:#04x}; a script is plain text, compiled code is not accepted"
    )]
    Control {
        chunk: String,
        line: usize,
        byte: u8,
    },
    /// The compiler's error message, with file and line.
    #[error("{0}")]
    Syntax(String),
    #[error("{chunk}: the script cannot be started: {reason}")]
    Machine { chunk: String, reason: String },
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScriptExit {
    pub reason: EndReason,
    /// For people: file, line, what happened and what to do; or the text of `script.stop`.
    pub message: Option<String>,
}

impl ScriptExit {
    /// The message, or the reason in words.
    pub fn text(&self) -> &str {
        self.message.as_deref().unwrap_or(self.reason.sentence())
    }
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct SourceLocation {
    pub file: String,
    pub line: u32,
}

impl fmt::Display for SourceLocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.file, self.line)
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum VmError {
    Memory,
    /// An error, converted to one short text.
    Text(String),
}

impl VmError {
    /// Converts an error of the VM. The VM's error objects can be chains of any depth: they are
    /// walked with a limit and never formatted with `Display`.
    pub(super) fn from_lua(error: &LuaError) -> VmError {
        let mut error = error;
        for _ in 0..32 {
            match error {
                LuaError::MemoryError(_) => return VmError::Memory,
                LuaError::CallbackError { cause, .. } => error = cause,
                LuaError::RuntimeError(text) | LuaError::SyntaxError { message: text, .. } => {
                    return VmError::Text(from_traceback(text));
                }
                LuaError::CoroutineUnresumable => {
                    return VmError::Text(RESUMED_BY_OTHERS.to_owned());
                }
                _ => break,
            }
        }
        VmError::Text("an error of the VM without a message".to_owned())
    }

    /// The error's text, or these words if the memory was not enough.
    pub(super) fn text_or(self, words: &str) -> String {
        match self {
            VmError::Memory => words.to_owned(),
            VmError::Text(text) => text,
        }
    }
}

/// Extracts the message of an error that has a stack trace. For an error raised inside the prelude,
/// the place is replaced by the line of the script that called it.
fn from_traceback(text: &str) -> String {
    let (message, trace) = text
        .split_once("\nstack traceback:\n")
        .unwrap_or((text, ""));
    let inside = message
        .split_once(':')
        .filter(|(file, _)| is_runtime_frame(file))
        .and_then(|(_, rest)| rest.split_once(": "));
    let message = match (inside, first_place(trace)) {
        (Some((_, words)), Some(location)) => format!("{location}: {words}"),
        (Some((_, words)), None) => words.to_owned(),
        (None, Some(location)) if !has_location(message) => format!("{location}: {message}"),
        (None, _) => message.to_owned(),
    };
    printable(&message, LONGEST)
}

/// `file:line` of the first frame of a stack trace that is not the prelude's or in C.
fn first_place(trace: &str) -> Option<&str> {
    trace.lines().map(str::trim).find_map(|line| {
        let end = line.find(' ').unwrap_or(line.len());
        let location = line.get(..end)?.trim_end_matches(':');
        let (file, number) = location.rsplit_once(':')?;
        let is_script_frame = !is_runtime_frame(file) && !file.starts_with('[');
        (is_script_frame && number.parse::<u32>().is_ok()).then_some(location)
    })
}

/// Whether a message begins with `file:line: `.
fn has_location(message: &str) -> bool {
    let location = message.split(": ").next().unwrap_or_default();
    let line = location.rsplit_once(':').map(|(_, line)| line);
    line.is_some_and(|line| line.parse::<u32>().is_ok())
}

/// Returns at most `longest` characters of the text. Removes control characters other than line
/// feed and tab, so that a script cannot control the terminal, and addresses, so that equal runs
/// have equal output.
pub(crate) fn printable(text: &str, longest: usize) -> String {
    let text = without_addresses(text);
    let safe = |c: &char| !c.is_control() || matches!(c, '\n' | '\t');
    let mut kept: String = text.chars().filter(safe).take(longest + 1).collect();
    if let Some((cut, _)) = kept.char_indices().nth(longest) {
        kept.truncate(cut);
        kept.push('…');
    }
    kept
}

/// Returns the text with `table` in place of `table: 0x00007f42c8a0b3d0`.
pub(super) fn without_addresses(text: &str) -> Cow<'_, str> {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(MARK) {
        let (before, marked) = rest.split_at(at);
        let digits = marked[MARK.len()..]
            .bytes()
            .take_while(u8::is_ascii_hexdigit)
            .count();
        out.push_str(before);
        if DIGITS.contains(&digits) && ends_with_type_name(before) {
            rest = &marked[MARK.len() + digits..];
        } else {
            out.push_str(MARK);
            rest = &marked[MARK.len()..];
        }
    }
    if out.is_empty() && rest.len() == text.len() {
        return Cow::Borrowed(text);
    }
    out.push_str(rest);
    Cow::Owned(out)
}

/// Whether the last word is a Luau type, or one of our objects, whose names are capitalised.
fn ends_with_type_name(before: &str) -> bool {
    let word = before
        .rsplit(|letter: char| !letter.is_ascii_alphanumeric())
        .next();
    let word = word.unwrap_or_default();
    matches!(
        word,
        "table" | "function" | "thread" | "userdata" | "buffer"
    ) || word.starts_with(|letter: char| letter.is_ascii_uppercase())
}

/// Explains the VM's text of a failure, such as `a.lua:3: attempt to index nil`, in plain words.
/// Returns `None` if the failure is not in the file `chunk`, or if there is nothing to add.
pub type Explain = fn(text: &str, chunk: &str, source: &str) -> Option<String>;

/// How often failures of the script are logged: explained the first time, then ever more rarely for
/// the same place.
#[derive(Default)]
pub(super) struct FailureLog {
    pub(super) explain: Option<Explain>,
    pub(super) source: String,
    counts: BTreeMap<String, u64>,
}

impl FailureLog {
    /// Counts a failure at the place that its text begins with, and returns how often it has
    /// happened there; `None` if it happens at too many places to count.
    pub(super) fn count(&mut self, text: &str) -> Option<u64> {
        let location = text.split(": ").next().unwrap_or(text);
        if !self.counts.contains_key(location) && self.counts.len() >= MAX_PLACES {
            return None;
        }
        let count = self.counts.entry(location.to_owned()).or_default();
        *count += 1;
        Some(*count)
    }
}

#[derive(Debug)]
pub(super) enum Life {
    Running,
    /// The last half second, in which the script may clean up.
    Stopping {
        exit: ScriptExit,
        deadline: Instant,
        /// Real time that its slices took; needed since the clock of the deadline may be virtual
        /// and stand still.
        spent: Duration,
    },
    Ended(ScriptExit),
}

/// Whether a script that ends for this reason must not run another line.
pub(super) fn is_kill(reason: EndReason) -> bool {
    matches!(
        reason,
        EndReason::Cpu | EndReason::Memory | EndReason::Safety
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_in_the_prelude_is_replaced_by_the_line_of_the_script() {
        let text = "spykee:12: attempt to compare nil < number\nstack traceback:\n\tspykee:12: in function 'less'\n\t[C]: in function 'sort'\n\tspykee:40\n\ta.lua:3: in function 'main'";
        assert_eq!(
            from_traceback(text),
            "a.lua:3: attempt to compare nil < number"
        );
    }

    #[test]
    fn texts_cannot_control_the_terminal() {
        assert_eq!(printable("a\x1b[31mb\u{9b}c\n\td", 20), "a[31mbc\n\td");
        assert_eq!(printable("abcdef", 3), "abc…");
    }

    #[test]
    fn error_chains_are_walked_to_their_cause() {
        let mut error = LuaError::MemoryError("x".to_owned());
        for _ in 0..10 {
            #[expect(clippy::arc_with_non_send_sync, reason = "the library's own type")]
            let cause = std::sync::Arc::new(error);
            error = LuaError::CallbackError {
                traceback: String::new(),
                cause,
            };
        }
        assert_eq!(VmError::from_lua(&error), VmError::Memory);
    }

    #[test]
    fn addresses_of_values_are_removed_and_other_hex_numbers_stay() {
        for (text, shown) in [
            ("table: 0x00007fa3d80b2b70", "table"),
            ("a.lua:3: table: 0x7fa3d80b2a50", "a.lua:3: table"),
            (
                "{} function: 0x00007fa3d8099520 Task: 0x00007fa3d80b2bb0 x",
                "{} function Task x",
            ),
            ("id: 0x00007fa3d8099520", "id: 0x00007fa3d8099520"),
            ("table: 0xff", "table: 0xff"),
            ("table: 0x00007fa3d80b2b7000", "table: 0x00007fa3d80b2b7000"),
            ("table: 0xtable: 0x00007fa3d80b2b70", "table: 0xtable"),
            (": 0x", ": 0x"),
            ("", ""),
        ] {
            assert_eq!(without_addresses(text), shown);
        }
    }
}
