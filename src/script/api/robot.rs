//! `robot.*`: lights, sounds, streams and state; the namespace as a whole.

use std::time::Duration;

use mlua::prelude::{IntoLua, LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Bounds, Refusal};
use super::super::events::battery_table;
use super::{Answered, Builder, Call, Entry, dock, events, frame, motion, plain, tasks};
use crate::robot::{Intent, Percent, Use};
use crate::wire::{Led, Sound, Stream};

const CALLS: [Entry; 10] = [
    plain("robot.led", led),
    plain("robot.blink", blink),
    plain("robot.play", play),
    plain("robot.stop_sound", stop_sound),
    plain("robot.volume", volume),
    plain("robot.say", say),
    plain("robot.stream", stream),
    plain("robot.battery", battery),
    plain("robot.docked", |call| call.reply(call.state.known.docked)),
    plain("robot.connected", |call| {
        call.reply(call.state.known.connected)
    }),
];

/// The longest speech of one call, in bytes: what one message of the wire holds.
const MAX_SPEECH: usize = crate::wire::MAX_PAYLOAD_LEN;

/// Times of `robot.blink`, in seconds.
pub(super) const BLINK: Bounds = Bounds::Between(0.02, 3600.0);

/// In percent.
pub(super) const VOLUME: Bounds = Bounds::Between(0.0, 100.0);

/// Where the prelude's loop of `robot.blink` is kept.
const BLINKER: &str = "spykee.blinker";

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<(&'static str, LuaTable)> {
    let table = builder.table(&CALLS)?;
    table.raw_set("info", builder.function(&plain("robot.info", info))?)?;
    let parts: [&[Entry]; 4] = [&motion::CALLS, &dock::CALLS, &events::CALLS, &frame::CALLS];
    for entries in parts {
        builder
            .table(entries)?
            .for_each(|name: LuaValue, function: LuaValue| table.raw_set(name, function))?;
    }
    let wait = builder.function(&tasks::WAIT)?;
    let led: LuaFunction = table.raw_get("led")?;
    let blinker: LuaFunction = builder.prelude.function("blinker")?.call((led, wait))?;
    builder.lua.set_named_registry_value(BLINKER, blinker)?;
    Ok(("robot", table))
}

/// The lights of a name.
fn lights(call: &Call<'_>) -> Result<&'static [Led], Refusal> {
    call.args.choice(
        0,
        "light",
        &[
            ("flash", &[Led::Flash][..]),
            ("left", &[Led::Left][..]),
            ("right", &[Led::Right][..]),
            ("all", Led::ALL),
        ],
    )
}

/// `robot.led(name, on)`
fn led(call: &mut Call<'_>) -> Answered {
    let lights = lights(call)?;
    let on = call.args.boolean(1, "on")?;
    for &led in lights {
        call.send(Intent::Led { led, on })?;
    }
    call.reply(())
}

/// `robot.blink(name, {on=0.2, off=0.2, count=3})` returns a Task.
fn blink(call: &mut Call<'_>) -> Answered {
    lights(call)?;
    let options = call.args.options(1, &["on", "off", "count"])?;
    let on = options.number("on", 0.2, BLINK)?;
    let off = options.number("off", 0.2, BLINK)?;
    let count = options.count("count", 3, 1_000_000)?;
    let name = call.args.value(0).clone();
    let mut values = LuaMultiValue::from_iter([name]);
    for number in [on, off, f64::from(count)] {
        values.push_back(number.into_lua(call.lua)?);
    }
    let blinker: LuaFunction = call.lua.named_registry_value(BLINKER)?;
    tasks::begin(call, &blinker, values, None)
}

/// `robot.play(sound)`
fn play(call: &mut Call<'_>) -> Answered {
    let known: Vec<_> = Sound::ALL.iter().map(|one| (one.name(), *one)).collect();
    let sound = call.args.choice(0, "sound", &known)?;
    call.send(Intent::Play(sound))?;
    call.reply(())
}

/// `robot.stop_sound()`
fn stop_sound(call: &mut Call<'_>) -> Answered {
    call.send(Intent::StopSound)?;
    call.reply(())
}

/// `robot.volume(percent)`
fn volume(call: &mut Call<'_>) -> Answered {
    let percent = call.args.number(0, "percent", VOLUME)?;
    // Inside 0..=100 by the check above.
    if let Some(percent) = Percent::new(percent.round() as u8) {
        call.send(Intent::Volume(percent))?;
    }
    call.reply(())
}

/// `robot.say(samples)`
fn say(call: &mut Call<'_>) -> Answered {
    let LuaValue::Buffer(samples) = call.args.value(0) else {
        return Err(call
            .args
            .misuse("the samples must be a buffer of s16 numbers, see buffer.create"));
    };
    let length = samples.len();
    if length > MAX_SPEECH || length % 2 != 0 {
        return Err(call.args.misuse(&format!(
            "the samples must have an even number of bytes, at most {MAX_SPEECH}, got {length}"
        )));
    }
    let always = call.state.options.streams.audio_out == Use::On;
    if !always && !call.state.streams.is_on(Stream::AudioOut) {
        return Err(call
            .args
            .misuse("switch the stream on first: robot.stream(\"audio_out\", true)"));
    }
    call.make_room(length)?;
    let samples = samples.to_vec();
    call.send(Intent::Say(samples))?;
    call.reply(())
}

/// `robot.stream(name, on)`
fn stream(call: &mut Call<'_>) -> Answered {
    let known: Vec<_> = Stream::ALL.iter().map(|one| (one.name(), *one)).collect();
    let stream = call.args.choice(0, "stream", &known)?;
    let on = call.args.boolean(1, "on")?;
    if on {
        call.make_room(0)?;
        call.switch_on(stream)?;
    } else if call.state.streams.is_on(stream) {
        call.send(Intent::Stream { stream, on })?;
        call.state.streams.switch_off(stream);
    }
    call.reply(())
}

/// `robot.battery()`: nil before the first report.
fn battery(call: &mut Call<'_>) -> Answered {
    let Some((battery, at)) = call.state.known.battery else {
        return call.reply(LuaValue::Nil);
    };
    let age: Duration = call.state.now.saturating_duration_since(at);
    let table = battery_table(call.lua, battery, age)?;
    call.reply(table)
}

/// `robot.info()`: nil before the first connection.
fn info(call: &mut Call<'_>) -> Answered {
    let Some(info) = &call.state.known.info else {
        return call.reply(LuaValue::Nil);
    };
    let table = call.lua.create_table_with_capacity(0, 5)?;
    table.raw_set("uid", info.uid.as_str())?;
    table.raw_set("name", info.name.as_str())?;
    table.raw_set("firmware", info.firmware.as_str())?;
    table.raw_set("address", info.address.as_str())?;
    table.raw_set("simulated", info.simulated)?;
    call.reply(table)
}
