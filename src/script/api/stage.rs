//! `scenario`, `expect` and `sim`: what scripts on a stage have in place of `robot`.

use mlua::prelude::{LuaResult, LuaTable, LuaValue};

use super::super::arguments::Refusal;
use super::super::plain as data;
use super::super::stdlib;
use super::tasks::WAIT;
use super::{Answered, Builder, Call, Entry, place, plain};

/// Bytes of all that is said in one call.
const LONGEST: usize = 64 * 1024;

const ASK: Entry = plain("ask", ask);

/// Adds the globals.
pub(super) fn install(builder: &Builder<'_>) -> LuaResult<()> {
    let (ask, wait) = (builder.function(&ASK)?, builder.function(&WAIT)?);
    let fail = builder.prelude.function("fail")?;
    let made: LuaTable = stdlib::scenario(builder.lua, (ask, wait, fail))?;
    for name in ["scenario", "expect"] {
        let function: LuaValue = made.raw_get(name)?;
        builder.lua.globals().raw_set(name, function)?;
    }
    builder.close("sim", made.raw_get("sim")?)
}

/// `ask(call, ...)`
fn ask(call: &mut Call<'_>) -> Answered {
    let name = call.args.text(0, "call", 100)?;
    let wrong = |why: String| Refusal::Misuse(format!("{name}: {why}"));
    let mut arguments = Vec::new();
    for value in call.args.values.iter().skip(1) {
        let value = match value {
            LuaValue::Nil => serde_json::Value::Null,
            value => {
                let text = data::to_json(value, LONGEST).map_err(|why| wrong(why.to_string()))?;
                serde_json::from_str(&text).map_err(|why| wrong(why.to_string()))?
            }
        };
        arguments.push(value);
    }
    let Some(stage) = call.state.stage.clone() else {
        return Err(wrong("there is no stage".to_owned()));
    };
    let answer = stage.ask(&name, &arguments, place(call.lua));
    let answer = data::to_lua(call.lua, &answer.map_err(wrong)?)?;
    call.reply(answer)
}
