//! `journal.*` and `notify.*`: entries of the journal, and messages to people.

use super::make::{boolean, call, short_text, text, value};
use super::model::{Availability, Function, Namespace, Type, Value};

/// The longest name of a kind of entry, in bytes.
const KIND: usize = 40;
/// The longest message, in bytes.
const MESSAGE: usize = 1000;

const ADD: &[Value] = &[
    short_text("kind", KIND, "one word of letters, digits, - and _"),
    value(
        "fields",
        Type::Fields,
        "values by name: strings, numbers, true, false, or tables of these; at most 4096 bytes",
    )
    .optional(),
];

const MORE: &[Value] = &[text("picture", "the path that `frame:save` returned").optional()];

const JOURNALLED: &[Function] = &[call(
    "journal.add",
    ADD,
    &[boolean(
        "kept",
        "false if this script's share of the day is used up",
    )],
    "Adds an entry to the journal; `spykee history` shows it.",
    "journal.add(\"moved\", { energy = 3.5, where = \"door\" })",
)];

const NOTIFIED: &[Function] = &[call(
    "notify.send",
    &[
        short_text("text", MESSAGE, "the message"),
        value("options", Type::Options(MORE), "").optional(),
    ],
    &[boolean(
        "sent",
        "false if this script's share of the day is used up",
    )],
    "Sends a message to the targets of the config's `notify:`, without waiting for it.",
    "notify.send(\"somebody is at the door\")",
)];

pub(super) const JOURNAL: Namespace = Namespace {
    name: "journal",
    about: "a record of what happened, for people",
    availability: Availability::Behaviour,
    functions: JOURNALLED,
    constants: &[],
    example: "",
};

pub(super) const NOTIFY: Namespace = Namespace {
    name: "notify",
    about: "messages to people",
    availability: Availability::Behaviour,
    functions: NOTIFIED,
    constants: &[],
    example: "",
};
