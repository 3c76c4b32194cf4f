//! Converts a script's plain data to JSON text and back: booleans, numbers, strings, lists and maps
//! of them. Depth, number of values and length are bounded, even for a table that contains itself.
//! Tables are read raw: no metamethod runs.

use std::collections::BTreeMap;
use std::io;

use mlua::prelude::{Lua, LuaError, LuaResult, LuaString, LuaTable, LuaValue};
use serde_json::{Map, Number, Value};

use super::arguments::describe;

const MAX_DEPTH: u32 = 16;
/// Largest number of values within one value.
const MAX_NODES: usize = 20_000;

const KEYS: &str = "a table must be a list without gaps, or have only strings as keys";

/// Converts a value to JSON of at most `longest` bytes; the error is for the script's author.
pub(super) fn to_json(value: &LuaValue, longest: usize) -> Result<String, String> {
    let mut reader = Reader {
        nodes: 0,
        bytes: 0,
        longest,
    };
    let value = reader.value(value, 0)?;
    let mut json = BoundedText {
        bytes: Vec::new(),
        longest,
    };
    // Escapes make a text up to six times as long: it ends where it is too long.
    serde_json::to_writer(&mut json, &value).map_err(|_| too_long(longest))?;
    String::from_utf8(json.bytes).map_err(|_| too_long(longest))
}

/// Takes at most this many bytes.
struct BoundedText {
    bytes: Vec<u8>,
    longest: usize,
}

impl io::Write for BoundedText {
    fn write(&mut self, part: &[u8]) -> io::Result<usize> {
        if self.bytes.len() + part.len() > self.longest {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        self.bytes.extend_from_slice(part);
        Ok(part.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

struct Reader {
    nodes: usize,
    /// Of all strings and keys so far.
    bytes: usize,
    longest: usize,
}

impl Reader {
    fn value(&mut self, value: &LuaValue, depth: u32) -> Result<Value, String> {
        self.nodes += 1;
        if self.nodes > MAX_NODES {
            return Err(too_many());
        }
        match value {
            LuaValue::Boolean(on) => Ok(Value::Bool(*on)),
            LuaValue::Integer(number) => Ok(Value::from(*number)),
            LuaValue::Number(number) => match Number::from_f64(*number) {
                Some(number) => Ok(Value::Number(number)),
                None => Err(format!("a number must be finite, got {number}")),
            },
            LuaValue::String(text) => Ok(Value::String(self.text(text)?)),
            LuaValue::Table(_) if depth >= MAX_DEPTH => Err(format!(
                "tables may be nested {MAX_DEPTH} deep; this one is deeper, or contains itself"
            )),
            LuaValue::Table(table) => match table.raw_len() {
                0 => self.map(table, depth),
                length => self.list(table, length, depth),
            },
            other => Err(format!(
                "{} cannot be stored; only true, false, numbers, strings and tables of them can",
                describe(other)
            )),
        }
    }

    fn text(&mut self, text: &LuaString) -> Result<String, String> {
        let bytes = text.as_bytes();
        // Checked before anything is copied.
        self.bytes += bytes.len();
        if self.bytes > self.longest {
            return Err(too_long(self.longest));
        }
        let text = std::str::from_utf8(&bytes);
        let text = text.map_err(|_| "a string must be UTF-8; other bytes cannot be stored")?;
        Ok(text.to_owned())
    }

    fn list(&mut self, table: &LuaTable, length: usize, depth: u32) -> Result<Value, String> {
        // A list that was filled backwards yields its keys in another order than 1 to n.
        let mut items = vec![LuaValue::Nil; length.min(MAX_NODES)];
        for (key, value) in self.entries(table)? {
            let at = key.as_usize().and_then(|at| at.checked_sub(1));
            let item = at.and_then(|at| items.get_mut(at));
            *item.ok_or(KEYS)? = value;
        }
        let mut list = Vec::with_capacity(length);
        for item in &items {
            if item.is_nil() {
                return Err(KEYS.to_owned());
            }
            list.push(self.value(item, depth + 1)?);
        }
        Ok(Value::Array(list))
    }

    fn map(&mut self, table: &LuaTable, depth: u32) -> Result<Value, String> {
        // In the order of the keys, so that equal runs have equal errors.
        let mut fields = BTreeMap::new();
        for (key, value) in self.entries(table)? {
            let LuaValue::String(key) = key else {
                return Err(KEYS.to_owned());
            };
            fields.insert(self.text(&key)?, value);
        }
        let mut map = Map::new();
        for (key, value) in fields {
            map.insert(key, self.value(&value, depth + 1)?);
        }
        Ok(Value::Object(map))
    }

    /// All entries of a table; fails if there are too many.
    fn entries(&self, table: &LuaTable) -> Result<Vec<(LuaValue, LuaValue)>, String> {
        let most = MAX_NODES - self.nodes;
        let mut entries = Vec::new();
        let read = table.for_each(|key: LuaValue, value: LuaValue| {
            if entries.len() == most {
                return Err(LuaError::runtime("enough"));
            }
            entries.push((key, value));
            Ok(())
        });
        match read {
            Ok(()) => Ok(entries),
            Err(_) => Err(too_many()),
        }
    }
}

fn too_long(longest: usize) -> String {
    format!("the value is longer than {longest} bytes")
}

fn too_many() -> String {
    format!("a value may consist of at most {MAX_NODES} values; this one has more")
}

/// Converts JSON to a value of the VM; `null` becomes nil.
pub(super) fn to_lua(lua: &Lua, value: &Value) -> LuaResult<LuaValue> {
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
