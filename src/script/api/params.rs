//! `params.*`: parameters that a person may set from outside.

use std::collections::BTreeMap;
use std::rc::Rc;

use mlua::prelude::{Lua, LuaError, LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Args, Refusal, describe};
use super::super::budget;
use super::super::declaration::{self, ParamValue, check_declaration};
use super::super::failure::printable;
use super::super::state::State;
use super::{Builder, Call, NativeResult, Natives};
use crate::api::Type;
use crate::robot::DeclaredParam;

pub(super) const NATIVES: &Natives = &[("params.declare", declare)];

/// Largest number of parameters of one script, and of choices of one parameter.
const MAX_PARAMS: usize = 64;
/// Largest length of a text, in bytes.
const LONGEST: usize = 1000;
const STRICT: &str = "spykee.params";
const VALUES: &str = "spykee.params.values";

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<LuaTable> {
    let shared = Rc::clone(builder.shared);
    let names = move |_: &Lua, _: &str| {
        let declared = &shared.borrow().declared_params;
        declared.iter().flat_map(BTreeMap::keys).cloned().collect()
    };
    let strict = builder.strict_with("params", names)?;
    builder.lua.set_named_registry_value(STRICT, strict)?;
    builder.namespace("params")
}

fn declare(call: &mut Call<'_>) -> NativeResult {
    if call.state.declared_params.is_some() {
        let words = "it was called before; declare all parameters in one call";
        return Err(call.misuse(words));
    }
    let LuaValue::Table(table) = call.args.value(0).clone() else {
        let words = "it needs a table, such as {speed = {default = 40, min = 10, max = 100}}";
        return Err(call.misuse(words));
    };
    let mut declared = declarations(call, &table)?;
    let set = declaration::set_given(&mut declared, &call.state.options.params);
    let table = to_lua(call.lua, declared.values())?;
    call.state.declared_params = Some(declared);
    if let Err(error) = set {
        // A pcall must not continue with a refused value.
        call.state.refused_params = Some(error);
        budget::latch_stopped();
        return call.reply(());
    }
    call.lua.set_named_registry_value(VALUES, &table)?;
    call.state.show_params();
    call.reply(table)
}

fn set(table: &LuaTable, name: &str, value: &ParamValue) -> LuaResult<()> {
    match value {
        ParamValue::Boolean(value) => table.raw_set(name, *value),
        ParamValue::Number(value) => table.raw_set(name, *value),
        ParamValue::Text(value) => table.raw_set(name, value.as_str()),
    }
}

/// Changes a parameter for a person: the script's table has the new value from now on.
pub(in crate::script) fn set_live(
    lua: &Lua,
    state: &mut State,
    name: &str,
    value: ParamValue,
) -> Result<(), String> {
    let declared = state.declared_params.as_mut();
    let Some(declared) = declared.and_then(|declared| declared.get_mut(name)) else {
        let name = printable(name, 60);
        return Err(format!("the script declares no parameter '{name}'"));
    };
    if !declared.live {
        return Err(format!("{name} cannot be changed while the script runs"));
    }
    if !declared.allows(&value) {
        return Err(format!("{name} must be {}", declared.expected()));
    }
    let changed = lua
        .named_registry_value::<LuaTable>(VALUES)
        .and_then(|table| {
            table.set_readonly(false);
            let changed = set(&table, name, &value);
            table.set_readonly(true);
            changed
        });
    changed.map_err(|error| format!("{name} could not be changed: {error}"))?;
    declared.value = value;
    state.show_params();
    Ok(())
}

/// Creates the read-only table of values, with an error for unknown names.
fn to_lua<'a>(lua: &Lua, declared: impl Iterator<Item = &'a DeclaredParam>) -> LuaResult<LuaTable> {
    let table = lua.create_table()?;
    for one in declared {
        set(&table, &one.name, &one.value)?;
    }
    let meta = lua.create_table()?;
    let strict: LuaFunction = lua.named_registry_value(STRICT)?;
    meta.raw_set("__index", strict)?;
    meta.raw_set("__metatable", false)?;
    table.set_metatable(Some(meta))?;
    table.set_readonly(true);
    Ok(table)
}

