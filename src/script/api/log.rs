//! `log.*` and `print`.

use mlua::prelude::{LuaFunction, LuaResult, LuaTable, LuaValue};

use super::super::output::{Level, LogLine};
use super::{Answered, Builder, Call, Entry, convert, place, plain};

const CALLS: [Entry; 4] = [
    plain("log.debug", |call| write(call, Level::Debug)),
    plain("log.info", |call| write(call, Level::Info)),
    plain("log.warn", |call| write(call, Level::Warn)),
    plain("log.error", |call| write(call, Level::Error)),
];

/// So many bytes of a text are looked at; the log keeps fewer.
const LOOK_AT: usize = 8 * 1024;

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<(&'static str, LuaTable)> {
    let table = builder.lua.create_table()?;
    for entry in &CALLS {
        let function = of_shim(builder, entry, "logger")?;
        let key = entry.name.trim_start_matches("log.");
        table.raw_set(key, function)?;
    }
    let native = builder.native(&plain("print", |call| write(call, Level::Info)))?;
    let show = builder
        .lua
        .create_function(|_, value: LuaValue| Ok(convert::text(&value)))?;
    let print: LuaFunction = builder.prelude.function("printer")?.call((native, show))?;
    builder.lua.globals().raw_set("print", print)?;
    Ok(("log", table))
}

fn of_shim(builder: &Builder<'_>, entry: &Entry, shim: &str) -> LuaResult<LuaFunction> {
    let native = builder.native(entry)?;
    builder.prelude.function(shim)?.call(native)
}

/// `log.info(text, fields)`: the text has been through `tostring`.
fn write(call: &mut Call<'_>, level: Level) -> Answered {
    let LuaValue::String(text) = call.args.value(0) else {
        return Err(call.args.misuse("the text is missing"));
    };
    let bytes = text.as_bytes();
    let start = &bytes[..bytes.len().min(LOOK_AT)];
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
    line.line = place(call.lua).map(|place| place.line);
    let now = call.state.now;
    call.state.outbox.log(line, now);
    call.reply(())
}
