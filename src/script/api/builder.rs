//! Tables of [`Entry`] to Lua tables: each native under its shim, unknown names as errors.

use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

use mlua::prelude::{IntoLuaMulti, Lua, LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Args, Refusal, describe};
use super::super::budget;
use super::super::failure::printable;
use super::super::sandbox::{self, Prelude};
use super::super::scheduler::CANCELLED;
use super::{Answered, Call, Entry, Reply, Shared, definition, events, frame, tasks, vision};

/// Turns tables of [`Entry`] into Lua tables.
pub(super) struct Builder<'a> {
    pub(super) lua: &'a Lua,
    pub(super) shared: &'a Shared,
    pub(super) prelude: &'a Prelude,
}

impl Builder<'_> {
    pub(super) fn prepare(&self) -> LuaResult<()> {
        let shared = Rc::clone(self.shared);
        let can_wait = self.lua.create_function(move |_, can: bool| {
            let mut state = shared.borrow_mut();
            Ok(std::mem::replace(&mut state.can_wait, can))
        })?;
        self.prelude
            .function("use_can_wait")?
            .call::<()>(can_wait)?;
        tasks::register_handle(self)?;
        events::register_handle(self)?;
        frame::register(self)?;
        vision::register(self)
    }

    /// A table with a function for each entry, under the last part of its name.
    pub(super) fn table(&self, entries: &[Entry]) -> LuaResult<LuaTable> {
        let table = self.lua.create_table()?;
        for entry in entries {
            table.raw_set(entry.key(), self.function(entry)?)?;
        }
        Ok(table)
    }

    /// The methods of an object.
    pub(super) fn methods(
        &self,
        parts: &[&[Entry]],
    ) -> LuaResult<Vec<(&'static str, LuaFunction)>> {
        parts
            .iter()
            .copied()
            .flatten()
            .map(|entry| Ok((entry.key(), self.function(entry)?)))
            .collect()
    }

    /// The function that the script sees.
    pub(super) fn function(&self, entry: &Entry) -> LuaResult<LuaFunction> {
        let shim = if entry.waits { "waiting" } else { "plain" };
        let native = self.native(entry)?;
        self.prelude.function(shim)?.call(native)
    }

    /// The native under its shim: `true, values...`, or `false, message`, or nothing.
    pub(super) fn native(&self, entry: &Entry) -> LuaResult<LuaFunction> {
        let shared = Rc::clone(self.shared);
        let Entry {
            name,
            native,
            waits,
        } = *entry;
        self.lua
            .create_function(move |lua, mut values: LuaMultiValue| {
                let yieldable = waits && values.pop_front() == Some(LuaValue::Boolean(true));
                // A panic must not become an error that a script's pcall could swallow.
                let answered = catch_unwind(AssertUnwindSafe(|| {
                    let mut state = shared.borrow_mut();
                    native(&mut Call {
                        lua,
                        state: &mut state,
                        args: Args { call: name, values },
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

    /// An error with the nearest name for fields of a namespace that do not exist; "" for globals.
    pub(super) fn strict(&self, owner: &'static str) -> LuaResult<LuaFunction> {
        self.strict_with(owner, known_names)
    }

    /// The same for the members of an object, as its definition lists them.
    pub(super) fn strict_object(&self, owner: &'static str) -> LuaResult<LuaFunction> {
        let names = move |_: &Lua, _: &str| {
            let members = definition::object(owner).map(definition::members);
            let members = members.unwrap_or_default().into_iter();
            members.map(str::to_owned).collect()
        };
        self.strict_with(owner, names)
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
        self.prelude.function("strict")?.call((unknown, owner))
    }

    /// Makes a namespace strict and read-only, and gives it to scripts.
    pub(super) fn close(&self, name: &'static str, table: LuaTable) -> LuaResult<()> {
        let meta = self.lua.create_table()?;
        meta.raw_set("__index", self.strict(name)?)?;
        meta.raw_set(
            "__newindex",
            self.prelude.function("locked")?.call::<LuaFunction>(name)?,
        )?;
        meta.raw_set("__metatable", false)?;
        table.set_metatable(Some(meta))?;
        table.set_readonly(true);
        self.lua.globals().raw_set(name, table)
    }
}

/// A native's answer in the form that its shim understands.
fn to_shim(lua: &Lua, answered: Answered) -> LuaResult<LuaMultiValue> {
    match answered {
        Ok(Reply::Values(mut values)) => {
            values.push_front(LuaValue::Boolean(true));
            Ok(values)
        }
        Ok(Reply::Wait) => Ok(LuaMultiValue::new()),
        Err(Refusal::Misuse(words)) => failed(lua, &words),
        Err(Refusal::Cancelled) => failed(lua, CANCELLED),
        Err(Refusal::Machine(error)) => Err(error),
    }
}

fn failed(lua: &Lua, words: &str) -> LuaResult<LuaMultiValue> {
    (false, words).into_lua_multi(lua)
}

/// Every path that can be read: globals, and the fields of those that are tables.
pub(in super::super) fn every_path(lua: &Lua) -> BTreeSet<String> {
    let mut paths = BTreeSet::new();
    for owner in known_names(lua, "") {
        let fields = known_names(lua, &owner);
        paths.extend(fields.into_iter().map(|field| format!("{owner}.{field}")));
        paths.insert(owner);
    }
    paths
}

/// The names that exist in a namespace, or globally.
fn known_names(lua: &Lua, owner: &str) -> Vec<String> {
    let mut names = Vec::new();
    let mut collect = |table: &LuaTable| {
        let _ = table.for_each(|key: LuaValue, _: LuaValue| {
            if let LuaValue::String(text) = key {
                names.push(text.to_string_lossy());
            }
            Ok(())
        });
    };
    let globals = lua.globals();
    let builtins = globals
        .metatable()
        .and_then(|meta| meta.raw_get::<LuaTable>("__index").ok());
    if owner.is_empty() {
        collect(&globals);
        builtins.iter().for_each(&mut collect);
    } else if let Some(Ok(table)) = builtins.map(|all| all.raw_get::<LuaTable>(owner)) {
        collect(&table);
    }
    names.sort();
    names
}
