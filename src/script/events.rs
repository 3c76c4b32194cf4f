//! What a script can listen to: names, payloads, and subscriptions.

use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{Lua, LuaFunction, LuaResult, LuaTable, LuaValue};
use tokio::time::Instant;

use super::api::{HeldFrame, frame_to_lua};
use super::queue::Timer;
use super::sound;
use super::task::{SubscriptionId, TaskId};
use super::way_back::Place;
use crate::robot::{Battery, Event, Percent};
use crate::wire::Stream;

/// Subscriptions that may exist at once.
pub(super) const MAX_SUBSCRIPTIONS: usize = 64;

/// Events that may wait for one subscription.
const MAX_QUEUE: usize = 64;

/// Declares the events with the names that scripts use.
macro_rules! event_names {
    ($($variant:ident = $text:literal,)+) => {
        /// An event that a script can listen to (`API.md`, *Events*).
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub(super) enum EventName { $($variant,)+ }

        impl EventName {
            pub(super) const ALL: &'static [EventName] = &[$(EventName::$variant,)+];

            pub(super) fn name(self) -> &'static str {
                match self { $(EventName::$variant => $text,)+ }
            }
        }
    };
}

event_names! {
    Connected = "connected",
    Disconnected = "disconnected",
    Battery = "battery",
    BatteryLow = "battery_low",
    BatteryOk = "battery_ok",
    Charging = "charging",
    Charged = "charged",
    Docked = "docked",
    Undocked = "undocked",
    BaseNotFound = "base_not_found",
    Frame = "frame",
    Audio = "audio",
    Noise = "noise",
    SoundFinished = "sound_finished",
    Safety = "safety",
    Loan = "loan",
    Engine = "engine",
}

impl EventName {
    pub(super) fn from_name(name: &str) -> Option<EventName> {
        let mut all = EventName::ALL.iter().copied();
        all.find(|event| event.name() == name)
    }

    /// What must be on for it to come.
    pub(super) fn stream(self) -> Option<Stream> {
        match self {
            EventName::Frame => Some(Stream::Video),
            EventName::Audio | EventName::Noise => Some(Stream::AudioIn),
            _ => None,
        }
    }

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
            Event::Moving { .. }
            | Event::Sounding
            | Event::MotionEnded { .. }
            | Event::DockEnded { .. }
            | Event::UndockEnded { .. } => {
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
    Noise { dbfs: f64, own: bool },
    Loan(Rc<Loan>),
}

/// The tracks are lent, for so long and with so much power.
pub(super) struct Loan {
    pub(super) seconds: Duration,
    pub(super) power: Percent,
    pub(super) low_for: Duration,
    pub(super) way_back: Option<Vec<Place>>,
}

impl Loan {
    fn to_lua(&self, lua: &Lua) -> LuaResult<LuaTable> {
        let table = lua.create_table_with_capacity(0, 4)?;
        table.raw_set("seconds", self.seconds.as_secs_f64())?;
        table.raw_set("power", self.power.get())?;
        table.raw_set("low_for", self.low_for.as_secs_f64())?;
        if let Some(places) = &self.way_back {
            let way = lua.create_table_with_capacity(places.len(), 0)?;
            for Place { x, y } in places {
                let place = lua.create_table_with_capacity(0, 2)?;
                place.raw_set("x", *x)?;
                place.raw_set("y", *y)?;
                way.raw_push(place)?;
            }
            table.raw_set("way_back", way)?;
        }
        Ok(table)
    }
}

impl Payload {
    /// The table of `API.md`, *Events*; an empty one where the event carries nothing.
    pub(super) fn to_lua(&self, lua: &Lua) -> LuaResult<LuaValue> {
        let event = match self {
            Payload::Frame(held) => return frame_to_lua(lua, held),
            Payload::Noise { dbfs, own } => {
                let table = lua.create_table_with_capacity(0, 2)?;
                table.raw_set("dbfs", *dbfs)?;
                table.raw_set("own", *own)?;
                return Ok(LuaValue::Table(table));
            }
            Payload::Loan(loan) => return loan.to_lua(lua).map(LuaValue::Table),
            Payload::Event(event) => event,
        };
        event_table(lua, event).map(LuaValue::Table)
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
    Ok(table)
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
