//! `robot.frame`, `robot.wait_frame` and the Frame object. Each frame is decoded at the first call
//! that examines it, into one buffer for all frames; one whose damage is found only then has no
//! results, which is counted and logged now and then.

use std::rc::Rc;
use std::time::Duration;

use mlua::UserDataFields as _;
use mlua::prelude::{Lua, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Argument, Given, Refusal};
use super::super::frame_state::LabelledBlob;
use super::super::output::{FromHost, Level};
use super::super::picture_store::{self, NotSaved};
use super::vision::Colours;
use super::{Builder, Call, NativeResult, Natives, of_row, robot};
use crate::api::{Bounds, EventName};
use crate::robot::{Frame, HostReport};
use crate::vision::{
    Blob, BlobOptions, Camera, Direction, Image, Line, Roi, Size, brightness, find_qrcodes,
    sharpness,
};

pub(super) const NATIVES: &Natives = &[
    ("robot.frame", newest),
    ("robot.wait_frame", wait_frame),
    ("Frame:save", save),
    ("Frame:find_blobs", blobs),
    ("Frame:find_line", line),
    ("Frame:find_qrcodes", qrcodes),
    ("Frame:brightness", |call| measure(call, brightness)),
    ("Frame:sharpness", |call| measure(call, sharpness)),
    ("Frame:get_pixel", pixel),
    // All are nil in a damaged picture.
    // `bearing, elevation`
    ("Frame:direction", |call| {
        convert_point(call, |camera, x, y, size| {
            let seen = camera.direction(x, y, size);
            Some((seen.bearing, seen.elevation))
        })
    }),
    // `ahead, left`, or nil above the horizon
    ("Frame:floor_position", |call| {
        convert_point(call, |camera, x, y, size| {
            let place = camera.floor_position(x, y, size)?;
            Some((place.ahead, place.left))
        })
    }),
    ("Frame:distance_to", distance_to),
    // `x, y`, or nil for a direction that is not in front of the camera
    ("Frame:pixel_at", |call| {
        convert_point(call, |camera, bearing, elevation, size| {
            camera.pixel(Direction { bearing, elevation }, size)
        })
    }),
];

/// `robot.frame` does not return older frames, since the stream has stopped then.
const STALE: Duration = Duration::from_secs(1);

/// Coordinates and sizes of a part of a frame, in pixels.
const PIXELS: Bounds = Bounds::Between(-10_000.0, 10_000.0);

/// Distance from a line's column to the sides of its box, in pixels.
const LINE_MARGIN: f64 = 4.0;

pub(in super::super) fn to_lua(lua: &Lua, frame: &Rc<Frame>) -> LuaResult<LuaValue> {
    let object = lua.create_any_userdata(Rc::clone(frame))?;
    Ok(LuaValue::UserData(object))
}

pub(super) fn of_value(value: &LuaValue) -> Option<Rc<Frame>> {
    let object = value.as_userdata()?.borrow::<Rc<Frame>>().ok()?;
    Some(Rc::clone(&object))
}

pub(super) fn receiver(call: &Call<'_>) -> Result<Rc<Frame>, Refusal> {
    Ok(Rc::clone(&*call.receiver::<Rc<Frame>>()?))
}

impl Argument for Rc<Frame> {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        of_value(&given.value).ok_or_else(|| given.wrong("a Frame"))
    }
}

pub(super) fn register(builder: &Builder<'_>) -> LuaResult<()> {
    let shared = Rc::clone(builder.shared);
    builder.object::<Rc<Frame>>("Frame", |registry| {
        registry.add_field_method_get("seq", |_, frame| Ok(frame.seq));
        registry.add_field_method_get("bytes", |_, frame| Ok(frame.jpeg.len()));
        let of_width = Rc::clone(&shared);
        registry.add_field_method_get("width", move |_, frame| {
            Ok(of_width.borrow().frames.size_of(frame).width)
        });
        let of_height = Rc::clone(&shared);
        registry.add_field_method_get("height", move |_, frame| {
            Ok(of_height.borrow().frames.size_of(frame).height)
        });
        let of_camera = Rc::clone(&shared);
        registry.add_field_method_get("lens_height", move |_, _| {
            Ok(of_camera.borrow().options.camera.height)
        });
        registry.add_field_method_get("age", move |_, frame| {
            let now = shared.borrow().now;
            let age = now.saturating_duration_since(frame.at);
            Ok(age.as_secs_f64())
        });
    })
}

