//! `clock.*`: the time of day.

use super::bounds::Bounds;
use super::make::{bounded, call, number, object, table, text, whole};
use super::model::{Availability, Function, Namespace, Object};

/// The times from the year 1 to the year 9999, in seconds since 1970.
const INSTANT: Bounds = Bounds::Between(-62_135_000_000.0, 253_402_000_000.0);

pub(super) const DATE: Object = table(
    "Date",
    "A date and a time of day.",
    &[
        whole("year", ""),
        whole("month", "1 to 12"),
        whole("day", "1 to 31"),
        whole("hour", "0 to 23"),
        whole("minute", "0 to 59"),
        whole("second", "0 to 59"),
        text("weekday", "such as `monday`"),
        text("zone", "the time zone, such as `Europe/Rome`"),
        whole("offset", "its offset from UTC, east positive").unit("s"),
        text("text", "such as `2026-03-29 01:30:00`"),
    ],
);

const FUNCTIONS: &[Function] = &[
    call(
        "clock.now",
        &[],
        &[number("seconds", "since 1970-01-01 00:00 UTC").unit("s")],
        "Returns the date and time as a number; in virtual time, those of the simulation.",
        "store.set(\"patrolled\", clock.now())",
    )
    .pure(),
    call(
        "clock.date",
        &[bounded("seconds", INSTANT, "a time of `clock.now`; default: now").unit("s").optional()],
        &[object("date", &DATE, "")],
        "Returns the date and time of day, in the time zone of the config (`time_zone:`).",
        "local date = clock.date()\nif date.hour >= 22 then\n\tprint(\"good night, it is\", date.text)\nend",
    )
    .pure(),
];

pub(super) const CLOCK: Namespace = Namespace {
    name: "clock",
    about: "the time of day",
    availability: Availability::Everywhere,
    functions: FUNCTIONS,
    constants: &[],
    example: "",
};
