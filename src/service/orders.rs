//! The orders that the service has given and that are not answered yet. Nobody waits for one: a script
//! that takes its time to load keeps neither the timetable nor the idle robot waiting.

use std::collections::BTreeSet;
use std::future::Future;

use tokio::sync::mpsc;
use tokio::task::{AbortHandle, JoinSet};

use crate::agent::{Blueprint, Docked, Roster, RosterError, Seat, SeatError};
use crate::robot::channel::{Request, Role};
use crate::robot::{BehaviourId, DockPlan, Priority};

/// The seat from which an idle robot is sent home; behind the persons', before the rescue behaviour's.
const ME: BehaviourId = BehaviourId(0xFFFD);
/// Behind everybody.
const LAST: Priority = Priority(i16::MIN);

/// What was ordered, and how that went.
#[derive(Debug)]
pub(super) enum Outcome {
    /// A start.
    Started(String, Result<(), RosterError>),
    /// A stop or a restart.
    Changed(String, Result<(), RosterError>),
    /// An idle robot was sent home.
    Home(Result<Docked, SeatError>),
}

/// See the module.
pub(super) struct Orders {
    roster: Roster,
    given: JoinSet<Outcome>,
    /// Of behaviours, and not answered yet.
    names: BTreeSet<String>,
}

impl Orders {
    pub(super) fn new(roster: Roster) -> Orders {
        Orders {
            roster,
            given: JoinSet::new(),
            names: BTreeSet::new(),
        }
    }

    /// No behaviour's order waits for its answer.
    pub(super) fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// An order of this behaviour waits for its answer.
    pub(super) fn has(&self, run: &str) -> bool {
        self.names.contains(run)
    }

    pub(super) fn start(&mut self, run: String) {
        let (roster, name) = (self.roster.clone(), run.clone());
        self.give(run, async move {
            let started = roster.start(&name).await;
            Outcome::Started(name, started)
        });
    }

    pub(super) fn stop(&mut self, run: String) {
        let (roster, name) = (self.roster.clone(), run.clone());
        self.give(run, async move {
            let stopped = roster.stop(&name).await;
            Outcome::Changed(name, stopped)
        });
    }

    pub(super) fn restart(&mut self, run: String) {
        let (roster, name) = (self.roster.clone(), run.clone());
        self.give(run, async move {
            let restarted = roster.restart(&name).await;
            Outcome::Changed(name, restarted)
        });
    }

    fn give(&mut self, run: String, order: impl Future<Output = Outcome> + Send + 'static) {
        self.names.insert(run);
        self.given.spawn(order);
    }

    /// Sends the idle robot to its station. Aborting it is giving up.
    pub(super) fn send_home(&mut self, requests: mpsc::Sender<Request>) -> AbortHandle {
        self.given
            .spawn(async move { Outcome::Home(send_home(requests).await) })
    }

    /// The next answer. Cancel-safe; `None` while none is under way.
    pub(super) async fn next(&mut self) -> Option<Outcome> {
        loop {
            // One that was called off says nothing.
            if let Ok(outcome) = self.given.join_next().await? {
                if let Outcome::Started(run, _) | Outcome::Changed(run, _) = &outcome {
                    self.names.remove(run);
                }
                return Some(outcome);
            }
        }
    }

    /// Replaces what the roster knows.
    ///
    /// # Errors
    /// As [`Roster::define`].
    pub(super) async fn define(&self, blueprints: Vec<Blueprint>) -> Result<(), RosterError> {
        self.roster.define(blueprints).await
    }
}

/// Gives way to everybody. Dropping it is giving up.
async fn send_home(requests: mpsc::Sender<Request>) -> Result<Docked, SeatError> {
    let seat = Seat::join(requests, ME, "an idle robot", LAST, Role::Person).await;
    seat?.dock(DockPlan::DEFAULT).await
}
