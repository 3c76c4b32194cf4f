//! `vision.*`: colours, and objects that examine one frame after the other.

use std::rc::Rc;
use std::time::Duration;

use mlua::UserDataMethods as _;
use mlua::prelude::{Lua, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Refusal, describe};
use super::super::failure::printable;
use super::super::frame_state::LabelledBlob;
use super::frame::{self, blob_table, mark};
use super::{Builder, Call, NativeResult, Natives, of_row};
use crate::robot::Frame;
use crate::vision::{
    Blob, BlobOptions, Colour, ColourError, Image, MAX_COLOURS, MotionDetector, MotionOptions,
    Track, Tracker, TrackerOptions, learn,
};
use crate::yaml::suggestion;

pub(super) const NATIVES: &Natives = &[
    ("vision.lab", lab),
    ("vision.hsv", hsv),
    ("vision.tracker", tracker),
    ("vision.motion", detector),
    ("vision.learn", learn_colour),
    ("Tracker:update", track),
    ("Tracker:best", best),
    ("Tracker:reset", reset),
    ("Detector:update", detect),
];

/// Largest number of trackers and detectors at once: their buffers are outside the VM's memory.
const MAX_WATCHERS: usize = 16;
/// Largest number of frames of one `vision.learn`: each is decoded into its own buffer.
const MAX_LEARN_FRAMES: usize = 16;
/// A frame that arrives within this time after the robot has moved may still show motion: pictures
/// are late, and the robot coasts and rocks.
const SETTLING: Duration = Duration::from_secs(1);

struct TrackerObject {
    tracker: Tracker,
    colours: Colours,
    /// Counts the object until it is dropped.
    _watcher: Rc<()>,
}

struct DetectorObject {
    detector: MotionDetector,
    /// Counts the object until it is dropped.
    _watcher: Rc<()>,
}

pub(super) fn register(builder: &Builder<'_>) -> LuaResult<()> {
    builder.object::<Colour>("Colour", |registry| {
        registry.add_meta_method("__tostring", |_, colour, ()| Ok(colour.to_string()));
    })?;
    builder.object::<TrackerObject>("Tracker", |_| {})?;
    builder.object::<DetectorObject>("Detector", |_| {})
}

/// Counts one more tracker or detector; collects garbage first if there are too many.
fn count(call: &Call<'_>) -> Result<Rc<()>, Refusal> {
    let watchers = &call.state.frames.watchers;
    if Rc::strong_count(watchers) > MAX_WATCHERS {
        call.lua.gc_collect()?;
    }
    if Rc::strong_count(watchers) > MAX_WATCHERS {
        return Err(call.misuse(&format!(
            "there are {MAX_WATCHERS} trackers and detectors already; make them once, outside of loops"
        )));
    }
    Ok(Rc::clone(watchers))
}

fn tracker(call: &mut Call<'_>) -> NativeResult {
    let table = call.args.options(0)?;
    let colours = Colours::parse(call, &table.value("colour")?)?;
    let options = TrackerOptions {
        min_age: table.get("min_age")?,
        max_lost: table.get("max_lost")?,
        max_jump: table.get("max_jump")?,
    };
    let object = TrackerObject {
        tracker: Tracker::new(options, call.state.options.camera),
        colours,
        _watcher: count(call)?,
    };
    let object = call.lua.create_any_userdata(object)?;
    call.reply(object)
}

