//! The thread that writes to stderr. Logging and status updates only enqueue:
//! a paused terminal, or a pipe without a reader, can stall only this thread.

use std::io::{self, IsTerminal, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread;
use std::time::Duration;

use jiff::Timestamp;
use parking_lot::Mutex;
use tokio::time::Instant;
use tracing_subscriber::fmt::MakeWriter;

use crate::rate_limit::{Repeats, TokenBucket};
use crate::sanitize;

/// The format of log lines.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Text for people
    #[default]
    Text,
    /// One JSON object per line
    Json,
}

/// Length of the queue. Records that find it full are dropped and counted.
const MAX_WAITING: usize = 512;
/// Maximum length of a record, bytes. Longer text records are cut; longer JSON records are dropped,
/// since a JSON object cannot be cut.
const MAX_RECORD_LEN: usize = 8 * 1024;
/// Replaces a JSON record that was dropped.
const TOO_LONG: &str = "a log line was dropped: it was too long";
/// Width to assume for a window of unknown width.
const DEFAULT_COLUMNS: usize = 80;
/// Timeout for enqueueing the message of [`Console::redirect`].
const REDIRECT_LIMIT: Duration = Duration::from_millis(500);
/// Interval between notices that lines are dropped because the day's byte budget is used up.
const DROP_NOTICE_INTERVAL: Duration = Duration::from_secs(60);
/// Pause between two attempts to enqueue into a full queue.
const RETRY_PAUSE: Duration = Duration::from_millis(5);
/// Largest number of bytes that the log may have per day, of which a 24th at once. Lines beyond it
/// are dropped and counted.
const BYTES_A_DAY: u64 = 256 << 20;

/// Returns to the start of the line and clears it.
const CLEAR_LINE: &str = "\r\x1b[K";
/// Replaces a line break within a record, so that no text can imitate a new record.
const CONTINUATION: &str = "\n  ";

/// A handle for writing to stderr. Cheap to clone; only [`Console::redirect`] and [`Console::end`]
/// may block.
#[derive(Clone)]
pub struct Console {
    messages: SyncSender<ConsoleMessage>,
    shared: Arc<Shared>,
    features: Features,
    format: LogFormat,
}

enum ConsoleMessage {
    Record(Vec<u8>),
    /// Why the program ends: written even if the day's byte budget is used up.
    LastWords(String),
    /// A new status line is in [`Shared`].
    Status,
    /// Write everything to this writer from now on; `None`: to stderr again.
    Redirect(Option<Box<dyn Write + Send>>),
    End(SyncSender<()>),
}

#[derive(Default)]
struct Shared {
    dropped: AtomicU64,
    /// The newest status line that is not drawn yet. Never locked while writing.
    status: Mutex<Option<String>>,
}

impl Console {
    pub fn start(format: LogFormat) -> io::Result<Console> {
        let features = features_of_stderr(format);
        let day = TokenBucket::a_day(BYTES_A_DAY);
        Console::with_output(io::stderr(), features, stderr_columns, format, day)
    }

    /// Collects the output instead, as if stderr were a file.
    pub(super) fn collecting(into: Collected, format: LogFormat) -> io::Result<Console> {
        let day = TokenBucket::a_day(BYTES_A_DAY);
        Console::with_output(into, Features::FILE, || DEFAULT_COLUMNS, format, day)
    }

    fn with_output(
        out: impl Write + Send + 'static,
        features: Features,
        columns: fn() -> usize,
        format: LogFormat,
        day: TokenBucket,
    ) -> io::Result<Console> {
        let (messages, inbox) = sync_channel(MAX_WAITING);
        let shared = Arc::new(Shared::default());
        let writer = ConsoleWriter {
            out,
            redirected: None,
            screen: Screen::new(features),
            columns,
            shared: Arc::clone(&shared),
            format,
            day,
            drop_notices: Repeats::new(DROP_NOTICE_INTERVAL),
        };
        thread::Builder::new()
            .name("console".into())
            .spawn(move || writer.serve(&inbox))?;
        Ok(Console {
            messages,
            shared,
            features,
            format,
        })
    }

    pub fn colour(&self) -> bool {
        self.features.colour
    }

    pub fn is_json(&self) -> bool {
        self.format == LogFormat::Json
    }

    /// Whether there is a status line: stderr is a terminal and logs are text.
    pub fn has_status_line(&self) -> bool {
        self.features.redraw
    }

    /// Sets the status line. Does nothing without a terminal: see [`Console::status_line_plain`].
    pub fn status(&self, text: impl Into<String>) {
        if !self.features.redraw {
            return;
        }
        *self.shared.status.lock() = Some(text.into());
        // If the queue is full, the next message that is processed redraws it.
        let _ = self.messages.try_send(ConsoleMessage::Status);
    }

