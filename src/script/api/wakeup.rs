//! Converts the answer that a task is resumed with to Lua values.

use mlua::prelude::{IntoLuaMulti, Lua, LuaMultiValue, LuaResult, LuaValue};

use super::super::scheduler::CANCELLED;
use super::super::task::{Status, Wakeup};
use super::{of_row, payload};
use crate::robot::{DockEnd, MotionEnd};

/// The values for `Thread::resume`: plain arguments at the start; after a yield `true` and the
/// return values of the waiting call, or `false` and the error to raise.
pub(in super::super) fn resume_values(lua: &Lua, answer: Wakeup) -> LuaResult<LuaMultiValue> {
    match answer {
        Wakeup::Start(values) => Ok(values),
        Wakeup::Deliver(payload) => payload::to_lua(&payload, lua)?.into_lua_multi(lua),
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

/// The return values of the waiting call.
fn returned(lua: &Lua, answer: Wakeup) -> LuaResult<LuaMultiValue> {
    match answer {
        Wakeup::Slept(time) => time.as_secs_f64().into_lua_multi(lua),
        Wakeup::Beat(missed) => (missed as f64).into_lua_multi(lua),
        Wakeup::Event(payload) => payload::to_lua(&payload, lua)?.into_lua_multi(lua),
        Wakeup::NoEvent => (LuaValue::Nil, "timeout").into_lua_multi(lua),
        Wakeup::Refused(code) => (false, code).into_lua_multi(lua),
        Wakeup::Motion(end) => (end == MotionEnd::Done, end.name()).into_lua_multi(lua),
        Wakeup::Dock {
            end,
            attempts,
            took,
        } => {
            let info = lua.create_table_with_capacity(0, 2)?;
            info.raw_set("attempts", attempts)?;
            info.raw_set("seconds", took.as_secs_f64())?;
            let info = of_row("DockInfo", info);
            (is_docked(end), end.name(), info).into_lua_multi(lua)
        }
        Wakeup::Undock(end) => (is_undocked(end), end.name()).into_lua_multi(lua),
        Wakeup::Joined(status, Some(text)) => {
            (status == Status::Done, status.name(), text).into_lua_multi(lua)
        }
        Wakeup::Joined(status, None) => (status == Status::Done, status.name()).into_lua_multi(lua),
        Wakeup::Again => "again".into_lua_multi(lua),
        Wakeup::Values(values) => Ok(values),
        Wakeup::Start(_) | Wakeup::Deliver(_) | Wakeup::Failed(_) | Wakeup::Cancelled => {
            Ok(LuaMultiValue::new())
        }
    }
}

/// Whether the robot is where the script wanted it to be.
fn is_docked(end: DockEnd) -> bool {
    matches!(end, DockEnd::Done | DockEnd::AlreadyDocked)
}

/// Whether the robot is where the script wanted it to be.
fn is_undocked(end: DockEnd) -> bool {
    matches!(end, DockEnd::Done | DockEnd::NotDocked)
}
