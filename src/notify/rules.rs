//! Decides which events become notifications, and with which text. Pure: the time is an argument.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use super::{Notice, Rule};
use crate::robot::{AgentEvent, Battery, DockEnd, EndReason, RobotInfo, STOP_HOLDS, SafetyAction};
use crate::sanitize::json_text;

/// Minimum interval between two notifications of the same problem.
const AGAIN: Duration = Duration::from_secs(600);
/// Maximum length of a text, in characters.
const LONGEST: usize = 1000;

#[derive(Debug)]
enum Link {
    Up,
    /// Down since this instant, for this reason.
    Down(Instant, Option<String>),
    /// Down, and reported.
    Missing,
}

#[derive(Debug)]
pub(super) struct Rules {
    unreachable_after: Duration,
    link: Link,
    robot: Option<String>,
    battery: Option<Battery>,
    low: bool,
    /// Whether a robot with a low battery stays where it is, because a person's STOP holds.
    stays: bool,
    /// Whether people know that the STOP which holds prevents starts.
    stop_told: bool,
    /// When each problem was last reported, by rule and subject.
    last_reported: BTreeMap<(Rule, String), Instant>,
}

impl Rules {
    pub(super) fn new(unreachable_after: Duration, now: Instant) -> Rules {
        Rules {
            unreachable_after,
            link: Link::Down(now, None),
            robot: None,
            battery: None,
            low: false,
            stays: false,
            stop_told: false,
            last_reported: BTreeMap::new(),
        }
    }

    fn link_up(&mut self, robot: &RobotInfo) -> Option<Notice> {
        let name = if robot.name.is_empty() {
            &robot.uid
        } else {
            &robot.name
        };
        self.robot = Some(name.clone());
        let was = std::mem::replace(&mut self.link, Link::Up);
        if !matches!(was, Link::Missing) {
            return None;
        }
        let text = format!("{name} is in reach again");
        Some(self.notice(Rule::Unreachable, text))
    }

