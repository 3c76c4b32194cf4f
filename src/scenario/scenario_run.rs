//! Runs one scenario: alternates on one thread between its script and the simulation with
//! behaviours and robot.

use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use image::{ImageFormat, RgbImage};
use serde::{Deserialize, Serialize};
use tokio::task::yield_now;
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::subscriber::{NoSubscriber, with_default};

use super::behaviours::Behaviours;
use super::run_record::RunRecord;
use super::running_api::{RunningScenarioApi, ScenarioCommand};
use super::scenario_file::{Scenario, ScenarioFile, load_world};
use crate::agent::{AgentError, Outcome};
use crate::clock::{or_never, until};
use crate::config::Config;
use crate::robot::EndReason;
use crate::script::{Script, SourceLocation};
use crate::sim::{self, Pose};
use crate::simulation::{self, Running, Simulation};

const MAX_LINES: usize = 200;

#[derive(Debug, Clone, Default)]
pub struct RunSettings {
    /// Colours, calibration, limits and the watchdog's parameters; what is known of a simulated robot
    /// is added.
    pub config: Config,
    /// The behaviour that `sim:run()` runs without arguments; if `None`, the one with the file's
    /// name without `_test`.
    pub subject: Option<PathBuf>,
    /// Parent of the behaviours' data folder, which exists until the scenario is over; the system's
    /// folder for temporary files if `None`.
    pub data: Option<PathBuf>,
    pub firmware: sim::Firmware,
    /// Ends all scenarios when cancelled.
    pub stop: CancellationToken,
}

#[derive(Debug, Serialize, Deserialize)]
pub struct ScenarioResult {
    pub simulated: Duration,
    pub failure: Option<Failure>,
    /// Lines that the scenario's script wrote with `print` and `log`.
    pub lines: Vec<String>,
}

#[derive(Debug, Serialize, Deserialize)]
pub struct Failure {
    /// The message of the `expect`, or another error.
    pub message: String,
    pub cause: Cause,
    pub location: Option<SourceLocation>,
    pub line: Option<String>,
    /// What to do, if that is known.
    pub help: Option<String>,
    /// The most recent events, oldest first, each with its time.
    pub recent: Vec<String>,
    /// The robot's state; `None` if the process that ran the scenario has ended.
    pub snapshot: Option<Snapshot>,
}

/// The state of the robot when a scenario failed.
#[derive(Debug, Serialize, Deserialize)]
pub struct Snapshot {
    /// Virtual time since the start.
    pub at: Duration,
    pub pose: Pose,
    pub battery: f64,
    /// The robot's path on the map of its world, as PNG.
    pub picture: Vec<u8>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    Expectation,
    Behaviour(String),
    /// The scenario has an error or did not finish in time.
    Scenario,
}

struct FailureReason {
    cause: Cause,
    message: String,
    location: Option<SourceLocation>,
}

impl RunSettings {
    fn simulation_options(
        &self,
        config: &Config,
        seed: u64,
        fps: Option<f64>,
    ) -> simulation::Options {
        simulation::Options {
            seed,
            sim: sim::Options {
                fps,
                firmware: self.firmware.clone(),
                faults: Some(Vec::new()),
                ..sim::Options::default()
            },
            limits: config.watchdog.clone(),
            streams: config.streams,
            stop: self.stop.clone(),
            ..simulation::Options::default()
        }
    }
}

