//! `task.*` and the Task object.

use std::rc::Rc;
use std::time::Duration;

use mlua::UserDataFields as _;
use mlua::prelude::{LuaError, LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue};
use tokio::time::Instant;

use super::super::arguments::{Refusal, describe};
use super::super::task::{
    Group, GroupId, Handle, MAX_TASKS, Rule, SHORTEST_WAIT, Status, TaskKind, Wait, Wakeup,
};
use super::{Builder, Call, NativeResult, Natives};
use crate::api;

pub(super) const NATIVES: &Natives = &[
    (WAIT, wait),
    ("task.spawn", spawn),
    ("task.delay", delay),
    (EVERY, every),
    ("task.now", now),
    ("task.all", |call| group(call, Rule::All)),
    ("task.race", |call| group(call, Rule::Race)),
    ("task.timeout", timeout),
    ("Task:cancel", cancel),
    ("Task:join", join),
];

const WAIT: &str = "task.wait";
const EVERY: &str = "task.every";

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<LuaTable> {
    let table = builder.namespace("task")?;
    if let Some(row) = api::function(EVERY) {
        let beat = builder.function_with_shim("waiting", row, beat)?;
        let beats: LuaFunction = builder
            .prelude
            .raw_get::<LuaFunction>("beats")?
            .call(beat)?;
        builder.lua.set_named_registry_value(BEATS, beats)?;
    }
    Ok(table)
}

/// `task.wait`, for functions of other namespaces that use it.
pub(super) fn wait_function(builder: &Builder<'_>) -> LuaResult<LuaFunction> {
    let row = api::function(WAIT).ok_or_else(|| LuaError::runtime(WAIT))?;
    builder.function(row, wait)
}

/// Registry key of the prelude's loop for `task.every`.
const BEATS: &str = "spykee.beats";

pub(super) fn register_handle(builder: &Builder<'_>) -> LuaResult<()> {
    builder.object::<Rc<Handle>>("Task", |registry| {
        registry.add_field_method_get("status", |_, task| Ok(task.status.get().name()));
        registry.add_field_method_get("missed", |_, task| Ok(task.missed.get()));
    })
}

fn wait(call: &mut Call<'_>) -> NativeResult {
    let time = call.args.get(0)?;
    call.may_wait()?;
    let since = call.state.now;
    call.wait(Wait::Time { since }, Some(time))
}

fn now(call: &mut Call<'_>) -> NativeResult {
    let time = call.state.now.saturating_duration_since(call.state.start);
    call.reply(time.as_secs_f64())
}

fn spawn(call: &mut Call<'_>) -> NativeResult {
    let function = call.args.get(0)?;
    let values = call.args.rest();
    begin(call, &function, values, None)
}

fn delay(call: &mut Call<'_>) -> NativeResult {
    let time: Duration = call.args.get(0)?;
    let function = call.args.get(1)?;
    let values = call.args.rest();
    let start = call.state.now + time.max(SHORTEST_WAIT);
    begin(call, &function, values, Some(start))
}

fn every(call: &mut Call<'_>) -> NativeResult {
    let seconds = call.args.get(0)?;
    let function = call.args.get(1)?;
    let beats: LuaFunction = call.lua.named_registry_value(BEATS)?;
    let values = [LuaValue::Number(seconds), LuaValue::Function(function)];
    begin(call, &beats, values.into_iter().collect(), None)
}

/// The wait between two beats. Beats whose time has already passed are counted and skipped.
fn beat(call: &mut Call<'_>) -> NativeResult {
    let period = call.args.get::<Duration>(0)?.max(SHORTEST_WAIT);
    call.may_wait()?;
    let now = call.state.now;
    let Some(task) = call.state.tasks.running() else {
        return call.reply(0);
    };
    let due = task.beat.map_or(now, |last| last) + period;
    let missed = missed_beats(due, period, now);
    let next = due + period * u32::try_from(missed).unwrap_or(u32::MAX);
    task.beat = Some(next);
    task.handle.missed.set(task.handle.missed.get() + missed);
    let time = next.saturating_duration_since(now);
    call.wait(Wait::Beat { missed }, Some(time))
}

