//! Luau's type checker as a process: found beside this program, asked about one script, and ended
//! if it does not answer.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::Duration;

use crate::script::check::{Answer, Finding, Typing};

/// The checker's file.
const NAME: &str = "spykee-luau-check";
/// A checker that does not answer in this time is ended; it usually takes 20 ms.
const LIMIT: Duration = Duration::from_secs(5);
/// No answer is longer.
const LONGEST: u64 = 4 << 20;

/// Asks the checker, if there is one.
#[derive(Debug)]
pub(super) struct TypeChecker {
    file: Option<PathBuf>,
}

impl TypeChecker {
    /// The one beside this program; without it no types are checked.
    pub(super) fn beside() -> TypeChecker {
        let own = std::env::current_exe().ok();
        let file = own.map(|own| own.with_file_name(NAME));
        TypeChecker {
            file: file.filter(|file| file.is_file()),
        }
    }

    /// What is wrong with a script's types, beside what was found already.
    ///
    /// # Errors
    /// The checker failed, in words. One that hung is not asked again.
    pub(super) fn findings(
        &mut self,
        (source, chunk): (&[u8], &str),
        said: &[Finding],
    ) -> Result<Vec<Finding>, String> {
        let (Some(file), Some(typing)) = (&self.file, Typing::of(source, chunk)) else {
            return Ok(Vec::new());
        };
        let question = serde_json::to_vec(&typing.question()).map_err(|error| error.to_string())?;
        let failed = |why: &str| format!("{} {why}", file.display());
        let answers = match ask(file, question) {
            Ok(answers) => answers,
            Err(Trouble::OfThisScript(why)) => return Err(failed(why)),
            Err(Trouble::OfAll(why)) => {
                let why = failed(&why);
                self.file = None;
                return Err(why);
            }
        };
        typing.findings(&answers, said)
    }
}

/// Why there is no answer.
enum Trouble {
    /// The next script may fare better.
    OfThisScript(&'static str),
    /// Asking again would cost the same again.
    OfAll(String),
}

fn ask(file: &Path, question: Vec<u8>) -> Result<Vec<Answer>, Trouble> {
    let mut child = Command::new(file)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|error| Trouble::OfAll(format!("cannot be started: {error}")))?;
    let answer = talk(&mut child, question);
    // Whether it has ended by itself does not matter any more.
    let _ = child.kill();
    let _ = child.wait();
    serde_json::from_slice(&answer?)
        .map_err(|_| Trouble::OfThisScript("has broken down over this script"))
}

/// Writes and reads at the same time: neither end waits for the other for ever.
fn talk(child: &mut Child, question: Vec<u8>) -> Result<Vec<u8>, Trouble> {
    let (Some(mut input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
        return Err(Trouble::OfThisScript("cannot be talked to"));
    };
    std::thread::spawn(move || input.write_all(&question));
    let (answered, answer) = mpsc::channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        let read = output.take(LONGEST).read_to_end(&mut bytes);
        let _ = answered.send(read.map(|_| bytes));
    });
    match answer.recv_timeout(LIMIT) {
        Ok(Ok(bytes)) => Ok(bytes),
        Ok(Err(_)) => Err(Trouble::OfThisScript("cannot be read from")),
        Err(_) => {
            let seconds = LIMIT.as_secs();
            let why = format!("did not answer within {seconds} s and was ended");
            Err(Trouble::OfAll(why))
        }
    }
}