impl ScenarioFile {
    /// Runs a scenario of this file with a seed. Blocks until it is over.
    pub fn run(
        &self,
        scenario: &Scenario,
        seed: u64,
        settings: &RunSettings,
    ) -> io::Result<ScenarioResult> {
        let data = match &settings.data {
            Some(folder) => tempfile::tempdir_in(folder)?,
            None => tempfile::tempdir()?,
        };
        let options = &scenario.options;
        let world = load_world(options.world.as_deref(), self.folder());
        let world = world.map_err(io::Error::other)?;
        let config = settings.config.clone().with_robot_of(&world);
        let record = RunRecord::default();
        let simulation_options = simulation::Options {
            events: Some(record.recorder()),
            ..settings.simulation_options(&config, seed, options.fps)
        };
        let behaviours = Behaviours {
            config,
            folder: self.folder().map(Path::to_owned),
            subject: settings.subject.clone().or_else(|| self.subject()),
            data: data.path().to_owned(),
            seed,
            origin: self.file().display().to_string(),
        };
        with_default(NoSubscriber::new(), || {
            simulation::run(
                world,
                simulation_options,
                async |simulation: &Simulation| {
                    let api = RunningScenarioApi::new(
                        simulation.sim().clone(),
                        behaviours,
                        record,
                        scenario.index,
                    );
                    let scenario_run = ScenarioRun {
                        scenario_file: self,
                        scenario,
                        simulation,
                        api: Rc::new(api),
                        agent: None,
                        lines: Vec::new(),
                    };
                    scenario_run.run(seed, &settings.stop).await
                },
            )
        })
    }
}

struct ScenarioRun<'a> {
    scenario_file: &'a ScenarioFile,
    scenario: &'a Scenario,
    simulation: &'a Simulation,
    api: Rc<RunningScenarioApi>,
    agent: Option<Running>,
    lines: Vec<String>,
}

