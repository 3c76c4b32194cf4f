//! What a script can listen to: names, payloads, and subscriptions.

use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{Lua, LuaFunction, LuaResult, LuaTable, LuaValue};
use tokio::time::Instant;

use super::api::{HeldFrame, frame_to_lua, of_row};
use super::queue::Timer;
use super::sound;
use super::task::{SubscriptionId, TaskId};
use crate::api;
pub(super) use crate::api::EventName;
use crate::robot::{Battery, Event};

/// Subscriptions that may exist at once.
pub(super) const MAX_SUBSCRIPTIONS: usize = 64;

/// Events that may wait for one subscription.
const MAX_QUEUE: usize = 64;

impl EventName {
    /// The name of an event that comes from outside; `None` for the answers to waiting calls.
    pub(super) fn of(event: &Event) -> Option<EventName> {
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
            Event::Loan { .. } => EventName::Loan,
            Event::Engine { .. } => EventName::Engine,
            Event::MotionEnded { .. } | Event::DockEnded { .. } | Event::UndockEnded { .. } => {
                return None;
            }
        })
    }

    /// Frames and sound come faster than they are handled, and only the newest matters.
    pub(super) fn keeps_latest(self) -> bool {
        matches!(self, EventName::Frame | EventName::Audio | EventName::Noise)
    }
}

/// What an event carries.
#[derive(Clone)]
pub(super) enum Payload {
    Event(Rc<Event>),
    Frame(Rc<HeldFrame>),
    Noise { dbfs: f64 },
}

impl Payload {
    /// The table of `API.md`, *Events*; an empty one where the event carries nothing.
    pub(super) fn to_lua(&self, lua: &Lua) -> LuaResult<LuaValue> {
        let event = match self {
            Payload::Frame(held) => return frame_to_lua(lua, held),
            Payload::Noise { dbfs } => {
                let table = lua.create_table_with_capacity(0, 1)?;
                table.raw_set("dbfs", *dbfs)?;
                return Ok(LuaValue::Table(of_row("Noise", table)));
            }
            Payload::Event(event) => event,
        };
        let table = event_table(lua, event)?;
        let row = EventName::of(event).and_then(|name| api::event(name.name()));
        let payload = row.and_then(|row| row.payload);
        let table = match payload {
            Some(object) => of_row(object.name, table),
            None => table,
        };
        Ok(LuaValue::Table(table))
    }
}

fn event_table(lua: &Lua, event: &Event) -> LuaResult<LuaTable> {
    let table = lua.create_table()?;
    match event {
        Event::Connected { info, .. } => table.raw_set("address", info.address.as_str())?,
        Event::Disconnected { reason } => table.raw_set("reason", reason.as_str())?,
        Event::Battery(battery) | Event::BatteryLow(battery) | Event::BatteryOk(battery) => {
            return battery_table(lua, *battery, Duration::ZERO);
        }
        Event::Charging { on } => table.raw_set("on", *on)?,
        Event::Audio(samples) => return sound::to_lua(lua, samples),
        Event::Safety { action, reason } => {
            table.raw_set("action", action.name())?;
            table.raw_set("reason", reason.as_str())?;
        }
        Event::Loan { seconds, power } => {
            table.raw_set("seconds", seconds.as_secs_f64())?;
            table.raw_set("power", power.get())?;
        }
        Event::Engine { code } => table.raw_set("code", *code)?,
        _ => {}
    }
    Ok(table)
}

/// What `robot.battery()` answers.
pub(super) fn battery_table(lua: &Lua, battery: Battery, age: Duration) -> LuaResult<LuaTable> {
    let table = lua.create_table_with_capacity(0, 4)?;
    table.raw_set("percent", battery.percent.get())?;
    table.raw_set("charging", battery.charging)?;
    table.raw_set("age", age.as_secs_f64())?;
    table.raw_set("minutes_left", battery.minutes_left)?;
    Ok(of_row("Battery", table))
}

/// One `robot.on` or `robot.once`.
pub(super) struct Subscription {
    pub(super) event: EventName,
    pub(super) function: LuaFunction,
    pub(super) once: bool,
    /// Only the newest event waits.
    pub(super) latest: bool,
    /// The least time between two runs.
    pub(super) interval: Option<Duration>,
    queue: VecDeque<Payload>,
    next_run: Option<Instant>,
    /// A run is queued or under way, or a timer will queue it.
    pub(super) busy: Busy,
    /// Failed runs since the last good one.
    pub(super) failures: u32,
    dropped: u64,
}

/// What a subscription is doing.
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

    /// Keeps an event until its turn; the number of events dropped so far if that number is one
    /// to log (1, 10, 100, ...).
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

    /// The next event, and the time of the run after that.
    pub(super) fn pop(&mut self, now: Instant) -> Option<Payload> {
        let payload = self.queue.pop_front()?;
        self.next_run = self.interval.map(|interval| now + interval);
        Some(payload)
    }

    /// When the next run may begin, if that is later than `now`.
    pub(super) fn held_until(&self, now: Instant) -> Option<Instant> {
        self.next_run.filter(|at| *at > now)
    }
}

/// 1, 10, 100, ...: how often a repeated complaint is worth a line.
pub(super) fn is_round(count: u64) -> bool {
    count > 0 && 10_u64.pow(count.ilog10()) == count
}

/// All subscriptions, in the order of their making.
pub(super) type Subscriptions = BTreeMap<SubscriptionId, Subscription>;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complaints_are_logged_at_powers_of_ten() {
        let logged: Vec<u64> = (0..=1000).filter(|&count| is_round(count)).collect();
        assert_eq!(logged, [1, 10, 100, 1000]);
    }
}
