//! The rows waiting to be written: decides which events become rows, and when to write them. Pure:
//! the time is an argument.

use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::Instant;

use crate::robot::{AgentEvent, Battery, Percent};

/// Maximum number of rows waiting for the disk; further events are only counted.
const MAX_WAITING: usize = 2000;
/// Maximum number of rows per minute: a robot that reports a docking a thousand times a second must
/// not fill the disk.
const MAX_PER_MINUTE: u32 = 600;
const MINUTE: Duration = Duration::from_secs(60);
/// Rows within this time are written together.
const BATCH_TIME: Duration = Duration::from_millis(250);
const RETRY_PAUSE: Duration = Duration::from_secs(5);

#[derive(Debug, Default)]
pub(super) struct Pending {
    rows: Vec<Row>,
    /// Number of events that are not among the rows.
    lost: u64,
    robot: Option<String>,
    /// The battery level, while the link is up.
    battery: Option<Battery>,
    sampled: Option<Instant>,
    minute: Option<(Instant, u32)>,
    due: Option<Instant>,
}

impl Pending {
    pub(super) fn add_event(&mut self, what: &AgentEvent, at: i64, now: Instant) {
        match what {
            AgentEvent::LinkUp { robot, .. } => self.robot = Some(robot.uid.clone()),
            AgentEvent::LinkDown { .. } => self.battery = None,
            AgentEvent::Battery(battery) => {
                (self.battery, self.sampled) = (Some(*battery), Some(now));
            }
            _ => {}
        }
        self.push(Content::from_occurrence(what), at, now);
    }

    pub(super) fn add_lost(&mut self, count: u64, now: Instant) {
        self.lost += count;
        self.due.get_or_insert(now + BATCH_TIME);
    }

    /// When [`Pending::sample`] should be called next.
    pub(super) fn samples_at(&self) -> Option<Instant> {
        self.battery.and(self.sampled).map(|at| at + MINUTE)
    }

    /// Adds the battery level once a minute if there was no battery event in the meantime.
    pub(super) fn sample(&mut self, at: i64, now: Instant) {
        if self.samples_at().is_none_or(|due| now < due) {
            return;
        }
        self.sampled = Some(now);
        if let Some(battery) = self.battery {
            self.push(Content::of_battery(&battery), at, now);
        }
    }

    fn push(&mut self, content: Content, at: i64, now: Instant) {
        if self.rows.len() >= MAX_WAITING || !self.has_room(now) {
            return self.add_lost(1, now);
        }
        let robot = self.robot.clone();
        self.rows.push(Row { at, robot, content });
        self.due.get_or_insert(now + BATCH_TIME);
    }

    fn has_room(&mut self, now: Instant) -> bool {
        let fresh = |(since, _): &(Instant, u32)| now.saturating_duration_since(*since) < MINUTE;
        let (since, rows) = self.minute.filter(fresh).unwrap_or((now, 0));
        self.minute = Some((since, rows.saturating_add(1)));
        rows < MAX_PER_MINUTE
    }

    /// When to write the rows and the number of lost events; `None` if there is nothing to write.
    pub(super) fn due(&self) -> Option<Instant> {
        self.due
    }

    pub(super) fn rows(&self) -> (&[Row], u64) {
        (&self.rows, self.lost)
    }

    pub(super) fn written(&mut self) {
        self.rows.clear();
        (self.lost, self.due) = (0, None);
    }

    /// Records that the write failed; it is retried after a pause.
    pub(super) fn failed(&mut self, now: Instant) {
        self.due = Some(now + RETRY_PAUSE);
    }
}

/// Maximum length of an event as JSON, in bytes; an entry of a script is shorter.
const LONGEST: usize = 16 * 1024;

/// A row of the journal, its time in milliseconds of the epoch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    pub(super) at: i64,
    pub(super) robot: Option<String>,
    pub(super) content: Content,
}

/// The content of a row; the variant determines the table.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Content {
    Battery {
        percent: Option<u8>,
        charging: bool,
    },
    Event {
        kind: String,
        behaviour: Option<String>,
        data: String,
    },
}

