//! `store.*`, `journal.*` and `notify.*`: what a script keeps between runs and sends to people.

use std::path::Path;

use mlua::prelude::LuaValue;

use super::super::arguments::Refusal;
use super::super::output::{MAX_ENTRY, MAX_KIND, Output};
use super::super::store::QUOTA;
use super::super::{picture_store, plain};
use super::{Call, NativeResult, Natives};
use crate::robot::HostReport;

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

fn get(call: &mut Call<'_>) -> NativeResult {
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

fn set(call: &mut Call<'_>) -> NativeResult {
    let key = key(call)?;
    let value = call.args.value(1);
    if value.is_nil() {
        return Err(call
            .args
            .misuse("value is missing; to remove a key, call store.delete(key)"));
    }
    let json = plain::to_json(value, QUOTA).map_err(|why| call.args.misuse(&why.to_string()))?;
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

pub(super) const JOURNAL: &Natives = &[("journal.add", add)];

pub(super) const NOTIFY: &Natives = &[("notify.send", send)];

/// `journal.add(kind, fields)`: returns whether there was room.
fn add(call: &mut Call<'_>) -> NativeResult {
    let kind = call.args.get::<String>(0)?;
    let plain_word = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '-');
    if kind.is_empty() || kind.len() > MAX_KIND || !kind.chars().all(plain_word) {
        let words = "kind must be one word of letters, digits, '-' and '_', such as \"moved\"";
        return Err(call.args.misuse(words));
    }
    let json = match call.args.value(1) {
        LuaValue::Nil => "{}".to_owned(),
        LuaValue::Table(table) if table.raw_len() > 0 => {
            let words = "the fields must have names, such as { energy = 3 }";
            return Err(call.args.misuse(words));
        }
        fields => plain::to_json(fields, MAX_ENTRY)
            .map_err(|why| call.args.misuse(&format!("fields: {why}")))?,
    };
    let now = call.state.now;
    let kept = call
        .state
        .daily_limits
        .take_entry(kind.len() + json.len(), now);
    if kept {
        let report = HostReport::Entry { kind, json };
        call.state.output.push(Output::HostReport(report));
    }
    call.reply(kept)
}

/// `notify.send(text, {picture=})`: returns whether the message is within the daily limit.
fn send(call: &mut Call<'_>) -> NativeResult {
    let text = call.args.get::<String>(0)?;
    if text.trim().is_empty() {
        return Err(call.args.misuse("the text is empty"));
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
        call.state.output.push(Output::HostReport(report));
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
        _ => Err(call.args.misuse(
            "picture must be a path that frame:save returned: a picture that this script has saved",
        )),
    }
}
