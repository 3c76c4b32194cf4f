//! A learner's run: a simulation in a confined process of its own, in virtual time whose clock keeps
//! pace with the real one, so that it can be slow, and stand. Nothing but its server reaches it, by
//! the private socket that is its standard input. The first connection tells it what to run; the run
//! ends with that connection. The others are those of viewers.

use std::ffi::OsString;
use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::process::{ExitCode, exit};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::{EnvFilter, Registry};

use crate::agent::{Agent, Behaviour, BehaviourSpec, Change, Plan, Roster};
use crate::behaviour::{Launch, Library, RestartPolicy, STACK, is_failure};
use crate::config::Config;
use crate::control::{EmergencyStop, Run, SimulatedRobot};
use crate::live::{self, LogTap, RunDefinition, Script, WebContext};
use crate::pilot::{LinkState, Status};
use crate::robot::{AgentEvent, BusMessage, EndReason, Listener, Priority};
use crate::sandbox::confined_main;
use crate::sim::{self, World};
use crate::simulation::{self, SimClock, Simulation, TimeScale};
use crate::{script, simulation::Options};

/// The hidden argument that selects this purpose of a confined process.
pub const LEARNER: &str = "learner";
/// The order to stand; another one lets everything go on.
pub(super) const HOLD: &str = "hold";
/// Maximum length of what the server tells a run, in bytes.
pub(super) const MAX_TOLD: u64 = 2 << 20;
/// What is in the log of a run and of a robot's agent.
pub(super) const LOG_FILTER: &str = "warn,spykee=info,spykee::script=debug";
/// A script that cannot be interrupted for this long ends the run.
const STUCK_LIMIT: Duration = Duration::from_secs(5);

/// What to run. Without a source the robot stands in its world.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct RunPlan {
    /// The script's name, such as `03-moving`; its file is `03-moving.lua` in `folder`.
    pub(super) name: String,
    pub(super) source: Option<String>,
    /// The learner's folder, in which modules are found.
    pub(super) folder: PathBuf,
    /// Where the script saves.
    pub(super) data: PathBuf,
    /// A built-in world.
    pub(super) world: String,
    /// Simulated seconds per second.
    pub(super) speed: f64,
    pub(super) seed: u64,
}

/// What happened in a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum RunNews {
    Started,
    Ended {
        /// What went wrong, for the script's author; `None`: nothing.
        error: Option<String>,
    },
}

/// The main function of the process. The arguments describe its `SandboxPolicy`.
pub fn learner_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    confined_main(arguments, "learner", STACK, play)
}

fn play() -> io::Result<()> {
    let log = Registry::default().with(EnvFilter::new(LOG_FILTER));
    let log = log.with(LogTap);
    let _ = tracing::dispatcher::set_global_default(log.into());
    let listener = UnixListener::from(io::stdin().as_fd().try_clone_to_owned()?);
    let (server, _) = listener.accept()?;
    let mut told = BufReader::new(server.try_clone()?.take(MAX_TOLD));
    let mut line = String::new();
    told.read_line(&mut line)?;
    let plan: RunPlan = serde_json::from_str(&line)?;
    let unknown = || io::Error::other("there is no such world");
    let world = World::builtin(&plan.world).ok_or_else(unknown)?;
    let clock = SimClock::default();
    clock.set_time_scale(TimeScale::new(plan.speed).unwrap_or(TimeScale::REAL));
    let held = clock.clone();
    std::thread::Builder::new()
        .name("server".to_owned())
        .spawn(move || obey(told, &held))?;
    script::when_stuck(STUCK_LIMIT, |_| exit(1));
    let options = Options {
        seed: plan.seed,
        sim: sim::Options {
            faults: Some(Vec::new()),
            ..sim::Options::default()
        },
        sim_clock: Some(clock),
        ..Options::default()
    };
    simulation::run(world, options, async |simulation: &Simulation| {
        drive(simulation, plan, listener, server).await
    })?
}

/// Holds the clock and lets it go on, as the server says; ends the process with the server.
fn obey(told: impl io::BufRead, clock: &SimClock) {
    for line in told.lines().map_while(Result::ok) {
        clock.hold(serde_json::from_str::<String>(&line).is_ok_and(|order| order == HOLD));
    }
    exit(0);
}

