//! Handles an idle robot: while no behaviour runs but those that are always on, it is sent to its
//! station, and its link may be released there. A state machine: takes facts and the time, returns an
//! action.

use std::time::Duration;

use tokio::time::Instant;

use crate::config::{Idle, Service};
use crate::pilot::LinkState;
use crate::rate_limit::Backoff;

/// Pause after a failed docking: the first one; it doubles each time, up to the maximum.
const PAUSE: Duration = Duration::from_secs(300);
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

#[derive(Debug, Clone, Copy)]
pub(super) struct IdleInputs {
    pub(super) now: Instant,
    /// A behaviour runs, is loading, or is due. One that is always on counts until another run has
    /// ended away from the station.
    pub(super) busy: bool,
    /// A behaviour runs, perhaps one that is always on: it needs the link.
    pub(super) runs: bool,
    /// The tracks run.
    pub(super) moving: bool,
    pub(super) link: LinkState,
    /// The robot is on its station, as far as is known.
    pub(super) docked: bool,
    /// The battery is low, and the watchdog controls the robot.
    pub(super) low: bool,
    /// A person's STOP holds.
    pub(super) stopped: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum IdleAction {
    Dock,
    CancelDocking,
    Release,
    Connect,
}

#[derive(Debug)]
pub(super) struct IdleRobot {
    policy: Service,
    /// Since when no behaviour runs and the robot is connected.
    since: Option<Instant>,
    docking: bool,
    backoff: Backoff,
    /// Earliest time of the next docking.
    next: Option<Instant>,
    asked: Option<LinkState>,
}

impl IdleRobot {
    pub(super) fn new(policy: Service) -> IdleRobot {
        IdleRobot {
            policy,
            since: None,
            docking: false,
            backoff: Backoff::new(PAUSE, LONGEST_PAUSE),
            next: None,
            asked: None,
        }
    }

    pub(super) fn replace(&mut self, policy: Service) {
        self.policy = policy;
    }

    pub(super) fn is_docking(&self) -> bool {
        self.docking
    }

    pub(super) fn docked(&mut self, done: bool, now: Instant) {
        self.docking = false;
        if done {
            self.backoff.reset();
            self.next = None;
            return;
        }
        self.next = Some(now + self.backoff.step());
    }

    pub(super) fn poll(&mut self, inputs: IdleInputs) -> Option<IdleAction> {
        let release = self.policy.idle == Idle::Release;
        if self.asked.is_some_and(|link| link != inputs.link) {
            self.asked = None;
        }
        if inputs.busy || inputs.stopped {
            self.since = None;
            self.backoff.reset();
            self.next = None;
            if std::mem::take(&mut self.docking) {
                return Some(IdleAction::CancelDocking);
            }
            if !inputs.busy {
                return None;
            }
            return self.request_once(inputs.link, LinkState::Released, IdleAction::Connect);
        }
        if inputs.link == LinkState::Released && !release {
            return self.request_once(inputs.link, LinkState::Released, IdleAction::Connect);
        }
        if inputs.link != LinkState::Up {
            self.since = None;
            return None;
        }
        // Somebody drives it, or what is always on does.
        if inputs.moving && !self.docking {
            self.since = None;
        }
        let since = *self.since.get_or_insert(inputs.now);
        if inputs.now < since + self.policy.idle_after.get() || self.docking || inputs.low {
            return None;
        }
        if inputs.docked {
            if !release || inputs.runs {
                return None;
            }
            return self.request_once(inputs.link, LinkState::Up, IdleAction::Release);
        }
        if !self.policy.dock || self.next.is_some_and(|next| inputs.now < next) {
            return None;
        }
        self.docking = true;
        Some(IdleAction::Dock)
    }

    /// When to poll again if nothing happens before.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        let idle = self.since.map(|since| since + self.policy.idle_after.get());
        idle.max(self.next)
    }

