//! `script.*`, `log.*`, `clock.*`, `params.*`, `store.*`, `journal.*`, `notify.*` and the functions
//! without a namespace.

use super::events::USAGE;
use super::make::{
    boolean, bounded, call, function, number, object, short_text, table, text, value, whole,
};
use super::model::{Availability, Bounds, Constant, Function, Namespace, Object, Type, Value};

const CONSTANTS: &[Constant] = &[Constant {
    path: "script.name",
    kind: Type::Text(None),
    doc: "The script's name: the name of its file without `.lua`, or the name in the config.",
    example: "print(script.name)",
}];

const FUNCTIONS: &[Function] = &[
    call(
        "script.stop",
        &[short_text("reason", 1000, "for the log").optional()],
        &[],
        "Ends the script; the calling task does not continue.",
        "script.stop(\"seen enough\")",
    ),
    call(
        "script.on_stop",
        &[function(
            "fn",
            "(reason: string) -> ...any",
            "gets the reason; must end within 0.5 s, and cannot drive",
        )],
        &[],
        "Calls a function when the script ends, whatever the reason.",
        "script.on_stop(function(reason)\n\tprint(\"goodbye:\", reason)\nend)",
    ),
    call(
        "script.usage",
        &[],
        &[object("usage", &USAGE, "")],
        "Returns the resources that the script has used so far.",
        "print(script.usage().memory_bytes // 1024, \"KiB\")",
    )
    .pure(),
];

pub(super) const SCRIPT: Namespace = Namespace {
    name: "script",
    about: "the script itself",
    availability: Availability::Everywhere,
    functions: FUNCTIONS,
    constants: CONSTANTS,
    example: "",
};

const PARAMETERS: &[Value] = &[
    value("text", Type::Any, "what to write: any value"),
    value("fields", Type::Fields, "further values, by name").optional(),
];

const LOG_FUNCTIONS: &[Function] = &[
    call(
        "log.debug",
        PARAMETERS,
        &[],
        "Writes a line that is shown only with the log level debug.",
        "log.debug(\"looking\", { angle = 0.4 })",
    ),
    call(
        "log.info",
        PARAMETERS,
        &[],
        "Writes a line to the log, with the script's name and line.",
        "log.info(\"on my way\")",
    ),
    call(
        "log.warn",
        PARAMETERS,
        &[],
        "Writes a warning to the log.",
        "log.warn(\"this takes long\", { seconds = task.now() })",
    ),
    call(
        "log.error",
        PARAMETERS,
        &[],
        "Writes an error to the log; the script continues.",
        "log.error(\"no ball in sight\")",
    ),
];

pub(super) const LOG: Namespace = Namespace {
    name: "log",
    about: "lines for the log",
    availability: Availability::Everywhere,
    functions: LOG_FUNCTIONS,
    constants: &[],
    example: "",
};

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

const CLOCK_FUNCTIONS: &[Function] = &[
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
    functions: CLOCK_FUNCTIONS,
    constants: &[],
    example: "",
};

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

const KEY: Value = short_text("key", 200, "UTF-8, not empty");

/// The keys that describe one parameter.
const PARAMETER: &[Value] = &[
    value(
        "default",
        Type::Any,
        "a number, a text, or true or false; it determines the type of the parameter",
    ),
    number("min", "the smallest permitted number").optional(),
    number("max", "the largest permitted number").optional(),
    text("unit", "the unit of a number, shown to people").optional(),
    value(
        "choices",
        Type::List(&Type::Text(None)),
        "the permitted values of a text",
    )
    .optional(),
    boolean(
        "live",
        "whether a person can change it while the script runs, for example on the page; if so, read it again each time you use it",
    )
    .optional(),
    text("doc", "what the parameter means, shown to people").optional(),
];

const DECLARE: &[Function] = &[call(
    "params.declare",
    &[value("parameters", Type::Named(PARAMETER), "by name")],
    &[value(
        "values",
        Type::Any,
        "by name: from --param, else the config, else the default",
    )],
    "Declares the script's parameters, and returns their values.",
    "local params = params.declare({\n\tspeed = { default = 40, min = 10, max = 100, unit = \"%\", doc = \"how fast\" },\n})\nrobot.move(params.speed, params.speed, 1)",
)];

const STORED: &[Function] = &[
    call(
        "store.get",
        &[
            KEY,
            value(
                "default",
                Type::Any,
                "returned if nothing is stored under the key",
            )
            .optional(),
        ],
        &[value("value", Type::Any, "nil if there is none").optional()],
        "Returns the value stored under a key, in this or an earlier run.",
        "local runs = store.get(\"runs\", 0) + 1\nstore.set(\"runs\", runs)\nprint(\"run number\", runs)",
    ),
    call(
        "store.set",
        &[
            KEY,
            value(
                "value",
                Type::Any,
                "a string, a number, true, false, or a table of these",
            ),
        ],
        &[],
        "Stores a value for later runs; at most 1 MiB in total.",
        "store.set(\"home\", { x = 1, y = 2 })",
    ),
    call(
        "store.delete",
        &[KEY],
        &[boolean("was_there", "whether there was a value")],
        "Deletes the value stored under a key.",
        "store.delete(\"home\")",
    ),
    call(
        "store.keys",
        &[],
        &[value(
            "keys",
            Type::List(&Type::Text(None)),
            "in alphabetical order",
        )],
        "Returns all keys that have a value.",
        "for _, key in store.keys() do\n\tprint(key, store.get(key))\nend",
    ),
];

const GLOBAL: &[Function] = &[
    call(
        "print",
        &[],
        &[],
        "Writes its arguments to the log, with spaces between them.",
        "print(\"it is\", task.now(), \"s since I began\")",
    )
    .with_rest("values to print"),
    call(
        "require",
        &[text(
            "path",
            "./NAME for a file beside this one, or @spykee/NAME for a built-in module",
        )],
        &[value("module", Type::Any, "what the module's file returns")],
        "Loads a module, once per script.",
        "local pid = require(\"@spykee/pid\")\nprint(pid)",
    )
    .waiting(),
];

pub(super) const PARAMS: Namespace = Namespace {
    name: "params",
    about: "settings that a person can change",
    availability: Availability::Behaviour,
    functions: DECLARE,
    constants: &[],
    example: "",
};

pub(super) const STORE: Namespace = Namespace {
    name: "store",
    about: "values kept from one run to the next",
    availability: Availability::Behaviour,
    functions: STORED,
    constants: &[],
    example: "",
};

pub(super) const GLOBALS: Namespace = Namespace {
    name: "",
    about: "functions without a namespace",
    availability: Availability::Everywhere,
    functions: GLOBAL,
    constants: &[],
    example: "",
};