fn with_tracker<R>(
    call: &mut Call<'_>,
    work: impl FnOnce(&mut Call<'_>, &mut TrackerObject) -> Result<R, Refusal>,
) -> Result<R, Refusal> {
    let mut object = call.receiver_mut::<TrackerObject>()?;
    work(call, &mut object)
}

fn track(call: &mut Call<'_>) -> NativeResult {
    let frame: Rc<Frame> = call.args.get(0)?;
    with_tracker(call, |call, object| {
        let blobs = call
            .state
            .find_blobs(&frame, &object.colours.colours, &BlobOptions::default());
        // A damaged frame is skipped: it does not count as a frame in which the blobs are lost.
        let size = call.state.image(&frame).map(Image::size);
        let at = frame.at.saturating_duration_since(call.state.start);
        let tracks = match size {
            Some(size) => object.tracker.update(at, size, &blobs),
            None => object.tracker.tracks(),
        };
        let marks = tracks
            .iter()
            .map(|track| track_mark(track, &object.colours));
        call.state.record_detections(&frame, marks);
        let list = call.lua.create_table_with_capacity(tracks.len(), 0)?;
        for track in tracks {
            list.raw_push(track_table(call.lua, track, &object.colours)?)?;
        }
        call.reply(list)
    })
}

/// The mark of a track, for people who see the frame: its id, and its assumed place while it is
/// lost.
fn track_mark(track: &Track, colours: &Colours) -> LabelledBlob {
    let name = colours.name_of(&track.blob);
    let id = track.id;
    let lost = if track.lost > 0 { " lost" } else { "" };
    mark(&track.blob, &format!("{name} #{id}{lost}"))
}

fn track_table(lua: &Lua, track: &Track, colours: &Colours) -> LuaResult<LuaTable> {
    let table = blob_table(lua, &track.blob, &colours.names)?;
    table.raw_set("id", track.id)?;
    table.raw_set("age", track.age)?;
    table.raw_set("lost", track.lost)?;
    table.raw_set("vx", track.vx)?;
    table.raw_set("vy", track.vy)?;
    Ok(of_row("Track", table))
}

fn best(call: &mut Call<'_>) -> NativeResult {
    with_tracker(call, |call, object| {
        let track = object.tracker.best();
        let table = track.map(|track| track_table(call.lua, track, &object.colours));
        call.reply(table.transpose()?)
    })
}

fn reset(call: &mut Call<'_>) -> NativeResult {
    with_tracker(call, |call, object| {
        object.tracker.reset();
        call.reply(())
    })
}

fn detector(call: &mut Call<'_>) -> NativeResult {
    let table = call.args.options(0)?;
    let options = MotionOptions {
        // The bounds of the row keep it at most 255.
        threshold: u8::try_from(table.get::<u32>("threshold")?).unwrap_or(u8::MAX),
        min_pixels: table.get("min_pixels")?,
    };
    let object = DetectorObject {
        detector: MotionDetector::new(options, call.state.options.camera),
        _watcher: count(call)?,
    };
    let object = call.lua.create_any_userdata(object)?;
    call.reply(object)
}

/// `Detector:update(frame)`: `{score, pixels, blobs}`, or `nil, "moving"` while anything
/// moves the robot, and for a while after.
fn detect(call: &mut Call<'_>) -> NativeResult {
    let frame: Rc<Frame> = call.args.get(0)?;
    let mut object = call.receiver_mut::<DetectorObject>()?;
    if call.state.has_moved_within(SETTLING) {
        object.detector.reset();
        return call.reply((LuaValue::Nil, "moving"));
    }
    let lua = call.lua;
    let Some(image) = call.state.image(&frame) else {
        let table = motion_table(lua, 0.0, 0, &[])?;
        return call.reply(table);
    };
    let motion = object.detector.update(image);
    let marks = motion.blobs.iter().map(|blob| mark(blob, "motion"));
    call.state.record_detections(&frame, marks);
    let table = motion_table(lua, motion.score, motion.pixels, motion.blobs)?;
    call.reply(table)
}

fn motion_table(lua: &Lua, score: f64, pixels: u32, blobs: &[Blob]) -> LuaResult<LuaTable> {
    let list = lua.create_table_with_capacity(blobs.len(), 0)?;
    for blob in blobs {
        list.raw_push(of_row("Blob", blob_table(lua, blob, &[])?))?;
    }
    let table = lua.create_table_with_capacity(0, 3)?;
    table.raw_set("score", score)?;
    table.raw_set("pixels", pixels)?;
    table.raw_set("blobs", list)?;
    Ok(of_row("Motion", table))
}

fn learn_colour(call: &mut Call<'_>) -> NativeResult {
    let frames = learn_frames(call)?;
    let part = call.args.get(1)?;
    let mut images = Vec::new();
    for frame in &frames {
        images.extend(call.state.image(frame).cloned());
    }
    let images: Vec<&Image> = images.iter().collect();
    match learn(&images, part) {
        Ok(learned) => {
            let colour = call.lua.create_any_userdata(learned.colour)?;
            let info = call.lua.create_table_with_capacity(0, 1)?;
            info.raw_set("quality", learned.quality)?;
            call.reply((colour, of_row("Learned", info)))
        }
        Err(refusal) => call.reply((LuaValue::Nil, refusal.code())),
    }
}

fn learn_frames(call: &Call<'_>) -> Result<Vec<Rc<Frame>>, Refusal> {
    let wrong = || {
        call.misuse(&format!(
            "the first argument must be a list of 1 to {MAX_LEARN_FRAMES} frames"
        ))
    };
    if let Some(frame) = frame::of_value(call.args.value(0)) {
        return Ok(vec![frame]);
    }
    let LuaValue::Table(list) = call.args.value(0) else {
        return Err(wrong());
    };
    let length = list.raw_len();
    if !(1..=MAX_LEARN_FRAMES).contains(&length) {
        return Err(wrong());
    }
    (1..=length)
        .map(|index| frame::of_value(&list.raw_get::<LuaValue>(index)?).ok_or_else(wrong))
        .collect()
}

/// The colours of one search, with the names under which their blobs are reported.
#[derive(Debug, Clone, Default)]
pub(super) struct Colours {
    pub(super) colours: Vec<Colour>,
    pub(super) names: Vec<Option<String>>,
}

impl Colours {
    pub(super) fn parse(call: &Call<'_>, value: &LuaValue) -> Result<Colours, Refusal> {
        let mut colours = Colours::default();
        match value {
            LuaValue::Table(list) => colours.add_list(call, list)?,
            one => colours.add(call, one)?,
        }
        Ok(colours)
    }

    pub(super) fn name_of(&self, blob: &Blob) -> &str {
        let name = self.names.get(blob.colour).and_then(Option::as_deref);
        name.unwrap_or_default()
    }

    fn add_list(&mut self, call: &Call<'_>, list: &LuaTable) -> Result<(), Refusal> {
        let count = list.raw_len();
        if count == 0 || count > MAX_COLOURS {
            return Err(call.misuse(&format!(
                "a list of colours has 1 to {MAX_COLOURS} of them, got {count}"
            )));
        }
        for index in 1..=count {
            self.add(call, &list.raw_get(index)?)?;
        }
        Ok(())
    }

    fn add(&mut self, call: &Call<'_>, value: &LuaValue) -> Result<(), Refusal> {
        let (colour, name) = match value {
            LuaValue::String(text) => {
                let name = text.to_string_lossy();
                (named(call, &name)?, Some(name))
            }
            other => (unnamed(call, other)?, None),
        };
        self.colours.push(colour);
        self.names.push(name);
        Ok(())
    }
}

fn named(call: &Call<'_>, name: &str) -> Result<Colour, Refusal> {
    let own = &call.state.options.colours;
    let found = own.get(name).copied().or_else(|| Colour::named(name));
    found.ok_or_else(|| {
        let known = || own.keys().map(String::as_str).chain(Colour::NAMES);
        let near = suggestion(name, known());
        let name = printable(name, 40);
        let known = known().collect::<Vec<_>>().join(", ");
        call.misuse(&format!("unknown colour '{name}'{near} (known: {known})"))
    })
}

fn unnamed(call: &Call<'_>, value: &LuaValue) -> Result<Colour, Refusal> {
    let object = value.as_userdata();
    let object = object.and_then(|object| object.borrow::<Colour>().ok());
    object.map(|object| *object).ok_or_else(|| {
        call.misuse(&format!(
            "a colour must be a name, vision.lab{{...}} or vision.hsv{{...}}, got {}",
            describe(value)
        ))
    })
}

pub(super) fn lab(call: &mut Call<'_>) -> NativeResult {
    let options = call.args.options(0)?;
    let colour = Colour::lab(options.get("l")?, options.get("a")?, options.get("b")?);
    made(call, colour)
}

pub(super) fn hsv(call: &mut Call<'_>) -> NativeResult {
    let options = call.args.options(0)?;
    let colour = Colour::hsv(options.get("h")?, options.get("s")?, options.get("v")?);
    made(call, colour)
}

fn made(call: &Call<'_>, colour: Result<Colour, ColourError>) -> NativeResult {
    let colour = colour.map_err(|error| call.misuse(&error.to_string()))?;
    let object = call.lua.create_any_userdata(colour)?;
    call.reply(object)
}
