//! A service: an agent that runs permanently, and what starts and ends behaviours in it. It is
//! composed of the agent, the [timetable](crate::timetable), and the handling of an idle robot;
//! journal, broker and page work beside it, through the agent's handles.
//!
//! Nothing here is on the driving core: a service that hangs does not affect the watchdog, the
//! running behaviours and their ends, and systemd notices (see [`Herald`]).

mod clerk;
mod herald;
mod idle;
mod orders;
mod record;
mod unit;
mod words;

use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

pub use herald::Herald;
pub use record::RecordFile;
pub use unit::{Unit, unit};

use self::clerk::Clerk;
use crate::agent::{Agent, AgentError, Blueprint, Bus, Outcome};
use crate::clock::{Clock, is_plausible};
use crate::pilot::Status;
use crate::robot::channel::Quiet;
pub use crate::timetable::View;
use crate::timetable::{Planner, Record, Timetable};

/// What a service does: all that a reload may change.
#[derive(Debug, Clone)]
pub struct Duties {
    /// All behaviours.
    pub blueprints: Vec<Blueprint>,
    /// Those that are started as soon as the robot is there.
    pub always: Vec<String>,
    /// When the others are.
    pub table: Timetable,
    /// The alarm is quiet in quiet hours too.
    pub quiet_alarm: bool,
    /// What becomes of an idle robot.
    pub idle: IdlePolicy,
}

impl Duties {
    /// What must not be heard or seen at this time.
    fn quiet(&self, now: Timestamp) -> Quiet {
        let quiet = self.table.quiet.filter(|_| is_plausible(now));
        match quiet.filter(|quiet| quiet.covers(now, &self.table.zone)) {
            Some(_) if self.quiet_alarm => Quiet::WithAlarm,
            Some(_) => Quiet::Scripts,
            None => Quiet::Off,
        }
    }
}

/// What becomes of an idle robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdlePolicy {
    /// On its station it is let go of.
    pub release: bool,
    /// So long after the last behaviour has ended.
    pub after: Duration,
    /// Off its station it is sent there.
    pub dock: bool,
}

/// New duties, and what of the running behaviours they touch.
#[derive(Debug)]
pub struct Reload {
    /// From now on.
    pub duties: Duties,
    /// Behaviours of which something has changed: those that run are restarted.
    pub changed: Vec<String>,
}

/// Who is told by the clerk.
struct Listeners {
    file: Option<RecordFile>,
    herald: Herald,
    bus: Bus,
    view: watch::Sender<View>,
}

/// A service that has not begun.
pub struct Service {
    /// It stays; its plan has no behaviours of its own.
    pub agent: Agent,
    /// The newest status of robot and watchdog.
    pub status: watch::Receiver<Status>,
    /// The time of day.
    pub clock: Clock,
    /// What it does.
    pub duties: Duties,
    /// What was under way when the last one ended, and where that is kept; none: nothing is kept.
    pub record: (Record, Option<RecordFile>),
    /// Who tells the system's manager.
    pub herald: Herald,
    /// Where starts that did not happen are told: that of the agent's plan.
    pub bus: Bus,
    /// Where it publishes what comes next, for display: see [`View::channel`].
    pub view: watch::Sender<View>,
    /// New duties.
    pub reloads: mpsc::Receiver<Reload>,
}

impl Service {
    /// Runs until `stop` is cancelled.
    ///
    /// # Errors
    /// As [`Agent::run`].
    pub async fn run(self, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let Service {
            agent,
            status,
            clock,
            duties,
            record: (record, file),
            herald,
            bus,
            view,
            reloads,
        } = self;
        let clerk = Clerk::new(
            agent.roster(),
            agent.requests(),
            status,
            clock,
            Planner::new(duties.table.clone(), record),
            duties,
            Listeners {
                file,
                herald: herald.clone(),
                bus,
                view,
            },
        );
        let outcome = tokio::select! {
            biased;
            outcome = agent.run(stop.clone()) => outcome,
            never = clerk.work(reloads, stop) => match never {},
        };
        herald.stopping();
        outcome
    }
}
