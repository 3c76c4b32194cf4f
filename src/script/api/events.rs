//! `robot.on`, `robot.once`, `robot.wait_for` and the Subscription object.

use std::time::Duration;

use mlua::prelude::LuaResult;

use super::super::arguments::{Argument, Given, Refusal};
use super::super::events::{EventName, MAX_SUBSCRIPTIONS, Subscription};
use super::super::output::Level;
use super::super::streams::Demand;
use super::super::task::{SubscriptionId, Wait};
use super::{Builder, Call, NativeResult, Natives};

pub(super) const CALLS: &Natives = &[
    ("robot.on", on),
    ("robot.once", once),
    ("robot.wait_for", wait_for),
];

const METHODS: &Natives = &[("Subscription:off", off)];

struct SubscriptionObject(SubscriptionId);

pub(super) fn register_handle(builder: &Builder<'_>) -> LuaResult<()> {
    builder.object::<SubscriptionObject>("Subscription", &[METHODS], |_| {})
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
        return Err(call.args.misuse(&format!(
            "there are {MAX_SUBSCRIPTIONS} handlers already; end some with :off()"
        )));
    }
    listen(call, subscription.event);
    let id = SubscriptionId(call.state.tasks.next_id());
    call.state.subscriptions.insert(id, subscription);
    let object = call.lua.create_any_userdata(SubscriptionObject(id))?;
    call.reply(object)
}

/// `robot.wait_for(name, timeout)` returns the payload, or `nil, "timeout"`.
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
        Some(Err(why)) if time.is_none() => return Err(call.args.misuse(&why.to_string())),
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
    let id = call.receiver::<SubscriptionObject>()?.0;
    call.state.unsubscribe(id);
    call.reply(())
}
