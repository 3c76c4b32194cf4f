//! `clock.*`: the time of day.

use std::cell::RefCell;

use jiff::Timestamp;
use jiff::civil::Weekday;

use super::{Call, NativeResult, Natives, of_row};
use crate::clock::{Clock, Zone};

pub(super) const CALLS: &Natives = &[("clock.now", now), ("clock.date", date)];

thread_local! {
    /// The last zone, cached because finding it takes longer than using it.
    static ZONE: RefCell<Option<Zone>> = const { RefCell::new(None) };
}

/// `clock.now()`
fn now(call: &mut Call<'_>) -> NativeResult {
    let now = instant(call);
    call.reply(now.as_millisecond() as f64 / 1e3)
}

/// `clock.date(seconds)`
fn date(call: &mut Call<'_>) -> NativeResult {
    let given: Option<f64> = call.args.get(0)?;
    let instant = match given {
        // The bounds of the row keep it within the supported years.
        Some(seconds) => Timestamp::from_millisecond((seconds * 1e3).floor() as i64)
            .unwrap_or(Timestamp::UNIX_EPOCH),
        None => instant(call),
    };
    let zone = zone(&call.state.options.time_zone);
    let time = zone.time(instant);
    let table = call.lua.create_table_with_capacity(0, 10)?;
    table.raw_set("year", time.year())?;
    table.raw_set("month", time.month())?;
    table.raw_set("day", time.day())?;
    table.raw_set("hour", time.hour())?;
    table.raw_set("minute", time.minute())?;
    table.raw_set("second", time.second())?;
    table.raw_set("weekday", weekday(time.weekday()))?;
    table.raw_set("zone", zone.name())?;
    table.raw_set("offset", time.offset().seconds())?;
    table.raw_set("text", time.strftime("%Y-%m-%d %H:%M:%S").to_string())?;
    call.reply(of_row("Date", table))
}

fn instant(call: &Call<'_>) -> Timestamp {
    Clock::ahead(call.state.options.clock).now()
}

/// The zone of this name; UTC if there is none.
fn zone(name: &str) -> Zone {
    ZONE.with_borrow_mut(|last| match last {
        Some(zone) if zone.name() == name => zone.clone(),
        _ => last
            .insert(name.parse().unwrap_or_else(|_| Zone::utc()))
            .clone(),
    })
}

fn weekday(day: Weekday) -> &'static str {
    match day {
        Weekday::Monday => "monday",
        Weekday::Tuesday => "tuesday",
        Weekday::Wednesday => "wednesday",
        Weekday::Thursday => "thursday",
        Weekday::Friday => "friday",
        Weekday::Saturday => "saturday",
        Weekday::Sunday => "sunday",
    }
}
