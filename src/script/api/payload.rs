//! Converts the payloads of events to Lua values.

use std::time::Duration;

use mlua::prelude::{Lua, LuaResult, LuaTable, LuaValue};

use super::super::events::{EventName, Payload};
use super::super::sound;
use super::{frame, of_row};
use crate::api;
use crate::robot::{Battery, Event};

/// The argument of handlers: an empty table if the event has no payload.
pub(super) fn to_lua(payload: &Payload, lua: &Lua) -> LuaResult<LuaValue> {
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
        Some(object) => of_row(object.name, table),
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
        Event::Audio(samples) => return sound::to_lua(lua, samples),
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

/// The table that `robot.battery()` returns.
pub(super) fn battery_table(lua: &Lua, battery: Battery, age: Duration) -> LuaResult<LuaTable> {
    let table = lua.create_table_with_capacity(0, 4)?;
    table.raw_set("percent", battery.percent.get())?;
    table.raw_set("charging", battery.charging)?;
    table.raw_set("age", age.as_secs_f64())?;
    table.raw_set("minutes_left", battery.minutes_left)?;
    Ok(of_row("Battery", table))
}
