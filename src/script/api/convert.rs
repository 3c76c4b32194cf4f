//! Converts a script's values to short texts, for the fields of log lines. Depth, number of values
//! and length of the texts are bounded, even for a table that contains itself.

use mlua::prelude::{LuaError, LuaTable, LuaValue};

use super::super::arguments::describe;
use super::super::failure::printable;

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
