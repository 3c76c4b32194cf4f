//! The state as published to the broker. Pure.

use std::collections::BTreeMap;

use serde_json::{Value, json};

use crate::agent::BehaviourStatus;
use crate::behaviour::is_failure;
use crate::pilot::{LinkState, Status};
use crate::robot::{AgentEvent, DockEnd, Percent, Setpoint};
use crate::safety::WatchdogState;
use crate::timetable::View;

/// Maximum number of behaviours whose failures are remembered.
const MAX_FAILURES: usize = 32;

/// Builds the published state, and remembers what it needs of past events.
#[derive(Debug, Default)]
pub(super) struct Report {
    lost: Option<String>,
    /// How the last docking failed, if it did.
    dock: Option<DockEnd>,
    /// Behaviours that failed and have not started since, with their error messages.
    failures: BTreeMap<String, String>,
    /// Who pressed the STOP that holds, if that happened in this program.
    stopped_by: Option<String>,
    /// The behaviour chosen for `start`, if any.
    chosen: Option<String>,
    running: Vec<String>,
    /// Whether what runs has driven: behaviours that only watch do no job that a person waits for.
    drives: bool,
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
            AgentEvent::Started { behaviour, .. } => {
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

    /// Takes in the newest state; the others are told of it in [`Report::state`].
    pub(super) fn observe(&mut self, status: &Status, statuses: &[BehaviourStatus]) {
        let running = statuses.iter().filter(|one| one.state.is_running());
        let running: Vec<String> = running.map(|one| one.name.clone()).collect();
        if running != self.running || status.docked {
            self.drives = false;
        }
        let moves = status.actuators.tracks != Setpoint::STOP;
        self.drives |= moves && status.safety == WatchdogState::Free && !running.is_empty();
        self.running = running;
    }

    /// Returns the behaviour that `start` starts: the chosen one, or else the first that is not always
    /// on.
    pub(super) fn chosen(&self, statuses: &[BehaviourStatus], always: &[String]) -> Option<String> {
        let is_chosen = |one: &&BehaviourStatus| Some(&one.name) == self.chosen.as_ref();
        let is_asked = |one: &&BehaviourStatus| !always.contains(&one.name);
        let chosen = statuses.iter().find(is_chosen);
        let chosen = chosen.or_else(|| statuses.iter().find(is_asked));
        chosen.or(statuses.first()).map(|one| one.name.clone())
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
        view: &View,
    ) -> Value {
        let reason = self.reason(status);
        let next = view.next.as_ref();
        json!({
            "state": activity(status, self.drives),
            "battery": status.battery.and_then(|battery| battery.percent).map(Percent::get),
            "charging": status.battery.is_some_and(|battery| battery.charging),
            "docked": status.docked,
            "low": status.low,
            "emergency_stop": status.emergency_stop,
            "stop_confirmation": status.stop,
            "link": status.link,
            "watchdog": status.safety.to_string(),
            "dock_state": status.dock_state.to_string(),
            "problem": reason.is_some(),
            "reason": reason,
            "running": self.running,
            "behaviour": self.chosen(statuses, &view.always),
            "next": next.map(|next| next.at.to_string()),
            "next_behaviour": next.map(|next| &next.behaviour),
            "next_skipped": next.is_some_and(|next| next.skipped),
            "paused": view.hold.paused,
        })
    }
}

/// Returns the activity in Home Assistant's terms for a vacuum.
fn activity(status: &Status, drives: bool) -> &'static str {
    match (status.link, status.safety) {
        (LinkState::Connecting | LinkState::Lost, _) | (_, WatchdogState::Alarm) => "error",
        _ if status.emergency_stop => "error",
        (_, WatchdogState::Docking | WatchdogState::LowGoingHome) => "returning",
        _ if status.docked => "docked",
        _ if drives => "cleaning",
        _ => "idle",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agent::BehaviourState;
    use crate::pilot::ActuatorState;
    use crate::robot::{Battery, BehaviourId, EndReason, Percent, Priority};
    use crate::timetable::NextStart;
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

    fn moving(status: Status) -> Status {
        let tracks = Setpoint::from_percent(30.0, 30.0).unwrap();
        let actuators = ActuatorState {
            tracks,
            ..status.actuators
        };
        Status {
            actuators,
            ..status
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
            by: None,
        }
    }

    #[test]
    fn the_activity_is_in_home_assistants_terms() {
        let activity_of = |status: Status, runs| {
            let mut report = Report::default();
            let statuses = [behaviour_status("patrol", runs)];
            report.observe(&moving(status), &statuses);
            let state = report.state(&status, &statuses, &View::default());
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
    fn a_behaviour_that_only_watches_does_not_clean() {
        let mut report = Report::default();
        let free = up(WatchdogState::Free);
        let guard = behaviour_status("guard", true);
        let both = [guard.clone(), behaviour_status("patrol", true)];
        let alone = [guard, behaviour_status("patrol", false)];
        let mut state_of = |status: Status, statuses: &[BehaviourStatus]| {
            report.observe(&status, statuses);
            let state = report.state(&status, statuses, &View::default());
            state["state"].as_str().unwrap().to_owned()
        };
        assert_eq!(state_of(free, &alone), "idle");
        assert_eq!(state_of(moving(free), &both), "cleaning");
        assert_eq!(state_of(free, &both), "cleaning", "it looks around");
        assert_eq!(state_of(free, &alone), "idle");
        // On its way home it moves, too.
        let home = up(WatchdogState::Docking);
        assert_eq!(state_of(moving(home), &alone), "returning");
        assert_eq!(state_of(free, &alone), "idle");
    }

    #[test]
    fn a_problem_has_its_reason_until_it_is_over() {
        let mut report = Report::default();
        let free = up(WatchdogState::Free);
        assert_eq!(report.state(&free, &[], &View::default())["problem"], false);
        report.record_event(&ended(EndReason::Error));
        let state = report.state(&free, &[], &View::default());
        assert_eq!(state["reason"], "patrol failed: patrol.lua:3: no");
        let lost = Status {
            link: LinkState::Lost,
            ..free
        };
        let reason = "no answer".to_owned();
        report.record_event(&AgentEvent::LinkDown { reason });
        let state = report.state(&lost, &[], &View::default());
        assert_eq!(state["reason"], "the robot is out of reach: no answer");
        let behaviour = "patrol".to_owned();
        report.record_event(&AgentEvent::Started {
            behaviour,
            by: None,
        });
        assert_eq!(
            report.state(&free, &[], &View::default())["reason"],
            Value::Null
        );
        report.record_event(&ended(EndReason::Cancelled));
        assert_eq!(report.state(&free, &[], &View::default())["problem"], false);
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
        let state = report.state(&stopped, &[], &View::default());
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
        let state = report.state(&up(WatchdogState::Free), &[], &View::default());
        assert_eq!(
            (&state["problem"], &state["emergency_stop"]),
            (&false.into(), &false.into())
        );
    }

    #[test]
    fn start_starts_the_chosen_behaviour_or_else_the_first_that_is_not_always_on() {
        let mut report = Report::default();
        let statuses = [behaviour_status("a", false), behaviour_status("b", false)];
        let always = ["a".to_owned()];
        assert_eq!(report.chosen(&[], &[]), None);
        assert_eq!(report.chosen(&statuses, &[]).as_deref(), Some("a"));
        assert_eq!(report.chosen(&statuses, &always).as_deref(), Some("b"));
        assert_eq!(report.chosen(&statuses[..1], &always).as_deref(), Some("a"));
        assert!(report.choose("b", &statuses) && !report.choose("c", &statuses));
        assert_eq!(report.chosen(&statuses, &[]).as_deref(), Some("b"));
        assert_eq!(report.chosen(&statuses[..1], &[]).as_deref(), Some("a"));
    }

    #[test]
    fn the_next_start_has_the_time_format_of_home_assistant() {
        let view = View {
            next: Some(NextStart {
                at: jiff::Timestamp::from_second(1_790_000_000).unwrap(),
                behaviour: "patrol".to_owned(),
                skipped: true,
            }),
            ..View::default()
        };
        let state = Report::default().state(&Status::default(), &[], &view);
        assert_eq!(state["next"], "2026-09-21T14:13:20Z");
        assert_eq!(state["next_behaviour"], "patrol");
        assert_eq!(state["next_skipped"], true);
        assert_eq!(state["paused"], Value::Null);
        let state = Report::default().state(&Status::default(), &[], &View::default());
        assert_eq!(state["next"], Value::Null);
    }
}
