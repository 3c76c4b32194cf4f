//! `journal.add` and `notify.send`.

use std::path::Path;

use mlua::prelude::LuaValue;

use super::super::daily_limits::{MAX_ENTRY, MAX_KIND};
use super::super::picture_store;
use super::super::plain;
use super::{Call, NativeResult, Natives};
use crate::robot::HostReport;

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
        call.state.output.report(HostReport::Entry { kind, json });
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
        call.state
            .output
            .report(HostReport::Notify { text, picture });
    }
    call.reply(sent)
}

/// The name of a picture in the script's data folder.
fn own_picture(call: &Call<'_>, path: &str) -> Result<String, super::Refusal> {
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
