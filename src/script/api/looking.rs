//! The methods that examine one frame: `frame:find_blobs` and similar ones. Each frame is decoded
//! at the first such call, into one buffer for all frames.
//!
//! Most damaged frames are rejected earlier (`State::deliver_frame`). A frame whose damage is found
//! only in decoding has no results: no blobs, no line, no brightness. Such frames are counted, and
//! this is logged now and then.

use mlua::prelude::{Lua, LuaResult, LuaTable, LuaValue};

use super::super::annotated_frame::LabelledBlob;
use super::super::arguments::{Argument, Given, Refusal};
use super::super::frame_state::HeldFrame;
use super::super::state::State;
use super::colours::Colours;
use super::frame::receiver;
use super::{Call, NativeResult, Natives, of_row};
use crate::api::PIXELS;
use crate::vision::{Blob, BlobOptions, Image, Line, Roi, brightness, find_qrcodes, sharpness};

pub(super) const METHODS: &Natives = &[
    ("Frame:find_blobs", blobs),
    ("Frame:find_line", line),
    ("Frame:find_qrcodes", qrcodes),
    ("Frame:brightness", |call| measure(call, brightness)),
    ("Frame:sharpness", |call| measure(call, sharpness)),
    ("Frame:get_pixel", pixel),
];

/// Distance from a line's column to the sides of its box, in pixels.
const LINE_MARGIN: f64 = 4.0;

impl State {
    /// The picture of a frame; `None` for a damaged one, which is counted.
    pub(super) fn image(&mut self, held: &HeldFrame) -> Option<&Image> {
        if let Err(error) = self
            .frames
            .analyser
            .decode(held.frame.seq, &held.frame.jpeg)
        {
            self.note_damage(held.frame.seq, &error);
            return None;
        }
        // The frame is decoded already: this only borrows it again.
        self.frames
            .analyser
            .decode(held.frame.seq, &held.frame.jpeg)
            .ok()
    }

    /// The blobs of a frame; none in a damaged one.
    pub(super) fn find_blobs(
        &mut self,
        held: &HeldFrame,
        colours: &Colours,
        options: &BlobOptions,
    ) -> Vec<Blob> {
        let frame = &held.frame;
        let found =
            self.frames
                .analyser
                .find_blobs(frame.seq, &frame.jpeg, &colours.colours, options);
        match found {
            Ok(blobs) => blobs.to_vec(),
            Err(error) => {
                self.note_damage(held.frame.seq, &error);
                Vec::new()
            }
        }
    }

    /// The line of a frame; none in a damaged one.
    fn find_line(
        &mut self,
        held: &HeldFrame,
        colours: &Colours,
        part: Option<Roi>,
    ) -> Option<Line> {
        let frame = &held.frame;
        let found = self
            .frames
            .analyser
            .find_line(frame.seq, &frame.jpeg, &colours.colours, part);
        found.unwrap_or_else(|error| {
            self.note_damage(frame.seq, &error);
            None
        })
    }
}

/// `frame:find_blobs(colour, {roi=, invert=, ...})`
fn blobs(call: &mut Call<'_>) -> NativeResult {
    let held = receiver(call)?;
    let colours = Colours::parse(call, call.args.value(0))?;
    let options = blob_options(call)?;
    let blobs = call.state.find_blobs(&held, &colours, &options);
    let marks = blobs.iter().map(|blob| mark(blob, colours.name_of(blob)));
    call.state.record_detections(&held, marks);
    let list = call.lua.create_table_with_capacity(blobs.len(), 0)?;
    for blob in &blobs {
        let table = blob_table(call.lua, blob, &colours.names)?;
        list.raw_push(of_row("Blob", table))?;
    }
    call.reply(list)
}

/// The mark of a blob, for people who see the frame.
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
    let ((x, w), (y, h)) = (side(x, w), side(y, h));
    Roi { x, y, w, h }
}

/// Creates the script's table of a blob.
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

/// `frame:find_line(colour, {roi=})`: `{offset, angle, strength}`, or nil.
fn line(call: &mut Call<'_>) -> NativeResult {
    let held = receiver(call)?;
    let colours = Colours::parse(call, call.args.value(0))?;
    let part: Option<Roi> = call.args.options(1)?.get("roi")?;
    let line = call.state.find_line(&held, &colours, part);
    let size = call.state.image(&held).map(Image::size);
    if let Some(whole) = size {
        let part = part.unwrap_or(whole.into()).within(whole);
        call.state
            .record_detections(&held, line.zip(part).map(line_mark));
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
fn line_mark((line, part): (Line, Roi)) -> LabelledBlob {
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

/// `frame:find_qrcodes()`: a list of `{text, corners}`.
fn qrcodes(call: &mut Call<'_>) -> NativeResult {
    let held = receiver(call)?;
    let codes = call
        .state
        .image(&held)
        .map(find_qrcodes)
        .unwrap_or_default();
    let list = call.lua.create_table()?;
    for code in codes {
        let corners = call.lua.create_table()?;
        for [x, y] in code.corners {
            let corner = call.lua.create_table_with_capacity(0, 2)?;
            corner.raw_set("x", x)?;
            corner.raw_set("y", y)?;
            corners.raw_push(of_row("Corner", corner))?;
        }
        let table = call.lua.create_table_with_capacity(0, 2)?;
        table.raw_set("text", code.text)?;
        table.raw_set("corners", corners)?;
        list.raw_push(of_row("QrCode", table))?;
    }
    call.reply(list)
}

/// `frame:brightness(roi)` and `frame:sharpness(roi)`
fn measure(call: &mut Call<'_>, figure: fn(&Image, Option<Roi>) -> f64) -> NativeResult {
    let held = receiver(call)?;
    let part = call.args.get(0)?;
    let figure = call
        .state
        .image(&held)
        .map_or(0.0, |image| figure(image, part));
    call.reply(figure)
}

/// `frame:get_pixel(x, y)`: `r, g, b`, or nil outside the picture.
fn pixel(call: &mut Call<'_>) -> NativeResult {
    let held = receiver(call)?;
    let (x, y): (f64, f64) = (call.args.get(0)?, call.args.get(1)?);
    let x = x.floor();
    let y = y.floor();
    if x < 0.0 || y < 0.0 {
        return call.reply(LuaValue::Nil);
    }
    let image = call.state.image(&held);
    match image.and_then(|image| image.pixel(x as u32, y as u32)) {
        Some([r, g, b]) => call.reply((r, g, b)),
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