fn newest(call: &mut Call<'_>) -> NativeResult {
    robot::listen(call, EventName::Frame);
    let now = call.state.now;
    let fresh = |frame: &&Rc<Frame>| now.saturating_duration_since(frame.at) <= STALE;
    let frame = call.state.frames.newest.as_ref().filter(fresh);
    let object = frame.map(|frame| to_lua(call.lua, frame)).transpose()?;
    call.reply(object)
}

/// `robot.wait_frame(timeout)`: the next frame, or `nil, "timeout"`. A truncated frame is ignored,
/// here and for `frame` handlers.
fn wait_frame(call: &mut Call<'_>) -> NativeResult {
    let time = call.args.get(0)?;
    robot::wait_for_event(call, EventName::Frame, time)
}

fn save(call: &mut Call<'_>) -> NativeResult {
    let frame = receiver(call)?;
    let name = call.args.get::<String>(0)?;
    let Some(name) = picture_store::file_name(&name) else {
        return Err(call.misuse(picture_store::NAMES));
    };
    let now = call.state.now;
    match call.state.picture_store.save(&name, &frame.jpeg, now) {
        Ok(saved) => {
            if let Some(notice) = saved.notice {
                call.state.log(Level::Info, &notice);
            }
            call.state
                .output
                .push(FromHost::HostReport(HostReport::Picture { name }));
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

fn blobs(call: &mut Call<'_>) -> NativeResult {
    let frame = receiver(call)?;
    let colours = Colours::parse(call, call.args.value(0))?;
    let options = blob_options(call)?;
    let blobs = call.state.find_blobs(&frame, &colours.colours, &options);
    let marks = blobs.iter().map(|blob| mark(blob, colours.name_of(blob)));
    call.state.record_detections(&frame, marks);
    let list = call.lua.create_table_with_capacity(blobs.len(), 0)?;
    for blob in &blobs {
        let table = blob_table(call.lua, blob, &colours.names)?;
        list.raw_push(of_row("Blob", table))?;
    }
    call.reply(list)
}

pub(super) fn mark(blob: &Blob, text: &str) -> LabelledBlob {
    LabelledBlob {
        blob: *blob,
        text: text.to_owned(),
    }
}

fn blob_options(call: &Call<'_>) -> Result<BlobOptions, Refusal> {
    let options = call.args.options(1)?;
    Ok(BlobOptions {
        roi: options.get("roi")?,
        invert: options.get("invert")?,
        area_threshold: options.get("area_threshold")?,
        pixels_threshold: options.get("pixels_threshold")?,
        merge: options.get("merge")?,
        margin: options.get("margin")?,
        max_blobs: options.get::<u32>("max_blobs")? as usize,
    })
}

/// `{x, y, w, h}`, or any table with fields of these names, such as a blob.
impl Argument for Roi {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        let LuaValue::Table(table) = &given.value else {
            return Err(given.wrong("a table {x, y, w, h}"));
        };
        let mut numbers = [0.0; 4];
        for (index, (number, name)) in numbers.iter_mut().zip(["x", "y", "w", "h"]).enumerate() {
            let mut value: LuaValue = table.raw_get(index + 1)?;
            if value.is_nil() {
                value = table.raw_get(name)?;
            }
            let name = format!("roi's {name}");
            *number = given.args.check_number(&name, &value, Some(PIXELS))?;
        }
        Ok(clipped(numbers))
    }
}

/// Cuts off the part of a rectangle that is left of or above the picture.
fn clipped([x, y, w, h]: [f64; 4]) -> Roi {
    let side = |start: f64, length: f64| {
        let end = (start + length).max(0.0);
        let start = start.max(0.0);
        (start.floor() as u32, (end - start).max(0.0).round() as u32)
    };
    let (x, w) = side(x, w);
    let (y, h) = side(y, h);
    Roi { x, y, w, h }
}

pub(super) fn blob_table(lua: &Lua, blob: &Blob, names: &[Option<String>]) -> LuaResult<LuaTable> {
    let table = lua.create_table_with_capacity(0, 24)?;
    let whole = [
        ("x", blob.x),
        ("y", blob.y),
        ("w", blob.w),
        ("h", blob.h),
        ("pixels", blob.pixels),
        ("area", blob.area),
        ("perimeter", blob.perimeter),
        ("code", blob.code),
        ("count", blob.count),
    ];
    let real = [
        ("cx", blob.cx),
        ("cy", blob.cy),
        ("density", blob.density),
        ("rotation", blob.rotation),
        ("elongation", blob.elongation),
        ("roundness", blob.roundness),
        ("bearing", blob.bearing),
    ];
    for (name, number) in whole {
        table.raw_set(name, number)?;
    }
    for (name, number) in real {
        table.raw_set(name, number)?;
    }
    table.raw_set("edge", blob.edge)?;
    if let Some(Some(name)) = names.get(blob.colour) {
        table.raw_set("colour", name.as_str())?;
    }
    Ok(table)
}

fn line(call: &mut Call<'_>) -> NativeResult {
    let frame = receiver(call)?;
    let colours = Colours::parse(call, call.args.value(0))?;
    let part: Option<Roi> = call.args.options(1)?.get("roi")?;
    let line = call.state.find_line(&frame, &colours.colours, part);
    let size = call.state.image(&frame).map(Image::size);
    if let Some(whole) = size {
        let part = part.unwrap_or(whole.into()).within(whole);
        call.state.record_detections(
            &frame,
            line.zip(part).map(|(line, part)| line_mark(line, part)),
        );
    }
    let Some(line) = line else {
        return call.reply(LuaValue::Nil);
    };
    let table = call.lua.create_table_with_capacity(0, 3)?;
    table.raw_set("offset", line.offset)?;
    table.raw_set("angle", line.angle)?;
    table.raw_set("strength", line.strength)?;
    call.reply(of_row("Line", table))
}

/// The mark of a line, for people who see the frame: a narrow box around the column given by
/// `offset`, as high as the examined part.
fn line_mark(line: Line, part: Roi) -> LabelledBlob {
    let column = f64::from(part.x) + (line.offset + 1.0) / 2.0 * f64::from(part.w) - 0.5;
    let blob = Blob {
        x: (column - LINE_MARGIN).max(0.0).round() as u32,
        y: part.y,
        w: 2 * LINE_MARGIN as u32 + 1,
        h: part.h,
        cx: column,
        cy: f64::from(part.y) + f64::from(part.h) / 2.0,
        ..Blob::default()
    };
    mark(&blob, "line")
}

fn qrcodes(call: &mut Call<'_>) -> NativeResult {
    let frame = receiver(call)?;
    let codes = call.state.image(&frame).map(find_qrcodes);
    let size = call.state.frames.size_of(&frame);
    let list = call.lua.create_table()?;
    for code in codes.unwrap_or_default() {
        let corners = call.lua.create_table()?;
        for [x, y] in code.corners {
            let corner = call.lua.create_table_with_capacity(0, 2)?;
            corner.raw_set("x", x)?;
            corner.raw_set("y", y)?;
            corners.raw_push(of_row("Corner", corner))?;
        }
        let table = call.lua.create_table_with_capacity(0, 7)?;
        table.raw_set("text", code.text)?;
        table.raw_set("corners", corners)?;
        let (x, w) = extent(code.corners.map(|[x, _]| x));
        let (y, h) = extent(code.corners.map(|[_, y]| y));
        for (name, number) in [("x", x), ("y", y), ("w", w), ("h", h)] {
            table.raw_set(name, number)?;
        }
        let cx = f64::from(x) + f64::from(w) / 2.0;
        let cy = f64::from(y) + f64::from(h) / 2.0;
        let camera = call.state.options.camera;
        table.raw_set("bearing", camera.bearing(cx, cy, size))?;
        list.raw_push(of_row("QrCode", table))?;
    }
    call.reply(list)
}

/// The first of the corners' columns or rows in the picture, and how many there are to the last one.
fn extent(corners: [i32; 4]) -> (i32, i32) {
    let first = corners.into_iter().min().unwrap_or(0).max(0);
    let last = corners.into_iter().max().unwrap_or(0);
    (first, last - first)
}

/// The distance at which something so wide fills the width of the box; nil if it may go on beyond the
/// picture.
fn distance_to(call: &mut Call<'_>) -> NativeResult {
    let part: Roi = call.args.get(0)?;
    let width: f64 = call.args.get(1)?;
    let frame = receiver(call)?;
    let camera = call.state.options.camera;
    let size = call.state.image(&frame).map(Image::size);
    let Some(size) = size.filter(|size| part.x > 0 && part.x + part.w < size.width) else {
        return call.reply(LuaValue::Nil);
    };
    let row = f64::from(part.y) + f64::from(part.h) / 2.0;
    // Positions count from the centres of pixels.
    let left = camera.bearing(f64::from(part.x) - 0.5, row, size);
    let right = camera.bearing(f64::from(part.x + part.w) - 0.5, row, size);
    let half = (left - right) / 2.0;
    if half > 0.0 {
        call.reply(width / (2.0 * half.tan()))
    } else {
        call.reply(LuaValue::Nil)
    }
}

fn measure(call: &mut Call<'_>, figure: fn(&Image, Option<Roi>) -> f64) -> NativeResult {
    let frame = receiver(call)?;
    let part = call.args.get(0)?;
    let figure = call
        .state
        .image(&frame)
        .map_or(0.0, |image| figure(image, part));
    call.reply(figure)
}

fn pixel(call: &mut Call<'_>) -> NativeResult {
    let frame = receiver(call)?;
    let x = call.args.get::<f64>(0)?.floor();
    let y = call.args.get::<f64>(1)?.floor();
    if x < 0.0 || y < 0.0 {
        return call.reply(LuaValue::Nil);
    }
    let image = call.state.image(&frame);
    match image.and_then(|image| image.pixel(x as u32, y as u32)) {
        Some([r, g, b]) => call.reply((r, g, b)),
        None => call.reply(LuaValue::Nil),
    }
}

/// From two numbers to two others, in a picture of a size; `None` where there are none.
type Conversion = fn(Camera, f64, f64, Size) -> Option<(f64, f64)>;

fn convert_point(call: &mut Call<'_>, convert: Conversion) -> NativeResult {
    let first = call.args.get(0)?;
    let second = call.args.get(1)?;
    let frame = receiver(call)?;
    let size = call.state.image(&frame).map(Image::size);
    let camera = call.state.options.camera;
    match size.and_then(|size| convert(camera, first, second, size)) {
        Some(converted) => call.reply(converted),
        None => call.reply(LuaValue::Nil),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_outside_the_picture_are_cut_off() {
        let roi = |numbers| {
            let Roi { x, y, w, h } = clipped(numbers);
            [x, y, w, h]
        };
        assert_eq!(roi([10.0, 20.0, 30.0, 40.0]), [10, 20, 30, 40]);
        assert_eq!(roi([-10.0, -50.0, 30.0, 40.0]), [0, 0, 20, 0]);
        assert_eq!(roi([5.0, 5.0, -3.0, 0.4]), [5, 5, 0, 0]);
    }
}
