//! A service: an agent that runs permanently, with its timetable and the handling of an idle robot.
//! Nothing here runs on the driving core: a service that hangs does not affect the watchdog and the
//! running behaviours, and systemd notices it (see [`ManagerNotifier::pass_on`]).

mod describe;
mod executor;
mod idle;
mod manager_notifier;
mod record;
mod unit;

use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

pub use manager_notifier::ManagerNotifier;
pub use record::{OpenedRecord, RecordFile};
pub use unit::{Unit, unit};

use self::executor::Executor;
use crate::agent::{
    Agent, AgentError, BehaviourSpec, Bus, ConnectAttempts, Outcome, Plan, retry_until_connected,
};
use crate::clock::{Clock, is_plausible};
use crate::pilot::Status;
use crate::robot::channel::Quiet;
pub use crate::timetable::View;
use crate::timetable::{Planner, Timetable};

/// What a service does: everything that a reload may change.
#[derive(Debug, Clone)]
pub struct ServicePlan {
    pub specs: Vec<BehaviourSpec>,
    /// Names of the behaviours that are started as soon as the robot is connected.
    pub always: Vec<String>,
    /// The timetable of the other behaviours.
    pub table: Timetable,
    /// Whether quiet hours also silence the alarm.
    pub quiet_alarm: bool,
    pub idle: IdlePolicy,
}

impl ServicePlan {
    fn quiet(&self, now: Timestamp) -> Quiet {
        match self.table.quiet {
            Some(hours) if is_plausible(now) && hours.covers(now, &self.table.zone) => {
                if self.quiet_alarm {
                    Quiet::WithAlarm
                } else {
                    Quiet::Scripts
                }
            }
            _ => Quiet::Off,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdlePolicy {
    /// Whether to release its link when it is on its station.
    pub release: bool,
    /// How long after the end of the last behaviour the robot counts as idle.
    pub after: Duration,
    /// Whether to send it to its station when it is off it.
    pub dock: bool,
}

/// A new plan, and the behaviours affected by the change.
#[derive(Debug)]
pub struct Reload {
    pub service_plan: ServicePlan,
    /// Behaviours whose definition has changed; the running ones are restarted.
    pub changed: Vec<String>,
}

struct Listeners {
    file: Option<RecordFile>,
    notifier: ManagerNotifier,
    bus: Bus,
    view: watch::Sender<View>,
}

pub struct Service {
    /// The permanent agent; its plan contains no behaviours.
    pub agent: Agent,
    pub status: watch::Receiver<Status>,
    pub clock: Clock,
    pub service_plan: ServicePlan,
    pub record: OpenedRecord,
    pub notifier: ManagerNotifier,
    /// Publishes missed starts; the bus of the agent's plan.
    pub bus: Bus,
    /// Publishes the next start, for display: see [`View::channel`].
    pub view: watch::Sender<View>,
    pub reloads: mpsc::Receiver<Reload>,
}

impl Service {
    /// A service in a simulation: it has no manager, nobody reloads its config, and its first
    /// connection is repeated until it succeeds.
    pub fn in_simulation(
        mut plan: Plan,
        service_plan: ServicePlan,
        record: OpenedRecord,
        seed: u64,
    ) -> Service {
        plan.stays = true;
        plan.specs = service_plan.specs.clone();
        plan.connector = retry_until_connected(plan.connector, seed, ConnectAttempts::default());
        let bus = plan.bus.clone();
        let (agent, status) = Agent::new(plan);
        let (_, reloads) = mpsc::channel(1);
        Service {
            agent,
            status,
            clock: Clock::default(),
            service_plan,
            record,
            notifier: ManagerNotifier::default(),
            bus,
            view: View::channel().0,
            reloads,
        }
    }

    /// Runs until `stop` is cancelled.
    pub async fn run(self, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let Service {
            agent,
            status,
            clock,
            service_plan,
            record: OpenedRecord { record, file },
            notifier,
            bus,
            view,
            reloads,
        } = self;
        let mut executor = Executor::new(
            agent.roster(),
            agent.requests(),
            status,
            clock,
            Planner::new(service_plan.table.clone(), record),
            service_plan,
            Listeners {
                file,
                notifier: notifier.clone(),
                bus,
                view,
            },
        );
        let outcome = tokio::select! {
            biased;
            outcome = agent.run(stop.clone()) => outcome,
            never = executor.work(reloads, stop) => match never {},
        };
        notifier.stopping();
        outcome
    }
}
