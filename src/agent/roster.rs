//! The behaviours of a running agent by name: which there are, which run, and the handle by which
//! they are started, stopped and restarted at any time. The handle is for those who ask (a person's
//! tool, a timetable, a page); the [`Company`](super::company) does it.

use std::fmt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{broadcast, mpsc, oneshot, watch};
use tokio::time::{Instant, timeout};

use super::Behaviour;
use crate::robot::{
    BehaviourId, EndReason, Findings, Knobs, Lookout, ParamValue, Priority, Turned,
};
use crate::script::{Ending, suggestion};

/// Commands that may wait; with a full queue a command is refused.
const MAX_COMMANDS: usize = 32;
/// The longest that an order may take: a script's farewell, and the loading of the next one.
const ANSWER: Duration = Duration::from_secs(10);

/// Why a behaviour cannot be made from its file.
#[derive(Debug, thiserror::Error)]
pub enum BlueprintError {
    /// The system does not give the file.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// Which.
        path: PathBuf,
        /// The system's words.
        source: std::io::Error,
    },
    /// A fault of this program.
    #[error("internal error: it could not be made")]
    Internal,
}

/// What a behaviour of this name is made of, each time that it starts: its file is read anew then.
#[derive(Clone)]
pub struct Blueprint {
    name: String,
    priority: Priority,
    make: Arc<dyn Fn() -> Result<Behaviour, BlueprintError> + Send + Sync>,
}

impl Blueprint {
    /// `make` may wait for the disk: it is called off the driving core.
    pub fn new(
        name: impl Into<String>,
        priority: Priority,
        make: impl Fn() -> Result<Behaviour, BlueprintError> + Send + Sync + 'static,
    ) -> Blueprint {
        Blueprint {
            name: name.into(),
            priority,
            make: Arc::new(make),
        }
    }

    /// Of a behaviour that is there already: the same text each time.
    pub(super) fn of(behaviour: &Behaviour) -> Blueprint {
        let Behaviour {
            priority,
            launch,
            checked,
            restart,
            ..
        } = behaviour;
        let (priority, launch, checked, restart) = (*priority, launch.clone(), *checked, *restart);
        Blueprint::new(launch.options.name.clone(), priority, move || {
            Ok(Behaviour {
                priority,
                launch: launch.clone(),
                checked,
                restart,
                reloads: None,
            })
        })
    }

    /// What it is called.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub(super) fn priority(&self) -> Priority {
        self.priority
    }

    pub(super) fn make(&self) -> Result<Behaviour, BlueprintError> {
        (self.make)()
    }
}

impl fmt::Debug for Blueprint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Blueprint").field(&self.name).finish()
    }
}

/// A behaviour that is known, and how it is with it.
#[derive(Debug, Clone)]
pub struct Member {
    /// What it is called.
    pub name: String,
    /// Who wins when several want to drive.
    pub priority: Priority,
    /// What it does.
    pub state: MemberState,
    /// How it ended for the last time in this agent, if it ever did.
    pub ending: Option<Ending>,
}

/// What a behaviour does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemberState {
    /// It does not run.
    Idle,
    /// Its script is being loaded.
    Loading,
    /// It runs, or waits for the pause before its restart.
    Running {
        /// Its number, which no other behaviour has that runs.
        by: BehaviourId,
        /// Since when.
        since: Instant,
    },
    /// It has been told to end.
    Ending,
}

/// Why an order is not obeyed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RosterError {
    /// No behaviour has this name.
    #[error("no behaviour is called `{name}`{near}")]
    Unknown {
        /// The name.
        name: String,
        /// What may have been meant, such as `; did you mean ...?`.
        near: String,
    },
    /// To start what runs.
    #[error("`{0}` runs already")]
    RunsAlready(String),
    /// To stop what does not run.
    #[error("`{0}` does not run")]
    DoesNotRun(String),
    /// Its script cannot be loaded; the words are for its author.
    #[error("{0}")]
    CannotLoad(String),
    /// It was stopped before it had begun.
    #[error("`{0}` was stopped before it had started")]
    StoppedFirst(String),
    /// So many run that there is no room for another.
    #[error("{0} behaviours run already, and that is the most")]
    Full(usize),
    /// A parameter that is not there, cannot be changed, or must be something else; in words.
    #[error("{0}")]
    WrongParam(String),
    /// There is no robot that it could drive.
    #[error("the robot is not connected")]
    Offline,
    /// The agent has too much to do.
    #[error("too many requests at once, try again")]
    Busy,
    /// The agent is coming to its end.
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

/// Where an order's outcome goes.
pub(super) type Reply = oneshot::Sender<Result<(), RosterError>>;

/// What is asked of the company.
pub(super) enum RosterCommand {
    /// Start the behaviour, and end it after so long if it still runs then.
    Start(String, Option<Duration>, Reply),
    /// End it, for this reason.
    Stop(String, EndReason, Reply),
    /// End it if it runs, and start it.
    Restart(String, Reply),
    /// From now on these are known, in place of those before. What runs goes on.
    Define(Vec<Blueprint>, Reply),
}

