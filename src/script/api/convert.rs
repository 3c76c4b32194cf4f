//! Converts a script's values to short texts, for the fields of log lines, and events and answers to
//! Lua values. Depth, number of values and length of the texts are bounded, even for a table that
//! contains itself.

use std::time::Duration;

use mlua::prelude::{IntoLuaMulti, Lua, LuaError, LuaMultiValue, LuaResult, LuaTable, LuaValue};

use super::super::arguments::describe;
use super::super::events::{EventName, Payload};
use super::super::failure::printable;
use super::super::state::CANCELLED;
use super::super::streams::audio_to_lua;
use super::super::task::{Status, Wakeup};
use super::{frame, of_row};
use crate::api;
use crate::robot::{Battery, DockEnd, Event, MotionEnd, Percent};

const MAX_DEPTH: u32 = 3;
/// Largest number of values in one text.
const MAX_NODES: u32 = 64;
const MAX_STRING: usize = 200;
/// Largest number of bytes of one text; checked only between values.
const MAX_BYTES: usize = 1000;
/// Largest number of fields of one log line.
const MAX_FIELDS: usize = 32;

pub(super) fn fields(table: &LuaTable) -> Vec<(String, String)> {
    let mut fields = Vec::new();
    let _ = table.for_each(|key: LuaValue, value: LuaValue| {
        if fields.len() >= MAX_FIELDS {
            return Err(LuaError::runtime("enough"));
        }
        fields.push((text(&key), text(&value)));
        Ok(())
    });
    fields.sort();
    fields
}

pub(super) fn text(value: &LuaValue) -> String {
    let mut writer = Writer {
        out: String::new(),
        nodes: 0,
    };
    writer.value(value, 0);
    writer.out
}

struct Writer {
    out: String,
    nodes: u32,
}

impl Writer {
    fn is_full(&self) -> bool {
        self.nodes >= MAX_NODES || self.out.len() >= MAX_BYTES
    }

    fn value(&mut self, value: &LuaValue, depth: u32) {
        self.nodes += 1;
        match value {
            LuaValue::Nil => self.out.push_str("nil"),
            LuaValue::String(string) => {
                let bytes = string.as_bytes();
                let start = &bytes[..bytes.len().min(4 * MAX_STRING)];
                let text = printable(&String::from_utf8_lossy(start), MAX_STRING);
                self.out.push_str(&text);
            }
            LuaValue::Table(table) if depth < MAX_DEPTH => self.table(table, depth),
            LuaValue::Table(_) => self.out.push_str("{...}"),
            other => self.out.push_str(&describe(other)),
        }
    }

    fn table(&mut self, table: &LuaTable, depth: u32) {
        self.out.push('{');
        let length = table.raw_len();
        let mut first = true;
        let _ = table.for_each(|key: LuaValue, value: LuaValue| {
            if !std::mem::take(&mut first) {
                self.out.push_str(", ");
            }
            if self.is_full() {
                self.out.push_str("...");
                return Err(LuaError::runtime("enough"));
            }
            if !is_position(&key, length) {
                self.value(&key, MAX_DEPTH);
                self.out.push('=');
            }
            self.value(&value, depth + 1);
            Ok(())
        });
        self.out.push('}');
    }
}

fn is_position(key: &LuaValue, length: usize) -> bool {
    match key {
        LuaValue::Integer(at) => usize::try_from(*at).is_ok_and(|at| (1..=length).contains(&at)),
        LuaValue::Number(at) => at.fract() == 0.0 && *at >= 1.0 && *at <= length as f64,
        _ => false,
    }
}

