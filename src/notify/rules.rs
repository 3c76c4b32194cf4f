//! Which happenings people are told of, and in which words. Pure: the time is an argument.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use super::notice::Rule;
use crate::robot::{Battery, DockEnd, EndReason, Occurrence, SafetyAction};

/// The same is told again after so long at the earliest.
const AGAIN: Duration = Duration::from_secs(600);
/// The longest text, in characters.
const LONGEST: usize = 1000;

/// What is to be told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Said {
    pub(super) rule: Rule,
    pub(super) text: String,
    pub(super) picture: Option<PathBuf>,
}

/// The link, as far as it matters to people.
#[derive(Debug)]
enum Link {
    Up,
    /// Since when, and why.
    Down(Instant, Option<String>),
    /// It has been told.
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
    /// When each was told, by what it was about.
    told: BTreeMap<(Rule, String), Instant>,
}

impl Rules {
    /// The robot is not there yet.
    pub(super) fn new(unreachable_after: Duration, now: Instant) -> Rules {
        Rules {
            unreachable_after,
            link: Link::Down(now, None),
            robot: None,
            battery: None,
            low: false,
            told: BTreeMap::new(),
        }
    }

    /// The robot's name, as far as it is known.
    pub(super) fn robot(&self) -> &str {
        self.robot.as_deref().unwrap_or("spykee")
    }

