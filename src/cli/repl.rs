//! `spykee repl`: runs typed Lua on a robot. Lines run in a behaviour host like any script, behind
//! the same pilot and watchdog. The terminal has its own thread; nothing here blocks on it.

mod editor;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::time::Duration;

use tokio::runtime::Handle;
use tokio::signal::unix::Signal;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::interrupt::{Terminal, handle_signals, listen};
use super::settings::CommandSettings;
use super::startup::{driving_core, guardian_files, refuse_if_stopped, runtime};
use super::{ConnectionArgs, Console, Exit, Failure};
use crate::agent::{AgentError, PilotSetup, ReplError, run_repl};
use crate::behaviour::{Launch, Library, PromptCommand, PromptMessage};
use crate::clock::until;
use crate::config::Config;
use crate::robot::EndReason;
use crate::script::{self, Evaluated, Level, LogLine};
use editor::{EditorCommand, Typed};

/// Name of the session in logs, and of its data folder.
const NAME: &str = "repl";
const HELP: &str = "type Lua, such as robot.move(30, 30, 2); `spykee api` in another terminal lists all \
                    calls, `spykee api NAME` explains one";
/// If the terminal takes longer than this to show a prompt, the tracks are stopped.
const TERMINAL_LIMIT: Duration = Duration::from_secs(2);
/// Length of the queue to the terminal; the last slot is reserved for the outcome of the line.
const MAX_EDITOR_COMMANDS: usize = 257;

/// Run Lua interactively on a robot
///
/// Ctrl-C stops the tracks, all tasks and all handlers; Ctrl-D ends the session. Lines can also
/// come from a pipe; then the exit code is 1 if one of them failed. Later lines have the variables of
/// earlier ones, also those that a line begins with, as in `local speed = 40`.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct ReplArgs {
    /// Seed for math.random and simulator noise [default: random]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    #[command(flatten)]
    connection: ConnectionArgs,
}

pub(super) fn run(
    args: &ReplArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let target = args.connection.resolve(settings, seed)?;
    let config = &target.config;
    refuse_if_stopped(config, target.sim.is_some())?;
    let runtime = runtime()?;
    let core = driving_core()?;
    let files = guardian_files(config, None);
    let launch = launch(config, seed)?;
    let setup = PilotSetup::new(target.pilot_plan(&core, files, seed)?);
    let terminal = Terminal::current();
    let session = run_session(launch, setup, core.handle(), &terminal, console);
    let outcome = runtime.block_on(session);
    drop(core);
    console.redirect(None);
    terminal.restore();
    runtime.shutdown_timeout(super::RUNTIME_LIMIT);
    outcome
}

/// An empty script that keeps running and evaluates lines.
fn launch(config: &Config, seed: u64) -> Result<Launch, Failure> {
    let data = config.data_folder().join(NAME);
    let options = script::Options {
        data_dir: Some(std::path::absolute(data).map_err(Failure::internal)?),
        interactive: true,
        ..config.script(NAME, NAME, seed)
    };
    Ok(Launch {
        source: Vec::new(),
        options,
        library: Library::new(PathBuf::from(".")),
    })
}

async fn run_session(
    launch: Launch,
    setup: PilotSetup,
    core: &Handle,
    terminal: &Terminal,
    console: &Console,
) -> Result<Exit, Failure> {
    let (commands, inbox) = mpsc::channel(16);
    let (message_sender, mut messages) = mpsc::channel(64);
    let stop = CancellationToken::new();
    let interactive = std::io::stdin().is_terminal();
    let requests = setup.requests();
    let mut interruption = if interactive {
        let original = Some(terminal.clone());
        handle_signals(core, requests, stop.clone(), &[libc::SIGINT], original)?;
        Some(listen(libc::SIGINT)?)
    } else {
        handle_signals(core, requests, stop.clone(), &[], None)?;
        None
    };
    let (to_editor, mut typed) = start_editor(console)?;
    let mut repl = Repl {
        commands: Some(commands),
        to_editor,
        console: console.clone(),
        interactive,
        begun: false,
        running: false,
        failed: false,
        terminal_due: None,
    };
    let session = run_repl(launch, setup, inbox, message_sender, stop.clone());
    let mut session = std::pin::pin!(session);
    loop {
        tokio::select! {
            biased;
            ended = &mut session => return repl.exit(ended, stop.is_cancelled()),
            () = next(&mut interruption) => repl.interrupted(&stop),
            Some(message) = messages.recv() => repl.receive(message),
            () = until(repl.terminal_due) => repl.give_up_on_terminal(),
            typed = typed.recv(), if repl.commands.is_some() => match typed {
                Some(typed) => repl.take(typed),
                // The prompt's thread has ended: no more input can arrive.
                None => drop(repl.commands.take()),
            },
        }
    }
}

fn start_editor(
    console: &Console,
) -> Result<(mpsc::Sender<EditorCommand>, mpsc::Receiver<Typed>), Failure> {
    let (sender, typed) = mpsc::channel(1);
    let (to_editor, commands) = mpsc::channel(MAX_EDITOR_COMMANDS);
    let console = console.clone();
    let thread = std::thread::Builder::new().name("editor".into());
    thread
        .spawn(move || editor::serve(&sender, commands, &console))
        .map_err(|error| Failure::io("start the prompt", error))?;
    Ok((to_editor, typed))
}

