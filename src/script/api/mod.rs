//! The native functions behind the API table ([`crate::api`]): one file for each Lua namespace. A
//! native gets a [`Call`] and returns a [`Reply`] or a [`Refusal`]; it never raises a Lua error. A
//! wait is registered with the scheduler and answered later ([`answer`]).

mod builder;
mod convert;
mod frame;
mod modules;
mod motion;
mod params;
mod robot;
mod scenario;
mod script;
mod tasks;
mod vision;

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{
    IntoLuaMulti, Lua, LuaFunction, LuaMultiValue, LuaResult, LuaUserDataRef, LuaUserDataRefMut,
    LuaValue,
};

use super::arguments::{Args, Refusal};
use super::budget;
use super::failure::{SourceLocation, is_runtime_frame};
use super::sandbox;
use super::state::State;
use super::streams::Demand;
use super::task::{Cancel, SHORTEST_WAIT, Wait};
use crate::wire::Stream;
use builder::Builder;

pub(super) use builder::{every_path, of_row};
pub(super) use frame::to_lua as frame_to_lua;
pub(super) use modules::compile as compile_module;
pub(super) use params::set_live as set_live_param;
pub(super) use robot::battery_table;

/// The state that native functions and the scheduler share. It is borrowed only while no line of
/// the script runs.
pub(super) type Shared = Rc<RefCell<State>>;

pub(super) struct Call<'a> {
    lua: &'a Lua,
    state: &'a mut State,
    args: Args,
    /// Whether the calling coroutine can yield here.
    yieldable: bool,
}

enum Reply {
    Values(LuaMultiValue),
    /// The scheduler will answer later.
    Wait,
}

type NativeResult = Result<Reply, Refusal>;
type Native = fn(&mut Call<'_>) -> NativeResult;
/// Native functions by the paths of their rows.
type Natives = [(&'static str, Native)];

impl Call<'_> {
    fn misuse(&self, words: &str) -> Refusal {
        self.args.misuse(words)
    }

    fn reply(&self, values: impl IntoLuaMulti) -> NativeResult {
        Ok(Reply::Values(values.into_lua_multi(self.lua)?))
    }

    /// Every waiting call checks this before it does anything else: waiting must be possible here,
    /// and the task must not be cancelled. A cancelled task gets an error; the second time it is
    /// also prevented from continuing.
    fn may_wait(&mut self) -> Result<(), Refusal> {
        if !self.yieldable || !self.state.can_wait {
            return Err(self.misuse(
                "nothing can wait here, inside a table.sort or gsub function or a metamethod",
            ));
        }
        let Some(task) = self.state.tasks.running() else {
            return Err(self.misuse("nothing can wait here"));
        };
        match task.cancel {
            Cancel::No => Ok(()),
            Cancel::Requested => {
                task.cancel = Cancel::Raised;
                Err(Refusal::Cancelled)
            }
            Cancel::Raised => {
                budget::latch_cancelled();
                Err(Refusal::Cancelled)
            }
        }
    }

    /// Waits, at most for `time`. Only after [`Call::may_wait`].
    fn wait(&mut self, wait: Wait, time: Option<Duration>) -> NativeResult {
        if let Some(id) = self.state.tasks.current {
            let deadline = time.map(|time| self.state.now + time.max(SHORTEST_WAIT));
            self.state.tasks.wait(id, wait, deadline);
        }
        Ok(Reply::Wait)
    }

    fn receiver<T: 'static>(&self) -> Result<LuaUserDataRef<T>, Refusal> {
        let object = self.args.receiver().as_userdata();
        let object = object.and_then(|object| object.borrow().ok());
        object.ok_or_else(|| self.no_receiver())
    }

    fn receiver_mut<T: 'static>(&self) -> Result<LuaUserDataRefMut<T>, Refusal> {
        let object = self.args.receiver().as_userdata();
        let object = object.and_then(|object| object.borrow_mut().ok());
        object.ok_or_else(|| self.no_receiver())
    }

    /// The error for a method that was not called on its object.
    fn no_receiver(&self) -> Refusal {
        let function = self.args.function;
        let what = function.owner().to_lowercase();
        let key = function.key();
        let words = format!("call it on a {what} with a colon, like {what}:{key}()");
        self.misuse(&words)
    }

    /// Refuses to start anything new once the script is ending.
    fn must_be_running(&self) -> Result<(), Refusal> {
        if self.state.is_running() {
            return Ok(());
        }
        Err(self.misuse("the script is ending, nothing new can begin"))
    }

    /// Sends an intent, unless the queue is full.
    fn send(&mut self, intent: crate::robot::Intent) -> Result<(), Refusal> {
        self.make_room(0)?;
        self.state.output.send(intent);
        Ok(())
    }

    /// Switches a stream on, if it is off, until the script switches it off.
    fn switch_on(&mut self, stream: Stream) -> Result<(), Refusal> {
        let wanted = self.state.need_stream(stream, Demand::Explicit);
        wanted.map_err(|why| self.misuse(&why))
    }

    fn make_room(&self, speech: usize) -> Result<(), Refusal> {
        if self.state.output.has_room(speech) {
            return Ok(());
        }
        Err(self
            .misuse("too many commands at once; put task.wait(0.1) into the loop that sends them"))
    }
}

