//! `require`.

use std::rc::Rc;

use mlua::prelude::{Lua, LuaError, LuaFunction, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Refusal, describe_key};
use super::super::failure::{VmError, printable};
use super::super::modules::{Progress, Target, resolve};
use super::super::output::FromHost;
use super::super::sandbox;
use super::super::task::{Cancel, MAX_TASKS, ModuleId, TaskId, Wait, Wakeup};
use super::{Builder, Call, NativeResult, Natives};
use crate::api::{self, EventName, Function, Namespace};

pub(super) const NATIVES: &Natives = &[
    // The first half of `require`; the other half is in the prelude.
    ("require", open),
];

/// Wraps the native function, in the table of globals, in the prelude's half.
pub(super) fn wrap(builder: &Builder<'_>, globals: &LuaTable) -> LuaResult<()> {
    let row = api::function("require").ok_or_else(|| LuaError::runtime("no require"))?;
    let open: LuaFunction = globals.raw_get("require")?;
    let done = builder.function_with_shim("plain", row, done)?;
    type Unknown = (String, LuaValue, LuaTable);
    let nearest = builder
        .lua
        .create_function(|_, (owner, key, table): Unknown| {
            let key = describe_key(&key);
            Ok(sandbox::unknown(&owner, &key, &names(&table)?))
        })?;
    let mismatch = builder
        .lua
        .create_function(|_, (owner, table): (String, LuaTable)| {
            mismatch(&owner, &names(&table)?)
        })?;
    let events = builder.lua.create_table()?;
    for event in EventName::ALL {
        events.raw_set(event.name(), true)?;
    }
    let location = builder
        .lua
        .create_function(|_, function| Ok(location(&function)))?;
    let shared = Rc::clone(builder.shared);
    let tasks = builder
        .lua
        .create_function(move |_, ()| Ok((shared.borrow().tasks.len(), MAX_TASKS)))?;
    let require: LuaFunction = builder
        .prelude
        .raw_get::<LuaFunction>("requirer")?
        .call((open, done, nearest, mismatch, events, location, tasks))?;
    globals.raw_set("require", require)
}

/// The string keys of a table, sorted.
pub(super) fn names(table: &LuaTable) -> LuaResult<Vec<String>> {
    let mut names = Vec::new();
    table.for_each(|key: LuaValue, _: LuaValue| {
        names.extend(key.as_string().map(|name| name.to_string_lossy()));
        Ok(())
    })?;
    names.sort();
    Ok(names)
}

/// The error message if a built-in module, or an object that it creates, has other functions than
/// its row in the API table. Modules and objects without a row are not part of the API.
fn mismatch(owner: &str, names: &[String]) -> LuaResult<Option<String>> {
    let module = api::module(owner).map(Namespace::members);
    let mut objects = api::objects().filter(|object| object.name.eq_ignore_ascii_case(owner));
    let object = || {
        let methods = objects.next()?.methods.iter();
        Some(methods.map(Function::key).collect())
    };
    let Some(mut known) = module.or_else(object) else {
        return Ok(None);
    };
    known.sort_unstable();
    if known == names {
        return Ok(None);
    }
    Ok(Some(format!(
        "{owner} has {names:?}, but the API table {known:?}"
    )))
}

/// The name of a function, if it has one, and the line in which it begins.
fn location(function: &LuaFunction) -> (Option<String>, Option<usize>) {
    let about = function.info();
    let name = about.name.filter(|name| !name.is_empty());
    (name.map(|name| printable(&name, 40)), about.line_defined)
}

fn requiring_module(call: &Call<'_>) -> ModuleId {
    let file = super::location(call.lua).map(|at| at.file);
    call.state.modules.of_chunk(&file.unwrap_or_default())
}

/// The first half of `require(path)`. Returns `"loaded", key`; `"run", key, function`; `"failed",
/// text`; or `"again"` after a wait.
fn open(call: &mut Call<'_>) -> NativeResult {
    let LuaValue::String(path) = call.args.value(0) else {
        let words = "the path must be a string, such as require(\"./lib/pid\")";
        return Err(call.misuse(words));
    };
    let bytes = path.as_bytes();
    let path = match std::str::from_utf8(&bytes[..bytes.len().min(1000)]) {
        Ok(path) => path.to_owned(),
        Err(_) => return Err(call.misuse("the path must be UTF-8")),
    };
    drop(bytes);
    let from = requiring_module(call);
    let target = resolve(call.state.modules.folder(from), &path);
    let target = target.map_err(|why| call.misuse(&printable(&why, 400)))?;
    let Some(task) = call.state.tasks.current else {
        return Err(call.misuse("nothing can be loaded here"));
    };
    let to = match find(call, &target) {
        Some(known) => known,
        None => add(call, target)?,
    };
    record_wait(call, from, to, task)?;
    let answered = next_step(call, to, task);
    let waits = matches!(call.state.modules.progress(to), Progress::Requested)
        || matches!(call.state.modules.progress(to), Progress::Running(..));
    if !waits {
        call.state.modules.remove_wait(from, to, task);
    }
    answered
}

