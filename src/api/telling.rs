//! `journal.*` and `notify.*`.

use super::make::{boolean, call, short_text, text, value};
use super::terms::{Availability, Function, Namespace, Type, Value};

/// The longest kind of an entry, in bytes.
const KIND: usize = 40;
/// The longest message, in bytes.
const MESSAGE: usize = 1000;

const ADD: &[Value] = &[
    short_text("kind", KIND, "one word: letters, digits, - and _"),
    value(
        "fields",
        Type::Fields,
        "named values: texts, numbers, true, false, or tables of these; 4096 bytes at most",
    )
    .optional(),
];

const MORE: &[Value] = &[text("picture", "what frame:save gave").optional()];

const JOURNALLED: &[Function] = &[call(
    "journal.add",
    ADD,
    &[boolean(
        "kept",
        "false: the day's share of this script is used up",
    )],
    "Adds an entry to the journal; `spykee history` shows it.",
    "journal.add(\"moved\", { energy = 3.5, where = \"door\" })",
)];

const NOTIFIED: &[Function] = &[call(
    "notify.send",
    &[
        short_text("text", MESSAGE, "what people are told"),
        value("options", Type::Options(MORE), "").optional(),
    ],
    &[boolean(
        "sent",
        "false: the day's share of this script is used up",
    )],
    "Tells people, wherever the config's `notify:` says; does not wait for it.",
    "notify.send(\"somebody is at the door\")",
)];

pub(super) const JOURNAL: Namespace = Namespace {
    name: "journal",
    about: "what is remembered for people",
    availability: Availability::Behaviour,
    functions: JOURNALLED,
    constants: &[],
    example: "",
};

pub(super) const NOTIFY: Namespace = Namespace {
    name: "notify",
    about: "messages to people who are elsewhere",
    availability: Availability::Behaviour,
    functions: NOTIFIED,
    constants: &[],
    example: "",
};
