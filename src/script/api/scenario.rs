//! `scenario`, `expect` and `sim`, which scenarios have in place of `robot`.

use mlua::prelude::{Lua, LuaError, LuaFunction, LuaResult, LuaTable, LuaValue};
use serde_json::Value as Json;

use super::super::arguments::{Args, Refusal};
use super::super::options::{ScenarioCall, ScenarioCallError};
use super::super::{plain as data, sandbox};
use super::tasks::wait_function;
use super::{Builder, Call, NativeResult, location, of_row};
use crate::api::{self, Function, Literal, Type};

/// Largest size of one argument of a call, in bytes of JSON.
const LONGEST: usize = 64 * 1024;

pub(super) fn install(builder: &Builder<'_>) -> LuaResult<()> {
    let lua = builder.lua;
    let row = api::function("scenario").ok_or_else(|| LuaError::runtime("no scenarios"))?;
    let ask = builder.function_with_shim("plain", row, ask)?;
    let wait = wait_function(builder)?;
    let fail = builder.prelude.raw_get::<LuaFunction>("fail")?;
    let rows = api::object("Sim").map_or(&[][..], |sim| sim.methods);
    let methods = lua.create_table()?;
    for row in rows {
        methods.raw_set(row.key(), row.waits)?;
    }
    let source = include_str!("../stdlib/scenario.luau");
    let make = sandbox::compile(lua, source, "@spykee/scenario")?;
    let made: LuaTable = make.call((ask, wait, fail, methods))?;
    for name in ["scenario", "expect"] {
        let function: LuaFunction = made.raw_get(name)?;
        lua.globals().raw_set(name, function)?;
    }
    builder.close("sim", made.raw_get("sim")?)
}

/// Checks a call; returns its name, its row if it has one, and its arguments.
fn checked(call: &Call<'_>) -> Result<(String, Option<&'static Function>, Args), Refusal> {
    let mut values = call.args.values.clone();
    let name = values.pop_front();
    let name = name.and_then(|name| name.as_string().map(|name| name.to_string_lossy()));
    let name = name.unwrap_or_default();
    let row = api::function(&name);
    if row.is_some_and(Function::is_method) {
        // A placeholder for the object `sim`.
        values.push_front(LuaValue::Nil);
    }
    let args = Args::new(row.unwrap_or(call.args.function), values);
    if let Some(row) = row {
        (0..row.parameters.len()).try_for_each(|index| args.given(index).check())?;
    }
    Ok((name, row, args))
}

/// `ask(call, ...)`: returns the answer of the scenario API.
fn ask(call: &mut Call<'_>) -> NativeResult {
    let (name, row, args) = checked(call)?;
    let wrong = |why: ScenarioCallError| Refusal::Misuse(format!("{name}: {why}"));
    let skipped = usize::from(row.is_some_and(Function::is_method));
    let mut arguments = Vec::new();
    for (index, value) in args.values.iter().skip(skipped).enumerate() {
        let mut value = as_json(value).map_err(wrong)?;
        if row.is_some_and(|row| takes_options(row, index)) {
            value = completed(&args, index, value)?;
        }
        arguments.push(value);
    }
    let Some(scenario_api) = call.state.scenario_api.clone() else {
        return Err(wrong("there is no scenario API".into()));
    };
    let answer = scenario_api.answer(ScenarioCall {
        name: &name,
        arguments: &arguments,
        location: location(call.lua).as_ref(),
    });
    let answer = to_lua(call.lua, row, &answer.map_err(wrong)?)?;
    call.reply(answer)
}

fn as_json(value: &LuaValue) -> Result<Json, ScenarioCallError> {
    // Functions cannot be sent to the scenario API.
    if value.is_nil() || value.is_function() {
        return Ok(Json::Null);
    }
    let text = data::to_json(value, LONGEST)?;
    Ok(serde_json::from_str(&text)?)
}

fn takes_options(row: &Function, index: usize) -> bool {
    let parameter = row.parameters.get(index);
    parameter.is_some_and(|parameter| matches!(parameter.kind, Type::Options(_)))
}

/// Adds the defaults of the options that are left out.
fn completed(args: &Args, index: usize, given: Json) -> Result<Json, Refusal> {
    let mut map = match given {
        Json::Object(map) => map,
        _ => serde_json::Map::new(),
    };
    for (key, literal) in args.options(index)?.defaults()? {
        let value = match literal {
            Literal::Boolean(on) => on.into(),
            Literal::Number(number) => number.into(),
            Literal::Range(low, high) => vec![low, high].into(),
        };
        map.insert(key.to_owned(), value);
    }
    Ok(Json::Object(map))
}

fn to_lua(lua: &Lua, row: Option<&'static Function>, answer: &Json) -> LuaResult<LuaValue> {
    let value = data::to_lua(lua, answer)?;
    let returns = row.and_then(|row| row.returns.first());
    match (returns.map(|one| one.kind), value) {
        (Some(Type::Object(object)), LuaValue::Table(table)) => {
            Ok(LuaValue::Table(of_row(object, table)))
        }
        (_, value) => Ok(value),
    }
}
