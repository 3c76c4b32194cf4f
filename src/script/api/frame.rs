//! `robot.frame`, `robot.wait_frame` and the Frame object: its data, and `frame:save`. What is seen
//! in it is asked in [`looking`](super::looking).

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{Lua, LuaFunction, LuaResult, LuaValue};

use super::super::arguments::Refusal;
use super::super::events::EventName;
use super::super::output::Level;
use super::{Answered, Builder, Call, Entry, album, events, looking, plain, waiting};
use crate::robot::Frame;
use crate::vision::Size;

pub(super) const CALLS: [Entry; 2] = [
    plain("robot.frame", newest),
    waiting("robot.wait_frame", wait_frame),
];

const METHODS: [Entry; 1] = [plain("Frame:save", save)];

/// Older frames are not the newest any more: the stream has stopped.
const STALE: Duration = Duration::from_secs(1);

/// A frame as it came, counted while anyone holds it.
pub(in super::super) struct HeldFrame {
    pub(super) frame: Frame,
    size: Size,
    held: Rc<Cell<u64>>,
}

impl HeldFrame {
    /// As it came.
    pub(in super::super) fn frame(&self) -> &Frame {
        &self.frame
    }

    /// `size` is what its markers say. Adds its bytes to `held` for as long as it lives.
    pub(in super::super) fn new(frame: Frame, size: Size, held: &Rc<Cell<u64>>) -> HeldFrame {
        held.set(held.get() + frame.jpeg.len() as u64);
        HeldFrame {
            frame,
            size,
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

/// The frame that is a script's value.
pub(super) fn of_value(value: &LuaValue) -> Option<Rc<HeldFrame>> {
    let object = value.as_userdata()?.borrow::<FrameObject>().ok()?;
    Some(Rc::clone(&object.0))
}

/// The frame that a method was called on.
pub(super) fn subject(call: &Call<'_>) -> Result<Rc<HeldFrame>, Refusal> {
    of_value(call.args.value(0)).ok_or_else(|| call.no_subject("frame"))
}

pub(super) fn register(builder: &Builder<'_>) -> LuaResult<()> {
    let unknown = builder.strict_object("Frame")?;
    let methods = builder.methods(&[&METHODS, &looking::METHODS])?;
    let shared = Rc::clone(builder.shared);
    builder
        .lua
        .register_userdata_type::<FrameObject>(|registry| {
            use mlua::UserDataFields as _;
            registry.add_meta_field("__type", "Frame");
            registry.add_meta_field("__index", unknown);
            registry.add_field_method_get("seq", |_, frame| Ok(frame.0.frame.seq));
            registry.add_field_method_get("bytes", |_, frame| Ok(frame.0.frame.jpeg.len()));
            registry.add_field_method_get("width", |_, frame| Ok(frame.0.size.width));
            registry.add_field_method_get("height", |_, frame| Ok(frame.0.size.height));
            registry.add_field_method_get("age", move |_, frame| {
                let now = shared.borrow().now;
                let age = now.saturating_duration_since(frame.0.frame.at);
                Ok(age.as_secs_f64())
            });
            add_methods(registry, methods);
        })
}

/// Gives a type its methods.
pub(super) fn add_methods<T>(
    registry: &mut mlua::UserDataRegistry<T>,
    methods: Vec<(&'static str, LuaFunction)>,
) {
    use mlua::UserDataFields as _;
    for (name, method) in methods {
        registry.add_field(name, method);
    }
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

/// `robot.wait_frame(timeout)`: the next frame, or `nil, "timeout"`. A frame cut short counts as none,
/// here and for `frame` handlers.
fn wait_frame(call: &mut Call<'_>) -> Answered {
    let time = call.args.optional_seconds(0, "timeout")?;
    events::wait_for_event(call, EventName::Frame, time)
}

/// `frame:save(name)`: the path, or `nil, "quota"` or `nil, "io"`.
fn save(call: &mut Call<'_>) -> Answered {
    let held = subject(call)?;
    let name = call.args.text(1, "name", 100)?;
    let Some(name) = album::file_name(&name) else {
        return Err(call.args.misuse(
            "the name may have letters, digits, '-', '_' and '.', and not begin with '.'",
        ));
    };
    let now = call.state.now;
    match call.state.album.save(&name, &held.frame.jpeg, now) {
        Ok(saved) => {
            if let Some(gone) = saved.gone {
                call.state.log(Level::Info, &gone);
            }
            call.reply(saved.path.to_string_lossy().into_owned())
        }
        Err(album::NotSaved::Quota(words)) => {
            if let Some(words) = words {
                call.state.log(Level::Warn, &words);
            }
            call.reply((LuaValue::Nil, "quota"))
        }
        Err(album::NotSaved::Io(reason)) => {
            call.state
                .log(Level::Warn, &format!("{name} is not saved: {reason}"));
            call.reply((LuaValue::Nil, "io"))
        }
    }
}
