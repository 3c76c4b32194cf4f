//! The service under test: made anew after each power cut, on the same data folder and the same robot.

use std::path::Path;
use std::time::Duration;

use spykee::agent::{
    Agent, AgentError, BehaviourSpec, Bus, ConnectAttempts, Outcome, retry_until_connected,
};
use spykee::clock::{Clock, Span};
use spykee::journal::{Options, RunInfo, SimulationJournal};
use spykee::link;
use spykee::robot::{Priority, Streams, Use};
use spykee::script;
use spykee::service::{IdlePolicy, ManagerNotifier, RecordFile, Service, ServicePlan, View};
use spykee::simulation::Simulation;
use spykee::timetable::{Rule, Timetable};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::super::behaviour;
use super::calendar::{CATCH_UP, PATROL};

/// Days that the journal remembers, and how large it may be.
pub const KEEPS: Options = Options {
    record: spykee::journal::When::On,
    keep_days: 10,
    max_mib: 8,
};
/// A light of the robot that is on for as long as a patrol runs: the robot's own account of runs.
const LIT_WHILE_RUNNING: &str = "robot.led('left', true) \
                         script.on_stop(function() robot.led('left', false) end) ";
const LOOK: &str = "robot.led('right', true)
local frame = robot.wait_frame(5)
local path = if frame then frame:save('look.jpg') else nil
robot.stream('video', false)
journal.add('looked', { seen = path ~= nil })
robot.led('right', false)";

/// A service that runs.
pub struct ServiceFixture {
    stop: CancellationToken,
    service: JoinHandle<Result<Outcome, AgentError>>,
    journal: SimulationJournal,
}

impl ServiceFixture {
    pub fn open(simulation: &Simulation, data: &Path, seed: u64) -> ServiceFixture {
        let bus = Bus::default();
        let about = RunInfo {
            target: "a simulated robot".to_owned(),
            simulated: true,
        };
        let journal = SimulationJournal::start(&bus, data, KEEPS, about);
        let service_plan = service_plan(data, seed);
        let mut plan = simulation.plan(Vec::new());
        plan.stays = true;
        plan.specs = service_plan.specs.clone();
        plan.connector = retry_until_connected(
            plan.connector,
            link::Options::default(),
            seed,
            ConnectAttempts::default(),
        );
        plan.bus = bus.clone();
        let (agent, status) = Agent::new(plan);
        // Nobody reloads.
        let (_, reloads) = mpsc::channel(1);
        let service = Service {
            agent,
            status,
            clock: Clock::default(),
            service_plan,
            record: RecordFile::open_in_simulation(data),
            notifier: ManagerNotifier::default(),
            bus,
            view: View::channel().0,
            reloads,
            ended_by_person: CancellationToken::new(),
        };
        let stop = CancellationToken::new();
        let service = tokio::task::spawn_local(service.run(stop.clone()));
        ServiceFixture {
            stop,
            service,
            journal,
        }
    }

    /// It has ended by itself.
    pub fn is_over(&self) -> bool {
        self.service.is_finished()
    }

    /// Ended without a word: nothing is written any more.
    pub fn cut(self) {
        self.service.abort();
    }

    /// As by SIGTERM.
    pub async fn close(self) -> bool {
        self.stop.cancel();
        let ended = matches!(self.service.await, Ok(Ok(_)));
        self.journal.finish().await;
        ended
    }
}

fn service_plan(data: &Path, seed: u64) -> ServicePlan {
    let patrol = include_str!("../../behaviours/patrol.lua");
    let scripts = [
        ("patrol", format!("{LIT_WHILE_RUNNING}{patrol}")),
        ("look", LOOK.to_owned()),
    ];
    let specs = scripts
        .into_iter()
        .zip(seed..)
        .map(|((name, source), seed)| spec(name, source, seed, data));
    let rule = |run: &str, at: &str, lasts: Option<Duration>| Rule {
        run: run.to_owned(),
        at: at.parse().unwrap(),
        lasts: lasts.map(|lasts| Span::minutes(lasts.as_secs() / 60)),
    };
    ServicePlan {
        specs: specs.collect(),
        always: Vec::new(),
        table: Timetable {
            rules: vec![
                rule("patrol", "0 9,21 * * *", Some(PATROL)),
                rule("look", "30 14 * * *", None),
            ],
            zone: "Europe/Rome".parse().unwrap(),
            quiet: Some("22:00-07:00".parse().unwrap()),
            catch_up: Span::minutes(CATCH_UP.as_secs() / 60),
        },
        quiet_alarm: true,
        idle: IdlePolicy {
            release: false,
            after: Duration::from_secs(60),
            dock: true,
        },
    }
}

fn spec(name: &'static str, source: String, seed: u64, data: &Path) -> BehaviourSpec {
    let streams = Streams {
        // A patrol's pictures are not what is tested here.
        video: if name == "patrol" {
            Use::Off
        } else {
            Use::Auto
        },
        ..Streams::default()
    };
    let options = script::Options {
        seed,
        streams,
        data_dir: Some(data.join(name)),
        time_zone: "Europe/Rome".to_owned(),
        ..script::Options::new(name, format!("{name}.lua"))
    };
    BehaviourSpec::new(name, Priority(0), move || {
        Ok(behaviour(source.clone(), options.clone()))
    })
}
