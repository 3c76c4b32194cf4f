//! `run --sim --fast`: the run happens in a simulation on its own thread, in virtual time; this
//! thread shows the progress and handles signals, in real time. A script that cannot be interrupted
//! ends the run and the program.

use std::convert::Infallible;
use std::fmt;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{oneshot, watch};
use tokio::time::sleep;

use super::interrupt::TerminatingSignals;
use super::live::PageInputs;
use super::startup::{STATUS_PERIOD, runtime};
use super::status::StatusLine;
use super::world::TraceFile;
use super::{Console, Exit, Failure};
use crate::agent::{AgentError, Behaviour, Bus, ConnectAttempts, Outcome};
use crate::clock::{every, hours};
use crate::config::Config;
use crate::control::{self, SimulatedRobot};
use crate::journal::{self, SimulationJournal};
use crate::pilot::Status;
use crate::robot::Streams;
use crate::script;
use crate::sim::{Handle, World};
use crate::simulation::{self, Recorder, Running, Simulation};
use crate::timetable::View;

/// A script that cannot be interrupted for this long ends the run.
const STUCK_LIMIT: Duration = Duration::from_secs(5);
/// Time limit, in real time, for ending the scripts and the run after a signal.
const SHUTDOWN_LIMIT: Duration = Duration::from_secs(10);

/// A fast run: its behaviours, world and outputs.
pub(super) struct Fast {
    pub(super) world: World,
    pub(super) behaviours: Vec<Behaviour>,
    pub(super) options: simulation::Options,
    pub(super) limit: Option<Duration>,
    /// The picture of the robot's path, drawn at the end.
    pub(super) trace: Option<TraceFile>,
    /// The page that shows the run and controls its clock.
    pub(super) page: Option<PageInputs>,
    pub(super) journal: Option<SimulationJournalOptions>,
}

/// A journal in virtual time and its folder. It is kept only if the config explicitly has
/// `journal: { record: on }`: by default, fast runs are not mixed with the history of real runs.
pub(super) struct SimulationJournalOptions {
    data: PathBuf,
    options: journal::Options,
}

impl SimulationJournalOptions {
    /// The journal that this config asks for, if any.
    pub(super) fn from_config(config: &Config) -> Option<SimulationJournalOptions> {
        let wanted = config.journal.record == journal::When::On;
        wanted.then(|| SimulationJournalOptions {
            data: config.data_folder().to_owned(),
            options: config.journal,
        })
    }

    /// Starts the journal, within the simulation.
    pub(super) fn start(self, bus: &Bus) -> SimulationJournal {
        let about = journal::RunInfo {
            target: "a simulated robot".to_owned(),
            simulated: true,
        };
        SimulationJournal::start(bus, &self.data, self.options, about)
    }
}

/// The view of a simulation from outside: the agent's status and the simulator.
type SimulationView = (watch::Receiver<Status>, Handle);

/// How the agent ended, and the virtual time that had passed.
type Run = (Result<Outcome, AgentError>, Duration);

impl Fast {
    /// Runs to the end and logs the speed.
    pub(super) fn run(
        self,
        names: String,
        console: &Console,
    ) -> Result<Result<Outcome, AgentError>, Failure> {
        let runtime = runtime()?;
        let began = Instant::now();
        let (outcome, simulated) = runtime.block_on(self.run_watched(names, began, console))?;
        tracing::info!("{}", Pace::new(simulated, began.elapsed()).summary());
        Ok(outcome)
    }

    async fn run_watched(
        self,
        names: String,
        began: Instant,
        console: &Console,
    ) -> Result<Run, Failure> {
        let mut signals = TerminatingSignals::except(&[])?;
        let stop = self.options.stop.clone();
        exit_when_stuck(console);
        let last = console.clone();
        let (opened, view) = oneshot::channel();
        let (ended, mut end) = oneshot::channel();
        let shown = console.clone();
        let simulation_thread = move || {
            let _ = ended.send(self.run_simulation(opened, &shown));
        };
        let thread = std::thread::Builder::new()
            .name("fast".into())
            .spawn(simulation_thread)
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
            exit_with_message(&last, &words, Exit::Interrupted)
        };
        let result = tokio::select! {
            biased;
            result = &mut end => result,
            never = show(names, view, began, console) => match never {},
            never = watching => match never {},
        };
        let joined = thread.join();
        match (result, joined) {
            (Ok(result), Ok(())) => result.map_err(no_simulation)?,
            _ => Err(Failure::new(
                Exit::Failed,
                AgentError::Broken("the simulation"),
            )),
        }
    }

    /// Runs the simulation, on a thread without a runtime.
    fn run_simulation(
        self,
        opened: oneshot::Sender<SimulationView>,
        console: &Console,
    ) -> std::io::Result<Result<Run, Failure>> {
        let behaviours = self.behaviours;
        let limit = self.limit;
        let trace = self.trace;
        let page = self.page;
        let sim_clock = self.options.sim_clock.clone();
        let streams = self.options.streams;
        let journal = self.journal;
        let bus = self.options.bus.clone();
        simulation::run(self.world, self.options, async |simulation: &Simulation| {
            let journal = journal.map(|journal| journal.start(&bus));
            let run = simulation.start(behaviours, limit);
            let simulated = SimulatedRobot {
                robot: simulation.sim().clone(),
                sim_clock,
            };
            let page = page.map(|page| page.serve(run_handle(&run, streams, simulated), console));
            let _page = page.transpose()?;
            let _ = opened.send((run.status(), simulation.sim().clone()));
            let outcome = run.outcome().await;
            if let Some(journal) = journal {
                journal.finish().await;
            }
            if let Some(Err(failure)) = trace.map(|trace| trace.write(simulation.sim())) {
                tracing::error!("{}", failure.report());
            }
            Ok((outcome, simulation.now()))
        })
    }
}

/// The handle through which the page accesses the run.
fn run_handle(run: &Running, streams: Streams, sim: SimulatedRobot) -> control::Run {
    control::Run {
        requests: run.requests(),
        roster: run.roster(),
        status: run.status(),
        pictures: run.pictures(),
        reactions: run.reactions(),
        end: None,
        emergency_stop: control::EmergencyStop::default(),
        streams,
        target: "a simulation".to_owned(),
        simulated: true,
        sim: Some(sim),
        began: tokio::time::Instant::now(),
        // A single run has no timetable.
        view: View::channel().1,
    }
}

/// Ends the program if a script cannot be interrupted for [`STUCK_LIMIT`].
pub(super) fn exit_when_stuck(console: &Console) {
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

async fn show(
    names: String,
    view: oneshot::Receiver<SimulationView>,
    began: Instant,
    console: &Console,
) -> Infallible {
    let Ok((status, sim)) = view.await else {
        return std::future::pending().await;
    };
    let mut line = StatusLine::new(names, Some(sim.clone()), ConnectAttempts::default());
    let mut ticks = every(STATUS_PERIOD);
    loop {
        ticks.tick().await;
        let newest = *status.borrow();
        let pace = Pace::new(sim.state().time, began.elapsed());
        if console.has_status_line() {
            console.status(format!("{pace} · {}", line.draw(&newest)));
        } else if let Some(text) = line.plain_line(&newest) {
            console.status_line_plain(&format!("{pace} · {text}"));
        }
    }
}

pub(super) fn no_simulation(error: std::io::Error) -> Failure {
    Failure::io("start the simulation", error)
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
