//! `robot.*`: lights, sounds, streams, state and events; the namespace as a whole.

use std::time::Duration;

use mlua::prelude::{IntoLua, Lua, LuaFunction, LuaMultiValue, LuaResult, LuaTable, LuaValue};

use super::super::arguments::{Argument, Given, Refusal};
use super::super::output::Level;
use super::super::state::{MAX_SUBSCRIPTIONS, Subscription};
use super::super::streams::Demand;
use super::super::task::{SubscriptionId, Wait};
use super::{Builder, Call, NativeResult, Natives, of_row, tasks};
use crate::api::EventName;
use crate::robot::{Battery, Intent, Percent, Use};
use crate::wire::{Led, Stream};

pub(super) const NATIVES: &Natives = &[
    ("robot.led", led),
    ("robot.blink", blink),
    ("robot.play", play),
    ("robot.stop_sound", stop_sound),
    ("robot.volume", volume),
    ("robot.say", say),
    ("robot.stream", stream),
    ("robot.battery", battery),
    ("robot.docked", |call| call.reply(call.state.robot.docked)),
    ("robot.connected", |call| {
        call.reply(call.state.robot.connected)
    }),
    ("robot.info", info),
    ("robot.on", on),
    ("robot.once", once),
    ("robot.wait_for", wait_for),
    ("Subscription:off", off),
];

/// The longest speech of one call, in bytes: the largest payload of one message to the robot.
const MAX_SPEECH: usize = crate::wire::MAX_PAYLOAD_LEN;

/// Registry key of the prelude's loop for `robot.blink`.
const BLINKER: &str = "spykee.blinker";

pub(super) fn namespace(builder: &Builder<'_>) -> LuaResult<LuaTable> {
    let table = builder.namespace("robot")?;
    let (led, wait): (LuaFunction, _) = (table.raw_get("led")?, tasks::wait_function(builder)?);
    let blinker: LuaFunction = builder
        .prelude
        .raw_get::<LuaFunction>("blinker")?
        .call((led, wait))?;
    builder.lua.set_named_registry_value(BLINKER, blinker)?;
    Ok(table)
}

impl Argument for &'static [Led] {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        given.named(|name| match name {
            "flash" => Some(&[Led::Flash][..]),
            "left" => Some(&[Led::Left][..]),
            "right" => Some(&[Led::Right][..]),
            "all" => Some(Led::ALL),
            _ => None,
        })
    }
}

fn led(call: &mut Call<'_>) -> NativeResult {
    let (lights, on): (&[Led], _) = (call.args.get(0)?, call.args.get(1)?);
    for &led in lights {
        call.send(Intent::Led { led, on })?;
    }
    call.reply(())
}

fn blink(call: &mut Call<'_>) -> NativeResult {
    let _: &[Led] = call.args.get(0)?;
    let options = call.args.options(1)?;
    let (on, off): (f64, f64) = (options.get("on")?, options.get("off")?);
    let count: u32 = options.get("count")?;
    let name = call.args.value(0).clone();
    let mut values = LuaMultiValue::from_iter([name]);
    for number in [on, off, f64::from(count)] {
        values.push_back(number.into_lua(call.lua)?);
    }
    let blinker: LuaFunction = call.lua.named_registry_value(BLINKER)?;
    tasks::begin(call, &blinker, values, None)
}

fn play(call: &mut Call<'_>) -> NativeResult {
    let sound = call.args.get(0)?;
    call.send(Intent::Play(sound))?;
    call.reply(())
}

fn stop_sound(call: &mut Call<'_>) -> NativeResult {
    call.send(Intent::StopSound)?;
    call.reply(())
}

fn volume(call: &mut Call<'_>) -> NativeResult {
    let percent: f64 = call.args.get(0)?;
    // The bounds of the row keep it within 0..=100.
    if let Some(percent) = Percent::new(percent.round() as u8) {
        call.send(Intent::Volume(percent))?;
    }
    call.reply(())
}

fn say(call: &mut Call<'_>) -> NativeResult {
    let LuaValue::Buffer(samples) = call.args.value(0) else {
        return Err(call.misuse("the samples must be a buffer of s16 numbers, see buffer.create"));
    };
    let length = samples.len();
    if length > MAX_SPEECH || length % 2 != 0 {
        return Err(call.misuse(&format!(
            "the samples must have an even number of bytes, at most {MAX_SPEECH}, got {length}"
        )));
    }
    let always = call.state.options.streams.audio_out == Use::On;
    if !always && !call.state.streams.is_on(Stream::AudioOut) {
        return Err(call.misuse("switch the stream on first: robot.stream(\"audio_out\", true)"));
    }
    call.make_room(length)?;
    let samples = samples.to_vec();
    call.send(Intent::Say(samples))?;
    call.reply(())
}

