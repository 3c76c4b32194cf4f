//! The behaviours of a running agent by name: which ones exist, which run, and a handle that
//! starts, stops and restarts them at any time. The handle is for those who request this (a
//! person's tool, a timetable, a page); the [`BehaviourSet`](super::behaviour_set) does it.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::sync::{broadcast, mpsc, oneshot, watch};
use tokio::time::{Instant, timeout};

use super::Behaviour;
use crate::robot::{
    BehaviourId, DeclaredParams, Detections, EndReason, ParamChange, ParamValue, Priority,
    ViewerChannel,
};
use crate::script::ScriptExit;
use crate::yaml::suggestion;

/// The most queued commands; with a full queue a command is refused.
const MAX_COMMANDS: usize = 32;
/// How long a person waits: for a script's last words and the loading of the next one.
const ANSWER: Duration = Duration::from_secs(10);

/// Creates the behaviour of this name each time it starts: its file is read again then.
#[derive(Clone)]
pub struct BehaviourSpec {
    name: String,
    pub(super) priority: Priority,
    /// Why it cannot be started at present, for those who look at the list.
    pub problem: Option<String>,
    make: Arc<dyn Fn() -> Result<Behaviour, RosterError> + Send + Sync>,
}

impl BehaviourSpec {
    /// Creates a spec. `make` may block on the disk: it is called off the driving core.
    pub fn new(
        name: impl Into<String>,
        priority: Priority,
        make: impl Fn() -> Result<Behaviour, RosterError> + Send + Sync + 'static,
    ) -> BehaviourSpec {
        BehaviourSpec {
            name: name.into(),
            priority,
            problem: None,
            make: Arc::new(make),
        }
    }

    /// The spec of an existing behaviour: the same text each time.
    pub(super) fn from_behaviour(behaviour: &Behaviour) -> BehaviourSpec {
        let first = behaviour.again();
        let name = first.launch.options.name.clone();
        BehaviourSpec::new(name, first.priority, move || Ok(first.again()))
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// How it ended last if it cannot be started.
    pub(super) fn exit(&self) -> Option<ScriptExit> {
        let problem = self.problem.as_ref()?;
        Some(ScriptExit {
            reason: EndReason::Error,
            message: Some(format!("cannot start: {problem}")),
        })
    }

    pub(super) fn make(&self) -> Result<Behaviour, RosterError> {
        (self.make)()
    }
}

impl fmt::Debug for BehaviourSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("BehaviourSpec").field(&self.name).finish()
    }
}

#[derive(Debug, Clone)]
pub struct BehaviourStatus {
    pub name: String,
    /// Decides which behaviour drives when several want to.
    pub priority: Priority,
    pub state: BehaviourState,
    /// How it last ended in this agent, if it ever did.
    pub exit: Option<ScriptExit>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BehaviourState {
    Idle,
    Loading,
    /// It runs, or waits for the pause before its restart.
    Running {
        /// Its number, which no other running behaviour has.
        by: BehaviourId,
        since: Instant,
    },
    Ending,
}

impl BehaviourState {
    /// The name that pages and programs receive.
    pub fn name(self) -> &'static str {
        match self {
            BehaviourState::Idle => "idle",
            BehaviourState::Loading => "loading",
            BehaviourState::Running { .. } => "running",
            BehaviourState::Ending => "ending",
        }
    }

    pub fn is_running(self) -> bool {
        matches!(self, BehaviourState::Running { .. })
    }
}

/// Why a command is refused or has failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RosterError {
    #[error("no behaviour is called `{name}`{near}")]
    Unknown {
        name: String,
        /// A suggestion, such as `; did you mean ...?`.
        near: String,
    },
    #[error("`{0}` runs already")]
    RunsAlready(String),
    #[error("`{0}` does not run")]
    DoesNotRun(String),
    /// Its script cannot be loaded; the message is for its author.
    #[error("{0}")]
    CannotLoad(String),
    #[error("`{0}` was stopped before it had started")]
    StoppedFirst(String),
    #[error("{0} behaviours run already, which is the maximum")]
    Full(usize),
    /// The parameter does not exist, cannot be changed, or does not allow the value; in words.
    #[error("{0}")]
    WrongParam(String),
    #[error("the robot is not connected")]
    Offline,
    /// Too many commands are queued, a command took too long, or a later restart replaced it.
    #[error("too many requests at once, try again")]
    Busy,
    #[error("the run is ending")]
    Closed,
}

