//! `script.*`: the end and the usage of the script itself.

use mlua::prelude::{LuaResult, LuaTable};

use super::super::budget;
use super::super::failure::printable;
use super::{Builder, Call, NativeResult, Natives, of_row};

const CALLS: &Natives = &[
    ("script.stop", stop),
    ("script.on_stop", on_stop),
    ("script.usage", usage),
];

/// Largest number of functions for `script.on_stop`.
const MAX_STOP_HANDLERS: usize = 16;

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

/// `script.on_stop(fn)`
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

/// `script.usage()`
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
