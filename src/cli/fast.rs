//! `--fast`: a run or a service in a simulation on its own thread, in virtual time; this thread shows
//! the progress and handles signals, in real time. A script that cannot be interrupted ends the run and
//! the program.

use std::convert::Infallible;
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{oneshot, watch};
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::assembly::zone;
use super::connection::ChosenRobot;
use super::interrupt::TerminatingSignals;
use super::startup::runtime;
use super::status::{StatusLine, show};
use super::{Console, Exit, Failure};
use crate::agent::{AgentError, Bus, ConnectAttempts};
use crate::clock::{Date, hours};
use crate::config::Config;
use crate::journal::{self, SimulationJournal};
use crate::pilot::Status;
use crate::script;
use crate::sim::{Handle, World};
use crate::simulation::{self, Recorder, Simulation};

/// A script that cannot be interrupted for this long ends the run.
const STUCK_LIMIT: Duration = Duration::from_secs(5);
/// Time limit, in real time, for ending the scripts and the run after a signal.
const SHUTDOWN_LIMIT: Duration = Duration::from_secs(10);

/// A run or service in virtual time.
pub(super) struct FastSetup<'a> {
    pub(super) config: &'a Config,
    pub(super) robot: ChosenRobot,
    /// What the config and the further fields do not say.
    pub(super) options: simulation::Options,
    pub(super) date: Option<Date>,
    /// The file for all events.
    pub(super) events: Option<&'a Path>,
    /// The beginning of the status line.
    pub(super) names: String,
    pub(super) is_service: bool,
}

/// The view of a simulation from outside: the agent's status and the simulator.
pub(super) type SimulationView = (watch::Receiver<Status>, Handle);

impl FastSetup<'_> {
    /// Has `job` run an agent in the simulation, and logs the speed. The job sends the view of it.
    pub(super) fn run(
        self,
        console: &Console,
        job: impl AsyncFnOnce(&Simulation, oneshot::Sender<SimulationView>) -> Result<Exit, Failure>
        + Send
        + 'static,
    ) -> Result<Exit, Failure> {
        let config = self.config;
        let world = world_of(self.robot, self.is_service)?;
        let events = self.events.map(EventFile::create).transpose()?;
        let options = simulation::Options {
            limits: config.watchdog.clone(),
            streams: config.streams,
            events: events.as_ref().map(EventFile::recorder),
            date: self.date.map(|date| date.at(&zone(true, config))),
            ..self.options
        };
        let runtime = runtime()?;
        let began = Instant::now();
        let stop = options.stop.clone();
        let bus = options.bus.clone();
        let journal = JournalSetup::from_config(config);
        let (opened, view) = oneshot::channel();
        let simulate = move || {
            simulation::run(world, options, async |simulation: &Simulation| {
                let journal = journal.map(|journal| journal.start(&bus));
                let exit = job(simulation, opened).await;
                if let Some(journal) = journal {
                    journal.finish().await;
                }
                (exit, simulation.now())
            })
        };
        let showing = async {
            let Ok((status, sim)) = view.await else {
                return std::future::pending().await;
            };
            let pace = || Pace::new(sim.state().time, began.elapsed());
            let prefix = || format!("{} · ", pace());
            let line = StatusLine::new(self.names, Some(sim.clone()), ConnectAttempts::default());
            show(line, status, console, self.is_service, prefix).await
        };
        let watched = watch_over(simulate, stop, showing, console);
        let (exit, simulated) = runtime.block_on(watched)?;
        tracing::info!("{}", Pace::new(simulated, began.elapsed()).summary());
        events.map_or(Ok(()), EventFile::finish)?;
        exit
    }
}

fn world_of(robot: ChosenRobot, is_service: bool) -> Result<World, Failure> {
    match robot {
        ChosenRobot::Sim(world) => Ok(*world),
        ChosenRobot::Robot(_) => {
            let example = if is_service {
                "spykee serve --sim --fast --for 86400"
            } else {
                "spykee run FILE.lua --sim --fast"
            };
            let why = "--fast needs --sim: a real robot runs in real time";
            Err(Failure::usage(why).help(example))
        }
    }
}

/// A journal in virtual time and its folder. It is kept only if the config explicitly has
/// `journal: { record: on }`: by default, fast runs are not mixed with the history of real runs.
struct JournalSetup {
    data: PathBuf,
    options: journal::Options,
}

impl JournalSetup {
    fn from_config(config: &Config) -> Option<JournalSetup> {
        let wanted = config.journal.record == journal::When::On;
        wanted.then(|| JournalSetup {
            data: config.data_folder().to_owned(),
            options: config.journal,
        })
    }

    /// Starts the journal, within the simulation.
    fn start(self, bus: &Bus) -> SimulationJournal {
        let about = journal::RunInfo {
            target: "a simulated robot".to_owned(),
            simulated: true,
        };
        SimulationJournal::start(bus, &self.data, self.options, about)
    }
}