const NATIVES: &[&Natives] = &[
    frame::NATIVES,
    modules::NATIVES,
    motion::NATIVES,
    params::NATIVES,
    robot::NATIVES,
    script::NATIVES,
    tasks::NATIVES,
    vision::NATIVES,
];

/// Defines everything that a script can call: a behaviour, or a scenario.
pub(super) fn install(lua: &Lua, shared: &Shared, is_scenario: bool) -> LuaResult<()> {
    let prelude = sandbox::run_prelude(lua, location_function(lua)?)?;
    let builder = Builder::new(lua, shared, &prelude, NATIVES)?;
    tasks::register_handle(&builder)?;
    robot::register_subscription(&builder)?;
    frame::register(&builder)?;
    vision::register(&builder)?;
    let mut tables = vec![
        ("script", script::namespace(&builder)?),
        ("log", builder.namespace("log")?),
        ("clock", builder.namespace("clock")?),
        ("task", tasks::namespace(&builder)?),
    ];
    if !is_scenario {
        tables.push(("robot", robot::namespace(&builder)?));
        tables.push(("params", params::namespace(&builder)?));
        for name in ["vision", "store", "journal", "notify"] {
            tables.push((name, builder.namespace(name)?));
        }
    }
    for (name, table) in tables {
        builder.close(name, table)?;
    }
    if is_scenario {
        scenario::install(&builder)?;
    }
    globals(&builder)?;
    let memory = shared.borrow().options.limits.memory_bytes;
    let memory = usize::try_from(memory).unwrap_or(usize::MAX);
    sandbox::close(lua, builder.strict("")?, memory)
}

fn globals(builder: &Builder<'_>) -> LuaResult<()> {
    let table = builder.namespace("")?;
    modules::wrap(builder, &table)?;
    table.for_each(|name: LuaValue, function: LuaValue| {
        builder.lua.globals().raw_set(name, function)
    })
}

/// The innermost line of the script itself.
fn location(lua: &Lua) -> Option<SourceLocation> {
    let of_script = |level| {
        lua.inspect_stack(level, |frame| {
            let file = frame.source().source?.strip_prefix('=')?.to_owned();
            let line = u32::try_from(frame.current_line()?).ok()?;
            (!is_runtime_frame(&file)).then_some(SourceLocation { file, line })
        })
    };
    (0..64).map_while(of_script).flatten().next()
}

/// Creates the prelude's function `location()`, which returns `file:line: ` or an empty text.
fn location_function(lua: &Lua) -> LuaResult<LuaFunction> {
    lua.create_function(
        |lua, ()| Ok(location(lua).map_or_else(String::new, |at| format!("{at}: "))),
    )
}
