//! The `spykee` command: parses the command line, dispatches to one module per subcommand, and
//! returns the exit code. The work itself is done by the layers below.

mod api;
mod argument;
mod assembly;
mod behaviour;
mod behaviour_loader;
mod calibrate;
mod check;
mod class;
mod colour;
mod completions;
mod config;
mod connection;
mod console;
mod discover;
mod doctor;
mod driver;
mod failure;
mod fast;
mod fleet;
mod history;
mod interrupt;
mod lesson;
mod live;
mod logging;
mod new;
mod notify;
mod repl;
mod robot;
mod run;
mod running;
mod runs;
mod secret;
mod serve;
mod service;
mod settings;
mod settings_page;
mod sim;
mod startup;
mod status;
mod table;
mod test;
mod token;
mod usable;
mod world;

use std::cell::RefCell;
use std::ffi::OsString;
use std::future::Future;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use crate::behaviour::{HOST_ARGUMENT, INSPECTION, host_main, inspection_main};
use crate::class::{LEARNER, learner_main};
use crate::guardian::{GUARDIAN_ARGUMENT, guardian_main};
use crate::sandbox::{WORKER_ARGUMENT, keep_descriptors};
use crate::sanitize;
use crate::scenario::{SCENARIO_PROCESS, scenario_process_main};
use clap::{CommandFactory, Parser, Subcommand};
use serde::Serialize;

pub use connection::{ConnectionArgs, LoginArgs};
pub use console::{Console, LogFormat};
pub use failure::{Exit, Failure};
use logging::Detail;
use settings::CommandSettings;

/// Timeout for writing the last lines to a blocked stderr at exit.
const CONSOLE_LIMIT: Duration = Duration::from_millis(500);
/// Timeout for background work, such as a name lookup, at exit.
const RUNTIME_LIMIT: Duration = Duration::from_millis(200);

/// Lua behaviours for the Spykee robot
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,

    /// YAML file with the settings [default: $SPYKEE_CONFIG, or else spykee.yaml in the current
    /// folder]
    #[arg(long, value_name = "FILE", global = true)]
    config: Option<PathBuf>,

    /// Format of the log on stderr [default: text]; $RUST_LOG filters it
    #[arg(long, value_enum, global = true)]
    log_format: Option<LogFormat>,
}

// In the order of `--help`: run behaviours, tools for active runs, robots, writing behaviours,
// simulation and pictures, the rest.
#[derive(Debug, Subcommand)]
enum Command {
    Run(Box<run::RunArgs>),
    Serve(serve::ServeArgs),
    /// Create a systemd unit for `spykee serve`, with its own user and few rights
    ///
    /// The unit cannot read home folders, so its program, config and password file must be elsewhere:
    /// /usr/local/bin/spykee, /etc/spykee/spykee.yaml. The service keeps its data in /var/lib/spykee,
    /// so the config should not set another `data:`.
    #[command(
        subcommand,
        after_help = "Examples:\n  spykee service print\n  sudo spykee service install --password-file /etc/spykee/password"
    )]
    Service(service::Action),
    Status(runs::StatusArgs),
    /// Start, stop, restart or list the behaviours of an active run
    ///
    /// Asks the `spykee run` or `spykee serve` of this data folder through its private socket, or with
    /// --url a service on another computer. Each start reads the script from its file; a script with a
    /// mistake is refused.
    #[command(
        subcommand,
        after_help = "Examples:\n  spykee behaviour list\n  spykee behaviour start patrol --for 30m\n  spykee behaviour restart guard"
    )]
    Behaviour(behaviour::BehaviourCommand),
    History(history::HistoryArgs),
    /// Control all robots on an MQTT broker: list them, start a behaviour, stop them
    ///
    /// The config names the broker (`mqtt: { host: ... }`); every run whose config names the same
    /// broker appears there under its robot's uid. The exit code is 4 if any robot did not carry out
    /// the command.
    #[command(
        subcommand,
        after_help = "Examples:\n  spykee fleet list\n  spykee fleet run patrol --on all\n  \
                        spykee fleet stop SPYKEE0001 SPYKEE0007\n  spykee fleet stop all"
    )]
    Fleet(fleet::Action),
    /// Create, list and revoke tokens for the page and the JSON API
    ///
    /// A token is 256 random bits. It is printed once, on a terminal with a link to the page and the
    /// link's QR code for a phone; the data folder keeps its SHA-256 digest in a private file. Programs
    /// send it as `Authorization: Bearer TOKEN`. Within a second an active run accepts a new token, and
    /// refuses a revoked one.
    #[command(
        subcommand,
        after_help = "Example: spykee token new phone --role driver"
    )]
    Token(token::Action),
    Discover(discover::DiscoverArgs),
    /// Send the robot a single command: battery, docking, lights, a picture, its settings
    ///
    /// The watchdog handles a low battery, the station and a dead link as in a run. The robot serves
    /// one user at a time. If that is a `spykee run` of the same data folder, then battery, info,
    /// snapshot, dock, undock, stop, reset-stop, led, play, volume and say go through it; without
    /// --robot they address the only active run, stop and reset-stop all of them. With --url they go
    /// through a service on another computer. If any other program uses the robot, end it first.
    #[command(
        subcommand,
        after_help = "Examples:\n  spykee robot battery --robot 172.17.6.1\n  spykee robot stop --robot 172.17.6.1\n  spykee robot snapshot -o room.jpg --sim"
    )]
    Robot(robot::RobotCommand),
    Calibrate(calibrate::CalibrateArgs),
    Doctor(doctor::DoctorArgs),
    New(new::NewArgs),
    Repl(repl::ReplArgs),
    Check(check::CheckArgs),
    Test(test::TestArgs),
    /// Learn to write behaviours with built-in exercises and checks
    #[command(subcommand)]
    Lesson(lesson::Action),
    Class(class::ClassArgs),
    Api(api::ApiArgs),
    Sim(sim::SimArgs),
    /// Find colours in pictures, as scripts do, or learn a new one
    #[command(subcommand)]
    Colour(colour::Action),
    /// Show the settings and where they come from, check a config file, list its coming starts, test
    /// its notification targets
    #[command(subcommand)]
    Config(config::Action),
    Completions(completions::CompletionsArgs),
}

