//! `store.*`: values that a script keeps between runs.

use mlua::prelude::LuaValue;

use super::super::arguments::Refusal;
use super::super::plain as data;
use super::super::store::QUOTA;
use super::{Call, NativeResult, Natives};

pub(super) const CALLS: &Natives = &[
    ("store.get", get),
    ("store.set", set),
    ("store.delete", delete),
    ("store.keys", keys),
];

fn key(call: &Call<'_>) -> Result<String, Refusal> {
    let key = call.args.get::<String>(0)?;
    if key.is_empty() || key.contains('\u{fffd}') {
        return Err(call.args.misuse("key must be a string in UTF-8, not empty"));
    }
    Ok(key)
}

/// `store.get(key, default)`
fn get(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let kept = call.state.store.get(&key);
    let kept = kept.and_then(|json| serde_json::from_str(json).ok());
    let value = match kept {
        Some(value) => data::to_lua(call.lua, &value)?,
        None => LuaValue::Nil,
    };
    match value {
        LuaValue::Nil => call.reply(call.args.value(1).clone()),
        value => call.reply(value),
    }
}

/// `store.set(key, value)`
fn set(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let value = call.args.value(1);
    if value.is_nil() {
        return Err(call
            .args
            .misuse("value is missing; to remove a key, call store.delete(key)"));
    }
    let json = data::to_json(value, QUOTA).map_err(|why| call.args.misuse(&why.to_string()))?;
    let set = call.state.store.set(key, json);
    set.map_err(|full| call.args.misuse(&full.to_string()))?;
    call.reply(())
}

/// `store.delete(key)` returns whether the key existed.
fn delete(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let was_there = call.state.store.delete(&key);
    call.reply(was_there)
}

/// `store.keys()`, sorted.
fn keys(call: &mut Call<'_>) -> NativeResult {
    let keys = call.lua.create_sequence_from(call.state.store.keys())?;
    call.reply(keys)
}