    /// Writes the status as a separate line, for files and pipes. Does nothing on a terminal.
    pub fn status_line_plain(&self, text: &str) {
        if !self.features.redraw {
            self.write_line("INFO", text);
        }
    }

    /// Writes a line that is not from the log, such as an error that ends the program. With
    /// `--log-format json` it is an object with `level` and `message`, so that every line is JSON.
    pub fn write_line(&self, level: &str, text: &str) {
        self.record(log_line(self.format, level, text).into_bytes());
    }

    /// Redirects the output, such as above a prompt; `None`: to stderr again.
    pub fn redirect(&self, to: Option<Box<dyn Write + Send>>) {
        let mut left = REDIRECT_LIMIT;
        self.enqueue_with_retry(ConsoleMessage::Redirect(to), &mut left);
    }

    fn record(&self, mut record: Vec<u8>) {
        if record.len() > MAX_RECORD_LEN {
            match self.format {
                LogFormat::Text => record.truncate(MAX_RECORD_LEN),
                LogFormat::Json => record = log_line(self.format, "WARN", TOO_LONG).into_bytes(),
            }
        }
        if let Err(TrySendError::Full(_)) = self.messages.try_send(ConsoleMessage::Record(record)) {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Writes the last words if there are any, clears the status line and waits until everything is
    /// written, at most `limit`.
    pub fn end(&self, last_words: Option<&str>, limit: Duration) {
        let mut left = limit;
        if let Some(text) = last_words {
            let record = log_line(self.format, "ERROR", text);
            self.enqueue_with_retry(ConsoleMessage::LastWords(record), &mut left);
        }
        let (done, wait) = sync_channel(1);
        self.enqueue_with_retry(ConsoleMessage::End(done), &mut left);
        let _ = wait.recv_timeout(left);
    }

    /// Enqueues a message, retrying while the queue is full and time is left.
    fn enqueue_with_retry(&self, mut message: ConsoleMessage, left: &mut Duration) {
        while let Err(TrySendError::Full(back)) = self.messages.try_send(message) {
            let Some(less) = left.checked_sub(RETRY_PAUSE) else {
                return;
            };
            thread::sleep(RETRY_PAUSE);
            (message, *left) = (back, less);
        }
    }
}

fn log_line(format: LogFormat, level: &str, text: &str) -> String {
    match format {
        LogFormat::Text => text.to_owned(),
        LogFormat::Json => serde_json::json!({
            // In the format of the other lines.
            "timestamp": format!("{:.6}", Timestamp::now()), "level": level, "message": text,
            "target": "spykee",
        })
        .to_string(),
    }
}

struct ConsoleWriter<W> {
    out: W,
    redirected: Option<Box<dyn Write + Send>>,
    screen: Screen,
    columns: fn() -> usize,
    shared: Arc<Shared>,
    format: LogFormat,
    day: TokenBucket,
    drop_notices: Repeats<()>,
}

impl<W: Write> ConsoleWriter<W> {
    /// Processes messages. Continues after write errors: messages to a broken stderr are discarded.
    fn serve(mut self, inbox: &Receiver<ConsoleMessage>) {
        while let Ok(message) = inbox.recv() {
            match message {
                ConsoleMessage::Record(record) => self.write(&String::from_utf8_lossy(&record)),
                ConsoleMessage::LastWords(text) => self.put_record(&text),
                ConsoleMessage::Status => {}
                ConsoleMessage::Redirect(to) => self.redirected = to,
                ConsoleMessage::End(done) => {
                    self.report_dropped();
                    let last = self.screen.end();
                    self.put(last.to_owned());
                    let _ = done.try_send(());
                    continue;
                }
            }
            self.report_dropped();
            self.redraw();
        }
    }

    /// Writes a record if the day's byte budget allows it.
    fn write(&mut self, record: &str) {
        let text = self.screen.record(record, (self.columns)());
        let now = Instant::now();
        if self.day.take(text.len() as f64, now) {
            return self.put(text);
        }
        if let Some(before) = self.drop_notices.record((), now) {
            let words = format!(
                "log lines are dropped ({before} before this one): the limit of {} bytes a day is used up",
                self.day.per_day()
            );
            self.put_record(&log_line(self.format, "WARN", &words));
        }
    }

    fn redraw(&mut self) {
        let newest = self.shared.status.lock().take();
        if let Some(text) = newest {
            let drawn = self.screen.status(&text, (self.columns)());
            self.put(drawn);
        }
    }

    fn report_dropped(&mut self) {
        let dropped = self.shared.dropped.swap(0, Ordering::Relaxed);
        if dropped > 0 {
            let text = format!("{dropped} log lines were dropped: stderr is too slow");
            self.put_record(&log_line(self.format, "WARN", &text));
        }
    }

    fn put_record(&mut self, text: &str) {
        let line = self.screen.record(text, (self.columns)());
        self.put(line);
    }

    fn put(&mut self, text: String) {
        if !text.is_empty() {
            let out: &mut dyn Write = match &mut self.redirected {
                Some(out) => out,
                None => &mut self.out,
            };
            let _ = out.write_all(text.as_bytes());
            let _ = out.flush();
        }
    }
}

/// Collects what a console writes, for tests of whole commands.
#[derive(Debug, Clone, Default)]
pub(super) struct Collected(Arc<Mutex<Vec<u8>>>);

impl Collected {
    pub(super) fn into_text(self) -> String {
        let bytes = self.0.lock();
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

impl Write for Collected {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut collected = self.0.lock();
        collected.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn features_of_stderr(format: LogFormat) -> Features {
    let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
    let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let redraw = io::stderr().is_terminal() && !dumb && format == LogFormat::Text;
    Features {
        redraw,
        colour: redraw && !no_colour,
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
    type Writer = &'a Console;

    fn make_writer(&'a self) -> &'a Console {
        self
    }
}

/// Each write is a log record.
impl Write for &Console {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // Keeps one byte more than the limit, to detect a record that is too long.
        let kept = bytes.len().min(MAX_RECORD_LEN + 1);
        self.record(bytes[..kept].to_vec());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Features {
    /// Whether a line can be redrawn in place.
    redraw: bool,
    colour: bool,
}

impl Features {
    const FILE: Features = Features {
        redraw: false,
        colour: false,
    };
}

/// Computes the output for a terminal, or for a file in its place: the log lines, and the status
/// line below them.
#[derive(Debug)]
struct Screen {
    features: Features,
    status: String,
}

impl Screen {
    fn new(features: Features) -> Screen {
        Screen {
            features,
            status: String::new(),
        }
    }

    /// The output for a log record: cleaned, with the status line redrawn below it.
    fn record(&self, text: &str, columns: usize) -> String {
        let text =
            sanitize::text(text.trim_end(), self.features.colour).replace('\n', CONTINUATION);
        if !self.features.redraw {
            return format!("{text}\n");
        }
        format!("{CLEAR_LINE}{text}\n{}", self.visible_status(columns))
    }

    /// The output for a new status line; empty if lines cannot be redrawn.
    fn status(&mut self, text: &str, columns: usize) -> String {
        self.status = sanitize::line(text);
        if !self.features.redraw {
            return String::new();
        }
        format!("{CLEAR_LINE}{}", self.visible_status(columns))
    }

    /// The output that clears the status line, so that the shell's prompt starts on an empty line.
    fn end(&mut self) -> &'static str {
        let drawn = !std::mem::take(&mut self.status).is_empty();
        if drawn && self.features.redraw {
            CLEAR_LINE
        } else {
            ""
        }
    }

    /// The status line, cut to leave one column free: many terminals wrap a line that fills the
    /// last column.
    fn visible_status(&self, columns: usize) -> String {
        self.status
            .chars()
            .take(columns.saturating_sub(1))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::mpsc::{Sender, channel};

    const TERMINAL: Features = Features {
        redraw: true,
        colour: true,
    };
    const LIMIT: Duration = Duration::from_secs(20);

    /// Keeps the written bytes; if it has a gate, each write waits for a permit.
    #[derive(Clone)]
    struct TestOutput {
        written: Arc<Mutex<Vec<u8>>>,
        gate: Option<Arc<Mutex<Receiver<()>>>>,
    }

    impl TestOutput {
        fn new() -> TestOutput {
            TestOutput {
                written: Arc::default(),
                gate: None,
            }
        }

        /// Every write blocks until the sender sends a permit or is dropped.
        fn blocked() -> (TestOutput, Sender<()>) {
            let (open, gate) = channel();
            let gate = Some(Arc::new(Mutex::new(gate)));
            (
                TestOutput {
                    gate,
                    ..TestOutput::new()
                },
                open,
            )
        }

        fn text(&self) -> String {
            String::from_utf8(self.written.lock().clone()).unwrap()
        }
    }

    impl Write for TestOutput {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if let Some(gate) = &self.gate {
                let _ = gate.lock().recv();
            }
            self.written.lock().extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn console(output: &TestOutput, features: Features, format: LogFormat) -> Console {
        Console::with_output(
            output.clone(),
            features,
            || 20,
            format,
            TokenBucket::a_day(1 << 40),
        )
        .unwrap()
    }

    #[test]
    fn lines_and_status_share_a_terminal() {
        let output = TestOutput::new();
        let console = console(&output, TERMINAL, LogFormat::Text);
        console.status("driving");
        console.end(None, LIMIT);
        console.write_line("INFO", "hello");
        console.status_line_plain("not here");
        console.end(None, LIMIT);
        assert_eq!(output.text(), "\r\x1b[Kdriving\r\x1b[K\r\x1b[Khello\n");
    }

    #[test]
    fn a_file_gets_only_plain_status_lines() {
        let output = TestOutput::new();
        let console = console(&output, Features::FILE, LogFormat::Text);
        console.status("driving");
        console.status_line_plain("docked");
        console.end(None, LIMIT);
        assert_eq!(output.text(), "docked\n");
    }

    #[test]
    fn last_words_are_written_when_the_day_limit_is_used_up() {
        let output = TestOutput::new();
        let day = TokenBucket::a_day(24 * 1000);
        let console =
            Console::with_output(output.clone(), Features::FILE, || 20, LogFormat::Text, day)
                .unwrap();
        for number in 0..300 {
            console.write_line("INFO", &format!("line {number} of a flood"));
        }
        console.end(Some("last words"), LIMIT);
        let text = output.text();
        let written = text
            .lines()
            .filter(|line| line.starts_with("line "))
            .count();
        assert!((20..=60).contains(&written), "{written}");
        assert_eq!(text.matches("24000 bytes a day is used up").count(), 1);
        assert!(text.ends_with("last words\n"), "{text}");
    }

    #[test]
    fn a_blocked_stderr_does_not_block_callers_and_dropped_lines_are_counted() {
        let (output, open) = TestOutput::blocked();
        let console = console(&output, Features::FILE, LogFormat::Text);
        for number in 0..MAX_WAITING * 4 {
            console.write_line("INFO", &format!("line {number}"));
            console.status("driving");
        }
        console.end(Some("last words"), Duration::from_millis(50));
        assert_eq!(output.text(), "");
        drop(open);
        console.end(None, LIMIT);
        let text = output.text();
        let lines = text
            .lines()
            .filter(|line| line.starts_with("line "))
            .count();
        let dropped: usize = text
            .lines()
            .filter_map(|line| {
                line.split_once(" log lines were dropped")?
                    .0
                    .parse::<usize>()
                    .ok()
            })
            .sum();
        assert_eq!(lines + dropped, MAX_WAITING * 4);
        assert!(dropped > 0 && lines > 0);
    }

    #[test]
    fn in_json_every_line_is_an_object() {
        let output = TestOutput::new();
        let console = console(&output, Features::FILE, LogFormat::Json);
        console.write_line("ERROR", "two\nlines \x1b[2J");
        console.end(None, LIMIT);
        let value: serde_json::Value = serde_json::from_str(&output.text()).unwrap();
        assert_eq!(value["message"], "two\nlines \x1b[2J");

        let mut writer = console.make_writer();
        writer.write_all(&[b'x'; 3 * MAX_RECORD_LEN]).unwrap();
        console.end(None, LIMIT);
        let text = output.text();
        let value: serde_json::Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        assert_eq!(value["message"], TOO_LONG);
    }

    #[test]
    fn a_long_record_is_cut() {
        let output = TestOutput::new();
        let console = console(&output, Features::FILE, LogFormat::Text);
        console.write_line("INFO", &"x".repeat(3 * MAX_RECORD_LEN));
        console.end(None, LIMIT);
        assert_eq!(output.text().trim_end().len(), MAX_RECORD_LEN);
    }

    #[test]
    fn the_status_line_stays_below_the_log_and_within_the_window() {
        let mut screen = Screen::new(TERMINAL);
        assert_eq!(screen.status("driving 80 %", 9), "\r\x1b[Kdriving ");
        assert_eq!(screen.record("hello\n", 80), "\r\x1b[Khello\ndriving 80 %");
        assert_eq!(screen.end(), "\r\x1b[K");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn a_file_gets_only_lines() {
        let mut screen = Screen::new(Features::FILE);
        assert_eq!(screen.status("driving", 80), "");
        assert_eq!(screen.record("\x1b[31mred\x1b[0m\n", 80), "red\n");
        assert_eq!(screen.end(), "");
    }

    #[test]
    fn a_line_break_in_a_text_cannot_imitate_a_record() {
        let screen = Screen::new(Features::FILE);
        let shown = screen.record("INFO said\nERROR forged", 80);
        assert_eq!(shown, "INFO said\n  ERROR forged\n");
    }

    proptest! {
        #[test]
        fn no_control_character_survives_in_a_file(text in "\\PC*|[\\x00-\\xff\u{1b}\\[m0-9;]{0,60}") {
            let shown = Screen::new(Features::FILE).record(&text, 80);
            let bad = shown.chars().any(|c| c.is_control() && !matches!(c, '\n' | '\t'));
            prop_assert!(!bad, "{:?}", shown);
        }
    }
}
