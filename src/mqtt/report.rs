//! The state as published to the broker. Pure.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::agent::BehaviourStatus;
use crate::behaviour::is_failure;
use crate::pilot::{LinkState, Status};
use crate::robot::{AgentEvent, DockEnd, Percent};
use crate::safety::WatchdogState;
use crate::timetable::NextStart;

/// Maximum number of behaviours whose failures are remembered.
const MAX_FAILURES: usize = 32;

/// Builds the published state, and remembers what it needs of past events.
#[derive(Debug, Default)]
pub(super) struct Report {
    /// Why the link was lost.
    lost: Option<String>,
    /// How the last docking failed, if it did.
    dock: Option<DockEnd>,
    /// Behaviours that failed and have not started since, with their error messages.
    failures: BTreeMap<String, String>,
    /// Who pressed the STOP that holds, if that happened in this program.
    stopped_by: Option<String>,
    /// The behaviour chosen for `start`, if any.
    chosen: Option<String>,
}

impl Report {
    pub(super) fn record_event(&mut self, what: &AgentEvent) {
        match what {
            AgentEvent::LinkUp { .. } => self.lost = None,
            AgentEvent::LinkDown { reason } => self.lost = Some(reason.clone()),
            AgentEvent::Dock { end, .. } => match end {
                DockEnd::Done | DockEnd::AlreadyDocked => self.dock = None,
                DockEnd::BaseNotFound | DockEnd::Timeout | DockEnd::NotCharging => {
                    self.dock = Some(*end);
                }
                _ => {}
            },
            AgentEvent::StopEngaged { by } => self.stopped_by = Some(by.clone()),
            AgentEvent::StopReset { .. } => self.stopped_by = None,
            AgentEvent::Watchdog { docked: true, .. } => self.dock = None,
            AgentEvent::Started { behaviour } => {
                self.failures.remove(behaviour);
            }
            AgentEvent::Ended {
                behaviour,
                reason,
                message,
                ..
            } if is_failure(*reason) => {
                let words = message.as_deref().unwrap_or(reason.sentence());
                self.failed(behaviour, words);
            }
            AgentEvent::GivenUp { behaviour, message } => {
                self.failed(behaviour, &format!("it is given up; {message}"));
            }
            _ => {}
        }
    }

    fn failed(&mut self, behaviour: &str, words: &str) {
        if self.failures.len() < MAX_FAILURES || self.failures.contains_key(behaviour) {
            let words = format!("{behaviour} failed: {words}");
            self.failures.insert(behaviour.to_owned(), words);
        }
    }

    /// Returns the behaviour that `start` starts: the chosen one, or else the first.
    pub(super) fn chosen(&self, statuses: &[BehaviourStatus]) -> Option<String> {
        let is_chosen = |one: &&BehaviourStatus| Some(&one.name) == self.chosen.as_ref();
        let chosen = statuses.iter().find(is_chosen).or(statuses.first());
        chosen.map(|one| one.name.clone())
    }

    /// Chooses the behaviour that `start` starts. Returns false if no behaviour has this name.
    pub(super) fn choose(&mut self, name: &str, statuses: &[BehaviourStatus]) -> bool {
        let known = statuses.iter().any(|one| one.name == name);
        if known {
            self.chosen = Some(name.to_owned());
        }
        known
    }

    /// Describes the problem that needs a person's attention, if there is one.
    fn reason(&self, status: &Status) -> Option<String> {
        if status.emergency_stop {
            let by = self
                .stopped_by
                .as_deref()
                .unwrap_or("in an earlier program");
            return Some(format!(
                "a person has stopped the robot ({by}): nothing drives or starts until a person \
                 releases it"
            ));
        }
        match (status.link, status.safety) {
            (LinkState::Connecting, _) => Some("the robot has not answered yet".to_owned()),
            (LinkState::Lost, _) => {
                let why = self.lost.as_deref().unwrap_or("the link is lost");
                Some(format!("the robot is out of reach: {why}"))
            }
            (_, WatchdogState::Alarm) => {
                Some("the battery is low, and the robot does not find its station".to_owned())
            }
            (_, WatchdogState::LowGoingHome) => {
                Some("the battery is low; the robot goes home".to_owned())
            }
            _ => match self.dock {
                Some(end) => {
                    let words = end.name().replace('_', " ");
                    Some(format!("it did not get to its station: {words}"))
                }
                None => self.failures.values().next().cloned(),
            },
        }
    }

    pub(super) fn state(
        &self,
        status: &Status,
        statuses: &[BehaviourStatus],
        next: Option<&NextStart>,
    ) -> Value {
        let running = statuses.iter().filter(|one| one.state.is_running());
        let running: Vec<&str> = running.map(|one| one.name.as_str()).collect();
        let reason = self.reason(status);
        json!({
            "state": activity(status, !running.is_empty()),
            "battery": status.battery.and_then(|battery| battery.percent).map(Percent::get),
            "charging": status.battery.is_some_and(|battery| battery.charging),
            "docked": status.docked,
            "low": status.low,
            "emergency_stop": status.emergency_stop,
            "stop_confirmation": status.stop,
            "link": status.link.name(),
            "watchdog": status.safety.to_string(),
            "dock_state": status.dock_state.to_string(),
            "problem": reason.is_some(),
            "reason": reason,
            "running": running,
            "behaviour": self.chosen(statuses),
            "next": next.map(|next| next.at.to_string()),
            "next_behaviour": next.map(|next| &next.behaviour),
        })
    }
}

