//! `log.*` and `print`.

use mlua::prelude::LuaValue;

use super::super::output::{Level, LogLine};
use super::{Call, NativeResult, Natives, convert, location};

pub(super) const CALLS: &Natives = &[
    ("log.debug", |call| write(call, Level::Debug)),
    ("log.info", |call| write(call, Level::Info)),
    ("log.warn", |call| write(call, Level::Warn)),
    ("log.error", |call| write(call, Level::Error)),
];

pub(super) const PRINT: &Natives = &[("print", |call| write(call, Level::Info))];

/// Number of bytes of a text that are read; the log keeps fewer.
const MAX_READ: usize = 8 * 1024;

/// `log.info(text, fields)`: the shim has already converted the text with `tostring`.
fn write(call: &mut Call<'_>, level: Level) -> NativeResult {
    let LuaValue::String(text) = call.args.value(0) else {
        return Err(call.args.misuse("the text is missing"));
    };
    let bytes = text.as_bytes();
    let start = &bytes[..bytes.len().min(MAX_READ)];
    let mut line = LogLine::new(level, &String::from_utf8_lossy(start));
    drop(bytes);
    line.fields = match call.args.value(1) {
        LuaValue::Nil => Vec::new(),
        LuaValue::Table(table) => convert::fields(table),
        _ => {
            return Err(call
                .args
                .misuse("the fields must be a table, such as {speed = 40}"));
        }
    };
    line.line = location(call.lua).map(|location| location.line);
    let now = call.state.now;
    call.state.output.log(line, now);
    call.reply(())
}