impl Command {
    /// Whether the subcommand uses the settings. The unit's config that `service` names may belong
    /// to another user.
    fn uses_settings(&self) -> bool {
        match self {
            Command::Config(action) => action.uses_settings(),
            Command::Colour(action) => action.uses_settings(),
            Command::Service(_)
            | Command::Discover(_)
            | Command::New(_)
            | Command::Lesson(_)
            | Command::Api(_)
            | Command::Sim(_)
            | Command::Completions(_) => false,
            _ => true,
        }
    }

    fn run(self, settings: &CommandSettings, console: &Console) -> Result<Exit, Failure> {
        match self {
            Command::Run(args) => run::run(*args, settings, console),
            Command::Serve(args) => serve::run(&args, settings, console),
            Command::Service(args) => service::run(&args),
            Command::Status(args) => runs::run(&args, settings),
            Command::Behaviour(args) => behaviour::run(&args, settings),
            Command::History(args) => history::run(&args, settings),
            Command::Fleet(args) => fleet::run(&args, settings),
            Command::Token(args) => token::run(&args, settings),
            Command::Discover(args) => discover::run(&args),
            Command::Robot(args) => robot::run(&args, settings, console),
            Command::Calibrate(args) => calibrate::run(&args, settings),
            Command::Doctor(args) => doctor::run(&args, settings, console),
            Command::New(args) => new::run(&args),
            Command::Repl(args) => repl::run(&args, settings, console),
            Command::Check(args) => check::run(&args, settings),
            Command::Test(args) => test::run(&args, settings, console),
            Command::Lesson(args) => lesson::run(&args, console),
            Command::Class(args) => class::run(&args, settings, console),
            Command::Api(args) => api::run(&args),
            Command::Sim(args) => sim::run(&args, console),
            Command::Colour(args) => colour::run(&args, settings, console),
            Command::Config(args) => config::run(&args, settings, console),
            Command::Completions(args) => completions::run(&args, command()),
        }
    }
}

/// The definition of the command line, from which the manual pages are generated.
#[must_use]
pub fn command() -> clap::Command {
    Cli::command()
}

/// Parses the command line, runs the subcommand and returns its exit code.
pub fn main() -> ExitCode {
    keep_descriptors();
    let mut args = std::env::args_os().skip(1);
    match args.next() {
        Some(first) if first == HOST_ARGUMENT => {
            return host_main(args);
        }
        Some(first) if first == WORKER_ARGUMENT => return work(args),
        Some(first) if first == GUARDIAN_ARGUMENT => return guardian_main(args),
        _ => {}
    }
    secret::remove_from_environment();
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // A broken stderr cannot be reported.
            let _ = error.print();
            return exit_of(&error).into();
        }
    };
    let start_logging = |console: &Console, format, detail| {
        report_panics(console.clone());
        logging::start(console, format, detail);
    };
    execute(cli, Console::start, start_logging).into()
}

#[derive(Debug)]
pub struct TestOutput {
    pub code: u8,
    pub out: String,
    /// What was written to stderr: log and error messages.
    pub err: String,
}

/// Runs a command in this process, for tests of texts and exit codes: without the program's handler
/// of panics, and with output, log and errors collected for this call alone, so that tests can run
/// side by side. Not for commands that start processes of this program.
pub fn run_for_test(args: &[&str]) -> TestOutput {
    let cli = match Cli::try_parse_from(std::iter::once("spykee").chain(args.iter().copied())) {
        Ok(cli) => cli,
        Err(error) => {
            let exit = exit_of(&error);
            let text = error.render().to_string();
            let (out, err) = match exit {
                Exit::Usage => (String::new(), text),
                _ => (text, String::new()),
            };
            let code = exit as u8;
            return TestOutput { code, out, err };
        }
    };
    let err = console::Collected::default();
    let start_console = |format| Console::collecting(err.clone(), format);
    COLLECTED_STDOUT.set(Some(String::new()));
    let exit = execute(cli, start_console, logging::start_on_this_thread);
    TestOutput {
        code: exit as u8,
        out: COLLECTED_STDOUT.take().unwrap_or_default(),
        err: err.into_text(),
    }
}

