//! Everything that can happen in an agent, as published to listeners. In JSON each event is a
//! flat object whose `event` names its kind: `{"event":"link_down","reason":"..."}`.

use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::sync::broadcast;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::{Battery, DockEnd, EndReason, RobotInfo, SafetyAction};

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WatchdogState {
    #[default]
    Offline,
    /// Free to move.
    Free,
    Docked,
    /// A behaviour sends the robot home.
    Docking,
    /// Low battery: on its way home, or waiting for the next attempt.
    #[serde(rename = "going_home")]
    LowGoingHome,
    /// Low battery and docking has failed: sounds the alarm, and tries again.
    Alarm,
}

impl std::fmt::Display for WatchdogState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            WatchdogState::Offline => "offline",
            WatchdogState::Free => "free",
            WatchdogState::Docked => "docked",
            WatchdogState::Docking => "docking",
            WatchdogState::LowGoingHome => "battery low, going home",
            WatchdogState::Alarm => "battery low, ALARM",
        })
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum AgentEvent {
    LinkUp {
        #[serde(flatten)]
        robot: RobotInfo,
        docked: bool,
    },
    LinkDown {
        reason: String,
    },
    /// The believed level or charging state has changed; also sent once after each login.
    Battery(Battery),
    /// The watchdog's state has changed, or what it believes of the battery or the station.
    Watchdog {
        state: WatchdogState,
        /// The battery is low, and the watchdog controls the robot.
        low: bool,
        docked: bool,
    },
    Safety {
        action: SafetyAction,
        reason: String,
    },
    /// A docking has ended; each attempt of a robot with a low battery counts as one.
    Dock {
        /// The behaviour that asked for it; `None`: the watchdog.
        by: Option<String>,
        end: DockEnd,
        attempts: u32,
        /// Time from its start, in seconds.
        seconds: f64,
    },
    /// The robot has left its station for a behaviour, or not in time.
    Undock {
        by: String,
        end: DockEnd,
    },
    Started {
        behaviour: String,
        /// Who has started it, if it does not belong to the run from its beginning.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by: Option<String>,
    },
    /// A behaviour has ended, or could not begin.
    Ended {
        behaviour: String,
        reason: EndReason,
        /// For people: with file and line if it failed.
        message: Option<String>,
        seconds: f64,
        /// Who has ended it, or what, if it did not end on its own.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        by: Option<String>,
    },
    /// A behaviour has failed too often and is not started again.
    GivenUp {
        behaviour: String,
        /// How it failed last.
        message: String,
    },
    /// A start in the timetable did not take place.
    StartMissed {
        behaviour: String,
        reason: String,
    },
    /// The robot stands although a behaviour runs that drives.
    Standstill {
        /// What runs.
        behaviour: String,
        reason: String,
    },
    /// A person has pressed STOP: the robot stands until a person releases it.
    StopEngaged {
        by: String,
    },
    StopReset {
        by: String,
    },
    /// A person has changed the timetable until further notice.
    TimetableChanged {
        by: String,
        /// What is different now.
        text: String,
    },
    Picture {
        behaviour: String,
        path: PathBuf,
    },
    /// A behaviour adds an entry to the journal.
    Entry {
        behaviour: String,
        /// The kind, a word that the behaviour chooses.
        kind: String,
        /// The entry's data; an object.
        data: Value,
    },
    Notify {
        behaviour: String,
        text: String,
        picture: Option<PathBuf>,
    },
}

/// A message of a host about its behaviour that is not for the robot. Texts come from scripts: they
/// are limited and checked where they arrive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum HostReport {
    /// It has saved a picture in its data folder.
    Picture { name: String },
    Entry {
        /// The kind, a word that the script chooses.
        kind: String,
        json: String,
    },
    Notify {
        text: String,
        /// The name of a file in its data folder.
        picture: Option<String>,
    },
}

/// The most events that a listener may be behind.
const MAX_WAITING: usize = 1024;

#[derive(Debug, Clone, PartialEq)]
pub struct TimedEvent {
    pub at: Instant,
    pub what: AgentEvent,
}

/// The publishing end. Cheap to clone; all clones are one bus.
#[derive(Debug, Clone)]
pub struct Bus(broadcast::Sender<Arc<TimedEvent>>);

impl Default for Bus {
    fn default() -> Bus {
        Bus(broadcast::Sender::new(MAX_WAITING))
    }
}

impl Bus {
    /// Publishes something that has happened just now.
    pub fn publish(&self, what: AgentEvent) {
        let at = Instant::now();
        // Fails only without listeners.
        let _ = self.0.send(Arc::new(TimedEvent { at, what }));
    }

    /// Subscribes to everything that is published from now on.
    pub fn subscribe(&self) -> Listener {
        Listener(self.0.subscribe())
    }
}

#[derive(Debug)]
pub struct Listener(broadcast::Receiver<Arc<TimedEvent>>);

#[derive(Debug, Clone, PartialEq)]
pub enum BusMessage {
    Event(Arc<TimedEvent>),
    /// The listener was too slow: this many events are lost.
    Missed(u64),
}

impl Listener {
    /// Waits for the next event; `None` once all publishers are gone. Cancel-safe.
    pub async fn next(&mut self) -> Option<BusMessage> {
        match self.0.recv().await {
            Ok(event) => Some(BusMessage::Event(event)),
            Err(broadcast::error::RecvError::Lagged(missed)) => Some(BusMessage::Missed(missed)),
            Err(broadcast::error::RecvError::Closed) => None,
        }
    }