impl Content {
    pub(super) fn of_battery(battery: &Battery) -> Content {
        Content::Battery {
            percent: battery.percent.map(Percent::get),
            charging: battery.charging,
        }
    }

    pub(super) fn from_occurrence(what: &AgentEvent) -> Content {
        if let AgentEvent::Battery(battery) = what {
            return Content::of_battery(battery);
        }
        // Serialisation cannot fail: all keys of an event are strings.
        let event = serde_json::to_value(what).unwrap_or_default();
        let kind = event["event"].as_str().unwrap_or_default().to_owned();
        let by = match what {
            AgentEvent::Dock { .. } | AgentEvent::Undock { .. } => &event["by"],
            _ => &event["behaviour"],
        };
        let behaviour = by.as_str().map(str::to_owned);
        let mut data = event.to_string();
        if data.len() > LONGEST {
            data = json!({ "event": kind, "too_long": data.len() }).to_string();
        }
        Content::Event {
            kind,
            behaviour,
            data,
        }
    }

    pub(super) fn of_lost(count: u64) -> Content {
        let data: Value = json!({ "event": "lost", "count": count });
        Content::Event {
            kind: "lost".to_owned(),
            behaviour: None,
            data: data.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{Percent, RobotInfo};

    fn battery(percent: u8) -> AgentEvent {
        AgentEvent::Battery(Battery {
            percent: Some(Percent::saturating(percent)),
            charging: false,
            minutes_left: None,
        })
    }

    fn down() -> AgentEvent {
        let reason = "gone".to_owned();
        AgentEvent::LinkDown { reason }
    }

    #[test]
    fn the_battery_is_recorded_at_each_change_and_each_minute_while_the_link_is_up() {
        let mut pending = Pending::default();
        let mut now = Instant::now();
        pending.add_event(&battery(70), 0, now);
        pending.add_event(&battery(69), 1, now);
        assert_eq!(pending.rows().0.len(), 2);
        pending.sample(2, now);
        assert_eq!(pending.rows().0.len(), 2, "the minute is not over");
        now += MINUTE;
        assert_eq!(pending.samples_at(), Some(now));
        pending.sample(3, now);
        assert_eq!(pending.rows().0.len(), 3);
        pending.add_event(&down(), 4, now);
        assert_eq!(pending.samples_at(), None);
    }

    #[test]
    fn rows_name_the_connected_robot() {
        let mut pending = Pending::default();
        let now = Instant::now();
        let robot = RobotInfo {
            uid: "SPYKEE7".to_owned(),
            name: String::new(),
            firmware: String::new(),
            address: String::new(),
            simulated: false,
        };
        let docked = false;
        pending.add_event(&AgentEvent::LinkUp { robot, docked }, 0, now);
        pending.add_event(&down(), 1, now);
        let robots = pending.rows().0.iter().map(|row| row.robot.as_deref());
        assert_eq!(robots.collect::<Vec<_>>(), [Some("SPYKEE7"); 2]);
    }

    #[test]
    fn a_flood_is_limited_and_every_lost_event_is_counted() {
        let mut pending = Pending::default();
        let mut now = Instant::now();
        for _ in 0..10_000 {
            pending.add_event(&down(), 0, now);
        }
        let (rows, lost) = pending.rows();
        assert_eq!((rows.len() as u64 + lost, rows.len()), (10_000, 600));
        pending.written();
        assert_eq!((pending.due(), pending.rows()), (None, (&[][..], 0)));
        now += MINUTE;
        pending.add_event(&down(), 0, now);
        assert_eq!((pending.rows().0.len(), pending.rows().1), (1, 0));
    }

    #[test]
    fn rows_that_cannot_be_written_wait_and_then_are_counted() {
        let mut pending = Pending::default();
        let mut now = Instant::now();
        for minute in 0..10_u64 {
            for _ in 0..500 {
                pending.add_event(&down(), minute as i64, now);
            }
            pending.failed(now);
            assert_eq!(pending.due(), Some(now + RETRY_PAUSE));
            now += MINUTE;
        }
        assert_eq!((pending.rows().0.len(), pending.rows().1), (2000, 3000));
    }
}
