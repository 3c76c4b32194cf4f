//! `robot.on`, `robot.once`, `robot.wait_for` and the Subscription object.

use std::time::Duration;

use mlua::prelude::LuaResult;

use super::super::arguments::{Bounds, Refusal};
use super::super::events::{EventName, MAX_SUBSCRIPTIONS, Subscription};
use super::super::output::Level;
use super::super::streams::Demand;
use super::super::task::{SubscriptionId, Wait};
use super::frame::add_methods;
use super::{Answered, Builder, Call, Entry, plain, waiting};

pub(super) const CALLS: [Entry; 3] = [
    plain("robot.on", on),
    plain("robot.once", once),
    waiting("robot.wait_for", wait_for),
];

const METHODS: [Entry; 1] = [plain("Subscription:off", off)];

/// Runs of a handler a second, at most. A slower one would overrun the clock's numbers.
pub(super) const RATE: Bounds = Bounds::Between(0.001, 1000.0);

/// What the script holds of a subscription.
struct SubscriptionObject(SubscriptionId);

pub(super) fn register_handle(builder: &Builder<'_>) -> LuaResult<()> {
    let methods = builder.methods(&[&METHODS])?;
    let unknown = builder.strict_object("Subscription")?;
    builder
        .lua
        .register_userdata_type::<SubscriptionObject>(|registry| {
            use mlua::UserDataFields as _;
            registry.add_meta_field("__type", "Subscription");
            registry.add_meta_field("__index", unknown);
            add_methods(registry, methods);
        })
}

/// `robot.on(name, fn, {rate=, queue=})`
fn on(call: &mut Call<'_>) -> Answered {
    let event = event(call)?;
    let function = call.args.function(1, "the function")?;
    let mut subscription = Subscription::new(event, function);
    let options = call.args.options(2, &["rate", "queue"])?;
    let rate = options.optional_number("rate", RATE)?;
    subscription.interval = rate.map(|rate| Duration::from_secs_f64(1.0 / rate));
    if let Some(latest) = options.choice("queue", &[("latest", true), ("all", false)])? {
        subscription.latest = latest;
    }
    subscribe(call, subscription)
}

/// `robot.once(name, fn)`
fn once(call: &mut Call<'_>) -> Answered {
    let event = event(call)?;
    let function = call.args.function(1, "the function")?;
    let mut subscription = Subscription::new(event, function);
    subscription.once = true;
    subscribe(call, subscription)
}

fn subscribe(call: &mut Call<'_>, subscription: Subscription) -> Answered {
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
fn wait_for(call: &mut Call<'_>) -> Answered {
    let event = event(call)?;
    let time = call.args.optional_seconds(1, "timeout")?;
    wait_for_event(call, event, time)
}

/// Waits for an event. For ever only if it can come.
pub(super) fn wait_for_event(
    call: &mut Call<'_>,
    event: EventName,
    time: Option<Duration>,
) -> Answered {
    call.may_wait()?;
    let streams = call.state.options.streams;
    let refusal = event.stream().and_then(|stream| streams.refusal(stream));
    match refusal {
        Some(why) if time.is_none() => return Err(call.args.misuse(&why)),
        _ => listen(call, event),
    }
    call.wait(Wait::Event(event), time)
}

/// Frames and sound come only when their stream is on. Where the config keeps it off they never
/// come: the script can do without, and its log says so once.
pub(super) fn listen(call: &mut Call<'_>, event: EventName) {
    let Some(stream) = event.stream() else {
        return;
    };
    if let Err(why) = call.state.want(stream, Demand::Used)
        && call.state.missed.insert(event)
    {
        let text = format!("'{}' never comes: {why}", event.name());
        call.state.log(Level::Warn, &text);
    }
}

fn event(call: &Call<'_>) -> Result<EventName, Refusal> {
    let known: Vec<_> = EventName::ALL
        .iter()
        .map(|event| (event.name(), *event))
        .collect();
    call.args.choice(0, "event", &known)
}

/// `Subscription:off()`
fn off(call: &mut Call<'_>) -> Answered {
    let object = call.args.value(0).as_userdata();
    let object = object.and_then(|object| object.borrow::<SubscriptionObject>().ok());
    let Some(id) = object.map(|object| object.0) else {
        return Err(call.no_subject("subscription"));
    };
    call.state.unsubscribe(id);
    call.reply(())
}
