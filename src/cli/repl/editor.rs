//! The prompt. Runs on its own thread, so that a blocked terminal blocks nothing else.

use std::fs::{DirBuilder, OpenOptions};
use std::io::{self, BufRead, IsTerminal as _, Read as _, Write};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::Hinter;
use rustyline::history::FileHistory;
use rustyline::validate::Validator;
use rustyline::{CompletionType, Config, Context, Editor, ExternalPrinter, Helper};
use tokio::sync::mpsc;

use super::super::Console;
use crate::api;
use crate::sanitize;
use crate::script::MAX_SOURCE;

/// The prompts for a new input and for a continued one.
const PROMPTS: (&str, &str) = ("spykee> ", "     .. ");
/// Maximum number of inputs kept from one session to the next.
const MAX_HISTORY: usize = 1000;

const HELP: &str = "\
Type Lua. An expression prints its value; a call that takes time blocks the prompt.
  robot.forward(0.5)      drive half a metre
  robot.move(30, 30)      drive until the next command
  robot.battery().percent
Tab completes names. Ctrl-C stops the tracks, all tasks and handlers. Ctrl-D ends.
Global variables stay until the session ends; a `local` one ends with its line.
  :api NAME   describe a call, such as :api robot.move
  :help       show this text
  :quit       end the session";

#[derive(Debug)]
pub(super) enum Typed {
    /// All output is written and the prompt is about to be shown.
    Ready,
    Line {
        text: String,
        /// Whether the input may continue; false after an empty line.
        more: bool,
    },
    Interrupt,
    End,
}

#[derive(Debug)]
pub(super) enum EditorCommand {
    Print(String),
    /// Ask for a new input.
    Prompt,
    /// Ask for the rest of an input.
    Continue,
}

type Lines = Editor<Names, FileHistory>;

/// Runs the prompt until the input ends or the receiver is dropped.
pub(super) fn serve(
    typed: &mpsc::Sender<Typed>,
    commands: mpsc::Receiver<EditorCommand>,
    console: &Console,
) {
    let mut prompt = match open() {
        Ok(lines) => Prompt {
            lines,
            commands,
            history: None,
            interactive: io::stdin().is_terminal(),
            pending: String::new(),
        },
        Err(error) => {
            tracing::error!("cannot open the prompt: {error}");
            return;
        }
    };
    if io::stdin().is_terminal() {
        prompt.redirect_console(console);
        prompt.open_history();
        console.write_line("INFO", "Lua for the robot; :help shows help, Ctrl-D ends");
    }
    while prompt.wait() {
        if typed.blocking_send(Typed::Ready).is_err() {
            return;
        }
        let what = prompt.read();
        // Returning drops the printer above the prompt: later output through it would be lost.
        let ends = matches!(what, Typed::End);
        if typed.blocking_send(what).is_err() || ends {
            return;
        }
    }
}

fn open() -> rustyline::Result<Lines> {
    let config = Config::builder()
        .max_history_size(MAX_HISTORY)?
        .completion_type(CompletionType::List)
        .auto_add_history(false)
        .build();
    let mut lines = Lines::with_config(config)?;
    lines.set_helper(Some(Names::new()));
    Ok(lines)
}

struct Prompt {
    lines: Lines,
    commands: mpsc::Receiver<EditorCommand>,
    history: Option<PathBuf>,
    /// Whether a person types; otherwise lines come from a pipe.
    interactive: bool,
    /// The lines so far of a continued input.
    pending: String,
}

impl Prompt {
    /// Redirects the console's output above the prompt.
    fn redirect_console(&mut self, console: &Console) {
        match self.lines.create_external_printer() {
            Ok(printer) => console.redirect(Some(Box::new(AbovePrompt(printer)))),
            Err(error) => tracing::debug!("logs and the prompt share the terminal: {error}"),
        }
    }