fn find(call: &Call<'_>, target: &Target) -> Option<ModuleId> {
    match target {
        Target::Library(name, _) => call.state.modules.find(name),
        Target::File(name) => call.state.modules.find(name.as_str()),
    }
}

fn record_wait(
    call: &mut Call<'_>,
    from: ModuleId,
    to: ModuleId,
    task: TaskId,
) -> Result<(), Refusal> {
    let tasks = &call.state.tasks;
    let modules = &mut call.state.modules;
    let recorded = modules.record_wait(from, to, task, |id| tasks.get(id).is_some());
    recorded.map_err(|why| call.misuse(&why))
}

fn add(call: &mut Call<'_>, target: Target) -> Result<ModuleId, Refusal> {
    let added = match target {
        Target::Library(name, source) => {
            let env = environment(call.lua)?;
            let function = sandbox::compile_module(call.lua, source, name, env)?;
            call.state.modules.add(name, Progress::Ready(function))
        }
        Target::File(name) => {
            call.may_wait()?;
            let added = call.state.modules.add(name.as_str(), Progress::Requested);
            if added.is_ok() {
                call.state.output.push(FromHost::Module(name));
            }
            added
        }
    };
    added.map_err(|why| call.misuse(&why))
}

/// Tells the prelude what to do next.
fn next_step(call: &mut Call<'_>, id: ModuleId, task: TaskId) -> NativeResult {
    let key = call.state.modules.key(id).to_owned();
    match call.state.modules.progress(id) {
        Progress::Loaded => call.reply(("loaded", key)),
        Progress::Failed(text) => call.reply(("failed", text)),
        Progress::Missing(words) => Err(call.misuse(&words)),
        Progress::Ready(function) => run(call, id, key, task, function),
        Progress::Running(by, _) if by == task => Err(call.misuse(&format!(
            "'{key}' is still being loaded by this very task; its file must not wait in coroutine.yield"
        ))),
        Progress::Running(by, function) if call.state.tasks.get(by).is_none() => {
            // The task that ran it ended before the module had run to its end.
            run(call, id, key, task, function)
        }
        Progress::Requested | Progress::Running(..) => {
            call.may_wait()?;
            call.wait(Wait::Module(id), None)
        }
    }
}

fn run(
    call: &mut Call<'_>,
    id: ModuleId,
    key: String,
    task: TaskId,
    function: LuaFunction,
) -> NativeResult {
    let running = Progress::Running(task, function.clone());
    call.state.modules.set(id, running);
    call.reply(("run", key, function))
}

/// `done(key, failed)`: the file has run, or failed with this text.
fn done(call: &mut Call<'_>) -> NativeResult {
    let LuaValue::String(key) = call.args.value(0) else {
        return call.reply(());
    };
    let key = key.to_string_lossy();
    let failed = match call.args.value(1) {
        LuaValue::String(text) => Some(printable(&text.to_string_lossy(), 1000)),
        _ => None,
    };
    let Some(id) = call.state.modules.find(&key) else {
        return call.reply(());
    };
    let running = call.state.tasks.running();
    let cancelled = running.is_some_and(|task| task.cancel != Cancel::No);
    let progress = match (failed, call.state.modules.progress(id)) {
        (None, _) => Progress::Loaded,
        // The next task that requires it runs it again.
        (Some(_), Progress::Running(_, function)) if cancelled => Progress::Ready(function),
        (Some(text), _) => Progress::Failed(text),
    };
    call.state.modules.set(id, progress);
    if let Some(task) = call.state.tasks.current {
        let from = requiring_module(call);
        call.state.modules.remove_wait(from, id, task);
    }
    call.state.answer(Wait::Module(id), || Wakeup::Again);
    call.reply(())
}

/// Creates a module's own globals, with the shared ones behind them.
fn environment(lua: &Lua) -> LuaResult<LuaTable> {
    let own = lua.create_table()?;
    let meta = lua.create_table()?;
    let builtins: Option<LuaTable> = match lua.globals().metatable() {
        Some(shared) => shared.raw_get("__index")?,
        None => None,
    };
    meta.raw_set("__index", builtins)?;
    meta.raw_set("__metatable", false)?;
    own.raw_set("_G", own.clone())?;
    own.set_metatable(Some(meta))?;
    Ok(own)
}

pub(in crate::script) fn compile(lua: &Lua, source: &[u8], chunk: &str) -> Progress {
    let text = match sandbox::check_source(source, chunk) {
        Ok(text) => text,
        Err(failure) => return Progress::Failed(failure.to_string()),
    };
    let compiled = environment(lua).and_then(|own| sandbox::compile_module(lua, text, chunk, own));
    match compiled {
        Ok(function) => Progress::Ready(function),
        Err(error) => {
            let words = format!("{chunk}: not enough memory for this module");
            Progress::Failed(VmError::from_lua(&error).text_or(&words))
        }
    }
}