fn stream(call: &mut Call<'_>) -> NativeResult {
    let stream = call.args.get(0)?;
    let on = call.args.get(1)?;
    if on {
        call.make_room(0)?;
        call.switch_on(stream)?;
    } else if call.state.streams.is_on(stream) {
        call.send(Intent::Stream { stream, on })?;
        call.state.streams.switch_off(stream);
    }
    call.reply(())
}

fn battery(call: &mut Call<'_>) -> NativeResult {
    let table = call.state.robot.battery.map(|(battery, at)| {
        let age = call.state.now.saturating_duration_since(at);
        battery_table(call.lua, battery, age)
    });
    call.reply(table.transpose()?)
}

pub(in super::super) fn battery_table(
    lua: &Lua,
    battery: Battery,
    age: Duration,
) -> LuaResult<LuaTable> {
    let table = lua.create_table_with_capacity(0, 4)?;
    table.raw_set("percent", battery.percent.map(Percent::get))?;
    table.raw_set("charging", battery.charging)?;
    table.raw_set("age", age.as_secs_f64())?;
    table.raw_set("minutes_left", battery.minutes_left)?;
    Ok(of_row("Battery", table))
}

fn info(call: &mut Call<'_>) -> NativeResult {
    let Some(info) = &call.state.robot.info else {
        return call.reply(LuaValue::Nil);
    };
    let table = call.lua.create_table_with_capacity(0, 5)?;
    table.raw_set("uid", info.uid.as_str())?;
    table.raw_set("name", info.name.as_str())?;
    table.raw_set("firmware", info.firmware.as_str())?;
    table.raw_set("address", info.address.as_str())?;
    table.raw_set("simulated", info.simulated)?;
    call.reply(of_row("Info", table))
}

pub(super) fn register_subscription(builder: &Builder<'_>) -> LuaResult<()> {
    builder.object::<SubscriptionId>("Subscription", |_| {})
}

impl Argument for EventName {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        given.named(EventName::from_name)
    }
}

fn on(call: &mut Call<'_>) -> NativeResult {
    let mut subscription = Subscription::new(call.args.get(0)?, call.args.get(1)?);
    let options = call.args.options(2)?;
    let rate: Option<f64> = options.get("rate")?;
    subscription.interval = rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
    if let Some(queue) = options.get::<Option<&str>>("queue")? {
        subscription.latest = queue == "latest";
    }
    subscribe(call, subscription)
}

fn once(call: &mut Call<'_>) -> NativeResult {
    let mut subscription = Subscription::new(call.args.get(0)?, call.args.get(1)?);
    subscription.once = true;
    subscribe(call, subscription)
}

fn subscribe(call: &mut Call<'_>, subscription: Subscription) -> NativeResult {
    call.must_be_running()?;
    if call.state.subscriptions.len() >= MAX_SUBSCRIPTIONS {
        return Err(call.misuse(&format!(
            "there are {MAX_SUBSCRIPTIONS} handlers already; end some with :off()"
        )));
    }
    listen(call, subscription.event);
    let id = SubscriptionId(call.state.tasks.next_id());
    call.state.subscriptions.insert(id, subscription);
    let object = call.lua.create_any_userdata(id)?;
    call.reply(object)
}

fn wait_for(call: &mut Call<'_>) -> NativeResult {
    let event = call.args.get(0)?;
    let time = call.args.get(1)?;
    wait_for_event(call, event, time)
}

/// Waits for an event. Waiting without a timeout is an error if the config prevents the event.
pub(super) fn wait_for_event(
    call: &mut Call<'_>,
    event: EventName,
    time: Option<Duration>,
) -> NativeResult {
    call.may_wait()?;
    let streams = call.state.options.streams;
    match event.stream().map(|stream| streams.allow(stream)) {
        Some(Err(why)) if time.is_none() => return Err(call.misuse(&why)),
        _ => listen(call, event),
    }
    call.wait(Wait::Event(event), time)
}

/// Switches on the stream that an event needs, since frames and sound arrive only while their
/// stream is on. If the config keeps the stream off, the event never comes: the script may still
/// run, and this is logged once.
pub(super) fn listen(call: &mut Call<'_>, event: EventName) {
    let Some(stream) = event.stream() else {
        return;
    };
    if let Err(why) = call.state.need_stream(stream, Demand::WhileUsed)
        && call.state.unavailable_events.insert(event)
    {
        let text = format!("'{}' never comes: {why}", event.name());
        call.state.log(Level::Warn, &text);
    }
}

fn off(call: &mut Call<'_>) -> NativeResult {
    let id = *call.receiver::<SubscriptionId>()?;
    call.state.unsubscribe(id);
    call.reply(())
}