/// The exit code after a command line was not parsed: a mistake, or a request for help.
fn exit_of(error: &clap::Error) -> Exit {
    if error.use_stderr() {
        Exit::Usage
    } else {
        Exit::Done
    }
}

/// Starts console and logging as given, runs the subcommand, and writes its error if it fails.
fn execute<Guard>(
    cli: Cli,
    start_console: impl FnOnce(LogFormat) -> std::io::Result<Console>,
    start_logging: impl FnOnce(&Console, LogFormat, Detail) -> Guard,
) -> Exit {
    let named = match cli.command {
        Command::Service(_) => None,
        _ => cli.config,
    };
    let is_named = named.is_some();
    let settings = CommandSettings::new(named);
    let format = cli.log_format.unwrap_or_default();
    let Ok(console) = start_console(format) else {
        return Exit::Failed;
    };
    let detail = match cli.command {
        Command::Serve(_) => Detail::Service,
        _ => Detail::Full,
    };
    let _logging = start_logging(&console, format, detail);
    let usable = if cli.command.uses_settings() {
        settings.warn_about_variables();
        Ok(())
    } else if is_named {
        settings.load().map(|_| ())
    } else {
        Ok(())
    };
    let (exit, last_words) = match usable.and_then(|()| cli.command.run(&settings, &console)) {
        Ok(exit) => (exit, None),
        Err(failure) if failure.what.is_empty() => (failure.exit, None),
        Err(failure) => (failure.exit, Some(failure.report())),
    };
    console.end(last_words.as_deref(), CONSOLE_LIMIT);
    exit
}

/// Runs a confined process of the kind named by its first argument.
fn work(mut args: impl Iterator<Item = OsString>) -> ExitCode {
    match args.next() {
        Some(kind) if kind == INSPECTION => inspection_main(args),
        Some(kind) if kind == LEARNER => learner_main(args),
        Some(kind) if kind == SCENARIO_PROCESS => scenario_process_main(args),
        _ => Exit::Usage.into(),
    }
}

/// Reports panics as internal errors: one line with the location, and a backtrace only if
/// `RUST_BACKTRACE` requests it. Writes through the console: a blocked stderr must not keep a
/// panicking thread from stopping the robot.
fn report_panics(console: Console) {
    std::panic::set_hook(Box::new(move |panic| {
        let payload = payload_text(panic.payload());
        let place = panic
            .location()
            .map_or_else(String::new, |place| format!(" at {place}"));
        let mut text = format!("internal error{place}: {payload}\nhelp: please report this line");
        let trace = std::backtrace::Backtrace::capture();
        if trace.status() == std::backtrace::BacktraceStatus::Captured {
            text.push_str(&format!("\n{trace}"));
        }
        console.write_line("ERROR", &text);
    }));
}

/// The message given to `panic!`, if it is text.
fn payload_text(payload: &dyn std::any::Any) -> &str {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str))
        .unwrap_or("no message")
}

/// Formats a count, such as `1 error` or `2 errors`.
fn plural(count: usize, word: &str) -> String {
    format!("{count} {word}{}", if count == 1 { "" } else { "s" })
}

/// Runs a future on its own runtime. Abandons unfinished background work.
fn block_on<F: Future>(future: F) -> Result<F::Output, Failure> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build();
    let runtime = runtime.map_err(|error| Failure::io("start the runtime", error))?;
    let output = runtime.block_on(future);
    runtime.shutdown_timeout(RUNTIME_LIMIT);
    Ok(output)
}

thread_local! {
    /// Collects what this thread prints, if it runs a command for a test.
    static COLLECTED_STDOUT: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// Writes text to stdout, without control sequences that could affect a terminal. A closed pipe is
/// not an error. Returns the exit code of a command that has done its work with that.
fn print(text: &str) -> Result<Exit, Failure> {
    print_coloured(text, false)
}

fn print_json(value: &impl Serialize) -> Result<Exit, Failure> {
    let text = serde_json::to_string(value).map_err(Failure::internal)?;
    print(&format!("{text}\n"))
}

/// Like [`print`], but with `colour` keeps the sequences that set colours: the caller must already
/// have cleaned all text from outside.
fn print_coloured(text: &str, colour: bool) -> Result<Exit, Failure> {
    let text = sanitize::text(text, colour);
    let is_collected = COLLECTED_STDOUT.with_borrow_mut(|collected| {
        if let Some(collected) = collected {
            collected.push_str(&text);
        }
        collected.is_some()
    });
    if is_collected {
        return Ok(Exit::Done);
    }
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::io("write to stdout", error))
        }
        _ => Ok(Exit::Done),
    }
}
