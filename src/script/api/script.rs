//! `script.*`, `log.*`, `print` and `clock.*`.

use std::cell::RefCell;

use jiff::Timestamp;
use jiff::civil::Weekday;
use mlua::prelude::{LuaResult, LuaTable, LuaValue};

use super::super::budget;
use super::super::failure::printable;
use super::super::output::{Level, LogLine};
use super::{Builder, Call, NativeResult, Natives, convert, location, of_row};
use crate::clock::{Clock, Zone};

const CALLS: &Natives = &[
    ("script.stop", stop),
    ("script.on_stop", on_stop),
    ("script.usage", usage),
];

const MAX_STOP_HANDLERS: usize = 16;

/// Number of bytes of a text that are read; the log keeps fewer.
const MAX_READ: usize = 8 * 1024;

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<LuaTable> {
    let table = builder.namespace("script", &[CALLS])?;
    #[cfg(test)]
    if let Some(row) = crate::api::function("script.stop") {
        let fault = builder.function(row, |_| panic!("tested"))?;
        table.raw_set("fault", fault)?;
    }
    table.raw_set("name", builder.shared.borrow().options.name.as_str())?;
    Ok(table)
}

/// `script.stop(reason)`: the calling task does not continue.
fn stop(call: &mut Call<'_>) -> NativeResult {
    let reason: Option<String> = call.args.get(0)?;
    let reason = reason.map(|reason| printable(&reason, 1000));
    call.state.exit.stop_requested = Some(reason);
    budget::latch_stopped();
    call.reply(())
}

fn on_stop(call: &mut Call<'_>) -> NativeResult {
    call.must_be_running()?;
    let function = call.args.get(0)?;
    if call.state.exit.stop_handlers.len() >= MAX_STOP_HANDLERS {
        return Err(call
            .args
            .misuse("at most 16 functions can be called at the end"));
    }
    call.state.exit.stop_handlers.push_back(function);
    call.reply(())
}

fn usage(call: &mut Call<'_>) -> NativeResult {
    let usage = call.state.usage;
    let table = call.lua.create_table_with_capacity(0, 3)?;
    table.raw_set("cpu_ms", usage.cpu.as_secs_f64() * 1e3)?;
    table.raw_set(
        "worst_callback_ms",
        usage.worst_callback.as_secs_f64() * 1e3,
    )?;
    table.raw_set("memory_bytes", call.lua.used_memory())?;
    call.reply(of_row("Usage", table))
}

pub(super) const LOG: &Natives = &[
    ("log.debug", |call| write(call, Level::Debug)),
    ("log.info", |call| write(call, Level::Info)),
    ("log.warn", |call| write(call, Level::Warn)),
    ("log.error", |call| write(call, Level::Error)),
];

pub(super) const PRINT: &Natives = &[("print", |call| write(call, Level::Info))];

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

pub(super) const CLOCK: &Natives = &[("clock.now", now), ("clock.date", date)];

thread_local! {
    /// The last zone, cached because finding it takes longer than using it.
    static ZONE: RefCell<Option<Zone>> = const { RefCell::new(None) };
}

fn now(call: &mut Call<'_>) -> NativeResult {
    let now = instant(call);
    call.reply(now.as_millisecond() as f64 / 1e3)
}

fn date(call: &mut Call<'_>) -> NativeResult {
    let given: Option<f64> = call.args.get(0)?;
    let instant = match given {
        // The bounds of the row keep it within the supported years.
        Some(seconds) => Timestamp::from_millisecond((seconds * 1e3).floor() as i64)
            .unwrap_or(Timestamp::UNIX_EPOCH),
        None => instant(call),
    };
    let zone = zone(&call.state.options.time_zone);
    let time = zone.time(instant);
    let table = call.lua.create_table_with_capacity(0, 10)?;
    table.raw_set("year", time.year())?;
    table.raw_set("month", time.month())?;
    table.raw_set("day", time.day())?;
    table.raw_set("hour", time.hour())?;
    table.raw_set("minute", time.minute())?;
    table.raw_set("second", time.second())?;
    table.raw_set("weekday", weekday(time.weekday()))?;
    table.raw_set("zone", zone.name())?;
    table.raw_set("offset", time.offset().seconds())?;
    table.raw_set("text", time.strftime("%Y-%m-%d %H:%M:%S").to_string())?;
    call.reply(of_row("Date", table))
}

fn instant(call: &Call<'_>) -> Timestamp {
    Clock::ahead(call.state.options.clock).now()
}

fn zone(name: &str) -> Zone {
    ZONE.with_borrow_mut(|last| match last {
        Some(zone) if zone.name() == name => zone.clone(),
        _ => last
            .insert(name.parse().unwrap_or_else(|_| Zone::utc()))
            .clone(),
    })
}

fn weekday(day: Weekday) -> &'static str {
    match day {
        Weekday::Monday => "monday",
        Weekday::Tuesday => "tuesday",
        Weekday::Wednesday => "wednesday",
        Weekday::Thursday => "thursday",
        Weekday::Friday => "friday",
        Weekday::Saturday => "saturday",
        Weekday::Sunday => "sunday",
    }
}