async fn drive(
    simulation: &Simulation,
    plan: RunPlan,
    listener: UnixListener,
    server: UnixStream,
) -> io::Result<()> {
    let definition = watch::channel(RunDefinition {
        scripts: plan.script().into_iter().collect(),
        timetable: None,
    });
    let config = Config::default().with_robot_of(simulation.sim().world());
    let agent_plan = Plan {
        stays: true,
        specs: plan.spec(&plan.name, &config).into_iter().collect(),
        ..simulation.plan(Vec::new())
    };
    let bus = agent_plan.pilot.bus.clone();
    let events = bus.subscribe();
    let for_page = bus.subscribe();
    let (agent, status) = Agent::new(agent_plan);
    let run = Run {
        simulated: true,
        sim: Some(SimulatedRobot {
            robot: simulation.sim().clone(),
            sim_clock: simulation.sim_clock(),
        }),
        ..Run::new(
            &agent,
            "a simulation",
            EmergencyStop::simulated(&bus),
            status.clone(),
        )
    };
    let context = WebContext {
        run,
        definition: definition.1,
        bus: for_page,
        log: live::tap(),
        data: plan.data.clone(),
    };
    let _page = live::serve_privately(context, listener).map_err(io::Error::other)?;
    let roster = agent.roster();
    tokio::spawn(follow(plan, roster, status, events, server));
    let ended = agent.run(simulation.stop()).await;
    ended.map(drop).map_err(io::Error::other)
}

/// Starts the script when the robot is there, and tells the server how it goes.
async fn follow(
    plan: RunPlan,
    roster: Roster,
    mut status: watch::Receiver<Status>,
    mut events: Listener,
    mut server: UnixStream,
) {
    let mut tell = move |news: &RunNews| {
        let line = serde_json::to_string(news).unwrap_or_default();
        // A server that is gone ends this process.
        let _ = server.write_all(format!("{line}\n").as_bytes());
    };
    let up = status.wait_for(|status| status.link == LinkState::Up);
    let is_up = up.await.is_ok();
    if !is_up || plan.source.is_none() {
        return;
    }
    let start = roster.change(Change::Start, &plan.name, None, "the learner");
    if let Err(error) = start.await {
        let error = Some(error.to_string());
        tell(&RunNews::Ended { error });
    }
    while let Some(message) = events.next().await {
        let BusMessage::Event(event) = message else {
            continue;
        };
        match &event.what {
            AgentEvent::Started { .. } => tell(&RunNews::Started),
            AgentEvent::Ended {
                reason, message, ..
            } => tell(&RunNews::Ended {
                error: what_failed(*reason, message.as_deref()),
            }),
            _ => {}
        }
    }
}

/// The script of blocks, in which each line tells the log that it runs, so that the page can show
/// which block does: at most forty of them in a second of the script's clock.
pub(super) fn traced(source: &str) -> String {
    let mut traced = "local __n, __s = 0, 0 local function __at(line) local s = clock.now() // 1 \
                      if s ~= __s then __n, __s = 0, s end __n += 1 \
                      if __n <= 40 then log.debug(line) end end "
        .to_owned();
    for (index, line) in source.lines().enumerate() {
        let code = line.trim_start();
        let ends = ["end", "else", "until"].map(|word| code.starts_with(word));
        if !code.is_empty() && !ends.contains(&true) {
            traced += &format!("__at(\"{}\") ", index + 1);
        }
        traced += line;
        traced.push('\n');
    }
    traced
}

pub(super) fn what_failed(reason: EndReason, message: Option<&str>) -> Option<String> {
    if is_failure(reason) {
        Some(message.unwrap_or(reason.sentence()).to_owned())
    } else {
        None
    }
}

impl RunPlan {
    fn file(&self) -> String {
        format!("{}.lua", self.name)
    }

    /// The script as the page shows it.
    fn script(&self) -> Option<Script> {
        Some(Script {
            name: self.name.clone(),
            file: self.file().into(),
            source: self.source.clone()?,
            params: Vec::new(),
        })
    }

    /// The script as a behaviour of this name.
    pub(super) fn spec(&self, name: &str, config: &Config) -> Option<BehaviourSpec> {
        let source = self.source.clone()?.into_bytes();
        let options = script::Options {
            data_dir: Some(self.data.clone()),
            detections: true,
            ..config.script(name.to_owned(), self.file(), self.seed)
        };
        let launch = Launch {
            source,
            options,
            library: Library::new(self.folder.clone()),
        };
        Some(BehaviourSpec::new(
            name.to_owned(),
            Priority(0),
            move || {
                Ok(Behaviour {
                    priority: Priority(0),
                    launch: launch.clone(),
                    checked: false,
                    restart: RestartPolicy::Never,
                    reloads: None,
                })
            },
        ))
    }
}
