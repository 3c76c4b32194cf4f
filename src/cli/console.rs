//! The one thread that writes to stderr. Logging and status updates only enqueue:
//! a paused terminal, or a pipe without a reader, can stall this thread and no other.

use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use tokio::time::Instant;
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};

use super::LogFormat;
use super::screen::{Features, Screen};
use crate::budget::{Budget, Repeats};
use crate::config::{Logging, When};

/// Records that wait; what comes while so many wait is dropped and counted.
const MAX_WAITING: usize = 512;
/// The longest record; what is over is cut, or, as a JSON object cannot be cut, left out.
const MAX_RECORD_LEN: usize = 8 * 1024;
/// In place of a JSON record that was left out.
const TOO_LONG: &str = "a log line was dropped: it was too long";
/// A window of unknown width.
const DEFAULT_COLUMNS: usize = 80;
/// The longest wait to divert what is written.
const DIVERT_LIMIT: Duration = Duration::from_millis(500);
/// How often is said that lines are left out, if a day's bytes are used up.
const LEFT_OUT_EVERY: Duration = Duration::from_secs(60);
/// Between two tries to leave a note when ending.
const END_PAUSE: Duration = Duration::from_millis(5);

/// The way to stderr. Cheap to clone; nothing but [`Console::end`] ever waits.
#[derive(Clone)]
pub struct Console {
    notes: SyncSender<Note>,
    shared: Arc<Shared>,
    features: Features,
    format: LogFormat,
}

/// What the writing thread is told.
enum Note {
    Record(Vec<u8>),
    /// Why the program ends: shown whatever else was.
    LastWords(String),
    /// The newest status line stands in [`Shared`].
    Status,
    /// From now on everything goes there; `None`: to stderr again.
    Divert(Option<Box<dyn Write + Send>>),
    End(SyncSender<()>),
}

#[derive(Default)]
struct Shared {
    dropped: AtomicU64,
    /// Newest wins. Never locked while writing.
    status: Mutex<Option<String>>,
}

impl Console {
    /// Starts the thread that writes to stderr.
    ///
    /// # Errors
    /// When the system has no thread to give.
    pub fn start(format: LogFormat, logging: &Logging) -> io::Result<Console> {
        let features = features_of_stderr(format, logging.colour);
        let day = Budget::new(logging.bytes_a_day);
        Console::over(io::stderr(), features, stderr_columns, format, day)
    }

    fn over(
        out: impl Write + Send + 'static,
        features: Features,
        columns: fn() -> usize,
        format: LogFormat,
        day: Budget,
    ) -> io::Result<Console> {
        let (notes, inbox) = sync_channel(MAX_WAITING);
        let shared = Arc::new(Shared::default());
        let desk = Desk {
            out,
            diverted: None,
            screen: Screen::new(features),
            columns,
            shared: Arc::clone(&shared),
            format,
            day,
            left_out: Repeats::new(LEFT_OUT_EVERY),
        };
        thread::Builder::new()
            .name("console".into())
            .spawn(move || desk.serve(&inbox))?;
        Ok(Console {
            notes,
            shared,
            features,
            format,
        })
    }

    /// Whether log lines are to be coloured.
    pub fn colour(&self) -> bool {
        self.features.colour
    }

    /// Whether logs are for programs.
    pub fn is_json(&self) -> bool {
        self.format == LogFormat::Json
    }

    /// Whether there is a status line: stderr is a terminal and logs are text.
    pub fn has_status_line(&self) -> bool {
        self.features.redraw
    }

    /// Sets the status line. Without a terminal nothing happens: see [`Console::status_line_plain`].
    pub fn status(&self, text: impl Into<String>) {
        if !self.features.redraw {
            return;
        }
        *self
            .shared
            .status
            .lock()
            .unwrap_or_else(PoisonError::into_inner) = Some(text.into());
        // When full, what is served next redraws it.
        let _ = self.notes.try_send(Note::Status);
    }

    /// The status as a line of its own, for files and pipes; on a terminal nothing happens.
    pub fn status_line_plain(&self, text: &str) {
        if !self.features.redraw {
            self.say("INFO", text);
        }
    }

    /// A line beside the log, such as an error that ends the program. Under `--log-format json` an
    /// object with `level` and `message`, so that every line stays one.
    pub fn say(&self, level: &str, text: &str) {
        self.record(said(self.format, level, text).into_bytes());
    }

    /// Writes elsewhere from now on, such as above a prompt; `None`: to stderr again.
    pub fn divert(&self, to: Option<Box<dyn Write + Send>>) {
        let mut left = DIVERT_LIMIT;
        self.insist(Note::Divert(to), &mut left);
    }