    /// Like [`Listener::next`], but once `stop` is cancelled only what has already been published.
    pub async fn next_until(&mut self, stop: &CancellationToken) -> Option<BusMessage> {
        match stop.run_until_cancelled(self.next()).await {
            Some(next) => next,
            None => self.try_next(),
        }
    }

    /// The next event, if there is one already.
    pub fn try_next(&mut self) -> Option<BusMessage> {
        match self.0.try_recv() {
            Ok(event) => Some(BusMessage::Event(event)),
            Err(broadcast::error::TryRecvError::Lagged(missed)) => Some(BusMessage::Missed(missed)),
            Err(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;

    fn all() -> Vec<AgentEvent> {
        let behaviour = "patrol".to_owned();
        let text = || "words".to_owned();
        vec![
            AgentEvent::LinkUp {
                robot: RobotInfo {
                    uid: "SPYKEE0001".to_owned(),
                    name: "Rover".to_owned(),
                    firmware: "1.0.22".to_owned(),
                    address: "10.0.0.2:9000".to_owned(),
                    simulated: true,
                },
                docked: true,
            },
            AgentEvent::LinkDown { reason: text() },
            AgentEvent::Battery(Battery {
                percent: Some(Percent::saturating(71)),
                charging: false,
                minutes_left: Some(12.5),
            }),
            AgentEvent::Watchdog {
                state: WatchdogState::LowGoingHome,
                low: true,
                docked: false,
            },
            AgentEvent::Safety {
                action: SafetyAction::Alarm,
                reason: text(),
            },
            AgentEvent::Dock {
                by: None,
                end: DockEnd::BaseNotFound,
                attempts: 1,
                seconds: 180.5,
            },
            AgentEvent::Undock {
                by: behaviour.clone(),
                end: DockEnd::Done,
            },
            AgentEvent::Started {
                behaviour: behaviour.clone(),
                by: Some(text()),
            },
            AgentEvent::Ended {
                behaviour: behaviour.clone(),
                reason: EndReason::Error,
                message: Some("patrol.lua:3: no".to_owned()),
                seconds: 1.5,
                by: None,
            },
            AgentEvent::GivenUp {
                behaviour: behaviour.clone(),
                message: text(),
            },
            AgentEvent::StartMissed {
                behaviour: behaviour.clone(),
                reason: text(),
            },
            AgentEvent::StopEngaged { by: text() },
            AgentEvent::Standstill {
                behaviour: behaviour.clone(),
                reason: text(),
            },
            AgentEvent::StopReset { by: text() },
            AgentEvent::TimetableChanged {
                by: text(),
                text: text(),
            },
            AgentEvent::Picture {
                behaviour: behaviour.clone(),
                path: "data/patrol/1.jpg".into(),
            },
            AgentEvent::Entry {
                behaviour: behaviour.clone(),
                kind: "moved".to_owned(),
                data: serde_json::json!({ "energy": 3.5 }),
            },
            AgentEvent::Notify {
                behaviour,
                text: text(),
                picture: None,
            },
        ]
    }

    #[test]
    fn each_is_a_flat_json_object_with_its_name_and_round_trips() {
        for one in all() {
            let json = serde_json::to_value(&one).unwrap();
            assert!(json["event"].is_string());
            assert_eq!(serde_json::from_value::<AgentEvent>(json).unwrap(), one);
        }
    }

    #[test]
    fn json_uses_the_names_of_scripts() {
        let json = all()
            .into_iter()
            .map(|one| serde_json::to_string(&one).unwrap());
        let json: String = json.collect();
        for word in [
            r#""end":"base_not_found""#,
            r#""action":"alarm""#,
            r#""percent":71"#,
        ] {
            assert!(json.contains(word), "{word}: {json}");
        }
    }

    fn lost(reason: &str) -> AgentEvent {
        let reason = reason.to_owned();
        AgentEvent::LinkDown { reason }
    }

    #[tokio::test]
    async fn a_slow_listener_loses_the_oldest_and_is_told_how_many() {
        let bus = Bus::default();
        let mut slow = bus.subscribe();
        (0..MAX_WAITING + 3).for_each(|number| bus.publish(lost(&number.to_string())));
        assert_eq!(slow.next().await, Some(BusMessage::Missed(3)));
        let Some(BusMessage::Event(first)) = slow.next().await else {
            panic!("nothing is left");
        };
        assert_eq!(first.what, lost("3"));
        drop(bus);
        while slow.try_next().is_some() {}
        assert_eq!(slow.next().await, None);
    }

    #[tokio::test]
    async fn earlier_events_are_not_received_and_later_ones_before_a_stop_are() {
        let bus = Bus::default();
        bus.publish(lost("before"));
        let mut late = bus.subscribe();
        assert_eq!(late.try_next(), None);
        bus.publish(lost("after"));
        bus.publish(lost("last"));
        let stop = CancellationToken::new();
        stop.cancel();
        for reason in ["after", "last"] {
            let next = late.next_until(&stop).await;
            assert!(matches!(next, Some(BusMessage::Event(one)) if one.what == lost(reason)));
        }
        assert_eq!(late.next_until(&stop).await, None);
    }
}
