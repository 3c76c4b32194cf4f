//! Plays one scenario: its script on the one hand, behaviours and robot in a laboratory on the
//! other, in turns on one thread.

use std::future::pending;
use std::io;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::rc::Rc;
use std::time::Duration;

use image::RgbImage;
use serde::{Deserialize, Serialize};
use tokio::task::yield_now;
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::subscriber::{NoSubscriber, with_default};

use super::book::{Book, Scenario, load_world};
use super::cast::Cast;
use super::chronicle::Chronicle;
use super::stage::{PlayStage, StageCommand};
use crate::agent::{AgentError, Outcome};
use crate::clock::until;
use crate::config::Config;
use crate::lab::{self, Lab};
use crate::robot::{Bus, EndReason};
use crate::script::{Script, SourceLocation};
use crate::sim::{self, Pose};

/// Lines that a scenario's script wrote, at most.
const MAX_LINES: usize = 200;

/// What scenarios have in common.
#[derive(Debug, Clone, Default)]
pub struct Setting {
    /// Colours, calibration, limits and the watchdog's numbers.
    pub config: Config,
    /// What `sim:run()` runs when it names nothing; else the behaviour that has the file's name
    /// without `_test`.
    pub subject: Option<PathBuf>,
    /// Within it behaviours keep what they keep, until the scenario is over; the system's own folder
    /// for such things unless given.
    pub data: Option<PathBuf>,
    /// How the simulated firmware behaves where the real one is unknown.
    pub firmware: sim::Firmware,
    /// Ends all that is played when cancelled.
    pub stop: CancellationToken,
}

/// How it went.
#[derive(Debug, Serialize, Deserialize)]
pub struct Played {
    /// Virtual time.
    pub simulated: Duration,
    /// What did not become true.
    pub failure: Option<Failure>,
    /// What the scenario's script wrote with `print` and `log`.
    pub lines: Vec<String>,
}

/// What did not become true, and what it was like then.
#[derive(Debug, Serialize, Deserialize)]
pub struct Failure {
    /// The message of the `expect`, or what else went wrong.
    pub message: String,
    /// What kind of thing that is.
    pub cause: Cause,
    /// The line of the scenario.
    pub place: Option<SourceLocation>,
    /// The text of that line.
    pub line: Option<String>,
    /// What happened last, oldest first, each with its time.
    pub recent: Vec<String>,
    /// How things stood; nothing if the process is gone in which it was played.
    pub scene: Option<Scene>,
}

/// The robot when a scenario failed.
#[derive(Debug, Serialize, Deserialize)]
pub struct Scene {
    /// Virtual time since the start.
    pub at: Duration,
    /// Where the robot stood.
    pub pose: Pose,
    /// Its battery, percent.
    pub battery: f64,
    /// The way of the robot on the map of its world.
    #[serde(with = "as_png")]
    pub picture: RgbImage,
}

/// A picture between processes.
mod as_png {
    use std::io::Cursor;

    use image::{ImageFormat, RgbImage, load_from_memory_with_format};
    use serde::de::Error as _;
    use serde::ser::Error as _;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(super) fn serialize<S: Serializer>(picture: &RgbImage, to: S) -> Result<S::Ok, S::Error> {
        let mut png = Cursor::new(Vec::new());
        let drawn = picture.write_to(&mut png, ImageFormat::Png);
        drawn.map_err(S::Error::custom)?;
        png.into_inner().serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<RgbImage, D::Error> {
        let png = Vec::<u8>::deserialize(from)?;
        let picture = load_from_memory_with_format(&png, ImageFormat::Png);
        Ok(picture.map_err(D::Error::custom)?.into_rgb8())
    }
}

/// What made a scenario fail.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    /// An `expect` did not hold.
    Expectation,
    /// A behaviour failed, with these words.
    Behaviour(String),
    /// The scenario itself: a mistake in it, or it was not over in time.
    Scenario,
}

/// Why a scenario failed.
struct Unplayed {
    cause: Cause,
    message: String,
    place: Option<SourceLocation>,
}