/// Runs a simulation on its own thread, shows its progress, and ends it at a signal.
async fn watch_over<T: Send + 'static>(
    simulate: impl FnOnce() -> std::io::Result<T> + Send + 'static,
    stop: CancellationToken,
    showing: impl Future<Output = Infallible>,
    console: &Console,
) -> Result<T, Failure> {
    let mut signals = TerminatingSignals::except(&[])?;
    exit_when_stuck(console);
    let (ended, mut end) = oneshot::channel();
    let thread = std::thread::Builder::new()
        .name("fast".into())
        .spawn(move || ended.send(simulate()).is_ok())
        .map_err(no_simulation)?;
    let watching = async {
        signals.next().await;
        stop.cancel();
        // A run that can end does so at once; a second signal skips the wait.
        tokio::select! {
            () = signals.next() => {}
            () = sleep(SHUTDOWN_LIMIT) => {}
        }
        let words = match script::running().first() {
            Some(file) => format!("error: interrupted within {file}, which did not end"),
            None => "error: interrupted before the run had ended".to_owned(),
        };
        exit_with_message(console, &words, Exit::Interrupted)
    };
    let result = tokio::select! {
        biased;
        result = &mut end => result,
        never = showing => match never {},
        never = watching => match never {},
    };
    match (result, thread.join()) {
        (Ok(result), Ok(_)) => result.map_err(no_simulation),
        _ => Err(Failure::new(
            Exit::Failed,
            AgentError::Broken("the simulation"),
        )),
    }
}

fn no_simulation(error: std::io::Error) -> Failure {
    Failure::io("start the simulation", error)
}

/// Ends the program if a script cannot be interrupted for [`STUCK_LIMIT`].
fn exit_when_stuck(console: &Console) {
    let console = console.clone();
    script::when_stuck(STUCK_LIMIT, move |file| {
        let words = format!("error: {}", script::stuck(file));
        exit_with_message(&console, &words, Exit::Failed);
    });
}

/// Ends the program with these last words when the simulation cannot be ended.
fn exit_with_message(console: &Console, words: &str, exit: Exit) -> ! {
    console.end(Some(words), super::CONSOLE_LIMIT);
    std::process::exit(exit as i32)
}

/// The virtual time that has passed, and the real time it took.
struct Pace {
    simulated: Duration,
    real: Duration,
}

impl Pace {
    fn new(simulated: Duration, real: Duration) -> Pace {
        Pace { simulated, real }
    }

    fn factor(&self) -> f64 {
        self.simulated.as_secs_f64() / self.real.as_secs_f64().max(1e-6)
    }

    fn summary(&self) -> String {
        format!(
            "{} simulated in {:.1} s ({:.0}x)",
            hours(self.simulated),
            self.real.as_secs_f64(),
            self.factor()
        )
    }
}

/// The beginning of the status line.
impl fmt::Display for Pace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:.0}x)", hours(self.simulated), self.factor())
    }
}

/// An event log file with one JSON object per line. Keeps the first write error.
pub(super) struct EventFile {
    shown: String,
    writing: Arc<Mutex<Writing>>,
}

struct Writing {
    file: BufWriter<File>,
    trouble: Option<std::io::Error>,
}

impl EventFile {
    /// Creates the file, or empties it.
    pub(super) fn create(path: &Path) -> Result<EventFile, Failure> {
        let shown = path.display().to_string();
        let file = File::create(path)
            .map_err(|error| Failure::io(format_args!("write the event log {shown}"), error))?;
        let writing = Writing {
            file: BufWriter::new(file),
            trouble: None,
        };
        Ok(EventFile {
            shown,
            writing: Arc::new(Mutex::new(writing)),
        })
    }

    /// A recorder that writes events to the file.
    pub(super) fn recorder(&self) -> Recorder {
        let writing = self.writing.clone();
        Recorder::new(move |event| {
            let mut writing = writing.lock().unwrap_or_else(PoisonError::into_inner);
            if writing.trouble.is_some() {
                return;
            }
            let written = serde_json::to_writer(&mut writing.file, &event)
                .map_err(std::io::Error::from)
                .and_then(|()| writing.file.write_all(b"\n"));
            writing.trouble = written.err();
        })
    }

    /// Writes the buffered rest.
    pub(super) fn finish(self) -> Result<(), Failure> {
        let mut writing = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        let flushed = writing.file.flush();
        match writing.trouble.take().map_or(flushed, Err) {
            Ok(()) => Ok(()),
            Err(error) => Err(Failure::internal(format_args!(
                "the event log {} is incomplete: {error}",
                self.shown
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_has_duration_and_speed() {
        let pace = Pace::new(Duration::from_secs(3600), Duration::from_millis(1100));
        assert_eq!(pace.summary(), "1:00:00 simulated in 1.1 s (3273x)");
    }
}
