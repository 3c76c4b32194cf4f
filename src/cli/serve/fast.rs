//! `serve --sim --fast`: runs days and weeks of a service in a simulation, in virtual time.

use super::service_plan::LoadedPlan;
use super::{ServeArgs, exit};
use crate::cli::fast::{EventFile, SimulationJournalOptions, exit_when_stuck, no_simulation};
use crate::cli::interrupt::TerminatingSignals;
use crate::cli::robot_target::ChosenRobot;
use crate::cli::{Console, Exit, Failure, startup};
use crate::clock::{Span, Zone};
use crate::config::Config;
use crate::service::{RecordFile, Service};
use crate::sim;
use crate::simulation::{self, Simulation};
use crate::wire::Login;

/// Serves until the time limit or the first signal.
pub(super) fn serve(
    args: &ServeArgs,
    robot: ChosenRobot,
    login: Login,
    config: &Config,
    loaded: LoadedPlan,
    seed: u64,
    console: &Console,
) -> Result<Exit, Failure> {
    let ChosenRobot::Sim(world) = robot else {
        let why = "--fast needs --sim: a real robot runs in real time";
        return Err(Failure::usage(why).help("spykee serve --sim --fast --for 86400"));
    };
    let zone = config.time_zone.clone().unwrap_or_else(Zone::utc);
    let events = args.events.as_deref().map(EventFile::create).transpose()?;
    let options = simulation::Options {
        seed,
        sim: sim::Options {
            login,
            ..sim::Options::default()
        },
        limits: config.watchdog.clone(),
        streams: config.streams,
        events: events.as_ref().map(EventFile::recorder),
        date: args.date.map(|date| date.at(&zone)),
        ..simulation::Options::default()
    };
    let stop = options.stop.clone();
    end_at_a_signal(stop.clone())?;
    let limit = args.limit.map(Span::get);
    let journal_options = SimulationJournalOptions::from_config(config);
    exit_when_stuck(console);
    let outcome = simulation::run(*world, options, async |simulation: &Simulation| {
        let mut plan = simulation.plan(Vec::new());
        plan.limit = limit;
        let journal = journal_options.map(|options| options.start(&plan.bus));
        let no_record = RecordFile::default();
        let seed = simulation.seed();
        let service = Service::in_simulation(plan, loaded.service_plan, no_record, seed);
        let outcome = service.run(stop).await;
        if let Some(journal) = journal {
            journal.finish().await;
        }
        outcome
    });
    let outcome = outcome.map_err(no_simulation)?;
    events.map_or(Ok(()), EventFile::finish)?;
    exit(outcome)
}

/// Starts a thread that cancels `stop` at the first terminating signal, in real time.
fn end_at_a_signal(stop: tokio_util::sync::CancellationToken) -> Result<(), Failure> {
    let runtime = startup::runtime()?;
    let mut signals = {
        let _guard = runtime.enter();
        TerminatingSignals::except(&[])?
    };
    let watch_signals = move || {
        runtime.block_on(async {
            signals.next().await;
            stop.cancel();
        });
    };
    std::thread::Builder::new()
        .name("signals".into())
        .spawn(watch_signals)
        .map(|_| ())
        .map_err(|error| Failure::io("start a thread", error))
}