impl RosterError {
    pub(super) fn unknown<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> RosterError {
        let names: Vec<&str> = names.collect();
        let near = match suggestion(name, names.iter().copied()) {
            near if !near.is_empty() => near,
            _ if names.is_empty() => "; there are none".to_owned(),
            _ => format!("; there are {}", names.join(", ")),
        };
        let name = name.to_owned();
        RosterError::Unknown { name, near }
    }
}

/// A change of a behaviour's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Change {
    /// Start it.
    Start,
    /// Stop it.
    Stop,
    /// Stop it if it runs, and start it again from its file.
    Restart,
}

pub(super) type Reply = oneshot::Sender<Result<(), RosterError>>;

#[derive(Debug)]
pub(super) enum RosterCommand {
    /// Change the state of this behaviour in the name of somebody. One that is started is ended after
    /// this time.
    Change(Change, String, Option<Duration>, String, Reply),
    /// End all of them, also those that are to be started again. The reply does not wait for that.
    StopAll(String, Reply),
    /// The same for those that have driven.
    StopDrivers(String, Reply),
    /// Replace the known behaviours. Running behaviours continue.
    Define(Vec<BehaviourSpec>, Reply),
}

/// The handle: cheap to clone, usable from any thread.
#[derive(Debug, Clone)]
pub struct Roster {
    commands: mpsc::Sender<RosterCommand>,
    statuses: watch::Receiver<Vec<BehaviourStatus>>,
    viewers: ViewerChannel,
    without_timeout: bool,
    /// How often all were stopped.
    stops: watch::Sender<u64>,
}

impl Roster {
    pub(super) fn new(
        statuses: watch::Receiver<Vec<BehaviourStatus>>,
        viewers: ViewerChannel,
    ) -> (Roster, mpsc::Receiver<RosterCommand>) {
        let (commands, taken) = mpsc::channel(MAX_COMMANDS);
        (
            Roster {
                commands,
                statuses,
                viewers,
                without_timeout: false,
                stops: watch::Sender::new(0),
            },
            taken,
        )
    }

    /// The same handle for callers that must know the outcome: its commands wait until they are
    /// executed, however long that takes. Others get [`RosterError::Busy`] after a while, although
    /// the command may still be executed.
    pub fn without_timeout(&self) -> Roster {
        Roster {
            without_timeout: true,
            ..self.clone()
        }
    }

    /// Changes a behaviour's state in the name of `by`. Returns when its script is loaded and begins,
    /// or when it has ended, after its last words; then it is not restarted, also if its new text cannot
    /// be loaded. A started one is ended after it has run for `time_limit`; a restart resets the time.
    pub async fn change(
        &self,
        change: Change,
        name: &str,
        time_limit: Option<Duration>,
        by: &str,
    ) -> Result<(), RosterError> {
        let name = name.to_owned();
        let by = by.to_owned();
        self.send_command(|reply| RosterCommand::Change(change, name, time_limit, by, reply))
            .await
    }

    /// Changes with each [`Roster::stop_all`].
    pub fn stops(&self) -> watch::Receiver<u64> {
        self.stops.subscribe()
    }

    /// Ends all behaviours, also those that an earlier command starts or restarts; returns when
    /// they have ended.
    pub async fn stop_all(&self, by: &str) -> Result<(), RosterError> {
        self.stops.send_modify(|stops| *stops += 1);
        self.send_command(|reply| RosterCommand::StopAll(by.to_owned(), reply))
            .await?;
        let mut statuses = self.statuses();
        let is_ending = |one: &BehaviourStatus| one.state == BehaviourState::Ending;
        let ended = statuses.wait_for(|statuses| !statuses.iter().any(is_ending));
        match timeout(ANSWER, ended).await {
            Ok(Ok(_)) => Ok(()),
            Ok(Err(_)) => Err(RosterError::Closed),
            Err(_) => Err(RosterError::Busy),
        }
    }

    /// Has all behaviours end that have driven; does not wait until they have ended.
    pub async fn stop_drivers(&self, by: String) -> Result<(), RosterError> {
        self.send_command(|reply| RosterCommand::StopDrivers(by, reply))
            .await
    }

    /// Replaces the known behaviours; running behaviours continue.
    pub async fn define(&self, specs: Vec<BehaviourSpec>) -> Result<(), RosterError> {
        self.send_command(|reply| RosterCommand::Define(specs, reply))
            .await
    }

