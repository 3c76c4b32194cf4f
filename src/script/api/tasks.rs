//! `task.*` and the Task object.

use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue};
use tokio::time::Instant;

use super::super::arguments::{Args, Bounds, Refusal};
use super::super::group::{Group, Rule};

use super::super::task::{Answer, GroupId, Handle, Kind, MAX_TASKS, SHORTEST_WAIT, Status, Wait};
use super::frame::add_methods;
use super::{Answered, Builder, Call, Entry, plain, waiting};

const CALLS: [Entry; 7] = [
    WAIT,
    plain("task.spawn", spawn),
    plain("task.delay", delay),
    plain("task.now", now),
    waiting("task.all", |call| group(call, Rule::All)),
    waiting("task.race", |call| group(call, Rule::Race)),
    waiting("task.timeout", timeout),
];

/// What other namespaces build upon.
pub(super) const WAIT: Entry = waiting("task.wait", wait);

const METHODS: [Entry; 2] = [plain("Task:cancel", cancel), waiting("Task:join", join)];

/// The shortest and the longest beat of `task.every`, in seconds.
pub(super) const BEAT: Bounds = Bounds::Between(0.001, 30.0 * 86_400.0);

/// What the script holds of a task.
pub(super) struct TaskObject(Rc<Handle>);

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<(&'static str, LuaTable)> {
    let table = builder.table(&CALLS)?;
    let beat = builder.function(&waiting("task.every", beat))?;
    let beats: LuaFunction = builder.prelude.function("beats")?.call(beat)?;
    builder.lua.set_named_registry_value(BEATS, beats)?;
    table.raw_set("every", builder.function(&plain("task.every", every))?)?;
    Ok(("task", table))
}

/// Where the prelude's loop of `task.every` is kept.
const BEATS: &str = "spykee.beats";

pub(super) fn register_handle(builder: &Builder<'_>) -> LuaResult<()> {
    let methods = builder.methods(&[&METHODS])?;
    let unknown = builder.strict_object("Task")?;
    builder
        .lua
        .register_userdata_type::<TaskObject>(|registry| {
            use mlua::UserDataFields as _;
            registry.add_meta_field("__type", "Task");
            registry.add_meta_field("__index", unknown);
            registry.add_field_method_get("status", |_, task| Ok(task.0.status.get().name()));
            registry.add_field_method_get("missed", |_, task| Ok(task.0.missed.get()));
            add_methods(registry, methods);
        })
}

/// `task.wait(seconds)` returns the seconds that passed.
fn wait(call: &mut Call<'_>) -> Answered {
    let time = match call.args.has(0) {
        true => call.args.seconds(0, "seconds")?,
        false => Duration::ZERO,
    };
    call.may_wait()?;
    let since = call.state.now;
    call.wait(Wait::Time { since }, Some(time))
}

/// `task.now()`: seconds since the script started.
fn now(call: &mut Call<'_>) -> Answered {
    let time = call.state.now.saturating_duration_since(call.state.start);
    call.reply(time.as_secs_f64())
}

/// `task.spawn(fn, ...)`
fn spawn(call: &mut Call<'_>) -> Answered {
    let function = call.args.function(0, "the function")?;
    let values = rest(&call.args, 1);
    begin(call, &function, values, None)
}

/// `task.delay(seconds, fn, ...)`
fn delay(call: &mut Call<'_>) -> Answered {
    let time = call.args.seconds(0, "seconds")?;
    let function = call.args.function(1, "the function")?;
    let values = rest(&call.args, 2);
    let start = call.state.now + time.max(SHORTEST_WAIT);
    begin(call, &function, values, Some(start))
}

/// `task.every(seconds, fn)`
fn every(call: &mut Call<'_>) -> Answered {
    let seconds = call.args.number(0, "seconds", BEAT)?;
    let function = call.args.function(1, "the function")?;
    let beats: LuaFunction = call.lua.named_registry_value(BEATS)?;
    let values = [LuaValue::Number(seconds), LuaValue::Function(function)];
    begin(call, &beats, values.into_iter().collect(), None)
}

