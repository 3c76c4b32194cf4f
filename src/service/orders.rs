//! The orders given by the service whose results are outstanding. They run concurrently: a script
//! that loads slowly delays neither the timetable nor the idle robot. An order is outstanding until
//! it has been executed, however long that takes.

use std::collections::BTreeSet;
use std::future::Future;

use tokio::sync::mpsc;
use tokio::task::{AbortHandle, JoinSet};

use crate::agent::{BehaviourSpec, Docked, PilotClient, PilotClientError, Roster, RosterError};
use crate::robot::channel::{Request, Role};
use crate::robot::{BehaviourId, DockPlan, Priority};

/// The client with which an idle robot is sent home; its number is between those of the persons and
/// of the rescue behaviour.
const IDLE_CLIENT: BehaviourId = BehaviourId(0xFFFD);
/// The lowest priority.
const LOWEST: Priority = Priority(i16::MIN);

/// The result of an order.
#[derive(Debug)]
pub(super) enum OrderResult {
    /// A start.
    Started(String, Result<(), RosterError>),
    /// A stop or a restart.
    Changed(String, Result<(), RosterError>),
    /// An idle robot was sent home.
    Home(Result<Docked, PilotClientError>),
}

/// See the module.
pub(super) struct Orders {
    roster: Roster,
    tasks: JoinSet<OrderResult>,
    /// Behaviours with an outstanding order.
    names: BTreeSet<String>,
}

impl Orders {
    pub(super) fn new(roster: Roster) -> Orders {
        Orders {
            roster,
            tasks: JoinSet::new(),
            names: BTreeSet::new(),
        }
    }

    /// Whether no behaviour has an outstanding order.
    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Whether this behaviour has an outstanding order.
    pub(super) fn has(&self, run: &str) -> bool {
        self.names.contains(run)
    }

    pub(super) fn start(&mut self, run: String) {
        let roster = self.roster.without_timeout();
        let name = run.clone();
        self.spawn(run, async move {
            let started = roster.start(&name).await;
            OrderResult::Started(name, started)
        });
    }

    pub(super) fn stop(&mut self, run: String) {
        let roster = self.roster.without_timeout();
        let name = run.clone();
        self.spawn(run, async move {
            let stopped = roster.stop(&name).await;
            OrderResult::Changed(name, stopped)
        });
    }

    pub(super) fn restart(&mut self, run: String) {
        let roster = self.roster.without_timeout();
        let name = run.clone();
        self.spawn(run, async move {
            let restarted = roster.restart(&name).await;
            OrderResult::Changed(name, restarted)
        });
    }

    fn spawn(&mut self, run: String, order: impl Future<Output = OrderResult> + Send + 'static) {
        self.names.insert(run);
        self.tasks.spawn(order);
    }

    /// Sends the idle robot to its station. Aborting the returned task cancels the docking.
    pub(super) fn send_home(&mut self, requests: mpsc::Sender<Request>) -> AbortHandle {
        self.tasks
            .spawn(async move { OrderResult::Home(send_home(requests).await) })
    }

    /// Returns the next result; `None` while no order is outstanding. Cancel-safe.
    pub(super) async fn next(&mut self) -> Option<OrderResult> {
        loop {
            // An aborted order has no result.
            if let Ok(result) = self.tasks.join_next().await? {
                if let OrderResult::Started(run, _) | OrderResult::Changed(run, _) = &result {
                    self.names.remove(run);
                }
                return Some(result);
            }
        }
    }

    /// Replaces the behaviours of the roster.
    ///
    /// # Errors
    /// See [`Roster::define`].
    pub(super) async fn define(&self, specs: Vec<BehaviourSpec>) -> Result<(), RosterError> {
        self.roster.define(specs).await
    }
}

/// Docks with the lowest priority. Dropping the future cancels the docking.
async fn send_home(requests: mpsc::Sender<Request>) -> Result<Docked, PilotClientError> {
    let client =
        PilotClient::join(requests, IDLE_CLIENT, "an idle robot", LOWEST, Role::Person).await;
    client?.dock(DockPlan::DEFAULT).await
}