    /// All behaviours that are known or run, in the order of the config; the receiver can wait for
    /// changes.
    pub fn statuses(&self) -> watch::Receiver<Vec<BehaviourStatus>> {
        self.statuses.clone()
    }

    /// Subscribes to what the behaviours find in frames; slow receivers miss some.
    pub fn detections(&self) -> broadcast::Receiver<Detections> {
        self.viewers.detections()
    }

    /// The parameters of the running behaviours; the receiver can wait for changes.
    pub fn params(&self) -> watch::Receiver<DeclaredParams> {
        self.viewers.params().declared()
    }

    /// Changes a parameter of a running behaviour, until it is restarted. The behaviour makes the
    /// final decision: it logs a value that it refuses.
    pub fn change_param(
        &self,
        behaviour: &str,
        name: &str,
        value: ParamValue,
    ) -> Result<(), RosterError> {
        let params = self.params();
        let params = params.borrow();
        let runs = || RosterError::DoesNotRun(behaviour.to_owned());
        let list = params.get(behaviour).ok_or_else(runs)?;
        let Some(param) = list.iter().find(|param| param.name == name) else {
            let near = suggestion(name, list.iter().map(|param| param.name.as_str()));
            let words = format!("`{behaviour}` has no parameter of this name{near}");
            return Err(RosterError::WrongParam(words));
        };
        if !param.live {
            let words = format!("`{name}` cannot be changed while `{behaviour}` runs");
            return Err(RosterError::WrongParam(words));
        }
        if !param.allows(&value) {
            let words = format!("`{name}` must be {}", param.expected());
            return Err(RosterError::WrongParam(words));
        }
        let behaviour = behaviour.to_owned();
        let name = name.to_owned();
        self.viewers.params().change(ParamChange {
            behaviour,
            name,
            value,
        });
        Ok(())
    }

    async fn send_command(
        &self,
        make: impl FnOnce(Reply) -> RosterCommand,
    ) -> Result<(), RosterError> {
        let (reply, answer) = oneshot::channel();
        if self.without_timeout {
            let sent = self.commands.send(make(reply)).await;
            sent.map_err(|_| RosterError::Closed)?;
            return answer.await.unwrap_or(Err(RosterError::Closed));
        }
        self.commands
            .try_send(make(reply))
            .map_err(|error| match error {
                mpsc::error::TrySendError::Full(_) => RosterError::Busy,
                mpsc::error::TrySendError::Closed(_) => RosterError::Closed,
            })?;
        match timeout(ANSWER, answer).await {
            Ok(Ok(answer)) => answer,
            Ok(Err(_)) => Err(RosterError::Closed),
            Err(_) => Err(RosterError::Busy),
        }
    }
}

#[cfg(test)]
mod tests {
    use tokio::time::sleep;

    use super::*;

    impl Roster {
        /// A roster without behaviours: for each start and stop the test gets its text and the
        /// channel for its outcome.
        pub(crate) fn fake(
            statuses: watch::Receiver<Vec<BehaviourStatus>>,
        ) -> (Roster, mpsc::UnboundedReceiver<(String, Reply)>) {
            let (roster, mut commands) = Roster::new(statuses, ViewerChannel::default());
            let (shown, taken) = mpsc::unbounded_channel();
            tokio::spawn(async move {
                while let Some(command) = commands.recv().await {
                    let text = format!("{command:?}");
                    let RosterCommand::Change(.., reply) = command else {
                        continue;
                    };
                    let _ = shown.send((text, reply));
                }
            });
            (roster, taken)
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_patient_command_waits_for_its_outcome_longer_than_a_person_does() {
        let (roster, mut commands) = Roster::fake(watch::Sender::new(Vec::new()).subscribe());
        let slow = async {
            let (_, first) = commands.recv().await.unwrap();
            let (_, second) = commands.recv().await.unwrap();
            sleep(2 * ANSWER).await;
            for reply in [first, second] {
                let _ = reply.send(Ok(()));
            }
        };
        let patient = roster.without_timeout();
        let (hasty, patient, ()) = tokio::join!(
            roster.change(Change::Start, "go", None, "anna"),
            patient.change(Change::Start, "go", None, "ben"),
            slow
        );
        assert_eq!((hasty, patient), (Err(RosterError::Busy), Ok(())));
    }
}
