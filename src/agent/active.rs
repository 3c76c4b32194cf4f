//! A behaviour of the set, from the command to start it until its end.

use std::time::Duration;

use tokio::sync::watch;
use tokio::time::Instant;

use super::roster::{BehaviourSpec, BehaviourState, BehaviourStatus, Reply, RosterError};
use crate::robot::{BehaviourId, EndReason, Priority};
use crate::script::ScriptExit;

/// Tells one behaviour to end, and why.
pub(super) type Stop = watch::Sender<Option<EndReason>>;

/// A behaviour from the command to start it until its end.
pub(super) struct ActiveBehaviour {
    pub(super) by: BehaviourId,
    pub(super) name: String,
    pub(super) stop: Stop,
    /// When it began; `None`: it is being loaded.
    pub(super) since: Option<Instant>,
    /// How long it may run before it is ended.
    pub(super) time_limit: Option<Duration>,
    /// The callers that wait for its start.
    pub(super) started: Vec<Reply>,
    /// The callers that wait for its end.
    pub(super) ended: Vec<Reply>,
    /// Present if it is to be started again when it has ended; receives the outcome.
    pub(super) restart_reply: Option<Reply>,
}

impl ActiveBehaviour {
    /// A behaviour whose script is being loaded.
    pub(super) fn new(
        by: BehaviourId,
        name: String,
        stop: Stop,
        time_limit: Option<Duration>,
    ) -> ActiveBehaviour {
        ActiveBehaviour {
            by,
            name,
            stop,
            since: None,
            time_limit,
            started: Vec::new(),
            ended: Vec::new(),
            restart_reply: None,
        }
    }

    /// When its time is over; `None`: it has no limit, or is ending already.
    pub(super) fn deadline(&self) -> Option<Instant> {
        if self.stop.borrow().is_some() {
            return None;
        }
        Some(self.since? + self.time_limit?)
    }

    /// Tells it to end, and not to start again.
    pub(super) fn stop_for_good(&mut self, reason: EndReason) {
        request_stop(&self.stop, reason);
        if let Some(again) = self.restart_reply.take() {
            let _ = again.send(Err(RosterError::StoppedFirst(self.name.clone())));
        }
    }

    /// Why it was not started. A missing robot is no reason if it was stopped as well: nobody must
    /// start it when the robot is back.
    pub(super) fn refusal(&self, why: RosterError) -> RosterError {
        match why {
            RosterError::Offline if self.stop.borrow().is_some() => {
                RosterError::StoppedFirst(self.name.clone())
            }
            why => why,
        }
    }

    /// The state of the behaviour.
    pub(super) fn state(&self) -> BehaviourState {
        match self.since {
            _ if self.stop.borrow().is_some() => BehaviourState::Ending,
            Some(since) => BehaviourState::Running { by: self.by, since },
            None => BehaviourState::Loading,
        }
    }
}

/// All behaviours of a set: those of its specs first, then those that still run but are no
/// longer in the config. `exits` holds each behaviour's last ending, by name.
pub(super) fn statuses(
    specs: &[BehaviourSpec],
    active: &[ActiveBehaviour],
    exits: &[(String, ScriptExit)],
) -> Vec<BehaviourStatus> {
    let known = |name: &str| specs.iter().any(|one| one.name() == name);
    let rest = active.iter().filter(|one| !known(&one.name));
    let rest = rest.map(|one| (one.name.as_str(), Priority::default()));
    let all = specs.iter().map(|one| (one.name(), one.priority()));
    let behaviour_status = |(name, priority): (&str, Priority)| {
        let running = active.iter().find(|one| one.name == name);
        let exit = exits.iter().find(|(of, _)| of == name);
        BehaviourStatus {
            name: name.to_owned(),
            priority,
            state: running.map_or(BehaviourState::Idle, ActiveBehaviour::state),
            exit: exit.map(|(_, exit)| exit.clone()),
        }
    };
    all.chain(rest).map(behaviour_status).collect()
}

/// Tells a behaviour to end; an earlier reason is kept.
pub(super) fn request_stop(stop: &Stop, reason: EndReason) {
    stop.send_if_modified(|stop| stop.is_none() && stop.replace(reason).is_none());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_behaviour_that_was_stopped_is_not_said_to_wait_for_the_robot() {
        let one = ActiveBehaviour::new(BehaviourId(1), "go".to_owned(), Stop::new(None), None);
        assert_eq!(one.refusal(RosterError::Offline), RosterError::Offline);
        request_stop(&one.stop, EndReason::Cancelled);
        let stopped = RosterError::StoppedFirst("go".to_owned());
        assert_eq!(one.refusal(RosterError::Offline), stopped);
        let broken = RosterError::CannotLoad("broken".to_owned());
        assert_eq!(one.refusal(broken.clone()), broken);
    }
}
