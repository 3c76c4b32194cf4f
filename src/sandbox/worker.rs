//! Asks a confined process of this program one question. Each question gets its own process, which
//! is killed at its deadline.

use std::ffi::OsString;
use std::io::{self, ErrorKind, Read, Write};
use std::net::Shutdown;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, ExitCode};
use std::thread;
use std::time::{Duration, Instant};

use super::confine::command;
use super::confine::{SandboxPolicy, confine};

/// The hidden argument that makes the executable answer one question.
pub const WORKER_ARGUMENT: &str = "__worker";
/// How often a blocked read or write checks whether the answer is still wanted.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// How long the process may take to exit after its answer.
const EXIT_TIME: Duration = Duration::from_secs(1);
/// Longest answer or question, bytes.
const LONGEST: usize = 32 << 20;
/// How much of its standard error is kept, bytes.
const MAX_STDERR: u64 = 4096;

/// Starts processes that answer questions of one kind.
#[derive(Debug, Clone)]
pub struct Worker {
    executable: PathBuf,
    kind: &'static str,
}

/// Why there is no answer.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WorkerError {
    #[error("it did not finish within {} s and was stopped", .0.as_secs_f64())]
    TimedOut(Duration),
    #[error("interrupted")]
    Cancelled,
    /// It ended unexpectedly or could not be started; holds the reason as text.
    #[error("{0}")]
    Broken(String),
}

struct Deadline<'a> {
    until: Instant,
    limit: Duration,
    wanted: &'a dyn Fn() -> bool,
}

impl Deadline<'_> {
    fn check(&self) -> Result<(), WorkerError> {
        if !(self.wanted)() {
            return Err(WorkerError::Cancelled);
        }
        if Instant::now() < self.until {
            return Ok(());
        }
        Err(WorkerError::TimedOut(self.limit))
    }
}

/// A child process that is killed when this is dropped.
struct Process(Child);

impl Drop for Process {
    fn drop(&mut self) {
        // It may have exited already.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Worker {
    /// A worker that starts the running executable.
    pub fn of_this_executable(kind: &'static str) -> io::Result<Worker> {
        let executable = std::env::current_exe()?;
        Ok(Worker { executable, kind })
    }

    /// A worker that starts this executable, which must be `spykee`.
    pub fn new(executable: PathBuf, kind: &'static str) -> Worker {
        Worker { executable, kind }
    }

    /// Waits for the answer while `wanted` returns true, at most for `limit`.
    pub fn ask(
        &self,
        policy: &SandboxPolicy,
        question: &[u8],
        limit: Duration,
        wanted: &dyn Fn() -> bool,
    ) -> Result<Vec<u8>, WorkerError> {
        let deadline = Deadline {
            until: Instant::now() + limit,
            limit,
            wanted,
        };
        let broke = |error: io::Error| WorkerError::Broken(format!("its process failed: {error}"));
        let (mut process, mut stream) = self.start(policy).map_err(broke)?;
        let exchanged = exchange(&mut stream, question, &deadline);
        match exchanged {
            Ok(answer) => match process.ended() {
                Some(true) => Ok(answer),
                _ => Err(WorkerError::Broken(process.failure_text())),
            },
            Err(WorkerError::Broken(_)) => Err(WorkerError::Broken(process.failure_text())),
            Err(error) => Err(error),
        }
    }

    fn start(&self, policy: &SandboxPolicy) -> io::Result<(Process, UnixStream)> {
        let (mut command, ours) = command(&self.executable, &[WORKER_ARGUMENT, self.kind], policy)?;
        ours.set_read_timeout(Some(POLL_INTERVAL))?;
        ours.set_write_timeout(Some(POLL_INTERVAL))?;
        Ok((Process(command.spawn()?), ours))
    }
}

fn exchange(
    stream: &mut UnixStream,
    question: &[u8],
    deadline: &Deadline<'_>,
) -> Result<Vec<u8>, WorkerError> {
    let broke = |error: io::Error| WorkerError::Broken(error.to_string());
    let mut left = question;
    while !left.is_empty() {
        deadline.check()?;
        match stream.write(left) {
            Ok(0) => return Err(broke(ErrorKind::WriteZero.into())),
            Ok(count) => left = &left[count..],
            Err(error) if is_transient(&error) => {}
            Err(error) => return Err(broke(error)),
        }
    }
    stream.shutdown(Shutdown::Write).map_err(broke)?;
    let mut answer = Vec::new();
    let mut chunk = vec![0; 64 * 1024];
    loop {
        deadline.check()?;
        match stream.read(&mut chunk) {
            Ok(0) => return Ok(answer),
            Ok(count) if answer.len() + count > LONGEST => {
                return Err(broke(ErrorKind::FileTooLarge.into()));
            }
            Ok(count) => answer.extend_from_slice(&chunk[..count]),
            Err(error) if is_transient(&error) => {}
            Err(error) => return Err(broke(error)),
        }
    }
}

fn is_transient(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

impl Process {
    /// Whether it exited successfully; `None` if it does not exit in time.
    fn ended(&mut self) -> Option<bool> {
        let until = Instant::now() + EXIT_TIME;
        loop {
            match self.0.try_wait() {
                Ok(Some(status)) => return Some(status.success()),
                Ok(None) if Instant::now() < until => thread::sleep(Duration::from_millis(1)),
                _ => return None,
            }
        }
    }

    /// Its standard error, or if that is empty its exit status.
    fn failure_text(&mut self) -> String {
        if self.ended().is_none() {
            let _ = self.0.kill();
        }
        let status = self.0.wait();
        let mut words = Vec::new();
        if let Some(stderr) = self.0.stderr.take() {
            let _ = stderr.take(MAX_STDERR).read_to_end(&mut words);
        }
        let words = String::from_utf8_lossy(&words).trim().to_owned();
        match (words.is_empty(), status) {
            (false, _) => words,
            (true, Ok(status)) => format!("its process ended unexpectedly ({status})"),
            (true, Err(error)) => format!("its process failed: {error}"),
        }
    }
}

/// The main function of a worker process: confines itself, reads the question and sends the answer.
/// `work` runs on a thread with a stack of `stack` bytes.
pub fn answer(
    arguments: impl Iterator<Item = OsString>,
    stack: usize,
    work: impl FnOnce(&[u8]) -> io::Result<Vec<u8>> + Send + 'static,
) -> ExitCode {
    confined_main(arguments, "work", stack, move || serve(work))
}

/// The main function of a confined process: confines itself by its arguments, then does its work on
/// a thread of this name with a stack of `stack` bytes.
pub fn confined_main(
    arguments: impl Iterator<Item = OsString>,
    name: &str,
    stack: usize,
    work: impl FnOnce() -> io::Result<()> + Send + 'static,
) -> ExitCode {
    let thread = thread::Builder::new().name(name.into()).stack_size(stack);
    let done = SandboxPolicy::of_arguments(arguments)
        .ok_or_else(|| ErrorKind::InvalidInput.into())
        .and_then(|(parent, policy)| confine(parent, &policy))
        .and_then(|_| thread.spawn(work))
        .and_then(|working| {
            let panicked = || Err(io::Error::other("it panicked"));
            working.join().unwrap_or_else(|_| panicked())
        });
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("its process failed: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve(work: impl FnOnce(&[u8]) -> io::Result<Vec<u8>>) -> io::Result<()> {
    let mut stream = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    let mut question = Vec::new();
    (&mut stream)
        .take(LONGEST as u64)
        .read_to_end(&mut question)?;
    stream.write_all(&work(&question)?)
}