    pub(super) fn handle_event(&mut self, what: &AgentEvent, now: Instant) -> Option<Notice> {
        match what {
            AgentEvent::LinkUp { robot, .. } => self.link_up(robot),
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
                if !*low || was_low {
                    return None;
                }
                let level = self.battery.map(|battery| format!(": {}", battery.level()));
                let mut text = format!("the battery is low{}", level.unwrap_or_default());
                if self.stays {
                    text += &format!("; the robot stays where it is: {STOP_HOLDS}");
                }
                Some(self.notice(Rule::Low, text))
            }
            AgentEvent::Safety {
                action: SafetyAction::Alarm,
                reason,
            } => self.once(Rule::Alarm, "", format!("the alarm sounds: {reason}"), now),
            AgentEvent::Safety { reason, .. } => {
                self.stays = reason.ends_with(STOP_HOLDS);
                None
            }
            AgentEvent::Dock {
                end, by, seconds, ..
            } => {
                let why = failed_docking(*end)?;
                let by = by.as_deref().unwrap_or("the watchdog");
                let text =
                    format!("docking failed after {seconds:.0} s: {why} (requested by {by})");
                self.once(Rule::NotDocked, "", text, now)
            }
            _ => self.of_behaviour(what, now),
        }
    }

    fn of_behaviour(&mut self, what: &AgentEvent, now: Instant) -> Option<Notice> {
        match what {
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
                Some(self.notice(Rule::RunFailed, text))
            }
            AgentEvent::StopReset { .. } => {
                self.stop_told = false;
                None
            }
            AgentEvent::StartMissed { behaviour, reason } => {
                self.start_missed(behaviour, reason, now)
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
            AgentEvent::Notify { text, picture, .. } => Some(Notice {
                picture: picture.clone(),
                ..self.notice(Rule::Script, text.clone())
            }),
            _ => None,
        }
    }

    /// Of the starts that a person's STOP prevents, people are told of the first.
    fn start_missed(&mut self, behaviour: &str, reason: &str, now: Instant) -> Option<Notice> {
        if reason != STOP_HOLDS {
            let text = format!("{behaviour} did not start: {reason}");
            return self.once(Rule::StartMissed, behaviour, text, now);
        }
        if std::mem::replace(&mut self.stop_told, true) {
            return None;
        }
        let text =
            format!("{behaviour} did not start, and nothing else will by the timetable: {reason}");
        Some(self.notice(Rule::StartMissed, text))
    }

    pub(super) fn deadline(&self) -> Option<Instant> {
        match &self.link {
            Link::Down(since, _) => Some(*since + self.unreachable_after),
            Link::Up | Link::Missing => None,
        }
    }

    /// Reports a robot that has been out of reach for too long.
    pub(super) fn poll(&mut self, now: Instant) -> Option<Notice> {
        if self.deadline().is_none_or(|deadline| now < deadline) {
            return None;
        }
        let Link::Down(_, why) = std::mem::replace(&mut self.link, Link::Missing) else {
            return None;
        };
        let minutes = self.unreachable_after.as_secs_f64() / 60.0;
        let why = why.map_or_else(String::new, |why| format!(": {why}"));
        let robot = self.robot.as_deref().unwrap_or("spykee");
        let text = format!("{robot} has been out of reach for {minutes:.0} min{why}");
        Some(self.notice(Rule::Unreachable, text))
    }

    /// A notice whose time is still to be set.
    fn notice(&self, rule: Rule, text: String) -> Notice {
        Notice {
            rule,
            text: text.chars().take(LONGEST).collect(),
            robot: self.robot.as_deref().unwrap_or("spykee").to_owned(),
            at: 0,
            time: String::new(),
            picture: None,
        }
    }

    /// Returns the notice, unless the same problem was reported recently.
    fn once(&mut self, rule: Rule, about: &str, text: String, now: Instant) -> Option<Notice> {
        self.last_reported
            .retain(|_, at| now.saturating_duration_since(*at) < AGAIN);
        let key = (rule, about.to_owned());
        if self.last_reported.contains_key(&key) {
            return None;
        }
        self.last_reported.insert(key, now);
        Some(self.notice(rule, text))
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

fn fields(data: &Value) -> String {
    let Some(map) = data.as_object().filter(|map| !map.is_empty()) else {
        return String::new();
    };
    let fields = map.iter();
    let fields = fields.map(|(name, value)| format!("{name} {}", json_text(value)));
    let fields: Vec<String> = fields.collect();
    format!(" ({})", fields.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{RobotInfo, WatchdogState};

    const LONG: Duration = Duration::from_secs(600);

    fn up() -> AgentEvent {
        AgentEvent::LinkUp {
            robot: RobotInfo {
                uid: "SPYKEE7".to_owned(),
                name: "Rover".to_owned(),
                firmware: String::new(),
                address: String::new(),
                simulated: false,
            },
            docked: false,
        }
    }

    fn down() -> AgentEvent {
        let reason = "closed".to_owned();
        AgentEvent::LinkDown { reason }
    }

    fn failed(behaviour: &str) -> AgentEvent {
        AgentEvent::Ended {
            behaviour: behaviour.to_owned(),
            reason: EndReason::Error,
            message: Some("a.lua:3: no".to_owned()),
            seconds: 1.0,
            by: None,
        }
    }

    fn low(low: bool) -> AgentEvent {
        AgentEvent::Watchdog {
            state: WatchdogState::Free,
            low,
            docked: false,
        }
    }

    #[test]
    fn a_robot_out_of_reach_is_reported_once_and_its_return_too() {
        let mut now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        assert_eq!(rules.handle_event(&up(), now), None);
        assert_eq!(rules.deadline(), None);
        rules.handle_event(&down(), now);
        now += LONG / 2;
        assert_eq!(rules.poll(now), None);
        // Another failure meanwhile changes nothing.
        rules.handle_event(&down(), now);
        now += LONG / 2;
        let notification = rules.poll(now).unwrap();
        assert_eq!(
            notification.text,
            "Rover has been out of reach for 10 min: closed"
        );
        assert_eq!((rules.poll(now + LONG), rules.deadline()), (None, None));
        assert!(
            rules
                .handle_event(&up(), now)
                .unwrap()
                .text
                .contains("in reach again")
        );
        rules.handle_event(&down(), now);
        assert_eq!(
            rules.handle_event(&up(), now),
            None,
            "a short absence is not reported"
        );
    }

    #[test]
    fn a_robot_that_was_never_connected_is_reported_too() {
        let now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        assert!(
            rules
                .poll(now + LONG)
                .unwrap()
                .text
                .contains("spykee has been")
        );
    }

    #[test]
    fn a_low_battery_is_reported_on_change_and_each_failure_at_intervals() {
        let mut now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        assert_eq!(rules.handle_event(&low(true), now).unwrap().rule, Rule::Low);
        assert_eq!(rules.handle_event(&low(true), now), None);
        assert_eq!(rules.handle_event(&low(false), now), None);
        assert!(rules.handle_event(&low(true), now).is_some());
        assert!(
            rules
                .handle_event(&failed("a"), now)
                .unwrap()
                .text
                .contains("a.lua:3")
        );
        assert_eq!(rules.handle_event(&failed("a"), now), None);
        assert!(
            rules.handle_event(&failed("b"), now).is_some(),
            "of another behaviour"
        );
        now += AGAIN;
        assert!(rules.handle_event(&failed("a"), now).is_some());
    }

    #[test]
    fn a_low_battery_says_that_the_robot_stays_where_a_person_has_stopped_it() {
        let now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        let hold = AgentEvent::Safety {
            action: SafetyAction::Hold,
            reason: format!("battery at 20 %: stays where it is; {STOP_HOLDS}"),
        };
        assert_eq!(rules.handle_event(&hold, now), None);
        let told = rules.handle_event(&low(true), now).unwrap().text;
        assert!(told.ends_with(STOP_HOLDS), "{told}");
    }

    #[test]
    fn each_rule_of_the_config_has_its_event_and_its_text() {
        let behaviour = || "patrol".to_owned();
        let entry = |kind: &str| AgentEvent::Entry {
            behaviour: behaviour(),
            kind: kind.to_owned(),
            data: serde_json::json!({ "energy": 3.5, "where": "door" }),
        };
        let alarm = AgentEvent::Safety {
            action: SafetyAction::Alarm,
            reason: "no station".to_owned(),
        };
        let given_up = AgentEvent::GivenUp {
            behaviour: behaviour(),
            message: "no".to_owned(),
        };
        let missed = AgentEvent::StartMissed {
            behaviour: behaviour(),
            reason: "no robot was connected".to_owned(),
        };
        let sent = AgentEvent::Notify {
            behaviour: behaviour(),
            text: "look".to_owned(),
            picture: Some("a.jpg".into()),
        };
        let now = Instant::now();
        for (what, rule, text) in [
            (alarm, Rule::Alarm, "the alarm sounds: no station"),
            (
                given_up,
                Rule::RunFailed,
                "patrol is given up, it failed too often: no",
            ),
            (
                missed,
                Rule::StartMissed,
                "patrol did not start: no robot was connected",
            ),
            (
                entry("moved"),
                Rule::Moved,
                "patrol: something moved (energy 3.5, where door)",
            ),
            (
                entry("noise"),
                Rule::Moved,
                "patrol: a noise (energy 3.5, where door)",
            ),
            (sent, Rule::Script, "look"),
        ] {
            let notification = Rules::new(LONG, now).handle_event(&what, now).unwrap();
            assert_eq!((notification.rule, &*notification.text), (rule, text));
            assert_eq!(notification.picture.is_some(), rule == Rule::Script);
        }
        assert_eq!(
            Rules::new(LONG, now).handle_event(&entry("lamp"), now),
            None
        );
    }

    #[test]
    fn only_failed_dockings_are_reported() {
        let now = Instant::now();
        let dock = |end| AgentEvent::Dock {
            by: None,
            end,
            attempts: 1,
            seconds: 180.0,
        };
        for end in [
            DockEnd::Done,
            DockEnd::Cancelled,
            DockEnd::Preempted,
            DockEnd::Disconnected,
        ] {
            assert_eq!(
                Rules::new(LONG, now).handle_event(&dock(end), now),
                None,
                "{end}"
            );
        }
        let notification = Rules::new(LONG, now).handle_event(&dock(DockEnd::BaseNotFound), now);
        assert_eq!(notification.unwrap().rule, Rule::NotDocked);
    }

    #[test]
    fn that_a_stop_prevents_starts_is_told_once_until_it_is_released() {
        let now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        let missed = |behaviour: &str| AgentEvent::StartMissed {
            behaviour: behaviour.to_owned(),
            reason: STOP_HOLDS.to_owned(),
        };
        let told = rules.handle_event(&missed("patrol"), now).unwrap();
        assert!(told.text.contains("reset-stop"), "{}", told.text);
        for day in 1..10 {
            let later = now + Duration::from_secs(86_400 * day);
            assert_eq!(rules.handle_event(&missed("guard"), later), None);
        }
        let by = "the page".to_owned();
        assert_eq!(rules.handle_event(&AgentEvent::StopReset { by }, now), None);
        assert!(rules.handle_event(&missed("patrol"), now).is_some());
    }
}
