//! Luau's type checker, one question a process: JSON on stdin, JSON on stdout. `spykee check` asks
//! it if it stands beside `spykee`.
//!
//! It is a program of its own because it cannot share one with the VM: both bring Luau's symbols.
//! So it uses nothing of the library.

use std::io::Read;
use std::process::ExitCode;
use std::time::Duration;

use luau_analyze::{CheckOptions, Checker, Severity};
use rustix::process::{Resource, Rlimit, setrlimit};
use serde::{Deserialize, Serialize};

/// What hostile input may use up.
const MEMORY: u64 = 1 << 30;
/// No question is longer.
const LONGEST: u64 = 8 << 20;

#[derive(Deserialize)]
struct Question {
    /// What all texts may call.
    definitions: String,
    /// Each is checked by itself.
    texts: Vec<String>,
    /// For each text.
    seconds: f64,
}

#[derive(Serialize)]
struct Finding {
    /// From 0.
    line: u32,
    /// From 0, in bytes.
    column: u32,
    end_line: u32,
    end_column: u32,
    message: String,
}

#[derive(Serialize)]
struct Checked {
    findings: Vec<Finding>,
    timed_out: bool,
}

fn main() -> ExitCode {
    let limit = Rlimit {
        current: Some(MEMORY),
        maximum: Some(MEMORY),
    };
    // Without the limit the work is still bounded in time, by whoever asks.
    let _ = setrlimit(Resource::As, limit);
    match answer() {
        Ok(answer) => {
            println!("{answer}");
            ExitCode::SUCCESS
        }
        Err(why) => {
            eprintln!("{why}");
            ExitCode::from(2)
        }
    }
}

fn answer() -> Result<String, String> {
    let mut text = String::new();
    let mut input = std::io::stdin().take(LONGEST);
    (input.read_to_string(&mut text)).map_err(|error| format!("no question: {error}"))?;
    let question: Question = serde_json::from_str(&text)
        .map_err(|error| format!("not a question of spykee check: {error}"))?;
    let mut checker = Checker::new().map_err(|error| error.to_string())?;
    let defined = checker.add_definitions(&question.definitions);
    defined.map_err(|error| error.to_string())?;
    let time = Duration::try_from_secs_f64(question.seconds).map_err(|error| error.to_string())?;
    let answers: Result<Vec<Checked>, String> = question
        .texts
        .iter()
        .map(|text| check(&mut checker, text, time))
        .collect();
    serde_json::to_string(&answers?).map_err(|error| error.to_string())
}

fn check(checker: &mut Checker, text: &str, time: Duration) -> Result<Checked, String> {
    let options = CheckOptions {
        timeout: Some(time),
        ..CheckOptions::default()
    };
    let result = checker.check_with_options(text, options);
    let result = result.map_err(|error| error.to_string())?;
    let errors = result.diagnostics.into_iter();
    let findings = errors
        .filter(|one| one.severity == Severity::Error)
        .map(|one| Finding {
            line: one.line,
            column: one.col,
            end_line: one.end_line,
            end_column: one.end_col,
            message: one.message,
        });
    Ok(Checked {
        findings: findings.collect(),
        timed_out: result.timed_out,
    })
}
