use super::*;
use std::sync::mpsc::{Sender, channel};

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
        String::from_utf8(self.written.lock().unwrap().clone()).unwrap()
    }
}

impl Write for TestOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if let Some(gate) = &self.gate {
            let _ = gate.lock().unwrap().recv();
        }
        self.written.lock().unwrap().extend_from_slice(bytes);
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
        Budget::new(1 << 40),
    )
    .unwrap()
}

#[test]
fn lines_and_status_share_a_terminal() {
    let output = TestOutput::new();
    let console = console(&output, Features::TERMINAL, LogFormat::Text);
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
    let day = Budget::new(24 * 1000);
    let console =
        Console::with_output(output.clone(), Features::FILE, || 20, LogFormat::Text, day).unwrap();
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

    let mut record = console.make_writer();
    record.write_all(&[b'x'; 3 * MAX_RECORD_LEN]).unwrap();
    drop(record);
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