/// Returns the activity in Home Assistant's terms for a vacuum.
fn activity(status: &Status, running: bool) -> &'static str {
    match (status.link, status.safety) {
        (LinkState::Connecting | LinkState::Lost, _) | (_, WatchdogState::Alarm) => "error",
        _ if status.emergency_stop => "error",
        (_, WatchdogState::Docking | WatchdogState::LowGoingHome) => "returning",
        _ if status.docked => "docked",
        _ if running => "cleaning",
        _ => "idle",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::BehaviourState;
    use crate::robot::{Battery, BehaviourId, EndReason, Percent, Priority};
    use tokio::time::Instant;

    fn up(safety: WatchdogState) -> Status {
        Status {
            link: LinkState::Up,
            safety,
            battery: Some(Battery {
                percent: Some(Percent::saturating(71)),
                charging: false,
                minutes_left: None,
            }),
            ..Status::default()
        }
    }

    fn behaviour_status(name: &str, runs: bool) -> BehaviourStatus {
        let by = BehaviourId(0);
        let since = Instant::now();
        BehaviourStatus {
            name: name.to_owned(),
            priority: Priority(0),
            state: if runs {
                BehaviourState::Running { by, since }
            } else {
                BehaviourState::Idle
            },
            exit: None,
        }
    }

    fn ended(reason: EndReason) -> AgentEvent {
        AgentEvent::Ended {
            behaviour: "patrol".to_owned(),
            reason,
            message: Some("patrol.lua:3: no".to_owned()),
            seconds: 1.0,
        }
    }

    #[test]
    fn the_activity_is_in_home_assistants_terms() {
        let report = Report::default();
        let activity_of = |status: Status, runs| {
            let state = report.state(&status, &[behaviour_status("patrol", runs)], None);
            state["state"].as_str().unwrap().to_owned()
        };
        assert_eq!(activity_of(Status::default(), true), "error");
        assert_eq!(activity_of(up(WatchdogState::Free), true), "cleaning");
        assert_eq!(activity_of(up(WatchdogState::Free), false), "idle");
        assert_eq!(
            activity_of(up(WatchdogState::LowGoingHome), true),
            "returning"
        );
        assert_eq!(activity_of(up(WatchdogState::Alarm), true), "error");
        let docked = Status {
            docked: true,
            ..up(WatchdogState::Docked)
        };
        assert_eq!(activity_of(docked, true), "docked");
    }

    #[test]
    fn a_problem_has_its_reason_until_it_is_over() {
        let mut report = Report::default();
        let free = up(WatchdogState::Free);
        assert_eq!(report.state(&free, &[], None)["problem"], false);
        report.record_event(&ended(EndReason::Error));
        let state = report.state(&free, &[], None);
        assert_eq!(state["reason"], "patrol failed: patrol.lua:3: no");
        let lost = Status {
            link: LinkState::Lost,
            ..free
        };
        let reason = "no answer".to_owned();
        report.record_event(&AgentEvent::LinkDown { reason });
        let state = report.state(&lost, &[], None);
        assert_eq!(state["reason"], "the robot is out of reach: no answer");
        let behaviour = "patrol".to_owned();
        report.record_event(&AgentEvent::Started { behaviour });
        assert_eq!(report.state(&free, &[], None)["reason"], Value::Null);
        report.record_event(&ended(EndReason::Cancelled));
        assert_eq!(report.state(&free, &[], None)["problem"], false);
    }

    #[test]
    fn a_stop_is_a_problem_with_its_reason_until_it_is_released() {
        let mut report = Report::default();
        let stopped = Status {
            emergency_stop: true,
            ..up(WatchdogState::LowGoingHome)
        };
        let by = "the page, token sofa".to_owned();
        report.record_event(&AgentEvent::StopEngaged { by });
        let state = report.state(&stopped, &[], None);
        assert_eq!(
            (&state["problem"], &state["state"]),
            (&true.into(), &"error".into())
        );
        let reason = state["reason"].as_str().unwrap();
        assert!(
            reason.contains("token sofa") && reason.contains("releases"),
            "{reason}"
        );
        let by = "the MQTT broker".to_owned();
        report.record_event(&AgentEvent::StopReset { by });
        let state = report.state(&up(WatchdogState::Free), &[], None);
        assert_eq!(
            (&state["problem"], &state["emergency_stop"]),
            (&false.into(), &false.into())
        );
    }

    #[test]
    fn start_starts_the_chosen_behaviour_or_else_the_first() {
        let mut report = Report::default();
        let statuses = [behaviour_status("a", false), behaviour_status("b", false)];
        assert_eq!(report.chosen(&[]), None);
        assert_eq!(report.chosen(&statuses).as_deref(), Some("a"));
        assert!(report.choose("b", &statuses) && !report.choose("c", &statuses));
        assert_eq!(report.chosen(&statuses).as_deref(), Some("b"));
        assert_eq!(report.chosen(&statuses[..1]).as_deref(), Some("a"));
    }

    #[test]
    fn the_next_start_has_the_time_format_of_home_assistant() {
        let next = NextStart {
            at: jiff::Timestamp::from_second(1_790_000_000).unwrap(),
            behaviour: "patrol".to_owned(),
        };
        let state = Report::default().state(&Status::default(), &[], Some(&next));
        assert_eq!(state["next"], "2026-09-21T14:13:20Z");
        assert_eq!(state["next_behaviour"], "patrol");
        let state = Report::default().state(&Status::default(), &[], None);
        assert_eq!(state["next"], Value::Null);
    }
}