    fn open_history(&mut self) {
        let Some(path) = history_path() else {
            return;
        };
        if let Err(error) = prepare_history(&path) {
            tracing::warn!("no history is kept in {}: {error}", path.display());
            return;
        }
        // If the history cannot be read, it starts empty.
        let _ = self.lines.load_history(&path);
        self.history = Some(path);
    }

    /// Prints output until the next input is due; false if none will be.
    fn wait(&mut self) -> bool {
        loop {
            match self.commands.blocking_recv() {
                Some(EditorCommand::Print(text)) => show(&text),
                Some(EditorCommand::Continue) => return true,
                Some(EditorCommand::Prompt) => {
                    self.pending.clear();
                    return true;
                }
                None => return false,
            }
        }
    }

    /// Reads until there is a message for the session; handles commands to the prompt itself here.
    /// An interruption discards the pending input.
    fn read(&mut self) -> Typed {
        loop {
            let prompt = if self.pending.is_empty() {
                PROMPTS.0
            } else {
                PROMPTS.1
            };
            let read = if self.interactive {
                self.lines.readline(prompt)
            } else {
                // Of a line that is too long, keeps only enough to detect that.
                bounded_line(&mut io::stdin().lock(), MAX_SOURCE + 1)
            };
            match read {
                Ok(line) => {
                    if let Some(typed) = self.line(&line) {
                        return typed;
                    }
                }
                Err(ReadlineError::Interrupted) => {
                    self.pending.clear();
                    return Typed::Interrupt;
                }
                Err(ReadlineError::Signal(_)) => {}
                Err(_) if !self.pending.is_empty() => {
                    let text = std::mem::take(&mut self.pending);
                    return Typed::Line { text, more: false };
                }
                Err(_) => return Typed::End,
            }
        }
    }

    fn line(&mut self, line: &str) -> Option<Typed> {
        let begins = self.pending.is_empty();
        if begins && line.trim().is_empty() {
            return None;
        }
        self.add_to_history(line);
        if begins && line.trim_start().starts_with(':') {
            return self.command(line.trim());
        }
        if self.pending.len() + line.len() > MAX_SOURCE {
            show("error: this input is too long");
            self.pending.clear();
            return None;
        }
        if !begins {
            self.pending.push('\n');
        }
        self.pending.push_str(line);
        let text = self.pending.clone();
        let more = !line.trim().is_empty();
        Some(Typed::Line { text, more })
    }

    fn add_to_history(&mut self, line: &str) {
        let Some(path) = &self.history else { return };
        let added = self.lines.add_history_entry(line).unwrap_or(false);
        if added && let Err(error) = self.lines.append_history(path) {
            tracing::debug!("this line is not in the history: {error}");
        }
    }

    fn command(&self, line: &str) -> Option<Typed> {
        match line
            .split_once(' ')
            .map_or((line, ""), |(a, b)| (a, b.trim()))
        {
            (":quit" | ":q", _) => return Some(Typed::End),
            (":help" | ":h", _) => show(HELP),
            (":api", "") => show("add a name, such as :api robot.move"),
            (":api", name) => match api::page(name) {
                Some(text) => show(&text),
                None => show(&format!(
                    "nothing in the API is called '{name}'; Tab completes names"
                )),
            },
            (other, _) => show(&format!(
                "there is no command {other}; use :help, :api NAME or :quit"
            )),
        }
        None
    }
}

/// Reads the next line without its line break, at most `most` bytes of it.
fn bounded_line(from: &mut impl BufRead, most: usize) -> rustyline::Result<String> {
    let mut line = Vec::new();
    let read = from
        .by_ref()
        .take(most as u64)
        .read_until(b'\n', &mut line)?;
    if read == 0 {
        return Err(ReadlineError::Eof);
    }
    if line.last() == Some(&b'\n') {
        line.pop();
    } else if read == most {
        from.skip_until(b'\n')?;
    }
    let line = String::from_utf8_lossy(&line);
    Ok(line.trim_end_matches('\r').to_owned())
}

