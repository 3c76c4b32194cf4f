//! `--fast`: a run or a service in a simulation on its own thread, in virtual time; this thread
//! shows the progress and handles signals, in real time. A script that cannot be interrupted ends
//! the run and the program.

use std::convert::Infallible;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::Mutex;
use tokio::sync::{oneshot, watch};
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use super::assembly::{RunRobot, RunSetup, StartedRun, with_trace, zone};
use super::interrupt::TerminatingSignals;
use super::startup::runtime;
use super::status::{StatusLine, show};
use super::{Console, Exit, Failure};
use crate::agent::AgentError;
use crate::clock::hours;
use crate::control::{EmergencyStop, SimulatedRobot};
use crate::journal::{self, SimulationJournal};
use crate::pilot::Status;
use crate::script;
use crate::sim::{Handle, World};
use crate::simulation::{self, Recorder, SimClock, Simulation};

/// A script that cannot be interrupted for this long ends the run.
const STUCK_LIMIT: Duration = Duration::from_secs(5);
/// Time limit, in real time, for ending the scripts and the run after a signal.
const SHUTDOWN_LIMIT: Duration = Duration::from_secs(10);

/// The view of a simulation from outside: the agent's status and the simulator.
type SimulationView = (watch::Receiver<Status>, Handle);

/// Has `drive` run the agent of this setup in a simulation of this world, and logs the speed.
pub(super) fn run(
    setup: RunSetup,
    world: World,
    console: &Console,
    drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure> + Send + 'static,
) -> Result<Exit, Failure> {
    let config = &setup.config;
    let events = setup.events.as_deref().map(EventFile::create).transpose()?;
    let options = simulation::Options {
        seed: setup.sim_options.seed,
        sim: setup.sim_options.clone(),
        limits: config.watchdog.clone(),
        streams: config.streams,
        events: events.as_ref().map(EventFile::recorder),
        date: setup.date.map(|date| date.at(&zone(true, config))),
        sim_clock: setup.page.as_ref().map(|_| SimClock::default()),
        ..simulation::Options::default()
    };
    let runtime = runtime()?;
    let began = Instant::now();
    let stop = options.stop.clone();
    let names = setup.names.clone();
    let is_service = setup.is_service;
    let (opened, view) = oneshot::channel();
    let shown = console.clone();
    let simulate = move || {
        simulation::run(world, options, async move |simulation: &Simulation| {
            let exit = run_agent(setup, simulation, opened, &shown, drive).await;
            (exit, simulation.now())
        })
    };
    let showing = async {
        let Ok((status, sim)) = view.await else {
            return std::future::pending().await;
        };
        let prefix = || {
            let simulated = sim.state().time;
            let factor = factor(simulated, began.elapsed());
            format!("{} ({factor:.0}x) · ", hours(simulated))
        };
        let line = StatusLine::new(names, Some(sim.clone()));
        show(line, status, console, is_service, prefix).await
    };
    let watched = watch_over(simulate, stop, showing, console);
    let (exit, simulated) = runtime.block_on(watched)?;
    tracing::info!("{}", summary(simulated, began.elapsed()));
    events.map_or(Ok(()), EventFile::finish)?;
    exit
}

/// Runs the agent within the simulation, of which it sends the view.
async fn run_agent(
    mut setup: RunSetup,
    simulation: &Simulation,
    opened: oneshot::Sender<SimulationView>,
    console: &Console,
    drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let sim = simulation.sim().clone();
    let robot = RunRobot {
        pilot: simulation.plan(Vec::new()).pilot,
        target: "a simulation".to_owned(),
        sim: Some(SimulatedRobot {
            robot: sim.clone(),
            sim_clock: simulation.sim_clock(),
        }),
        emergency_stop: EmergencyStop::default(),
        stop: simulation.stop(),
    };
    let config = &setup.config;
    // By default, fast runs are not mixed with the history of real runs.
    let journal = if setup.keeps_journal() {
        let about = journal::RunInfo {
            target: "a simulated robot".to_owned(),
            simulated: true,
        };
        let bus = &robot.pilot.bus;
        let data = config.data_folder();
        Some(SimulationJournal::start(bus, data, config.journal, about))
    } else {
        None
    };
    let (started, _control, _page) = setup.assemble(robot, console)?;
    let _ = opened.send((started.status.clone(), sim.clone()));
    let exit = drive(started).await;
    if let Some(journal) = journal {
        journal.finish().await;
    }
    with_trace(exit, setup.trace, Some(sim))
}

/// Runs a simulation on its own thread, shows its progress, and ends it at a signal.
async fn watch_over<T: Send + 'static>(
    simulate: impl FnOnce() -> io::Result<T> + Send + 'static,
    stop: CancellationToken,
    showing: impl Future<Output = Infallible>,
    console: &Console,
) -> Result<T, Failure> {
    let mut signals = TerminatingSignals::except(&[])?;
    // A script that cannot be interrupted ends the program.
    let last = console.clone();
    script::when_stuck(STUCK_LIMIT, move |file| {
        let words = format!("error: {}", script::stuck(file));
        exit_with_message(&last, &words, Exit::Failed);
    });
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

fn no_simulation(error: io::Error) -> Failure {
    Failure::io("start the simulation", error)
}

/// Ends the program with these last words when the simulation cannot be ended.
fn exit_with_message(console: &Console, words: &str, exit: Exit) -> ! {
    console.end(Some(words), super::CONSOLE_LIMIT);
    std::process::exit(exit as i32)
}

/// How many times faster than real time it runs.
fn factor(simulated: Duration, real: Duration) -> f64 {
    simulated.as_secs_f64() / real.as_secs_f64().max(1e-6)
}

fn summary(simulated: Duration, real: Duration) -> String {
    let factor = factor(simulated, real);
    let seconds = real.as_secs_f64();
    let simulated = hours(simulated);
    format!("{simulated} simulated in {seconds:.1} s ({factor:.0}x)")
}

/// An event log file with one JSON object per line; or the first error of writing it.
struct EventFile {
    shown: String,
    file: Arc<Mutex<io::Result<BufWriter<File>>>>,
}

impl EventFile {
    fn create(path: &Path) -> Result<EventFile, Failure> {
        let shown = path.display().to_string();
        let file = File::create(path)
            .map_err(|error| Failure::io(format_args!("write the event log {shown}"), error))?;
        let file = Arc::new(Mutex::new(Ok(BufWriter::new(file))));
        Ok(EventFile { shown, file })
    }

    fn recorder(&self) -> Recorder {
        let file = self.file.clone();
        Recorder::new(move |event| {
            let mut file = file.lock();
            if let Ok(writer) = &mut *file {
                let written = serde_json::to_writer(&mut *writer, &event)
                    .map_err(io::Error::from)
                    .and_then(|()| writer.write_all(b"\n"));
                if let Err(error) = written {
                    *file = Err(error);
                }
            }
        })
    }

    fn finish(self) -> Result<(), Failure> {
        let mut file = self.file.lock();
        let error = match &mut *file {
            Ok(writer) => writer.flush().err().map(|error| error.to_string()),
            Err(error) => Some(error.to_string()),
        };
        error.map_or(Ok(()), |error| {
            let what = format!("the event log {} is incomplete: {error}", self.shown);
            Err(Failure::internal(what))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_has_duration_and_speed() {
        let summary = summary(Duration::from_secs(3600), Duration::from_millis(1100));
        assert_eq!(summary, "1:00:00 simulated in 1.1 s (3273x)");
    }
}