/// The number of beats from `due` on whose time passed before `now`.
fn missed_beats(due: Instant, period: Duration, now: Instant) -> u64 {
    let late = now.saturating_duration_since(due);
    (late.as_secs_f64() / period.as_secs_f64()).ceil() as u64
}

pub(super) fn begin(
    call: &mut Call<'_>,
    function: &LuaFunction,
    values: LuaMultiValue,
    start: Option<Instant>,
) -> NativeResult {
    let handle = add(call, function, TaskKind::Spawned, values, start)?;
    let object = call.lua.create_any_userdata(handle)?;
    call.reply(object)
}

fn add(
    call: &mut Call<'_>,
    function: &LuaFunction,
    kind: TaskKind,
    values: LuaMultiValue,
    start: Option<Instant>,
) -> Result<Rc<Handle>, Refusal> {
    call.must_be_running()?;
    if call.state.tasks.len() >= MAX_TASKS {
        return Err(call.misuse(&format!(
            "{MAX_TASKS} tasks are running already; end some, or wait for them with :join()"
        )));
    }
    let thread = call.lua.create_thread(function.clone())?;
    let now = call.state.now;
    Ok(call
        .state
        .tasks
        .add(thread, kind, Wakeup::Start(values), start, now))
}

fn group(call: &mut Call<'_>, rule: Rule) -> NativeResult {
    let count = call.args.values.len();
    let functions = (0..count)
        .map(|index| match call.args.value(index) {
            LuaValue::Function(function) => Ok(function.clone()),
            other => {
                let number = index + 1;
                let got = describe(other);
                let words = format!("argument {number} must be a function, got {got}");
                Err(call.misuse(&words))
            }
        })
        .collect::<Result<Vec<_>, _>>()?;
    if functions.is_empty() && rule == Rule::Race {
        return Err(call.misuse("at least one function is needed"));
    }
    call.may_wait()?;
    if functions.is_empty() {
        return call.reply(());
    }
    let children = functions.into_iter().map(|one| (one, LuaMultiValue::new()));
    run_group(call, rule, children.collect(), None)
}

fn timeout(call: &mut Call<'_>) -> NativeResult {
    let time: Duration = call.args.get(0)?;
    let function = call.args.get(1)?;
    let values = call.args.rest();
    call.may_wait()?;
    run_group(call, Rule::Timeout, vec![(function, values)], Some(time))
}

fn run_group(
    call: &mut Call<'_>,
    rule: Rule,
    functions: Vec<(LuaFunction, LuaMultiValue)>,
    time: Option<Duration>,
) -> NativeResult {
    let Some(parent) = call.state.tasks.current else {
        return Err(call.misuse("nothing can wait here"));
    };
    let id = GroupId(call.state.tasks.next_id());
    let mut children = Vec::new();
    for (index, (function, values)) in functions.into_iter().enumerate() {
        match add(call, &function, TaskKind::Child(id, index), values, None) {
            Ok(handle) => children.push(handle.id),
            Err(refusal) => {
                // Cancel the children that were already created.
                for child in children {
                    call.state.cancel(child);
                }
                return Err(refusal);
            }
        }
    }
    let group = Group::new(parent, rule, children);
    call.state.groups.insert(id, group);
    call.wait(Wait::Group(id), time)
}

fn receiver(call: &Call<'_>) -> Result<Rc<Handle>, Refusal> {
    Ok(Rc::clone(&*call.receiver::<Rc<Handle>>()?))
}

fn cancel(call: &mut Call<'_>) -> NativeResult {
    let id = receiver(call)?.id;
    call.state.cancel(id);
    call.reply(())
}

fn join(call: &mut Call<'_>) -> NativeResult {
    let handle = receiver(call)?;
    let time = call.args.get(0)?;
    call.may_wait()?;
    let _ = call.state.failed_task.take_if(|(id, _)| *id == handle.id);
    match handle.status.get() {
        Status::Running if call.state.tasks.current == Some(handle.id) => {
            Err(call.misuse("a task cannot wait for itself"))
        }
        Status::Running => call.wait(Wait::Join(handle.id), time),
        status => call.reply((status == Status::Done, status.name())),
    }
}
