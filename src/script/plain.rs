//! Converts a script's plain data to JSON text and back: booleans, numbers, strings, lists and maps
//! of them. Depth, number of values and length are bounded, even for a table that contains itself.
//! Tables are read raw: no metamethod runs.

use std::collections::BTreeMap;

use mlua::prelude::{Lua, LuaError, LuaResult, LuaTable, LuaValue};

use super::arguments::describe;

const MAX_DEPTH: u32 = 16;
/// Largest number of values within one value.
const MAX_NODES: usize = 20_000;

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum NotPlain {
    #[error("{0} cannot be stored; only true, false, numbers, strings and tables of them can")]
    Kind(String),
    #[error("a number must be finite, got {0}")]
    NotFinite(String),
    #[error("a string must be UTF-8; other bytes cannot be stored")]
    NotUtf8,
    #[error("tables may be nested {MAX_DEPTH} deep; this one is deeper, or contains itself")]
    TooDeep,
    #[error("a value may consist of at most {MAX_NODES} values; this one has more")]
    TooMany,
    #[error("the value is longer than {0} bytes")]
    TooLong(usize),
    #[error("a table must be a list without gaps, or have only strings as keys")]
    Keys,
}

/// Converts a value to JSON of at most `longest` bytes.
pub(super) fn to_json(value: &LuaValue, longest: usize) -> Result<String, NotPlain> {
    let mut writer = Writer {
        out: String::new(),
        nodes: 0,
        longest,
    };
    writer.value(value, 0)?;
    Ok(writer.out)
}

struct Writer {
    out: String,
    nodes: usize,
    longest: usize,
}

impl Writer {
    fn value(&mut self, value: &LuaValue, depth: u32) -> Result<(), NotPlain> {
        self.nodes += 1;
        if self.nodes > MAX_NODES {
            return Err(NotPlain::TooMany);
        }
        match value {
            LuaValue::Boolean(on) => self.push(if *on { "true" } else { "false" }),
            LuaValue::Integer(number) => self.push(&number.to_string()),
            LuaValue::Number(number) => self.number(*number),
            LuaValue::String(text) => {
                let bytes = text.as_bytes();
                // Check before anything is copied.
                self.make_room(bytes.len())?;
                let text = std::str::from_utf8(&bytes).map_err(|_| NotPlain::NotUtf8)?;
                self.text(text)
            }
            LuaValue::Table(_) if depth >= MAX_DEPTH => Err(NotPlain::TooDeep),
            LuaValue::Table(table) => match table.raw_len() {
                0 => self.map(table, depth),
                length => self.list(table, length, depth),
            },
            other => Err(NotPlain::Kind(describe(other))),
        }
    }

    fn number(&mut self, number: f64) -> Result<(), NotPlain> {
        if !number.is_finite() {
            return Err(NotPlain::NotFinite(number.to_string()));
        }
        let text =
            serde_json::to_string(&number).map_err(|_| NotPlain::NotFinite(String::new()))?;
        self.push(&text)
    }

    fn text(&mut self, text: &str) -> Result<(), NotPlain> {
        let quoted = serde_json::to_string(text).map_err(|_| NotPlain::NotUtf8)?;
        self.push(&quoted)
    }

    fn list(&mut self, table: &LuaTable, length: usize, depth: u32) -> Result<(), NotPlain> {
        let mut keys = 0;
        self.visit(table, |_, _| {
            keys += 1;
            Ok(())
        })?;
        if keys != length {
            return Err(NotPlain::Keys);
        }
        for at in 1..=length {
            self.push(if at == 1 { "[" } else { "," })?;
            let value: LuaValue = table.raw_get(at).map_err(|_| NotPlain::Keys)?;
            if value.is_nil() {
                return Err(NotPlain::Keys);
            }
            self.value(&value, depth + 1)?;
        }
        self.push("]")
    }

    fn map(&mut self, table: &LuaTable, depth: u32) -> Result<(), NotPlain> {
        let mut fields = BTreeMap::new();
        let mut length = 0;
        let longest = self.longest;
        self.visit(table, |key, value| {
            let LuaValue::String(key) = key else {
                return Err(NotPlain::Keys);
            };
            let bytes = key.as_bytes();
            length += bytes.len();
            if length > longest {
                return Err(NotPlain::TooLong(longest));
            }
            let key = std::str::from_utf8(&bytes).map_err(|_| NotPlain::NotUtf8)?;
            fields.insert(key.to_owned(), value);
            Ok(())
        })?;
        self.push("{")?;
        for (at, (key, value)) in fields.iter().enumerate() {
            if at > 0 {
                self.push(",")?;
            }
            self.text(key)?;
            self.push(":")?;
            self.value(value, depth + 1)?;
        }
        self.push("}")
    }

    /// Visits all entries of a table; fails if there are too many.
    fn visit(
        &self,
        table: &LuaTable,
        mut visit: impl FnMut(LuaValue, LuaValue) -> Result<(), NotPlain>,
    ) -> Result<(), NotPlain> {
        let mut left = MAX_NODES - self.nodes;
        let mut wrong = None;
        let _ = table.for_each(|key: LuaValue, value: LuaValue| {
            let visited = match left.checked_sub(1) {
                Some(rest) => {
                    left = rest;
                    visit(key, value)
                }
                None => Err(NotPlain::TooMany),
            };
            visited.map_err(|why| {
                wrong = Some(why);
                LuaError::runtime("enough")
            })
        });
        wrong.map_or(Ok(()), Err)
    }

    fn make_room(&self, bytes: usize) -> Result<(), NotPlain> {
        if self.out.len() + bytes > self.longest {
            Err(NotPlain::TooLong(self.longest))
        } else {
            Ok(())
        }
    }

    fn push(&mut self, text: &str) -> Result<(), NotPlain> {
        self.make_room(text.len())?;
        self.out.push_str(text);
        Ok(())
    }
}

/// Converts JSON to a value of the VM; `null` becomes nil.
pub(super) fn to_lua(lua: &Lua, value: &serde_json::Value) -> LuaResult<LuaValue> {
    use serde_json::Value;
    Ok(match value {
        Value::Null => LuaValue::Nil,
        Value::Bool(on) => LuaValue::Boolean(*on),
        Value::Number(number) => LuaValue::Number(number.as_f64().unwrap_or(0.0)),
        Value::String(text) => LuaValue::String(lua.create_string(text)?),
        Value::Array(list) => {
            let table = lua.create_table_with_capacity(list.len(), 0)?;
            for (at, value) in list.iter().enumerate() {
                table.raw_set(at + 1, to_lua(lua, value)?)?;
            }
            LuaValue::Table(table)
        }
        Value::Object(map) => {
            let table = lua.create_table_with_capacity(0, map.len())?;
            for (key, value) in map {
                table.raw_set(key.as_str(), to_lua(lua, value)?)?;
            }
            LuaValue::Table(table)
        }
    })
}