    /// Returns the action if the link is in state `of`, but only once until the link changes.
    fn request_once(
        &mut self,
        link: LinkState,
        of: LinkState,
        action: IdleAction,
    ) -> Option<IdleAction> {
        if link != of || self.asked == Some(of) {
            return None;
        }
        self.asked = Some(of);
        Some(action)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    fn idle(release: bool) -> (IdleRobot, IdleInputs) {
        let policy = Service {
            idle: if release { Idle::Release } else { Idle::Keep },
            ..Service::default()
        };
        let inputs = IdleInputs {
            now: Instant::now(),
            busy: false,
            runs: false,
            moving: false,
            link: LinkState::Up,
            docked: false,
            low: false,
            stopped: false,
        };
        (IdleRobot::new(policy), inputs)
    }

    #[test]
    fn an_idle_robot_is_sent_home_after_a_while_and_released_there() {
        let (mut idle, mut inputs) = idle(true);
        assert_eq!(idle.poll(inputs), None);
        inputs.now += MINUTE;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Dock));
        assert_eq!(idle.poll(inputs), None, "it is under way");
        idle.docked(true, inputs.now);
        inputs.docked = true;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Release));
        assert_eq!(idle.poll(inputs), None, "requested once");
        inputs.link = LinkState::Released;
        inputs.now += 1000 * MINUTE;
        assert_eq!(idle.poll(inputs), None);
        inputs.busy = true;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Connect));
        assert_eq!(idle.poll(inputs), None);
    }

    #[test]
    fn a_robot_that_is_driven_is_not_idle_and_one_that_is_watched_is_not_released() {
        let (mut idle, mut inputs) = idle(true);
        (inputs.runs, inputs.moving) = (true, true);
        for _ in 0..10 {
            assert_eq!(idle.poll(inputs), None);
            inputs.now += MINUTE;
        }
        inputs.moving = false;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Dock));
        inputs.moving = true;
        assert_eq!(idle.poll(inputs), None, "it is on its way");
        idle.docked(true, inputs.now);
        (inputs.docked, inputs.moving) = (true, false);
        for _ in 0..10 {
            inputs.now += MINUTE;
            assert_eq!(idle.poll(inputs), None);
        }
        inputs.runs = false;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Release));
    }

    #[test]
    fn without_the_release_policy_the_link_is_kept() {
        let (mut idle, mut inputs) = idle(false);
        inputs.docked = true;
        for _ in 0..10 {
            assert_eq!(idle.poll(inputs), None);
            inputs.now += MINUTE;
        }
    }

    #[test]
    fn a_start_cancels_the_docking_and_a_low_battery_prevents_it() {
        let (mut idle, mut inputs) = idle(false);
        idle.poll(inputs);
        inputs.now += MINUTE;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Dock));
        inputs.busy = true;
        assert_eq!(idle.poll(inputs), Some(IdleAction::CancelDocking));
        (inputs.busy, inputs.low) = (false, true);
        idle.poll(inputs);
        inputs.now += 10 * MINUTE;
        assert_eq!(idle.poll(inputs), None);
    }

    #[test]
    fn an_idle_robot_that_a_person_has_stopped_stays_where_it_is_until_it_is_released() {
        let (mut idle, mut inputs) = idle(true);
        idle.poll(inputs);
        inputs.now += MINUTE;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Dock));
        inputs.stopped = true;
        assert_eq!(idle.poll(inputs), Some(IdleAction::CancelDocking));
        for _ in 0..100 {
            inputs.now += MINUTE;
            assert_eq!(idle.poll(inputs), None);
        }
        inputs.stopped = false;
        assert_eq!(idle.poll(inputs), None, "it is idle from now on");
        inputs.now += MINUTE;
        assert_eq!(idle.poll(inputs), Some(IdleAction::Dock));
    }

    #[test]
    fn failed_dockings_are_retried_with_growing_pauses() {
        let (mut idle, mut inputs) = idle(false);
        idle.poll(inputs);
        let begin = inputs.now;
        let mut tries = Vec::new();
        while inputs.now < begin + 300 * MINUTE {
            inputs.now += MINUTE;
            if idle.poll(inputs) == Some(IdleAction::Dock) {
                tries.push((inputs.now - begin).as_secs() / 60);
                idle.docked(false, inputs.now);
            }
        }
        assert_eq!(tries, [1, 6, 16, 36, 76, 136, 196, 256]);
    }
}
