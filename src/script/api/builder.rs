//! Builds Lua tables from the rows of the API table and their native functions: each function is
//! wrapped in its shim, and unknown names are errors.

use std::collections::{BTreeMap, BTreeSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

use mlua::prelude::{
    IntoLuaMulti, Lua, LuaError, LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue,
};
use mlua::{UserDataFields as _, UserDataRegistry};

use super::super::arguments::{Args, Refusal, describe};
use super::super::budget;
use super::super::failure::printable;
use super::super::sandbox;
use super::super::state::CANCELLED;
use super::{Call, Native, NativeResult, Natives, Reply, Shared, convert, modules};
use crate::api::{self, Function};

/// Builds Lua tables from rows and native functions.
pub(super) struct Builder<'a> {
    pub(super) lua: &'a Lua,
    pub(super) shared: &'a Shared,
    /// The prelude's functions.
    pub(super) prelude: &'a LuaTable,
    natives: BTreeMap<&'static str, Native>,
}

impl<'a> Builder<'a> {
    /// Fails if a native function has no row in the API table.
    pub(super) fn new(
        lua: &'a Lua,
        shared: &'a Shared,
        prelude: &'a LuaTable,
        natives: &[&Natives],
    ) -> LuaResult<Builder<'a>> {
        let natives: BTreeMap<_, _> = natives.iter().copied().flatten().copied().collect();
        if let Some(path) = natives.keys().find(|path| api::function(path).is_none()) {
            return Err(unpaired(path));
        }
        let of_state = Rc::clone(shared);
        let can_wait = lua.create_function(move |_, can: bool| {
            let mut state = of_state.borrow_mut();
            Ok(std::mem::replace(&mut state.can_wait, can))
        })?;
        prelude
            .raw_get::<LuaFunction>("use_can_wait")?
            .call::<()>(can_wait)?;
        Ok(Builder {
            lua,
            shared,
            prelude,
            natives,
        })
    }

    pub(super) fn namespace(&self, name: &'static str) -> LuaResult<LuaTable> {
        let table = self.lua.create_table()?;
        for row in api::namespace(name).map_or(&[][..], |namespace| namespace.functions) {
            table.raw_set(row.key(), self.native_of(row)?)?;
        }
        Ok(table)
    }

    /// The native function of a row. Fails if there is none.
    fn native_of(&self, row: &'static Function) -> LuaResult<LuaFunction> {
        let native = self.natives.get(row.path);
        self.function(row, *native.ok_or_else(|| unpaired(row.path))?)
    }

    /// Registers the type of a kind of script objects: its methods, its fields, and errors for
    /// other names.
    pub(super) fn object<T: 'static>(
        &self,
        name: &'static str,
        more: impl FnOnce(&mut UserDataRegistry<T>),
    ) -> LuaResult<()> {
        let object = api::object(name).ok_or_else(|| unpaired(name))?;
        let mut methods = Vec::new();
        for row in object.methods {
            methods.push((row.key(), self.native_of(row)?));
        }
        let members = move |_: &Lua, _: &str| {
            let members = object.members().into_iter();
            members.map(str::to_owned).collect()
        };
        let unknown = self.strict_with(name, members)?;
        self.lua.register_userdata_type::<T>(|registry| {
            registry.add_meta_field("__type", name);
            registry.add_meta_field("__index", unknown);
            more(registry);
            for (name, method) in methods {
                registry.add_field(name, method);
            }
        })
    }

    pub(super) fn function(
        &self,
        row: &'static Function,
        native: Native,
    ) -> LuaResult<LuaFunction> {
        let shim = match row.path {
            "print" => "printer",
            _ if row.owner() == "log" => "logger",
            _ if row.waits => "waiting",
            _ => "plain",
        };
        self.function_with_shim(shim, row, native)
    }

    pub(super) fn function_with_shim(
        &self,
        shim: &str,
        row: &'static Function,
        native: Native,
    ) -> LuaResult<LuaFunction> {
        let native = self.native(row, native, shim == "waiting")?;
        let shim = self.prelude.raw_get::<LuaFunction>(shim)?;
        let show = |_: &Lua, value: LuaValue| Ok(convert::text(&value));
        match row.path {
            "print" => shim.call((native, self.lua.create_function(show)?)),
            _ => shim.call(native),
        }
    }

    /// Builds the function that the shim calls. It returns `true, values...`, or `false, message`,
    /// or nothing if the call waits.
    fn native(
        &self,
        function: &'static Function,
        native: Native,
        waits: bool,
    ) -> LuaResult<LuaFunction> {
        let shared = Rc::clone(self.shared);
        self.lua
            .create_function(move |lua, mut values: LuaMultiValue| {
                let yieldable = waits && values.pop_front() == Some(LuaValue::Boolean(true));
                // A panic must not become an error that a script's pcall could swallow.
                let answered = catch_unwind(AssertUnwindSafe(|| {
                    let mut state = shared.borrow_mut();
                    native(&mut Call {
                        lua,
                        state: &mut state,
                        args: Args::new(function, values),
                        yieldable,
                    })
                }));
                let Ok(answered) = answered else {
                    shared.borrow_mut().broken = true;
                    budget::latch_stopped();
                    return failed(lua, "internal fault");
                };
                to_shim(lua, answered)
            })
    }

    /// Builds the error, with the nearest name, for fields of a namespace that do not exist; "" is
    /// for globals.
    pub(super) fn strict(&self, owner: &'static str) -> LuaResult<LuaFunction> {
        self.strict_with(owner, known_names)
    }

    pub(super) fn strict_with(
        &self,
        owner: &'static str,
        names: impl Fn(&Lua, &str) -> Vec<String> + 'static,
    ) -> LuaResult<LuaFunction> {
        let unknown = move |lua: &Lua, (name, key): (String, LuaValue)| {
            let key = match &key {
                LuaValue::String(text) => printable(&text.to_string_lossy(), 40),
                other => describe(other),
            };
            Ok(sandbox::unknown(&name, &key, &names(lua, &name)))
        };
        let unknown = self.lua.create_function(unknown)?;
        self.prelude
            .raw_get::<LuaFunction>("strict")?
            .call((unknown, owner))
    }

    /// Makes a namespace strict and read-only, and adds it to the globals.
    pub(super) fn close(&self, name: &'static str, table: LuaTable) -> LuaResult<()> {
        let meta = self.lua.create_table()?;
        meta.raw_set("__index", self.strict(name)?)?;
        meta.raw_set(
            "__newindex",
            self.prelude
                .raw_get::<LuaFunction>("locked")?
                .call::<LuaFunction>(name)?,
        )?;
        meta.raw_set("__metatable", false)?;
        table.set_metatable(Some(meta))?;
        table.set_readonly(true);
        self.lua.globals().raw_set(name, table)
    }
}