impl Book {
    /// Plays a scenario of this book with a seed. Blocks until it is over.
    ///
    /// # Errors
    /// If the system gives no thread or no folder for what behaviours keep.
    pub fn play(&self, scenario: &Scenario, seed: u64, setting: &Setting) -> io::Result<Played> {
        let data = match &setting.data {
            Some(folder) => tempfile::tempdir_in(folder)?,
            None => tempfile::tempdir()?,
        };
        let options = &scenario.options;
        let world =
            load_world(options.world.as_deref(), self.folder()).map_err(io::Error::other)?;
        let (config, chronicle) = (&setting.config, Chronicle::default());
        let lab_options = lab::Options {
            seed,
            sim: sim::Options {
                fps: options.fps,
                firmware: setting.firmware.clone(),
                faults: Some(Vec::new()),
                ..sim::Options::default()
            },
            limits: config.watchdog.clone(),
            link: config.link.clone(),
            streams: config.streams,
            stop: setting.stop.clone(),
            events: Some(chronicle.recorder()),
            date: None,
            tempo: None,
            bus: Bus::default(),
        };
        let cast = Cast {
            config: config.clone(),
            folder: self.folder().map(Path::to_owned),
            subject: setting.subject.clone().or_else(|| self.subject()),
            data: data.path().to_owned(),
            seed,
            origin: self.file().display().to_string(),
        };
        with_default(NoSubscriber::new(), || {
            lab::run(world, lab_options, async |lab: &Lab| {
                let stage = PlayStage::new(lab.sim().clone(), cast, chronicle, scenario.index);
                let play = Play {
                    book: self,
                    scenario,
                    lab,
                    stage: Rc::new(stage),
                    agent: None,
                    lines: Vec::new(),
                };
                play.run(seed, &setting.stop).await
            })
        })
    }
}

/// An agent at work.
struct Agent {
    stop: CancellationToken,
    outcome: Pin<Box<dyn Future<Output = Result<Outcome, AgentError>>>>,
}

/// A scenario that is played.
struct Play<'a> {
    book: &'a Book,
    scenario: &'a Scenario,
    lab: &'a Lab,
    stage: Rc<PlayStage>,
    agent: Option<Agent>,
    lines: Vec<String>,
}