    /// Something has happened.
    pub(super) fn hear(&mut self, what: &Occurrence, now: Instant) -> Option<Said> {
        match what {
            Occurrence::LinkUp { robot, .. } => {
                let name = if robot.name.is_empty() {
                    &robot.uid
                } else {
                    &robot.name
                };
                self.robot = Some(name.clone());
                let was = std::mem::replace(&mut self.link, Link::Up);
                let missing = matches!(was, Link::Missing);
                missing.then(|| said(Rule::Unreachable, format!("{name} is in reach again")))
            }
            Occurrence::LinkDown { reason } => {
                if let Link::Up = self.link {
                    self.link = Link::Down(now, Some(reason.clone()));
                }
                None
            }
            Occurrence::Battery(battery) => {
                self.battery = Some(*battery);
                None
            }
            Occurrence::Watchdog { low, .. } => {
                let was_low = std::mem::replace(&mut self.low, *low);
                (*low && !was_low).then(|| said(Rule::Low, self.low_text()))
            }
            Occurrence::Safety {
                action: SafetyAction::Alarm,
                reason,
            } => self.once(Rule::Alarm, "", format!("the alarm sounds: {reason}"), now),
            Occurrence::Dock {
                end, by, seconds, ..
            } => {
                let why = failed_docking(*end)?;
                let by = by.as_deref().unwrap_or("the watchdog");
                let text = format!("docking failed after {seconds:.0} s: {why} (asked by {by})");
                self.once(Rule::NotDocked, "", text, now)
            }
            Occurrence::Ended {
                behaviour,
                reason: EndReason::Error | EndReason::Cpu | EndReason::Memory,
                message,
                ..
            } => {
                let why = message.as_deref().unwrap_or("no reason is known");
                let text = format!("{behaviour} failed: {why}");
                self.once(Rule::RunFailed, behaviour, text, now)
            }
            Occurrence::GivenUp { behaviour, message } => {
                let text = format!("{behaviour} is given up, it failed too often: {message}");
                Some(said(Rule::RunFailed, text))
            }
            Occurrence::StartMissed { behaviour, reason } => {
                let text = format!("{behaviour} did not start: {reason}");
                self.once(Rule::StartMissed, behaviour, text, now)
            }
            Occurrence::Entry {
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
            Occurrence::Notify { text, picture, .. } => Some(Said {
                picture: picture.clone(),
                ..said(Rule::Script, text.clone())
            }),
            _ => None,
        }
    }

    /// When [`Rules::poll`] has something to say.
    pub(super) fn deadline(&self) -> Option<Instant> {
        match &self.link {
            Link::Down(since, _) => Some(*since + self.unreachable_after),
            Link::Up | Link::Missing => None,
        }
    }

    /// Lets time pass.
    pub(super) fn poll(&mut self, now: Instant) -> Option<Said> {
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
        Some(said(Rule::Unreachable, text))
    }

    fn low_text(&self) -> String {
        match self.battery {
            Some(battery) => format!("the battery is low: {}", battery.percent),
            None => "the battery is low".to_owned(),
        }
    }

    /// Unless people were told lately.
    fn once(&mut self, rule: Rule, about: &str, text: String, now: Instant) -> Option<Said> {
        self.told
            .retain(|_, at| now.saturating_duration_since(*at) < AGAIN);
        let key = (rule, about.to_owned());
        if self.told.contains_key(&key) {
            return None;
        }
        self.told.insert(key, now);
        Some(said(rule, text))
    }
}

fn said(rule: Rule, text: String) -> Said {
    Said {
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

/// What a script says of its entry.
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
mod tests {
    use super::*;
    use crate::robot::{RobotInfo, WatchdogState};

    const LONG: Duration = Duration::from_secs(600);

    fn up() -> Occurrence {
        Occurrence::LinkUp {
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

    fn down() -> Occurrence {
        let reason = "closed".to_owned();
        Occurrence::LinkDown { reason }
    }

    fn failed(behaviour: &str) -> Occurrence {
        Occurrence::Ended {
            behaviour: behaviour.to_owned(),
            reason: EndReason::Error,
            message: Some("a.lua:3: no".to_owned()),
            seconds: 1.0,
        }
    }

    fn low(low: bool) -> Occurrence {
        Occurrence::Watchdog {
            state: WatchdogState::Free,
            low,
            docked: false,
        }
    }

    #[test]
    fn a_robot_that_is_away_for_long_is_told_once_and_that_it_is_back() {
        let mut now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        assert_eq!(rules.hear(&up(), now), None);
        assert_eq!(rules.deadline(), None);
        rules.hear(&down(), now);
        now += LONG / 2;
        assert_eq!(rules.poll(now), None);
        // Another failure in between changes nothing.
        rules.hear(&down(), now);
        now += LONG / 2;
        let told = rules.poll(now).unwrap();
        assert_eq!(told.text, "Rover has been out of reach for 10 min: closed");
        assert_eq!((rules.poll(now + LONG), rules.deadline()), (None, None));
        assert!(
            rules
                .hear(&up(), now)
                .unwrap()
                .text
                .contains("in reach again")
        );
        rules.hear(&down(), now);
        assert_eq!(rules.hear(&up(), now), None, "a short absence is none");
    }

    #[test]
    fn a_robot_that_was_never_there_is_told_too() {
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
    fn low_is_told_when_it_becomes_low_and_each_failure_once_in_a_while() {
        let mut now = Instant::now();
        let mut rules = Rules::new(LONG, now);
        assert_eq!(rules.hear(&low(true), now).unwrap().rule, Rule::Low);
        assert_eq!(rules.hear(&low(true), now), None);
        assert_eq!(rules.hear(&low(false), now), None);
        assert!(rules.hear(&low(true), now).is_some());
        assert!(
            rules
                .hear(&failed("a"), now)
                .unwrap()
                .text
                .contains("a.lua:3")
        );
        assert_eq!(rules.hear(&failed("a"), now), None);
        assert!(
            rules.hear(&failed("b"), now).is_some(),
            "of another behaviour"
        );
        now += AGAIN;
        assert!(rules.hear(&failed("a"), now).is_some());
    }

    #[test]
    fn each_rule_of_the_config_has_its_happening_and_its_words() {
        let behaviour = || "patrol".to_owned();
        let entry = |kind: &str| Occurrence::Entry {
            behaviour: behaviour(),
            kind: kind.to_owned(),
            data: serde_json::json!({ "energy": 3.5, "where": "door" }),
        };
        let alarm = Occurrence::Safety {
            action: SafetyAction::Alarm,
            reason: "no station".to_owned(),
        };
        let given_up = Occurrence::GivenUp {
            behaviour: behaviour(),
            message: "no".to_owned(),
        };
        let missed = Occurrence::StartMissed {
            behaviour: behaviour(),
            reason: "no robot was there".to_owned(),
        };
        let sent = Occurrence::Notify {
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
                "patrol did not start: no robot was there",
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
            let told = Rules::new(LONG, now).hear(&what, now).unwrap();
            assert_eq!((told.rule, &*told.text), (rule, text));
            assert_eq!(told.picture.is_some(), rule == Rule::Script);
        }
        assert_eq!(Rules::new(LONG, now).hear(&entry("lamp"), now), None);
    }

    #[test]
    fn only_what_went_wrong_with_a_docking_is_told() {
        let now = Instant::now();
        let dock = |end| Occurrence::Dock {
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
            assert_eq!(Rules::new(LONG, now).hear(&dock(end), now), None, "{end}");
        }
        let told = Rules::new(LONG, now).hear(&dock(DockEnd::BaseNotFound), now);
        assert_eq!(told.unwrap().rule, Rule::NotDocked);
    }
}