fn unpaired(path: &str) -> LuaError {
    LuaError::runtime(format!(
        "'{path}' is not both a native function and a row of the API table"
    ))
}

/// Checks, in builds with debug assertions, that a table from a call or an event has the fields of
/// its row.
pub(in super::super) fn of_row(object: &'static str, table: LuaTable) -> LuaTable {
    debug_assert!(has_fields(object, &table), "a {object} has other fields");
    table
}

fn has_fields(object: &str, table: &LuaTable) -> bool {
    let Some(object) = api::object(object) else {
        return false;
    };
    let mut known = true;
    let visited = table.for_each(|key: String, _: LuaValue| {
        known &= object.fields.iter().any(|field| field.name == key);
        Ok(())
    });
    let has = |field: &api::Value| {
        let value = table.raw_get::<LuaValue>(field.name);
        !field.is_required() || value.is_ok_and(|value| !value.is_nil())
    };
    visited.is_ok() && known && object.fields.iter().all(has)
}

/// Converts the answer of a native function to the form that its shim understands.
fn to_shim(lua: &Lua, answered: NativeResult) -> LuaResult<LuaMultiValue> {
    match answered {
        Ok(Reply::Values(mut values)) => {
            values.push_front(LuaValue::Boolean(true));
            Ok(values)
        }
        Ok(Reply::Wait) => Ok(LuaMultiValue::new()),
        Err(Refusal::Misuse(words)) => failed(lua, &words),
        Err(Refusal::Cancelled) => failed(lua, CANCELLED),
        Err(Refusal::Vm(error)) => Err(error),
    }
}

fn failed(lua: &Lua, words: &str) -> LuaResult<LuaMultiValue> {
    (false, words).into_lua_multi(lua)
}

/// Every name that can be read: globals, and the fields of those that are tables.
pub(in super::super) fn every_path(lua: &Lua) -> BTreeSet<String> {
    let mut paths = BTreeSet::new();
    for owner in known_names(lua, "") {
        let fields = known_names(lua, &owner);
        paths.extend(fields.into_iter().map(|field| format!("{owner}.{field}")));
        paths.insert(owner);
    }
    paths
}

fn known_names(lua: &Lua, owner: &str) -> Vec<String> {
    let globals = lua.globals();
    let builtins = globals
        .metatable()
        .and_then(|meta| meta.raw_get::<LuaTable>("__index").ok());
    let tables = if owner.is_empty() {
        std::iter::once(globals).chain(builtins).collect()
    } else {
        Vec::from_iter(builtins.and_then(|all| all.raw_get::<LuaTable>(owner).ok()))
    };
    let names = tables.iter().map(modules::names);
    let mut names: Vec<String> = names.flat_map(Result::unwrap_or_default).collect();
    names.sort();
    names
}