/// The handle: cheap to clone, for any thread.
#[derive(Debug, Clone)]
pub struct Roster {
    orders: mpsc::Sender<RosterCommand>,
    members: watch::Receiver<Vec<Member>>,
    lookout: Lookout,
}

impl Roster {
    pub(super) fn new(
        members: watch::Receiver<Vec<Member>>,
        lookout: Lookout,
    ) -> (Roster, mpsc::Receiver<RosterCommand>) {
        let (orders, taken) = mpsc::channel(MAX_COMMANDS);
        (
            Roster {
                orders,
                members,
                lookout,
            },
            taken,
        )
    }

    /// Starts a behaviour; returns when its script is loaded and begins.
    ///
    /// # Errors
    /// See [`RosterError`].
    pub async fn start(&self, name: &str) -> Result<(), RosterError> {
        self.order(|reply| RosterCommand::Start(name.to_owned(), None, reply))
            .await
    }

    /// Starts a behaviour, and ends it after it has run for so long, unless it has ended by itself. A
    /// restart begins the time anew.
    ///
    /// # Errors
    /// See [`RosterError`].
    pub async fn start_for(&self, name: &str, lasts: Duration) -> Result<(), RosterError> {
        self.order(|reply| RosterCommand::Start(name.to_owned(), Some(lasts), reply))
            .await
    }

    /// Ends a behaviour; returns when it has ended, its last words said. It is not restarted.
    ///
    /// # Errors
    /// See [`RosterError`].
    pub async fn stop(&self, name: &str) -> Result<(), RosterError> {
        let reason = EndReason::Cancelled;
        self.order(|reply| RosterCommand::Stop(name.to_owned(), reason, reply))
            .await
    }

    /// Ends a behaviour if it runs, and starts it from its file as that is now. A text that cannot be
    /// loaded leaves it ended.
    ///
    /// # Errors
    /// See [`RosterError`].
    pub async fn restart(&self, name: &str) -> Result<(), RosterError> {
        self.order(|reply| RosterCommand::Restart(name.to_owned(), reply))
            .await
    }

    /// Replaces what is known; what runs goes on.
    ///
    /// # Errors
    /// See [`RosterError`].
    pub async fn define(&self, blueprints: Vec<Blueprint>) -> Result<(), RosterError> {
        self.order(|reply| RosterCommand::Define(blueprints, reply))
            .await
    }

    /// All that are known or run, in the order of the config; changes can be waited for.
    pub fn members(&self) -> watch::Receiver<Vec<Member>> {
        self.members.clone()
    }

    /// What the behaviours find in frames from now on; who is slow misses some.
    pub fn findings(&self) -> broadcast::Receiver<Findings> {
        self.lookout.look()
    }

    /// The parameters of the behaviours that run; changes can be waited for.
    pub fn knobs(&self) -> watch::Receiver<Knobs> {
        self.lookout.console().knobs()
    }

    /// Changes a parameter of a behaviour that runs, until it is started anew. Who has declared it has
    /// the last word: what it refuses after all it says in its log.
    ///
    /// # Errors
    /// See [`RosterError`].
    pub fn turn(&self, behaviour: &str, name: &str, value: ParamValue) -> Result<(), RosterError> {
        let knobs = self.knobs();
        let knobs = knobs.borrow();
        let runs = || RosterError::DoesNotRun(behaviour.to_owned());
        let list = knobs.get(behaviour).ok_or_else(runs)?;
        let Some(knob) = list.iter().find(|knob| knob.name == name) else {
            let near = suggestion(name, list.iter().map(|knob| knob.name.as_str()));
            let words = format!("`{behaviour}` has no parameter of this name{near}");
            return Err(RosterError::WrongParam(words));
        };
        if !knob.live {
            let words = format!("`{name}` cannot be changed while `{behaviour}` runs");
            return Err(RosterError::WrongParam(words));
        }
        if !knob.allows(&value) {
            let words = format!("`{name}` must be {}", knob.expected());
            return Err(RosterError::WrongParam(words));
        }
        let (behaviour, name) = (behaviour.to_owned(), name.to_owned());
        self.lookout.console().turn(Turned {
            behaviour,
            name,
            value,
        });
        Ok(())
    }

    async fn order(&self, order: impl FnOnce(Reply) -> RosterCommand) -> Result<(), RosterError> {
        let (reply, answer) = oneshot::channel();
        self.orders
            .try_send(order(reply))
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

impl fmt::Debug for RosterCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            RosterCommand::Start(name, lasts, _) => write!(f, "Start({name}, {lasts:?})"),
            RosterCommand::Stop(name, reason, _) => write!(f, "Stop({name}, {reason})"),
            RosterCommand::Restart(name, _) => write!(f, "Restart({name})"),
            RosterCommand::Define(blueprints, _) => write!(f, "Define({blueprints:?})"),
        }
    }
}
