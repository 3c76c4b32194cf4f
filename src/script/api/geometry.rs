//! Conversion between points of a picture and directions: `frame:direction` and `frame:pixel_at`.

use mlua::prelude::LuaValue;

use super::frame::receiver;
use super::{Call, NativeResult, Natives};
use crate::vision::{Direction, Size};

pub(super) const METHODS: &Natives =
    &[("Frame:direction", direction), ("Frame:pixel_at", pixel_at)];

/// `frame:direction(x, y)`: `bearing, elevation`, or nil in a damaged picture.
fn direction(call: &mut Call<'_>) -> NativeResult {
    let x = call.args.get(0)?;
    let y = call.args.get(1)?;
    let Some(size) = size(call)? else {
        return call.reply(LuaValue::Nil);
    };
    let seen = call.state.options.camera.direction(x, y, size);
    call.reply((seen.bearing, seen.elevation))
}

/// `frame:pixel_at(bearing, elevation)`: `x, y`, or nil for a direction that is not in front of the
/// camera.
fn pixel_at(call: &mut Call<'_>) -> NativeResult {
    let bearing = call.args.get(0)?;
    let elevation = call.args.get(1)?;
    let Some(size) = size(call)? else {
        return call.reply(LuaValue::Nil);
    };
    let direction = Direction { bearing, elevation };
    match call.state.options.camera.pixel(direction, size) {
        Some((x, y)) => call.reply((x, y)),
        None => call.reply(LuaValue::Nil),
    }
}

fn size(call: &mut Call<'_>) -> Result<Option<Size>, super::Refusal> {
    let held = receiver(call)?;
    Ok(call.state.image(&held).map(|image| image.size()))
}