    fn record(&self, mut record: Vec<u8>) {
        if record.len() > MAX_RECORD_LEN {
            match self.format {
                LogFormat::Text => record.truncate(MAX_RECORD_LEN),
                LogFormat::Json => record = said(self.format, "WARN", TOO_LONG).into_bytes(),
            }
        }
        if let Err(TrySendError::Full(_)) = self.notes.try_send(Note::Record(record)) {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Says the last words if there are any, takes the status line away and waits until all is
    /// written, at most `limit`.
    pub fn end(&self, last_words: Option<&str>, limit: Duration) {
        let mut left = limit;
        if let Some(text) = last_words {
            let record = said(self.format, "ERROR", text);
            self.insist(Note::LastWords(record), &mut left);
        }
        let (done, wait) = sync_channel(1);
        self.insist(Note::End(done), &mut left);
        let _ = wait.recv_timeout(left);
    }

    /// Leaves a note even if it takes a while.
    fn insist(&self, mut note: Note, left: &mut Duration) {
        while let Err(TrySendError::Full(back)) = self.notes.try_send(note) {
            let Some(less) = left.checked_sub(END_PAUSE) else {
                return;
            };
            thread::sleep(END_PAUSE);
            (note, *left) = (back, less);
        }
    }
}

fn said(format: LogFormat, level: &str, text: &str) -> String {
    match format {
        LogFormat::Text => text.to_owned(),
        LogFormat::Json => serde_json::json!({
            "timestamp": now(), "level": level, "message": text, "target": "spykee",
        })
        .to_string(),
    }
}

/// The time as the other lines of a JSON log have it.
fn now() -> String {
    let mut text = String::new();
    // Writing into a string cannot fail.
    let _ = SystemTime.format_time(&mut Writer::new(&mut text));
    text
}

/// The writing thread's side.
struct Desk<W> {
    out: W,
    diverted: Option<Box<dyn Write + Send>>,
    screen: Screen,
    columns: fn() -> usize,
    shared: Arc<Shared>,
    format: LogFormat,
    day: Budget,
    left_out: Repeats<()>,
}

impl<W: Write> Desk<W> {
    /// A broken stderr is no reason to end: notes are taken and go nowhere.
    fn serve(mut self, inbox: &Receiver<Note>) {
        while let Ok(note) = inbox.recv() {
            match note {
                Note::Record(record) => self.write(&String::from_utf8_lossy(&record)),
                Note::LastWords(text) => {
                    let line = self.screen.record(&text, (self.columns)());
                    self.put(line);
                }
                Note::Status => {}
                Note::Divert(to) => self.diverted = to,
                Note::End(done) => {
                    self.confess();
                    let last = self.screen.end();
                    self.put(last.to_owned());
                    let _ = done.try_send(());
                    continue;
                }
            }
            self.confess();
            self.redraw();
        }
    }

    /// A record, if the day's bytes allow it.
    fn write(&mut self, record: &str) {
        let text = self.screen.record(record, (self.columns)());
        let now = Instant::now();
        if self.day.take(text.len() as u64, now) {
            return self.put(text);
        }
        if let Some(before) = self.left_out.note((), now) {
            let words = format!(
                "log lines are left out, {before} before this one: {} bytes a day are used up",
                self.day.per_day()
            );
            let line = self
                .screen
                .record(&said(self.format, "WARN", &words), (self.columns)());
            self.put(line);
        }
    }

    fn redraw(&mut self) {
        let newest = self
            .shared
            .status
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .take();
        if let Some(text) = newest {
            let drawn = self.screen.status(&text, (self.columns)());
            self.put(drawn);
        }
    }

    /// Says how many records were dropped since the last time.
    fn confess(&mut self) {
        let dropped = self.shared.dropped.swap(0, Ordering::Relaxed);
        if dropped > 0 {
            let text = format!("{dropped} log lines were dropped: stderr is too slow");
            let line = self
                .screen
                .record(&said(self.format, "WARN", &text), (self.columns)());
            self.put(line);
        }
    }

    fn put(&mut self, text: String) {
        if !text.is_empty() {
            let out: &mut dyn Write = match &mut self.diverted {
                Some(out) => out,
                None => &mut self.out,
            };
            let _ = out.write_all(text.as_bytes());
            let _ = out.flush();
        }
    }
}

fn features_of_stderr(format: LogFormat, colour: When) -> Features {
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let redraw = io::stderr().is_terminal() && !dumb && format == LogFormat::Text;
    Features {
        redraw,
        colour: format == LogFormat::Text
            && match colour {
                When::Auto => redraw && !no_colour,
                When::Always => true,
                When::Never => false,
            },
    }
}

fn stderr_columns() -> usize {
    rustix::termios::tcgetwinsize(rustix::stdio::stderr())
        .ok()
        .map(|window| usize::from(window.ws_col))
        .filter(|&columns| columns > 0)
        .unwrap_or(DEFAULT_COLUMNS)
}

impl<'a> MakeWriter<'a> for Console {
    type Writer = Record<'a>;

    fn make_writer(&'a self) -> Record<'a> {
        Record {
            console: self,
            bytes: Vec::new(),
        }
    }
}

/// One log record in the making; sent when dropped.
pub struct Record<'a> {
    console: &'a Console,
    bytes: Vec<u8>,
}

impl Write for Record<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // One byte more than fits tells that it was too long.
        let room = (MAX_RECORD_LEN + 1).saturating_sub(self.bytes.len());
        self.bytes
            .extend_from_slice(&bytes[..bytes.len().min(room)]);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Record<'_> {
    fn drop(&mut self) {
        if !self.bytes.is_empty() {
            self.console.record(std::mem::take(&mut self.bytes));
        }
    }
}

#[cfg(test)]
mod tests;
