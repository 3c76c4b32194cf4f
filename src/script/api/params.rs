//! `params.*`: parameters that a person may set from outside.

use std::collections::BTreeMap;
use std::rc::Rc;

use mlua::prelude::{Lua, LuaError, LuaFunction, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Refusal, describe, describe_key};
use super::super::budget;
use super::super::declaration::{self, Declaration, ParamValue};
use super::super::failure::{printable, suggestion};
use super::super::state::State;
use super::{Builder, Call, NativeResult, Natives};
use crate::api::Type;

const CALLS: &Natives = &[("params.declare", declare)];

/// Largest number of parameters of one script, and of choices of one parameter.
const MAX_PARAMS: usize = 64;
/// Largest length of a text, in bytes.
const LONGEST: usize = 1000;
const STRICT: &str = "spykee.params";
const VALUES: &str = "spykee.params.values";

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<LuaTable> {
    let shared = Rc::clone(builder.shared);
    let names = move |_: &Lua, _: &str| shared.borrow().params.names.clone().unwrap_or_default();
    let strict = builder.strict_with("params", names)?;
    builder.lua.set_named_registry_value(STRICT, strict)?;
    builder.namespace("params", &[CALLS])
}

/// `params.declare{ speed = {default=40, min=10, max=100, unit="%", doc="..."} }` returns the
/// values.
fn declare(call: &mut Call<'_>) -> NativeResult {
    if call.state.params.names.is_some() {
        let words = "it was called before; declare all parameters in one call";
        return Err(call.args.misuse(words));
    }
    let LuaValue::Table(table) = call.args.value(0).clone() else {
        let words = "it needs a table, such as {speed = {default = 40, min = 10, max = 100}}";
        return Err(call.args.misuse(words));
    };
    let declared = declarations(call, &table)?;
    call.state.params.names = Some(declared.keys().cloned().collect());
    let given = &call.state.options.params;
    match declaration::param_values(&declared, given) {
        Ok(values) => {
            let table = to_lua(call.lua, &values)?;
            call.lua.set_named_registry_value(VALUES, &table)?;
            let all = declared.into_iter().zip(values.into_values());
            call.state.params.all = all
                .map(|((name, declaration), value)| (name, (declaration, value)))
                .collect();
            call.state.show_params();
            call.reply(table)
        }
        Err(error) => {
            // A pcall must not continue with a refused value.
            call.state.params.refused = Some(error.to_string());
            budget::latch_stopped();
            call.reply(())
        }
    }
}

fn set(table: &LuaTable, name: &str, value: &ParamValue) -> LuaResult<()> {
    match value {
        ParamValue::Boolean(value) => table.raw_set(name, *value),
        ParamValue::Number(value) => table.raw_set(name, *value),
        ParamValue::Text(value) => table.raw_set(name, value.as_str()),
    }
}

#[derive(Debug, thiserror::Error)]
pub(in crate::script) enum SetParamError {
    #[error("the script declares no parameter '{0}'")]
    Undeclared(String),
    #[error("{0} cannot be changed while the script runs")]
    Fixed(String),
    #[error("{name} must be {expected}")]
    Refused { name: String, expected: String },
    #[error("{name} could not be changed: {source}")]
    Vm { name: String, source: LuaError },
}

/// Changes a parameter for a person: the script's table has the new value from now on.
pub(in crate::script) fn set_live(
    lua: &Lua,
    state: &mut State,
    name: &str,
    value: ParamValue,
) -> Result<(), SetParamError> {
    let Some((declaration, current)) = state.params.all.get_mut(name) else {
        return Err(SetParamError::Undeclared(printable(name, 60)));
    };
    if !declaration.live {
        return Err(SetParamError::Fixed(name.to_owned()));
    }
    if !declaration.allows(&value) {
        let name = name.to_owned();
        let expected = declaration.expected();
        return Err(SetParamError::Refused { name, expected });
    }
    let changed = lua
        .named_registry_value::<LuaTable>(VALUES)
        .and_then(|table| {
            table.set_readonly(false);
            let changed = set(&table, name, &value);
            table.set_readonly(true);
            changed
        });
    changed.map_err(|source| SetParamError::Vm {
        name: name.to_owned(),
        source,
    })?;
    *current = value;
    state.show_params();
    Ok(())
}

