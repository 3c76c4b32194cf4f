//! Handles an idle robot: while no behaviour runs but those that are always on, and nothing drives, it
//! is sent to its station, and its link may be released there. A state machine: takes facts and the
//! time, returns an action.

use std::time::Duration;

use tokio::time::Instant;

use crate::config::{Idle, Service};
use crate::pilot::{LinkState, Status};
use crate::rate_limit::Backoff;
use crate::robot::WatchdogState;

/// Pause after a failed docking: the first one; it doubles each time, up to the maximum.
const PAUSE: Duration = Duration::from_secs(300);
const LONGEST_PAUSE: Duration = Duration::from_secs(3600);

/// What behaviours do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Activity {
    None,
    /// Only behaviours run that are always on: they need the link.
    Watched,
    /// Another behaviour runs, is loading, or is due.
    Busy,
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
    /// Since when nothing has driven and the robot is connected.
    since: Option<Instant>,
    pub(super) docking: bool,
    /// Whether it was on its station at the last poll.
    docked: bool,
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
            docked: false,
            backoff: Backoff::new(PAUSE, LONGEST_PAUSE),
            next: None,
            asked: None,
        }
    }

    pub(super) fn replace(&mut self, policy: Service) {
        self.policy = policy;
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

    /// Somebody drives it instead: that is no failure, and the wait begins again.
    pub(super) fn preempted(&mut self) {
        self.docking = false;
        self.since = None;
    }

    pub(super) fn poll(
        &mut self,
        status: &Status,
        activity: Activity,
        now: Instant,
    ) -> Option<IdleAction> {
        let busy = activity == Activity::Busy;
        let release = self.policy.idle == Idle::Release;
        if self.asked.is_some_and(|link| link != status.link) {
            self.asked = None;
        }
        if busy || status.emergency_stop {
            self.since = None;
            self.backoff.reset();
            self.next = None;
            if std::mem::take(&mut self.docking) {
                return Some(IdleAction::CancelDocking);
            }
            if !busy {
                return None;
            }
            return self.request_once(status.link, LinkState::Released, IdleAction::Connect);
        }
        if status.link == LinkState::Released && !release {
            return self.request_once(status.link, LinkState::Released, IdleAction::Connect);
        }
        if status.link != LinkState::Up {
            self.since = None;
            return None;
        }
        // Somebody drives it or sends it home, or what is always on does.
        let drives = !status.actuators.tracks.is_stop() || status.safety == WatchdogState::Docking;
        let leaves = std::mem::replace(&mut self.docked, status.docked) && !status.docked;
        if (drives && !self.docking) || leaves {
            self.since = None;
        }
        let since = *self.since.get_or_insert(now);
        if now < since + self.policy.idle_after.get() || self.docking || status.low {
            return None;
        }
        if status.docked && release && activity != Activity::Watched {
            return self.request_once(status.link, LinkState::Up, IdleAction::Release);
        }
        if status.docked || !self.policy.dock || self.next.is_some_and(|next| now < next) {
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
    use crate::robot::Setpoint;

    const MINUTE: Duration = Duration::from_secs(60);

    fn idle(release: bool) -> (IdleRobot, Status, Instant) {
        let policy = Service {
            idle: if release { Idle::Release } else { Idle::Keep },
            ..Service::default()
        };
        let status = Status {
            link: LinkState::Up,
            ..Status::default()
        };
        (IdleRobot::new(policy), status, Instant::now())
    }

    #[test]
    fn a_docking_that_somebody_ends_by_driving_is_repeated_after_the_usual_wait() {
        let (mut idle, status, now) = idle(false);
        assert_eq!(idle.poll(&status, Activity::Watched, now), None);
        let now = now + MINUTE;
        let sent = idle.poll(&status, Activity::Watched, now);
        assert_eq!(sent, Some(IdleAction::Dock));
        idle.preempted();
        assert_eq!(idle.poll(&status, Activity::Watched, now), None);
        let sent = idle.poll(&status, Activity::Watched, now + MINUTE);
        assert_eq!(sent, Some(IdleAction::Dock));
    }

    #[test]
    fn an_idle_robot_is_sent_home_after_a_while_and_released_there() {
        let (mut idle, mut status, mut now) = idle(true);
        assert_eq!(idle.poll(&status, Activity::None, now), None);
        now += MINUTE;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            Some(IdleAction::Dock)
        );
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            None,
            "it is under way"
        );
        idle.docked(true, now);
        status.docked = true;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            Some(IdleAction::Release)
        );
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            None,
            "requested once"
        );
        status.link = LinkState::Released;
        now += 1000 * MINUTE;
        assert_eq!(idle.poll(&status, Activity::None, now), None);
        assert_eq!(
            idle.poll(&status, Activity::Busy, now),
            Some(IdleAction::Connect)
        );
        assert_eq!(idle.poll(&status, Activity::Busy, now), None);
    }

    #[test]
    fn a_robot_that_is_driven_is_not_idle_and_one_that_is_watched_is_not_released() {
        let (mut idle, mut status, mut now) = idle(true);
        status.actuators.tracks = Setpoint::from_percent(30.0, 30.0).unwrap();
        for _ in 0..10 {
            assert_eq!(idle.poll(&status, Activity::Watched, now), None);
            now += MINUTE;
        }
        status.actuators.tracks = Setpoint::STOP;
        status.safety = WatchdogState::Docking;
        now += MINUTE;
        assert_eq!(idle.poll(&status, Activity::Watched, now), None);
        status.safety = WatchdogState::Free;
        assert_eq!(idle.poll(&status, Activity::Watched, now), None);
        now += MINUTE;
        let dock = idle.poll(&status, Activity::Watched, now);
        assert_eq!(dock, Some(IdleAction::Dock));
        status.actuators.tracks = Setpoint::from_percent(30.0, 30.0).unwrap();
        let under_way = idle.poll(&status, Activity::Watched, now);
        assert_eq!(under_way, None);
        idle.docked(true, now);
        status.docked = true;
        status.actuators.tracks = Setpoint::STOP;
        for _ in 0..10 {
            now += MINUTE;
            assert_eq!(idle.poll(&status, Activity::Watched, now), None);
        }
        let release = idle.poll(&status, Activity::None, now);
        assert_eq!(release, Some(IdleAction::Release));
        status.docked = false;
        let left = idle.poll(&status, Activity::None, now);
        assert_eq!(left, None, "a person has just left the station");
        let dock = idle.poll(&status, Activity::None, now + MINUTE);
        assert_eq!(dock, Some(IdleAction::Dock));
    }

    #[test]
    fn without_the_release_policy_the_link_is_kept() {
        let (mut idle, mut status, mut now) = idle(false);
        status.docked = true;
        for _ in 0..10 {
            assert_eq!(idle.poll(&status, Activity::None, now), None);
            now += MINUTE;
        }
    }

    #[test]
    fn a_start_cancels_the_docking_and_a_low_battery_prevents_it() {
        let (mut idle, mut status, mut now) = idle(false);
        idle.poll(&status, Activity::None, now);
        now += MINUTE;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            Some(IdleAction::Dock)
        );
        let cancelled = Some(IdleAction::CancelDocking);
        assert_eq!(idle.poll(&status, Activity::Busy, now), cancelled);
        status.low = true;
        idle.poll(&status, Activity::None, now);
        now += 10 * MINUTE;
        assert_eq!(idle.poll(&status, Activity::None, now), None);
    }

    #[test]
    fn an_idle_robot_that_a_person_has_stopped_stays_where_it_is_until_it_is_released() {
        let (mut idle, mut status, mut now) = idle(true);
        idle.poll(&status, Activity::None, now);
        now += MINUTE;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            Some(IdleAction::Dock)
        );
        status.emergency_stop = true;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            Some(IdleAction::CancelDocking)
        );
        for _ in 0..100 {
            now += MINUTE;
            assert_eq!(idle.poll(&status, Activity::None, now), None);
        }
        status.emergency_stop = false;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            None,
            "it is idle from now on"
        );
        now += MINUTE;
        assert_eq!(
            idle.poll(&status, Activity::None, now),
            Some(IdleAction::Dock)
        );
    }

    #[test]
    fn failed_dockings_are_retried_with_growing_pauses() {
        let (mut idle, status, mut now) = idle(false);
        idle.poll(&status, Activity::None, now);
        let begin = now;
        let mut tries = Vec::new();
        while now < begin + 300 * MINUTE {
            now += MINUTE;
            if idle.poll(&status, Activity::None, now) == Some(IdleAction::Dock) {
                tries.push((now - begin).as_secs() / 60);
                idle.docked(false, now);
            }
        }
        assert_eq!(tries, [1, 6, 16, 36, 76, 136, 196, 256]);
    }
}