async fn next(signal: &mut Option<Signal>) {
    match signal {
        Some(signal) => _ = signal.recv().await,
        None => std::future::pending().await,
    }
}

/// Connects the prompt with the behaviour.
struct Repl {
    /// Commands to the behaviour; `None` ends the session.
    commands: Option<mpsc::Sender<PromptCommand>>,
    to_editor: mpsc::Sender<EditorCommand>,
    console: Console,
    /// Whether a person types; otherwise lines come from a pipe.
    interactive: bool,
    /// Whether the behaviour has been ready once.
    begun: bool,
    /// Whether a line is running and the prompt waits for it.
    running: bool,
    failed: bool,
    /// Deadline of the terminal for showing a prompt.
    terminal_due: Option<Instant>,
}

impl Repl {
    fn take(&mut self, typed: Typed) {
        match typed {
            Typed::Ready => self.terminal_due = None,
            Typed::Line { text, .. } if text.trim() == "help" => {
                self.running = true;
                self.print(HELP);
                self.finish(EditorCommand::Prompt);
            }
            Typed::Line { text, more } => {
                self.running = true;
                self.send(PromptCommand::Evaluate { text, more });
            }
            Typed::Interrupt => {
                self.send(PromptCommand::Interrupt);
                self.finish(EditorCommand::Prompt);
            }
            Typed::End => {
                self.commands = None;
                self.console.redirect(None);
            }
        }
    }

    /// Sends a command to the behaviour. Ends the session if the queue is full, since the robot
    /// would otherwise miss the command.
    fn send(&mut self, command: PromptCommand) {
        let sent = self
            .commands
            .as_ref()
            .map(|commands| commands.try_send(command));
        if sent.is_some_and(|sent| sent.is_err()) {
            self.commands = None;
        }
    }

    /// Interrupts the line. If the session has ended and only waits for a robot with a low battery
    /// to return to its station, stops waiting.
    fn interrupted(&mut self, stop: &CancellationToken) {
        match self.commands {
            Some(_) => self.send(PromptCommand::Interrupt),
            None => stop.cancel(),
        }
    }

    fn receive(&mut self, message: PromptMessage) {
        match message {
            PromptMessage::Ready if !self.begun => {
                self.begun = true;
                self.finish(EditorCommand::Prompt);
            }
            PromptMessage::Ready => {}
            PromptMessage::Line(line) => self.print(&written(&line)),
            PromptMessage::Evaluated(evaluated) => self.evaluated(evaluated),
            PromptMessage::Ended(exit) => {
                let why = exit.message.unwrap_or_default();
                let reason = exit.reason;
                self.failed |= !matches!(reason, EndReason::Done);
                self.print(&format!(
                    "ended ({reason}): {why}\na new session starts; all variables are unset"
                ));
                if self.running {
                    self.finish(EditorCommand::Prompt);
                }
            }
        }
    }

    fn evaluated(&mut self, evaluated: Evaluated) {
        match evaluated {
            Evaluated::Incomplete => return self.finish(EditorCommand::Continue),
            Evaluated::Values(values) if values.is_empty() => {}
            Evaluated::Values(values) => self.print(&values.join("\t")),
            Evaluated::Failed(text) => {
                self.failed = true;
                self.print(&format!("error: {text}"));
            }
            Evaluated::Cancelled => self.print("interrupted"),
        }
        self.finish(EditorCommand::Prompt);
    }

    /// Prints text: while a line runs, in order with its result; otherwise above the prompt.
    fn print(&self, text: &str) {
        if !self.running {
            return self.console.write_line("INFO", text);
        }
        // The last slot is reserved for the outcome of the line.
        if self.to_editor.capacity() > 1 {
            let _ = self
                .to_editor
                .try_send(EditorCommand::Print(text.to_owned()));
        }
    }

    fn finish(&mut self, next: EditorCommand) {
        self.running = false;
        self.terminal_due = Some(Instant::now() + TERMINAL_LIMIT);
        let _ = self.to_editor.try_send(next);
    }

    fn give_up_on_terminal(&mut self) {
        self.terminal_due = None;
        self.send(PromptCommand::Interrupt);
        tracing::warn!("the terminal does not accept output: everything was stopped");
    }

    fn exit(&self, ended: Result<bool, ReplError>, interrupted: bool) -> Result<Exit, Failure> {
        match ended {
            Ok(safety) => Ok(if safety {
                Exit::Safety
            } else if interrupted {
                Exit::Interrupted
            } else if self.failed && !self.interactive {
                Exit::Failed
            } else {
                Exit::Done
            }),
            Err(ReplError::Agent(AgentError::Link(error))) => Err(error.into()),
            Err(error) => Err(Failure::new(Exit::Failed, error)),
        }
    }
}

/// Formats a log line for a person at a prompt.
fn written(line: &LogLine) -> String {
    let mut text = match line.level {
        Level::Debug => "debug: ".to_owned(),
        Level::Info => String::new(),
        Level::Warn => "warning: ".to_owned(),
        Level::Error => "error: ".to_owned(),
    };
    text += &line.text;
    for (key, value) in &line.fields {
        text += &format!(" {key}={value}");
    }
    text
}