/// Creates the read-only table of values, with an error for unknown names.
fn to_lua(lua: &Lua, values: &BTreeMap<String, ParamValue>) -> LuaResult<LuaTable> {
    let table = lua.create_table()?;
    for (name, value) in values {
        set(&table, name, value)?;
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
) -> Result<BTreeMap<String, Declaration>, Refusal> {
    let mut declared = BTreeMap::new();
    for (key, value) in pairs(call, table, "the table")? {
        let LuaValue::String(key) = &key else {
            let words = format!("names are texts, got {}", describe(&key));
            return Err(call.args.misuse(&words));
        };
        let name = printable(&key.to_string_lossy(), 60);
        if !is_name(&name) {
            let words = format!("'{name}' is not a name; use letters, digits and _");
            return Err(call.args.misuse(&words));
        }
        let LuaValue::Table(about) = value else {
            let words = format!("{name} must be a table, such as {{default = 40}}");
            return Err(call.args.misuse(&words));
        };
        let reader = ParamReader { call, name: &name };
        let declaration = reader.read(&about)?;
        declared.insert(name, declaration);
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
        return Err(call.args.misuse(&words));
    }
    Ok(pairs)
}

fn is_name(text: &str) -> bool {
    let is_start = |c: char| c.is_ascii_alphabetic() || c == '_';
    text.starts_with(is_start) && text.chars().all(|c| is_start(c) || c.is_ascii_digit())
}

struct ParamReader<'a> {
    call: &'a Call<'a>,
    name: &'a str,
}

impl ParamReader<'_> {
    fn wrong(&self, words: &str) -> Refusal {
        self.call.args.misuse(&format!("{}: {words}", self.name))
    }

    fn read(&self, table: &LuaTable) -> Result<Declaration, Refusal> {
        self.check_keys(table)?;
        let default = match table.raw_get("default")? {
            LuaValue::Boolean(value) => ParamValue::Boolean(value),
            LuaValue::String(_) => {
                ParamValue::Text(self.text(table, "default")?.unwrap_or_default())
            }
            LuaValue::Nil => return Err(self.wrong("default is missing")),
            _ => ParamValue::Number(self.number(table, "default")?.unwrap_or_default()),
        };
        let declaration = Declaration {
            min: self.number(table, "min")?,
            max: self.number(table, "max")?,
            unit: self.text(table, "unit")?,
            choices: self.choices(table)?,
            default,
            live: self.boolean(table, "live")?,
            doc: self.text(table, "doc")?.unwrap_or_default(),
        };
        declaration
            .check()
            .map_err(|error| self.wrong(&error.to_string()))?;
        Ok(declaration)
    }

    fn keys(&self) -> Vec<&'static str> {
        let row = self.call.args.function.parameters.first();
        match row.map(|row| row.kind) {
            Some(Type::Named(keys)) => keys.iter().map(|key| key.name).collect(),
            _ => Vec::new(),
        }
    }

    fn check_keys(&self, table: &LuaTable) -> Result<(), Refusal> {
        for (key, _) in pairs(self.call, table, self.name)? {
            let text = describe_key(&key);
            let keys = self.keys();
            if !keys.contains(&text.as_str()) {
                let near = suggestion(&text, keys.iter().copied());
                let known = keys.join(", ");
                return Err(self.wrong(&format!("unknown key '{text}'{near} (known: {known})")));
            }
        }
        Ok(())
    }

    fn number(&self, table: &LuaTable, key: &str) -> Result<Option<f64>, Refusal> {
        let number = match table.raw_get(key)? {
            LuaValue::Nil => return Ok(None),
            LuaValue::Integer(number) => number as f64,
            LuaValue::Number(number) => number,
            other => {
                let words = format!("{key} must be a number, got {}", describe(&other));
                return Err(self.wrong(&words));
            }
        };
        if number.is_finite() {
            return Ok(Some(number));
        }
        Err(self.wrong(&format!("{key} must be a finite number, got {number}")))
    }

    fn boolean(&self, table: &LuaTable, key: &str) -> Result<bool, Refusal> {
        match table.raw_get(key)? {
            LuaValue::Nil => Ok(false),
            LuaValue::Boolean(value) => Ok(value),
            other => {
                let words = format!("{key} must be true or false, got {}", describe(&other));
                Err(self.wrong(&words))
            }
        }
    }

    fn text(&self, table: &LuaTable, key: &str) -> Result<Option<String>, Refusal> {
        match table.raw_get(key)? {
            LuaValue::Nil => Ok(None),
            value => self.as_text(&value, key).map(Some),
        }
    }

    fn as_text(&self, value: &LuaValue, key: &str) -> Result<String, Refusal> {
        let text = match value {
            LuaValue::String(text) if text.as_bytes().len() <= LONGEST => text,
            LuaValue::String(_) => {
                return Err(self.wrong(&format!("{key} is too long: at most {LONGEST} bytes")));
            }
            other => {
                let words = format!("{key} must be a text, got {}", describe(other));
                return Err(self.wrong(&words));
            }
        };
        Ok(printable(&text.to_string_lossy(), LONGEST))
    }

    fn choices(&self, table: &LuaTable) -> Result<Vec<String>, Refusal> {
        let list = match table.raw_get("choices")? {
            LuaValue::Nil => return Ok(Vec::new()),
            LuaValue::Table(list) => list,
            other => {
                let words = format!("choices must be a list of texts, got {}", describe(&other));
                return Err(self.wrong(&words));
            }
        };
        let choices = pairs(self.call, &list, "choices")?;
        if choices.is_empty() {
            return Err(self.wrong("choices must have at least one text"));
        }
        let texts = choices
            .iter()
            .map(|(_, value)| self.as_text(value, "a choice"));
        texts.collect()
    }
}