/// Reads the declarations. Tables are read raw: no metamethod of the script runs here.
fn declarations(
    call: &Call<'_>,
    table: &LuaTable,
) -> Result<BTreeMap<String, DeclaredParam>, Refusal> {
    let mut declared = BTreeMap::new();
    for (key, value) in pairs(call, table, "the table")? {
        let LuaValue::String(key) = &key else {
            let words = format!("names are texts, got {}", describe(&key));
            return Err(call.misuse(&words));
        };
        let name = printable(&key.to_string_lossy(), 60);
        if !is_name(&name) {
            let words = format!("'{name}' is not a name; use letters, digits and _");
            return Err(call.misuse(&words));
        }
        let LuaValue::Table(about) = value else {
            let words = format!("{name} must be a table, such as {{default = 40}}");
            return Err(call.misuse(&words));
        };
        declared.insert(name.clone(), declaration(call, name, about)?);
    }
    Ok(declared)
}

/// All entries of a table, at most [`MAX_PARAMS`].
fn pairs(
    call: &Call<'_>,
    table: &LuaTable,
    what: &str,
) -> Result<Vec<(LuaValue, LuaValue)>, Refusal> {
    let mut pairs = Vec::new();
    let _ = table.for_each(|key: LuaValue, value: LuaValue| {
        pairs.push((key, value));
        if pairs.len() > MAX_PARAMS {
            return Err(LuaError::runtime("enough"));
        }
        Ok(())
    });
    if pairs.len() > MAX_PARAMS {
        let words = format!("{what} may have at most {MAX_PARAMS} entries");
        return Err(call.misuse(&words));
    }
    Ok(pairs)
}

fn is_name(text: &str) -> bool {
    let is_start = |c: char| c.is_ascii_alphabetic() || c == '_';
    text.starts_with(is_start) && text.chars().all(|c| is_start(c) || c.is_ascii_digit())
}

/// Reads what is declared of one parameter.
fn declaration(call: &Call<'_>, name: String, about: LuaTable) -> Result<DeclaredParam, Refusal> {
    let args = Args {
        function: call.args.function,
        values: LuaMultiValue::new(),
        within: format!("{name}: "),
    };
    let keys = match args.function.parameters.first().map(|row| row.kind) {
        Some(Type::Named(keys)) => keys,
        _ => &[],
    };
    let table = args.table(Some(about), keys)?;
    let text = |key: &str| -> Result<Option<String>, Refusal> {
        let text: Option<String> = table.get(key)?;
        Ok(text.map(|text| printable(&text, LONGEST)))
    };
    let declared = DeclaredParam {
        name,
        value: match table.value("default")? {
            LuaValue::Boolean(value) => ParamValue::Boolean(value),
            LuaValue::Integer(value) => ParamValue::Number(value as f64),
            LuaValue::Number(value) => ParamValue::Number(value),
            LuaValue::Nil => return Err(args.misuse("default is missing")),
            other => ParamValue::Text(short_text(&args, "default", &other)?),
        },
        min: table.get("min")?,
        max: table.get("max")?,
        unit: text("unit")?,
        choices: choices(call, &args, &table.value("choices")?)?,
        live: table.get::<Option<bool>>("live")?.unwrap_or_default(),
        doc: text("doc")?.unwrap_or_default(),
    };
    check_declaration(&declared).map_err(|error| args.misuse(&error))?;
    Ok(declared)
}

fn short_text(args: &Args, key: &str, value: &LuaValue) -> Result<String, Refusal> {
    match value {
        LuaValue::String(text) if text.as_bytes().len() <= LONGEST => {
            Ok(printable(&text.to_string_lossy(), LONGEST))
        }
        LuaValue::String(_) => {
            Err(args.misuse(&format!("{key} is too long: at most {LONGEST} bytes")))
        }
        other => {
            let got = describe(other);
            Err(args.misuse(&format!("{key} must be a text, got {got}")))
        }
    }
}

fn choices(call: &Call<'_>, args: &Args, value: &LuaValue) -> Result<Vec<String>, Refusal> {
    let list = match value {
        LuaValue::Nil => return Ok(Vec::new()),
        LuaValue::Table(list) => pairs(call, list, "choices")?,
        other => {
            let got = describe(other);
            return Err(args.misuse(&format!("choices must be a list of texts, got {got}")));
        }
    };
    if list.is_empty() {
        return Err(args.misuse("choices must have at least one text"));
    }
    let texts = list
        .iter()
        .map(|(_, value)| short_text(args, "a choice", value));
    texts.collect()
}