/// The argument of handlers: an empty table if the event has no payload.
pub(in super::super) fn payload_to_lua(payload: &Payload, lua: &Lua) -> LuaResult<LuaValue> {
    let event = match payload {
        Payload::Frame(held) => return frame::to_lua(lua, held),
        Payload::Noise { dbfs, own } => {
            let table = lua.create_table_with_capacity(0, 2)?;
            table.raw_set("dbfs", *dbfs)?;
            table.raw_set("own", *own)?;
            return Ok(LuaValue::Table(of_row("Noise", table)));
        }
        Payload::Event(event) => event,
    };
    let table = event_table(lua, event)?;
    let row = EventName::from_event(event).and_then(|name| api::event(name.name()));
    let object = row.and_then(|row| row.payload);
    let table = match object {
        Some(object) => of_row(object, table),
        None => table,
    };
    Ok(LuaValue::Table(table))
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
        Event::Audio(samples) => return audio_to_lua(lua, samples),
        Event::Safety { action, reason } => {
            table.raw_set("action", action.name())?;
            table.raw_set("reason", reason.as_str())?;
        }
        Event::Engine { code } => table.raw_set("code", *code)?,
        Event::DriveGrant { seconds, power } => {
            table.raw_set("seconds", seconds.as_secs_f64())?;
            table.raw_set("power", power.get())?;
        }
        _ => {}
    }
    Ok(table)
}

pub(super) fn battery_table(lua: &Lua, battery: Battery, age: Duration) -> LuaResult<LuaTable> {
    let table = lua.create_table_with_capacity(0, 4)?;
    table.raw_set("percent", battery.percent.map(Percent::get))?;
    table.raw_set("charging", battery.charging)?;
    table.raw_set("age", age.as_secs_f64())?;
    table.raw_set("minutes_left", battery.minutes_left)?;
    Ok(of_row("Battery", table))
}

/// The values for `Thread::resume`: plain arguments at the start; after a yield `true` and the
/// return values of the waiting call, or `false` and the error to raise.
pub(in super::super) fn resume_values(lua: &Lua, answer: Wakeup) -> LuaResult<LuaMultiValue> {
    match answer {
        Wakeup::Start(values) => Ok(values),
        // The text has its place already.
        Wakeup::Failed(text) => (false, text, true).into_lua_multi(lua),
        Wakeup::Cancelled => (false, CANCELLED).into_lua_multi(lua),
        answer => {
            let mut values = returned(lua, answer)?;
            values.push_front(LuaValue::Boolean(true));
            Ok(values)
        }
    }
}

fn returned(lua: &Lua, answer: Wakeup) -> LuaResult<LuaMultiValue> {
    match answer {
        Wakeup::Slept(time) => time.as_secs_f64().into_lua_multi(lua),
        Wakeup::Beat(missed) => (missed as f64).into_lua_multi(lua),
        Wakeup::Event(payload) => payload_to_lua(&payload, lua)?.into_lua_multi(lua),
        Wakeup::NoEvent => (LuaValue::Nil, "timeout").into_lua_multi(lua),
        Wakeup::Refused(code) => (false, code).into_lua_multi(lua),
        Wakeup::Motion(end) => (end == MotionEnd::Done, end.name()).into_lua_multi(lua),
        Wakeup::Dock(outcome) => {
            let info = lua.create_table_with_capacity(0, 2)?;
            info.raw_set("attempts", outcome.attempts)?;
            info.raw_set("seconds", outcome.took.as_secs_f64())?;
            let info = of_row("DockInfo", info);
            let docked = matches!(outcome.end, DockEnd::Done | DockEnd::AlreadyDocked);
            (docked, outcome.end.name(), info).into_lua_multi(lua)
        }
        Wakeup::Undock(end) => {
            let undocked = matches!(end, DockEnd::Done | DockEnd::NotDocked);
            (undocked, end.name()).into_lua_multi(lua)
        }
        Wakeup::Joined(status, Some(text)) => {
            (status == Status::Done, status.name(), text).into_lua_multi(lua)
        }
        Wakeup::Joined(status, None) => (status == Status::Done, status.name()).into_lua_multi(lua),
        Wakeup::Again => "again".into_lua_multi(lua),
        Wakeup::Values(values) => Ok(values),
        Wakeup::Start(_) | Wakeup::Failed(_) | Wakeup::Cancelled => Ok(LuaMultiValue::new()),
    }
}
