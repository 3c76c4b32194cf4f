//! `robot.frame`, `robot.wait_frame` and the Frame object.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{Lua, LuaResult, LuaValue};

use super::super::events::EventName;
use super::super::task::Wait;
use super::{Answered, Builder, Call, Entry, events, plain, waiting};
use crate::robot::Frame;

pub(super) const CALLS: [Entry; 2] = [
    plain("robot.frame", newest),
    waiting("robot.wait_frame", wait_frame),
];

/// Older frames are not the newest any more: the stream has stopped.
const STALE: Duration = Duration::from_secs(1);

/// A frame as it came, counted while anyone holds it.
#[derive(Debug)]
pub(in super::super) struct HeldFrame {
    frame: Frame,
    held: Rc<Cell<u64>>,
}

impl HeldFrame {
    /// Adds its bytes to `held` for as long as it lives.
    pub(in super::super) fn new(frame: Frame, held: &Rc<Cell<u64>>) -> HeldFrame {
        held.set(held.get() + frame.jpeg.len() as u64);
        HeldFrame {
            frame,
            held: Rc::clone(held),
        }
    }
}

impl Drop for HeldFrame {
    fn drop(&mut self) {
        let bytes = self.frame.jpeg.len() as u64;
        self.held.set(self.held.get().saturating_sub(bytes));
    }
}

/// What the script holds of a frame.
struct FrameObject(Rc<HeldFrame>);

/// The Frame object of a frame.
pub(in super::super) fn to_lua(lua: &Lua, held: &Rc<HeldFrame>) -> LuaResult<LuaValue> {
    let object = lua.create_any_userdata(FrameObject(Rc::clone(held)))?;
    Ok(LuaValue::UserData(object))
}

pub(super) fn register(builder: &Builder<'_>) -> LuaResult<()> {
    let unknown = builder.strict("Frame")?;
    let shared = Rc::clone(builder.shared);
    builder
        .lua
        .register_userdata_type::<FrameObject>(|registry| {
            use mlua::UserDataFields as _;
            registry.add_meta_field("__type", "Frame");
            registry.add_meta_field("__index", unknown);
            registry.add_field_method_get("seq", |_, frame| Ok(frame.0.frame.seq));
            registry.add_field_method_get("bytes", |_, frame| Ok(frame.0.frame.jpeg.len()));
            registry.add_field_method_get("age", move |_, frame| {
                let now = shared.borrow().now;
                let age = now.saturating_duration_since(frame.0.frame.at);
                Ok(age.as_secs_f64())
            });
        })
}

/// `robot.frame()`: the newest frame, or nil.
fn newest(call: &mut Call<'_>) -> Answered {
    events::listen(call, EventName::Frame);
    let now = call.state.now;
    let fresh = |held: &&Rc<HeldFrame>| now.saturating_duration_since(held.frame.at) <= STALE;
    match call.state.newest.as_ref().filter(fresh) {
        Some(held) => {
            let object = to_lua(call.lua, held)?;
            call.reply(object)
        }
        None => call.reply(LuaValue::Nil),
    }
}

/// `robot.wait_frame(timeout)`: the next frame, or `nil, "timeout"`.
fn wait_frame(call: &mut Call<'_>) -> Answered {
    let time = call.args.optional_seconds(0, "timeout")?;
    call.may_wait()?;
    events::listen(call, EventName::Frame);
    call.wait(Wait::Event(EventName::Frame), time)
}