/// The wait between two beats. Beats that are over already are counted and left out.
fn beat(call: &mut Call<'_>) -> Answered {
    let period = call.args.seconds(0, "seconds")?.max(SHORTEST_WAIT);
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

/// How many beats from `due` on were over before `now`.
fn missed_beats(due: Instant, period: Duration, now: Instant) -> u64 {
    let late = now.saturating_duration_since(due);
    (late.as_secs_f64() / period.as_secs_f64()).ceil() as u64
}

/// Arguments from `start` on.
pub(super) fn rest(args: &Args, start: usize) -> LuaMultiValue {
    args.values.iter().skip(start).cloned().collect()
}

/// Begins a task of its own and returns its Task.
pub(super) fn begin(
    call: &mut Call<'_>,
    function: &LuaFunction,
    values: LuaMultiValue,
    start: Option<Instant>,
) -> Answered {
    let handle = add(call, function, Kind::Spawned, values, start)?;
    let object = call.lua.create_any_userdata(TaskObject(handle))?;
    call.reply(object)
}

fn add(
    call: &mut Call<'_>,
    function: &LuaFunction,
    kind: Kind,
    values: LuaMultiValue,
    start: Option<Instant>,
) -> Result<Rc<Handle>, Refusal> {
    call.must_be_running()?;
    if call.state.tasks.len() >= MAX_TASKS {
        return Err(call.args.misuse(&format!(
            "{MAX_TASKS} tasks are running already; end some, or wait for them with :join()"
        )));
    }
    let thread = call.lua.create_thread(function.clone())?;
    let now = call.state.now;
    Ok(call
        .state
        .tasks
        .add(thread, kind, Answer::Start(values), start, now))
}

/// `task.all(fn, ...)` and `task.race(fn, ...)`
fn group(call: &mut Call<'_>, rule: Rule) -> Answered {
    let count = call.args.values.len();
    let functions = (0..count)
        .map(|index| {
            call.args
                .function(index, &format!("argument {}", index + 1))
        })
        .collect::<Result<Vec<_>, _>>()?;
    if functions.is_empty() && rule == Rule::Race {
        return Err(call.args.misuse("at least one function is needed"));
    }
    call.may_wait()?;
    if functions.is_empty() {
        return call.reply(());
    }
    let children = functions.into_iter().map(|one| (one, LuaMultiValue::new()));
    run_group(call, rule, children.collect(), None)
}

/// `task.timeout(seconds, fn, ...)` returns `true` and the results, or `false, "timeout"`.
fn timeout(call: &mut Call<'_>) -> Answered {
    let time = call.args.seconds(0, "seconds")?;
    let function = call.args.function(1, "the function")?;
    let values = rest(&call.args, 2);
    call.may_wait()?;
    run_group(call, Rule::Timeout, vec![(function, values)], Some(time))
}

fn run_group(
    call: &mut Call<'_>,
    rule: Rule,
    functions: Vec<(LuaFunction, LuaMultiValue)>,
    time: Option<Duration>,
) -> Answered {
    let Some(parent) = call.state.tasks.current else {
        return Err(call.args.misuse("nothing can wait here"));
    };
    let id = GroupId(call.state.tasks.next_id());
    let mut children = Vec::new();
    for (index, (function, values)) in functions.into_iter().enumerate() {
        match add(call, &function, Kind::Child(id, index), values, None) {
            Ok(handle) => children.push(handle.id),
            Err(refusal) => {
                // Those that were made before must not stay behind.
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

/// The task that a method was called on.
fn subject(call: &Call<'_>) -> Result<Rc<Handle>, Refusal> {
    let object = call.args.value(0).as_userdata();
    let object = object.and_then(|object| object.borrow::<TaskObject>().ok());
    object
        .map(|object| Rc::clone(&object.0))
        .ok_or_else(|| call.no_subject("task"))
}

/// `Task:cancel()`
fn cancel(call: &mut Call<'_>) -> Answered {
    let id = subject(call)?.id;
    call.state.cancel(id);
    call.reply(())
}

/// `Task:join(timeout)` returns `ok, status`, for a failed task also its message.
fn join(call: &mut Call<'_>) -> Answered {
    let handle = subject(call)?;
    let time = call.args.optional_seconds(1, "timeout")?;
    call.may_wait()?;
    match handle.status.get() {
        Status::Running if call.state.tasks.current == Some(handle.id) => {
            Err(call.args.misuse("a task cannot wait for itself"))
        }
        Status::Running => call.wait(Wait::Join(handle.id), time),
        status => call.reply((status == Status::Done, status.name())),
    }
}
