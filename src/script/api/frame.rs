//! `robot.frame`, `robot.wait_frame` and the Frame object: its data, and `frame:save`. The methods
//! that examine the picture are in [`looking`](super::looking).

use std::rc::Rc;
use std::time::Duration;

use mlua::UserDataFields as _;
use mlua::prelude::{Lua, LuaResult, LuaValue};

use super::super::arguments::{Argument, Given, Refusal};
use super::super::events::EventName;
use super::super::frame_state::HeldFrame;
use super::super::output::Level;
use super::super::picture_store::{self, NotSaved};
use super::{Builder, Call, NativeResult, Natives, events};
use crate::robot::HostReport;

pub(super) const CALLS: &Natives = &[("robot.frame", newest), ("robot.wait_frame", wait_frame)];

pub(super) const METHODS: &Natives = &[("Frame:save", save)];

/// `robot.frame` does not return older frames, since the stream has stopped then.
const STALE: Duration = Duration::from_secs(1);

/// Creates the Frame object of a frame.
pub(super) fn to_lua(lua: &Lua, held: &Rc<HeldFrame>) -> LuaResult<LuaValue> {
    let object = lua.create_any_userdata(Rc::clone(held))?;
    Ok(LuaValue::UserData(object))
}

/// The frame of a script's Frame object.
pub(super) fn of_value(value: &LuaValue) -> Option<Rc<HeldFrame>> {
    let object = value.as_userdata()?.borrow::<Rc<HeldFrame>>().ok()?;
    Some(Rc::clone(&object))
}

/// The frame that a method was called on.
pub(super) fn receiver(call: &Call<'_>) -> Result<Rc<HeldFrame>, Refusal> {
    Ok(Rc::clone(&*call.receiver::<Rc<HeldFrame>>()?))
}

impl Argument for Rc<HeldFrame> {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        of_value(&given.value).ok_or_else(|| given.wrong("a Frame"))
    }
}

/// Registers the Frame object with these methods.
pub(super) fn register(builder: &Builder<'_>, natives: &[&Natives]) -> LuaResult<()> {
    let shared = Rc::clone(builder.shared);
    builder.object::<Rc<HeldFrame>>("Frame", natives, |registry| {
        registry.add_field_method_get("seq", |_, held| Ok(held.frame.seq));
        registry.add_field_method_get("bytes", |_, held| Ok(held.frame.jpeg.len()));
        registry.add_field_method_get("width", |_, held| Ok(held.size.width));
        registry.add_field_method_get("height", |_, held| Ok(held.size.height));
        registry.add_field_method_get("age", move |_, held| {
            let now = shared.borrow().now;
            let age = now.saturating_duration_since(held.frame.at);
            Ok(age.as_secs_f64())
        });
    })
}

/// `robot.frame()`: the newest frame, or nil.
fn newest(call: &mut Call<'_>) -> NativeResult {
    events::listen(call, EventName::Frame);
    let now = call.state.now;
    let fresh = |held: &&Rc<HeldFrame>| now.saturating_duration_since(held.frame.at) <= STALE;
    match call.state.frames.newest.as_ref().filter(fresh) {
        Some(held) => {
            let object = to_lua(call.lua, held)?;
            call.reply(object)
        }
        None => call.reply(LuaValue::Nil),
    }
}

/// `robot.wait_frame(timeout)`: the next frame, or `nil, "timeout"`. A truncated frame is ignored,
/// here and for `frame` handlers.
fn wait_frame(call: &mut Call<'_>) -> NativeResult {
    let time = call.args.get(0)?;
    events::wait_for_event(call, EventName::Frame, time)
}

/// `frame:save(name)`: the path, or `nil, "quota"` or `nil, "io"`.
fn save(call: &mut Call<'_>) -> NativeResult {
    let held = receiver(call)?;
    let name = call.args.get::<String>(0)?;
    let Some(name) = picture_store::file_name(&name) else {
        return Err(call.args.misuse(picture_store::NAMES));
    };
    let now = call.state.now;
    match call.state.picture_store.save(&name, &held.frame.jpeg, now) {
        Ok(saved) => {
            if let Some(notice) = saved.notice {
                call.state.log(Level::Info, &notice);
            }
            call.state.output.report(HostReport::Picture { name });
            call.reply(saved.path.to_string_lossy().into_owned())
        }
        Err(NotSaved::Quota(words)) => {
            if let Some(words) = words {
                call.state.log(Level::Warn, &words);
            }
            call.reply((LuaValue::Nil, "quota"))
        }
        Err(NotSaved::Io(reason)) => {
            call.state
                .log(Level::Warn, &format!("{name} was not saved: {reason}"));
            call.reply((LuaValue::Nil, "io"))
        }
    }
}
