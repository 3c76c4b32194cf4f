//! The built-in modules, written in Lua: `@spykee/...`. Each begins with a comment on its purpose
//! and use.

use mlua::prelude::{FromLuaMulti, IntoLuaMulti, Lua, LuaFunction, LuaResult};

pub fn modules() -> &'static [(&'static str, &'static str)] {
    &[
        ("@spykee/bt", include_str!("bt.luau")),
        ("@spykee/compass", include_str!("compass.luau")),
        ("@spykee/easy", include_str!("easy.luau")),
        ("@spykee/floor", include_str!("floor.luau")),
        ("@spykee/fsm", include_str!("fsm.luau")),
        ("@spykee/map", include_str!("map.luau")),
        ("@spykee/pid", include_str!("pid.luau")),
        ("@spykee/station", include_str!("station.luau")),
        ("@spykee/whereabouts", include_str!("whereabouts.luau")),
    ]
}

/// The built-in rescue behaviour, a whole script. The watchdog grants it the tracks when a robot
/// with a low battery does not find its station.
pub const RESCUE: &str = include_str!("rescue.luau");

/// Runs the module behind `scenario`, `expect` and `sim`.
pub(super) fn scenario<T: FromLuaMulti>(lua: &Lua, with: impl IntoLuaMulti) -> LuaResult<T> {
    let made: LuaFunction =
        super::sandbox::compile(lua, include_str!("scenario.luau"), "@spykee/scenario")?;
    made.call(with)
}
