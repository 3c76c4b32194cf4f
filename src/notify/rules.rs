//! Decides which events become notifications, and with which text. Pure: the time is an argument.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use super::notice::Rule;
use crate::robot::{AgentEvent, Battery, DockEnd, EndReason, SafetyAction};

/// Minimum interval between two notifications of the same problem.
const AGAIN: Duration = Duration::from_secs(600);
/// Maximum length of a text, in characters.
const LONGEST: usize = 1000;

/// A notification to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Notification {
    pub(super) rule: Rule,
    pub(super) text: String,
    pub(super) picture: Option<PathBuf>,
}

/// The state of the link, for notifications.
#[derive(Debug)]
enum Link {
    Up,
    /// Down since this instant, for this reason.
    Down(Instant, Option<String>),
    /// Down, and reported.
    Missing,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Rules {
    unreachable_after: Duration,
    link: Link,
    robot: Option<String>,
    battery: Option<Battery>,
    low: bool,
    /// When each problem was last reported, by rule and subject.
    last_reported: BTreeMap<(Rule, String), Instant>,
}

impl Rules {
    /// Starts with a robot that is not connected yet.
    pub(super) fn new(unreachable_after: Duration, now: Instant) -> Rules {
        Rules {
            unreachable_after,
            link: Link::Down(now, None),
            robot: None,
            battery: None,
            low: false,
            last_reported: BTreeMap::new(),
        }
    }

    /// The robot's name; `spykee` while unknown.
    pub(super) fn robot(&self) -> &str {
        self.robot.as_deref().unwrap_or("spykee")
    }

    /// Handles an event.
    pub(super) fn handle_event(&mut self, what: &AgentEvent, now: Instant) -> Option<Notification> {
        match what {
            AgentEvent::LinkUp { robot, .. } => {
                let name = if robot.name.is_empty() {
                    &robot.uid
                } else {
                    &robot.name
                };
                self.robot = Some(name.clone());
                let was = std::mem::replace(&mut self.link, Link::Up);
                let missing = matches!(was, Link::Missing);
                missing
                    .then(|| notification(Rule::Unreachable, format!("{name} is in reach again")))
            }
            AgentEvent::LinkDown { reason } => {
                if let Link::Up = self.link {
                    self.link = Link::Down(now, Some(reason.clone()));
                }
                None
            }
            AgentEvent::Battery(battery) => {
                self.battery = Some(*battery);
                None
            }
            AgentEvent::Watchdog { low, .. } => {
                let was_low = std::mem::replace(&mut self.low, *low);
                (*low && !was_low).then(|| notification(Rule::Low, self.low_text()))
            }
            AgentEvent::Safety {
                action: SafetyAction::Alarm,
                reason,
            } => self.once(Rule::Alarm, "", format!("the alarm sounds: {reason}"), now),
            AgentEvent::Dock {
                end, by, seconds, ..
            } => {
                let why = failed_docking(*end)?;
                let by = by.as_deref().unwrap_or("the watchdog");
                let text =
                    format!("docking failed after {seconds:.0} s: {why} (requested by {by})");
                self.once(Rule::NotDocked, "", text, now)
            }
            AgentEvent::Ended {
                behaviour,
                reason: EndReason::Error | EndReason::Cpu | EndReason::Memory,
                message,
                ..
            } => {
                let why = message.as_deref().unwrap_or("no reason is known");
                let text = format!("{behaviour} failed: {why}");
                self.once(Rule::RunFailed, behaviour, text, now)
            }
            AgentEvent::GivenUp { behaviour, message } => {
                let text = format!("{behaviour} is given up, it failed too often: {message}");
                Some(notification(Rule::RunFailed, text))
            }
            AgentEvent::StartMissed { behaviour, reason } => {
                let text = format!("{behaviour} did not start: {reason}");
                self.once(Rule::StartMissed, behaviour, text, now)
            }
            AgentEvent::Entry {
                behaviour,
                kind,
                data,
            } if kind == "moved" || kind == "noise" => {
                let what = if kind == "moved" {
                    "something moved"
                } else {
                    "a noise"
                };
                let text = format!("{behaviour}: {what}{}", fields(data));
                self.once(Rule::Moved, kind, text, now)
            }
            AgentEvent::Notify { text, picture, .. } => Some(Notification {
                picture: picture.clone(),
                ..notification(Rule::Script, text.clone())
            }),
            _ => None,
        }
    }

    /// When [`Rules::poll`] should be called next.
    pub(super) fn deadline(&self) -> Option<Instant> {
        match &self.link {
            Link::Down(since, _) => Some(*since + self.unreachable_after),
            Link::Up | Link::Missing => None,
        }
    }

    /// Reports a robot that has been out of reach for too long.
    pub(super) fn poll(&mut self, now: Instant) -> Option<Notification> {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return None;
        }
        let Link::Down(_, why) = std::mem::replace(&mut self.link, Link::Missing) else {
            return None;
        };
        let minutes = self.unreachable_after.as_secs_f64() / 60.0;
        let why = why.map_or_else(String::new, |why| format!(": {why}"));
        let text = format!(
            "{} has been out of reach for {minutes:.0} min{why}",
            self.robot()
        );
        Some(notification(Rule::Unreachable, text))
    }

    fn low_text(&self) -> String {
        match self.battery {
            Some(battery) => format!("the battery is low: {}", battery.percent),
            None => "the battery is low".to_owned(),
        }
    }

    /// Returns the notification, unless the same problem was reported recently.
    fn once(
        &mut self,
        rule: Rule,
        about: &str,
        text: String,
        now: Instant,
    ) -> Option<Notification> {
        self.last_reported
            .retain(|_, at| now.saturating_duration_since(*at) < AGAIN);
        let key = (rule, about.to_owned());
        if self.last_reported.contains_key(&key) {
            return None;
        }
        self.last_reported.insert(key, now);
        Some(notification(rule, text))
    }
}

fn notification(rule: Rule, text: String) -> Notification {
    Notification {
        rule,
        text: text.chars().take(LONGEST).collect(),
        picture: None,
    }
}

fn failed_docking(end: DockEnd) -> Option<&'static str> {
    match end {
        DockEnd::BaseNotFound => Some("the station was not found"),
        DockEnd::Timeout => Some("it took too long"),
        DockEnd::NotCharging => Some("on the station, but it does not charge"),
        _ => None,
    }
}

/// Formats the fields of a script's entry.
fn fields(data: &Value) -> String {
    let Some(map) = data.as_object().filter(|map| !map.is_empty()) else {
        return String::new();
    };
    let field = |(name, value): (&String, &Value)| match value {
        Value::String(text) => format!("{name} {text}"),
        value => format!("{name} {value}"),
    };
    let fields: Vec<String> = map.iter().map(field).collect();
    format!(" ({})", fields.join(", "))
}

#[cfg(test)]
mod tests;