impl Play<'_> {
    async fn run(mut self, seed: u64, stop: &CancellationToken) -> Played {
        if let Some(percent) = self.scenario.options.battery {
            self.lab.sim().set_battery(percent);
            yield_now().await;
        }
        let trouble = match self.book.script(seed, self.stage.clone()) {
            Ok(script) => self.act(script, stop).await.err(),
            Err(failure) => Some(Unplayed {
                cause: Cause::Scenario,
                message: failure.to_string(),
                place: None,
            }),
        };
        Played {
            simulated: self.stage.time(),
            failure: trouble.map(|trouble| self.failure(trouble)),
            lines: self.lines,
        }
    }

    async fn act(&mut self, mut script: Script, stop: &CancellationToken) -> Result<(), Unplayed> {
        let limit = self.stage.began + self.scenario.options.limit;
        loop {
            script.run_ready(Instant::now());
            let lines = &mut self.lines;
            self.book.serve(&mut script, |line| {
                if lines.len() < MAX_LINES {
                    lines.push(line);
                }
            });
            self.obey();
            if let Some(end) = self.verdict(&script) {
                return end;
            }
            if script.is_ready() {
                yield_now().await;
                continue;
            }
            tokio::select! {
                biased;
                () = stop.cancelled() => return Err(self.trouble("interrupted")),
                () = sleep_until(limit) => return Err(self.too_long()),
                outcome = outcome(&mut self.agent) => self.agent_ended(outcome)?,
                () = until(script.next_deadline()) => {}
            }
        }
    }

    fn obey(&mut self) {
        while let Some(command) = self.stage.take_command() {
            match command {
                StageCommand::Run(behaviours) => {
                    let running = self.lab.start(behaviours, None);
                    self.agent = Some(Agent {
                        stop: running.stopper(),
                        outcome: Box::pin(running.outcome()),
                    });
                }
                StageCommand::Stop => match &self.agent {
                    Some(agent) => agent.stop.cancel(),
                    None => self.stage.has_stopped(),
                },
                StageCommand::Vanish => {
                    self.agent = None;
                    self.stage.has_stopped();
                }
            }
        }
    }

    fn agent_ended(&mut self, outcome: Result<Outcome, AgentError>) -> Result<(), Unplayed> {
        self.agent = None;
        self.stage.has_stopped();
        match outcome {
            Ok(_) => Ok(()),
            Err(error) => Err(self.trouble(&error.to_string())),
        }
    }

    /// Whether it is over, and how.
    fn verdict(&self, script: &Script) -> Option<Result<(), Unplayed>> {
        let failed = self.stage.chronicle.failed();
        if let Some(failed) = failed.filter(|_| !self.scenario.options.may_fail) {
            let text = format!("the behaviour {} failed: {}", failed.behaviour, failed.text);
            return Some(Err(Unplayed {
                cause: Cause::Behaviour(failed.text),
                ..self.trouble(&text)
            }));
        }
        // Also one whose error was caught.
        if let Some((place, message)) = self.stage.take_expected() {
            return Some(Err(Unplayed {
                cause: Cause::Expectation,
                message,
                place: place.or_else(|| self.stage.last_place()),
            }));
        }
        if let Some(end) = self.stage.take_end() {
            return Some(end.map_err(|raised| self.raised(raised)));
        }
        let ending = script.ended()?;
        let text = match (ending.reason, ending.message) {
            (_, Some(message)) => message,
            (EndReason::Done, None) => "its script ended before it was played".to_owned(),
            (reason, None) => reason.sentence().to_owned(),
        };
        Some(Err(self.trouble(&text)))
    }

    /// An error of the scenario's function that was no `expect`.
    fn raised(&self, raised: String) -> Unplayed {
        let shown = self.book.file().display().to_string();
        let (place, text) = match split_place(&raised, &shown) {
            Some((line, text)) => (Some(SourceLocation { file: shown, line }), text.to_owned()),
            None => (self.stage.last_place(), in_words(&raised).to_owned()),
        };
        Unplayed {
            cause: Cause::Scenario,
            message: text,
            place,
        }
    }

    fn too_long(&self) -> Unplayed {
        let limit = self.scenario.options.limit.as_secs_f64();
        self.trouble(&format!(
            "it was not over within its limit of {limit} s; a longer one is given as {{ limit = \
             seconds }}"
        ))
    }

    /// At the line that was asked from last.
    fn trouble(&self, message: &str) -> Unplayed {
        Unplayed {
            cause: Cause::Scenario,
            message: message.to_owned(),
            place: self.stage.last_place(),
        }
    }

    fn failure(&self, trouble: Unplayed) -> Failure {
        let sim = self.lab.sim();
        let state = sim.state();
        sim.note("it failed here");
        let own = |place: &SourceLocation| place.file == self.book.file().display().to_string();
        let line = trouble.place.as_ref().filter(|place| own(place));
        Failure {
            line: line.and_then(|place| self.book.line(place.line)),
            message: trouble.message,
            cause: trouble.cause,
            place: trouble.place,
            recent: self.stage.chronicle.recent(),
            scene: Some(Scene {
                at: self.stage.time(),
                pose: state.pose,
                battery: state.battery,
                picture: sim.trace().draw(sim.world()),
            }),
        }
    }
}

async fn outcome(agent: &mut Option<Agent>) -> Result<Outcome, AgentError> {
    match agent {
        Some(agent) => agent.outcome.as_mut().await,
        None => pending().await,
    }
}

/// What the VM says without a place.
fn in_words(raised: &str) -> &str {
    match raised {
        "not enough memory" => EndReason::Memory.sentence(),
        other => other,
    }
}

/// `FILE:12: text` of this file in its parts.
fn split_place<'a>(text: &'a str, file: &str) -> Option<(u32, &'a str)> {
    let rest = text.strip_prefix(file)?.strip_prefix(':')?;
    let (line, text) = rest.split_once(": ")?;
    Some((line.parse().ok()?, text))
}
