//! `script.*`, `log.*`, `print`, `clock.*`, and what a script keeps between runs and sends to people:
//! `store.*`, `journal.*` and `notify.*`.

use std::cell::RefCell;
use std::path::Path;

use jiff::Timestamp;
use mlua::prelude::{LuaResult, LuaTable, LuaValue};

use super::super::arguments::Refusal;
use super::super::failure::printable;
use super::super::output::{FromHost, Level, LogLine, MAX_ENTRY, MAX_KIND};
use super::super::store::QUOTA;
use super::super::{budget, picture_store, plain};
use super::{Builder, Call, NativeResult, Natives, convert, location, of_row};
use crate::clock::{Clock, Zone};
use crate::robot::HostReport;

pub(super) const NATIVES: &Natives = &[
    ("script.stop", stop),
    ("script.on_stop", on_stop),
    ("script.usage", usage),
    ("log.debug", |call| write(call, Level::Debug)),
    ("log.info", |call| write(call, Level::Info)),
    ("log.warn", |call| write(call, Level::Warn)),
    ("log.error", |call| write(call, Level::Error)),
    ("print", |call| write(call, Level::Info)),
    ("clock.now", now),
    ("clock.date", date),
    ("store.get", store_get),
    ("store.set", store_set),
    ("store.delete", store_delete),
    ("store.keys", store_keys),
    ("journal.add", journal_add),
    ("notify.send", notify_send),
];

const MAX_STOP_HANDLERS: usize = 16;

/// Number of bytes of a text that are read; the log keeps fewer.
const MAX_READ: usize = 8 * 1024;

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<LuaTable> {
    let table = builder.namespace("script")?;
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
    call.state.stop_requested = Some(reason);
    budget::latch_stopped();
    call.reply(())
}

fn on_stop(call: &mut Call<'_>) -> NativeResult {
    call.must_be_running()?;
    let function = call.args.get(0)?;
    if call.state.stop_handlers.len() >= MAX_STOP_HANDLERS {
        return Err(call.misuse("at most 16 functions can be called at the end"));
    }
    call.state.stop_handlers.push_back(function);
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

/// The shim has already converted the text with `tostring`.
fn write(call: &mut Call<'_>, level: Level) -> NativeResult {
    let LuaValue::String(text) = call.args.value(0) else {
        return Err(call.misuse("the text is missing"));
    };
    let bytes = text.as_bytes();
    let start = &bytes[..bytes.len().min(MAX_READ)];
    let mut line = LogLine::new(level, &String::from_utf8_lossy(start));
    drop(bytes);
    line.fields = match call.args.value(1) {
        LuaValue::Nil => Vec::new(),
        LuaValue::Table(table) => convert::fields(table),
        _ => {
            return Err(call.misuse("the fields must be a table, such as {speed = 40}"));
        }
    };
    line.line = location(call.lua).map(|location| location.line);
    let now = call.state.now;
    call.state.output.log(line, now);
    call.reply(())
}

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
    let weekday = time.strftime("%A").to_string().to_lowercase();
    table.raw_set("weekday", weekday)?;
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

fn key(call: &Call<'_>) -> Result<String, Refusal> {
    let key = call.args.get::<String>(0)?;
    if key.is_empty() || key.contains('\u{fffd}') {
        return Err(call.misuse("key must be a string in UTF-8, not empty"));
    }
    Ok(key)
}

fn store_get(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let kept = call.state.store.get(&key);
    let kept = kept.and_then(|json| serde_json::from_str(json).ok());
    let value = match kept {
        Some(value) => plain::to_lua(call.lua, &value)?,
        None => LuaValue::Nil,
    };
    match value {
        LuaValue::Nil => call.reply(call.args.value(1).clone()),
        value => call.reply(value),
    }
}

fn store_set(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let value = call.args.value(1);
    if value.is_nil() {
        return Err(call.misuse("value is missing; to remove a key, call store.delete(key)"));
    }
    let json = plain::to_json(value, QUOTA).map_err(|why| call.misuse(&why))?;
    let set = call.state.store.set(key, json);
    set.map_err(|full| call.misuse(&full))?;
    call.reply(())
}

fn store_delete(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let was_there = call.state.store.delete(&key);
    call.reply(was_there)
}

fn store_keys(call: &mut Call<'_>) -> NativeResult {
    let keys = call.lua.create_sequence_from(call.state.store.keys())?;
    call.reply(keys)
}

fn journal_add(call: &mut Call<'_>) -> NativeResult {
    let kind = call.args.get::<String>(0)?;
    let plain_word = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    if kind.is_empty() || kind.len() > MAX_KIND || !kind.chars().all(plain_word) {
        let words = "kind must be one word of letters, digits, '-' and '_', such as \"moved\"";
        return Err(call.misuse(words));
    }
    let json = match call.args.value(1) {
        LuaValue::Nil => "{}".to_owned(),
        LuaValue::Table(table) if table.raw_len() > 0 => {
            let words = "the fields must have names, such as { energy = 3 }";
            return Err(call.misuse(words));
        }
        fields => plain::to_json(fields, MAX_ENTRY)
            .map_err(|why| call.misuse(&format!("fields: {why}")))?,
    };
    let now = call.state.now;
    let kept = call
        .state
        .daily_limits
        .take_entry(kind.len() + json.len(), now);
    if kept {
        let report = HostReport::Entry { kind, json };
        call.state.output.push(FromHost::HostReport(report));
    }
    call.reply(kept)
}

fn notify_send(call: &mut Call<'_>) -> NativeResult {
    let text = call.args.get::<String>(0)?;
    if text.trim().is_empty() {
        return Err(call.misuse("the text is empty"));
    }
    let picture: Option<String> = call.args.options(1)?.get("picture")?;
    let picture = match picture {
        Some(path) => Some(own_picture(call, &path)?),
        None => None,
    };
    let now = call.state.now;
    let sent = call.state.daily_limits.take_notice(now);
    if sent {
        let report = HostReport::Notify { text, picture };
        call.state.output.push(FromHost::HostReport(report));
    }
    call.reply(sent)
}

fn own_picture(call: &Call<'_>, path: &str) -> Result<String, Refusal> {
    let path = Path::new(path);
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty());
    let own = folder.is_none() || folder == call.state.options.data_dir.as_deref();
    let name = path.file_name().and_then(|name| name.to_str());
    match name.and_then(picture_store::file_name) {
        Some(name) if own => Ok(name),
        _ => Err(call.misuse(
            "picture must be a path that frame:save returned: a picture that this script has saved",
        )),
    }
}