impl ScenarioRun<'_> {
    async fn run(mut self, seed: u64, stop: &CancellationToken) -> ScenarioResult {
        if let Some(percent) = self.scenario.options.battery {
            self.simulation.sim().set_battery(percent);
            yield_now().await;
        }
        let reason = match self.scenario_file.script(seed, self.api.clone()) {
            Ok(script) => self.act(script, stop).await.err(),
            Err(failure) => Some(FailureReason {
                cause: Cause::Scenario,
                message: failure.to_string(),
                location: None,
            }),
        };
        ScenarioResult {
            simulated: self.api.time(),
            failure: reason.map(|reason| self.failure(reason)),
            lines: self.lines,
        }
    }

    async fn act(
        &mut self,
        mut script: Script,
        stop: &CancellationToken,
    ) -> Result<(), FailureReason> {
        let limit = self.api.began + self.scenario.options.limit;
        loop {
            script.run_ready(Instant::now());
            let lines = &mut self.lines;
            self.scenario_file.serve(&mut script, |line| {
                if lines.len() < MAX_LINES {
                    lines.push(line);
                }
            });
            self.execute_commands();
            if let Some(end) = self.verdict(&script) {
                return end;
            }
            if script.is_ready() {
                yield_now().await;
                continue;
            }
            tokio::select! {
                biased;
                () = stop.cancelled() => return Err(self.failure_reason("interrupted")),
                () = sleep_until(limit) => return Err(self.limit_exceeded()),
                outcome = or_never(self.agent.as_mut().map(Running::ended)) => {
                    self.agent_ended(outcome)?;
                }
                () = until(script.next_deadline()) => {}
            }
        }
    }

    fn execute_commands(&mut self) {
        while let Some(command) = self.api.take_command() {
            match command {
                ScenarioCommand::Run(behaviours) => {
                    self.agent = Some(self.simulation.start(behaviours, None));
                }
                ScenarioCommand::Stop => match &self.agent {
                    Some(agent) => agent.stop(),
                    None => self.api.has_stopped(),
                },
                ScenarioCommand::Vanish => {
                    self.agent = None;
                    self.api.has_stopped();
                }
            }
        }
    }

    fn agent_ended(&mut self, outcome: Result<Outcome, AgentError>) -> Result<(), FailureReason> {
        self.agent = None;
        self.api.has_stopped();
        match outcome {
            Ok(_) => Ok(()),
            Err(error) => Err(self.failure_reason(&error.to_string())),
        }
    }

    fn verdict(&self, script: &Script) -> Option<Result<(), FailureReason>> {
        if let Some(failed) = self.api.record.failed()
            && !self.scenario.options.may_fail
        {
            let text = format!("the behaviour {} failed: {}", failed.behaviour, failed.text);
            return Some(Err(FailureReason {
                cause: Cause::Behaviour(failed.text),
                ..self.failure_reason(&text)
            }));
        }
        // A failed `expect` counts even if the script caught its error.
        if let Some((location, message)) = self.api.take_expected() {
            return Some(Err(FailureReason {
                cause: Cause::Expectation,
                message,
                location: location.or_else(|| self.api.last_location()),
            }));
        }
        if let Some(end) = self.api.take_end() {
            return Some(end.map_err(|raised| self.raised(raised)));
        }
        let exit = script.ended()?;
        let text = match (exit.reason, exit.message) {
            (_, Some(message)) => message,
            (EndReason::Done, None) => "its script ended before it ran".to_owned(),
            (reason, None) => reason.sentence().to_owned(),
        };
        Some(Err(self.failure_reason(&text)))
    }

    /// Creates a failure from an error of the scenario's function that is not from `expect`.
    fn raised(&self, raised: String) -> FailureReason {
        let shown = self.scenario_file.file().display().to_string();
        let (location, text) = match split_location(&raised, &shown) {
            Some((line, text)) => (Some(SourceLocation { file: shown, line }), text.to_owned()),
            None => (
                self.api.last_location(),
                translate_error(&raised).to_owned(),
            ),
        };
        FailureReason {
            cause: Cause::Scenario,
            message: text,
            location,
        }
    }

    fn limit_exceeded(&self) -> FailureReason {
        let limit = self.scenario.options.limit.as_secs_f64();
        self.failure_reason(&format!(
            "it did not finish within its limit of {limit} s; set a longer one with {{ limit = \
             seconds }}"
        ))
    }

    /// Creates a failure at the place of the script's last call.
    fn failure_reason(&self, message: &str) -> FailureReason {
        FailureReason {
            cause: Cause::Scenario,
            message: message.to_owned(),
            location: self.api.last_location(),
        }
    }

    fn failure(&self, reason: FailureReason) -> Failure {
        let sim = self.simulation.sim();
        let state = sim.state();
        sim.note("it failed here");
        let own = |location: &SourceLocation| {
            location.file == self.scenario_file.file().display().to_string()
        };
        let line = reason.location.as_ref().filter(|location| own(location));
        let line = line.map(|location| location.line);
        // A message of several lines is explained already.
        let is_plain = reason.cause == Cause::Scenario && !reason.message.contains('\n');
        let explained = match line {
            Some(line) if is_plain => self.scenario_file.explanation(line, &reason.message),
            _ => None,
        };
        Failure {
            line: line.and_then(|line| self.scenario_file.line(line)),
            help: explained.as_ref().and_then(|one| one.help.clone()),
            message: explained.map_or(reason.message, |one| one.message),
            cause: reason.cause,
            location: reason.location,
            recent: self.api.record.recent(),
            snapshot: Some(Snapshot {
                at: self.api.time(),
                pose: state.pose,
                battery: state.battery,
                picture: png(&sim.trace().draw(sim.world())),
            }),
        }
    }
}

fn png(picture: &RgbImage) -> Vec<u8> {
    let mut png = io::Cursor::new(Vec::new());
    if let Err(error) = picture.write_to(&mut png, ImageFormat::Png) {
        // Writing to memory does not fail.
        tracing::error!("cannot draw the robot's path: {error}");
    }
    png.into_inner()
}

/// Rewrites errors that the VM raises without a place.
fn translate_error(raised: &str) -> &str {
    match raised {
        "not enough memory" => EndReason::Memory.sentence(),
        other => other,
    }
}

/// Splits `FILE:12: text`, for this file, into line and text.
fn split_location<'a>(text: &'a str, file: &str) -> Option<(u32, &'a str)> {
    let rest = text.strip_prefix(file)?.strip_prefix(':')?;
    let (line, text) = rest.split_once(": ")?;
    Some((line.parse().ok()?, text))
}
