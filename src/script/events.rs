//! The events that a script can listen to: names, payloads and subscriptions.

use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::LuaFunction;
use tokio::time::Instant;

use super::frame_state::HeldFrame;
use super::task::{SubscriptionId, TaskId, Timer};
use crate::robot::Event;

pub(super) use crate::api::EventName;

pub(super) const MAX_SUBSCRIPTIONS: usize = 64;

const MAX_QUEUE: usize = 64;

impl EventName {
    /// The script's name of an event; `None` for events that scripts cannot subscribe to, such as
    /// the answers to waiting calls.
    pub(super) fn from_event(event: &Event) -> Option<EventName> {
        Some(match event {
            Event::Connected { .. } => EventName::Connected,
            Event::Disconnected { .. } => EventName::Disconnected,
            Event::Battery(_) => EventName::Battery,
            Event::BatteryLow(_) => EventName::BatteryLow,
            Event::BatteryOk(_) => EventName::BatteryOk,
            Event::Charging { .. } => EventName::Charging,
            Event::Charged => EventName::Charged,
            Event::Docked => EventName::Docked,
            Event::Undocked => EventName::Undocked,
            Event::BaseNotFound => EventName::BaseNotFound,
            Event::Audio(_) => EventName::Audio,
            Event::SoundFinished => EventName::SoundFinished,
            Event::Safety { .. } => EventName::Safety,
            Event::DriveGrant { .. } => EventName::DriveGrant,
            Event::Engine { .. } => EventName::Engine,
            Event::Moving { .. }
            | Event::Sounding
            | Event::MotionWaiting { .. }
            | Event::MotionEnded { .. }
            | Event::DockEnded { .. }
            | Event::UndockEnded { .. } => {
                return None;
            }
        })
    }

    /// Whether only the newest event is kept by default: frames and sound may arrive faster than
    /// they are handled, and old ones are useless.
    pub(super) fn keeps_latest(self) -> bool {
        matches!(self, EventName::Frame | EventName::Audio | EventName::Noise)
    }
}

#[derive(Clone)]
pub(super) enum Payload {
    Event(Rc<Event>),
    Frame(Rc<HeldFrame>),
    Noise { dbfs: f64, own: bool },
}

/// One `robot.on` or `robot.once`.
pub(super) struct Subscription {
    pub(super) event: EventName,
    pub(super) function: LuaFunction,
    pub(super) once: bool,
    pub(super) latest: bool,
    /// The least time between the starts of two runs.
    pub(super) interval: Option<Duration>,
    queue: VecDeque<Payload>,
    next_run: Option<Instant>,
    /// Whether a run is queued or in progress, or a timer will queue it.
    pub(super) busy: Busy,
    /// Failed runs since the last successful one.
    pub(super) failures: u32,
    dropped: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Busy {
    No,
    Queued,
    Timed(Timer),
    Running(TaskId),
}

impl Subscription {
    pub(super) fn new(event: EventName, function: LuaFunction) -> Subscription {
        Subscription {
            event,
            function,
            once: false,
            latest: event.keeps_latest(),
            interval: None,
            queue: VecDeque::new(),
            next_run: None,
            busy: Busy::No,
            failures: 0,
            dropped: 0,
        }
    }

    /// Queues an event. Returns the number of events dropped so far if that number is worth a log
    /// line (1, 10, 100, ...).
    pub(super) fn push(&mut self, payload: Payload) -> Option<u64> {
        if self.latest {
            self.queue.clear();
            self.queue.push_back(payload);
            return None;
        }
        if self.queue.len() < MAX_QUEUE {
            self.queue.push_back(payload);
            return None;
        }
        self.dropped += 1;
        is_round(self.dropped).then_some(self.dropped)
    }

    pub(super) fn has_waiting(&self) -> bool {
        !self.queue.is_empty()
    }

    /// Takes the next event from the queue, and sets the earliest time of the run after it.
    pub(super) fn pop(&mut self, now: Instant) -> Option<Payload> {
        let payload = self.queue.pop_front()?;
        self.next_run = self.interval.map(|interval| now + interval);
        Some(payload)
    }

    pub(super) fn delayed_until(&self, now: Instant) -> Option<Instant> {
        self.next_run.filter(|at| *at > now)
    }
}

/// Whether a repeated failure is logged at this count: 1, 10, 100, ...
pub(super) fn is_round(count: u64) -> bool {
    count > 0 && 10_u64.pow(count.ilog10()) == count
}

pub(super) type Subscriptions = BTreeMap<SubscriptionId, Subscription>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_failures_are_logged_at_powers_of_ten() {
        let logged: Vec<u64> = (0..=1000).filter(|&count| is_round(count)).collect();
        assert_eq!(logged, [1, 10, 100, 1000]);
    }
}