/// Prints text. Ignores errors: a closed terminal cannot be reported.
fn show(text: &str) {
    let mut out = io::stdout().lock();
    let _ = writeln!(out, "{}", sanitize::text(text.trim_end(), false));
    let _ = out.flush();
}

/// Prints each record above the prompt.
struct AbovePrompt<P>(P);

impl<P: ExternalPrinter> Write for AbovePrompt<P> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes).into_owned();
        self.0.print(text).map_err(io::Error::other)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// The file that keeps typed lines: `$XDG_STATE_HOME/spykee/history`, or in `~/.local/state`;
/// `None` without a home.
fn history_path() -> Option<PathBuf> {
    let folder = |name| {
        let path = std::env::var_os(name).map(PathBuf::from);
        path.filter(|path| path.is_absolute())
    };
    let state = folder("XDG_STATE_HOME")
        .or_else(|| folder("HOME").map(|home| home.join(".local").join("state")))?;
    Some(state.join("spykee").join("history"))
}

/// Creates the file and its folder, readable only by this user.
fn prepare_history(path: &Path) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
    }
    let mut private = OpenOptions::new();
    private.create(true).append(true).mode(0o600);
    private.open(path).map(|_| ())
}

/// Keywords and common functions of the language.
const WORDS: [&str; 24] = [
    "and", "break", "continue", "do", "else", "elseif", "end", "false", "for", "function", "if",
    "in", "ipairs", "local", "nil", "not", "or", "pairs", "print", "repeat", "return", "then",
    "true", "while",
];

/// Completes names up to the cursor.
pub(super) struct Names(Vec<String>);

impl Names {
    pub(super) fn new() -> Names {
        let api = api::names().map(|(path, ..)| path);
        let words = WORDS.iter().map(|&word| word.to_owned());
        let mut names: Vec<String> = api.chain(words).collect();
        names.sort();
        names.dedup();
        Names(names)
    }

    /// Returns the start of the word before the cursor and its possible completions.
    fn candidates(&self, line: &str, cursor: usize) -> (usize, Vec<String>) {
        let before = line.get(..cursor).unwrap_or(line);
        let part = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.');
        let start = before.trim_end_matches(part).len();
        let word = &before[start..];
        if word.is_empty() {
            return (start, Vec::new());
        }
        let fits = self.0.iter().filter(|name| name.starts_with(word));
        (start, fits.cloned().collect())
    }
}

impl Completer for Names {
    type Candidate = String;

    fn complete(
        &self,
        line: &str,
        cursor: usize,
        _: &Context<'_>,
    ) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(self.candidates(line, cursor))
    }
}

impl Hinter for Names {
    type Hint = String;
}
impl Highlighter for Names {}
impl Validator for Names {}
impl Helper for Names {}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_piped_line_is_bounded_whatever_its_length() {
        let long = format!("one\r\n{}\n\nlast", "x".repeat(1_000_000));
        let mut from = io::BufReader::with_capacity(1000, long.as_bytes());
        let mut next = || bounded_line(&mut from, 4096).ok();
        assert_eq!(next().as_deref(), Some("one"));
        assert_eq!(next().map(|line| line.len()), Some(4096));
        assert_eq!(next().as_deref(), Some(""));
        assert_eq!(next().as_deref(), Some("last"));
        assert_eq!(next(), None);
    }

    #[test]
    fn names_of_the_api_are_completed_at_the_cursor() {
        let names = Names::new();
        let (start, found) = names.candidates("if robot.forw", 13);
        assert_eq!((start, found), (3, vec!["robot.forward".to_owned()]));
        let (_, found) = names.candidates("robot.", 6);
        assert!(found.contains(&"robot.move".to_owned()), "{found:?}");
        assert_eq!(names.candidates("", 0), (0, vec![]));
    }

    proptest! {
        #[test]
        fn no_line_causes_a_panic(line in ".{0,40}", cursor in 0..200_usize) {
            let (start, _) = Names::new().candidates(&line, cursor);
            prop_assert!(start <= line.len());
        }
    }
}
