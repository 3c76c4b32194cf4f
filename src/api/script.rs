//! `script.*`, `task.*`, `log.*`, `clock.*`, `params.*`, `store.*`, `journal.*`, `notify.*` and the
//! functions without a namespace.

use super::events::{TASK_STATUS, USAGE};
use super::model::{
    Availability, Bounds, Constant, Function, Namespace, Object, SECONDS, Type, Value, boolean,
    bounded, call, choice, function, namespace, number, object, short_text, strict, table, text,
    value, whole,
};

const CONSTANTS: &[Constant] = &[Constant {
    path: "script.name",
    kind: Type::Text(None),
    doc: "The script's name: the name of its file without `.lua`, or the name in the config.",
}];

pub(super) const SCRIPT: Namespace = Namespace {
    constants: CONSTANTS,
    ..namespace("script", "the script itself")
        .functions(&[
            call("script.stop")
                .takes(&[short_text("reason", 1000, "for the log").optional()])
                .doc("Ends the script; the calling task does not continue."),
            call("script.on_stop")
                .takes(&[function(
                    "fn",
                    "(reason: string) -> ...any",
                    "gets the reason; must end within 0.5 s, and cannot drive",
                )])
                .doc("Calls a function when the script ends, whatever the reason."),
            call("script.usage")
                .returns(&[object("usage", &USAGE, "")])
                .doc("Returns the resources that the script has used so far.")
                .pure(),
        ])
        .available(Availability::Everywhere)
};

const PARAMETERS: &[Value] = &[
    value("text", Type::Any, "what to write: any value"),
    value("fields", Type::Fields, "further values, by name").optional(),
];

pub(super) const LOG: Namespace = namespace("log", "lines for the log")
    .functions(&[
        call("log.debug")
            .takes(PARAMETERS)
            .doc("Writes a line that is shown only with the log level debug."),
        call("log.info")
            .takes(PARAMETERS)
            .doc("Writes a line to the log, with the script's name and line."),
        call("log.warn")
            .takes(PARAMETERS)
            .doc("Writes a warning to the log."),
        call("log.error")
            .takes(PARAMETERS)
            .doc("Writes an error to the log; the script continues."),
    ])
    .available(Availability::Everywhere);

/// The times from the year 1 to the year 9999, in seconds since 1970.
const INSTANT: Bounds = Bounds::Between(-62_135_000_000.0, 253_402_000_000.0);

pub(super) const DATE: Object = table("Date").doc("A date and a time of day.").fields(&[
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
]);

pub(super) const CLOCK: Namespace = namespace("clock", "the time of day")
    .functions(&[
        call("clock.now")
            .returns(&[number("seconds", "since 1970-01-01 00:00 UTC").unit("s")])
            .doc("Returns the date and time as a number; in virtual time, those of the simulation.")
            .pure(),
        call("clock.date")
            .takes(&[
                bounded("seconds", INSTANT, "a time of `clock.now`; default: now")
                    .unit("s")
                    .optional(),
            ])
            .returns(&[object("date", &DATE, "")])
            .doc("Returns the date and time of day, in the time zone of the config (`time_zone:`).")
            .pure(),
    ])
    .available(Availability::Everywhere);

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

const JOURNALLED: &[Function] = &[call("journal.add")
    .takes(ADD)
    .returns(&[boolean(
        "kept",
        "false if this script's share of the day is used up",
    )])
    .doc("Adds an entry to the journal; `spykee history` shows it.")];

pub(super) const JOURNAL: Namespace =
    namespace("journal", "a record of what happened, for people").functions(JOURNALLED);

pub(super) const NOTIFY: Namespace =
    namespace("notify", "messages to people").functions(&[call("notify.send")
        .takes(&[
            short_text("text", MESSAGE, "the message"),
            value("options", Type::Options(MORE), "").optional(),
        ])
        .returns(&[boolean(
            "sent",
            "false if this script's share of the day is used up",
        )])
        .doc("Sends a message to the targets of the config's `notify:`, without waiting for it.")]);

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
    short_text("unit", 1000, "the unit of a number, shown to people").optional(),
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
    short_text("doc", 1000, "what the parameter means, shown to people").optional(),
];

const DECLARE: &[Function] = &[call("params.declare")
    .takes(&[value("parameters", Type::Named(PARAMETER), "by name")])
    .returns(&[value(
        "values",
        Type::Any,
        "by name: from --param, else the config, else the default",
    )])
    .doc("Declares the script's parameters, and returns their values.")];

const STORED: &[Function] = &[
    call("store.get")
        .takes(&[
            KEY,
            value(
                "default",
                Type::Any,
                "returned if nothing is stored under the key",
            )
            .optional(),
        ])
        .returns(&[value("value", Type::Any, "nil if there is none").optional()])
        .doc("Returns the value stored under a key, in this or an earlier run."),
    call("store.set")
        .takes(&[
            KEY,
            value(
                "value",
                Type::Any,
                "a string, a number, true, false, or a table of these",
            ),
        ])
        .doc("Stores a value for later runs; at most 1 MiB in total."),
    call("store.delete")
        .takes(&[KEY])
        .returns(&[boolean("was_there", "whether there was a value")])
        .doc("Deletes the value stored under a key."),
    call("store.keys")
        .returns(&[value(
            "keys",
            Type::List(&Type::Text(None)),
            "in alphabetical order",
        )])
        .doc("Returns all keys that have a value."),
];

pub(super) const PARAMS: Namespace =
    namespace("params", "settings that a person can change").functions(DECLARE);

pub(super) const STORE: Namespace =
    namespace("store", "values kept from one run to the next").functions(STORED);

pub(super) const GLOBALS: Namespace = namespace("", "functions without a namespace")
    .functions(&[
        call("print")
            .doc("Writes its arguments to the log, with spaces between them.")
            .with_rest("values to print"),
        call("require")
            .takes(&[text(
                "path",
                "./NAME for a file beside this one, or @spykee/NAME for a built-in module",
            )])
            .returns(&[value("module", Type::Any, "what the module's file returns")])
            .doc("Loads a module, once per script.")
            .waiting(),
    ])
    .available(Availability::Everywhere);

const FUNCTION: Value = function("fn", "(...any) -> ...any", "the function to run");
const HANDLE: Value = object("task", &TASK, "");
/// The shortest and the longest period of `task.every`, in seconds.
const BEAT: Bounds = Bounds::Between(0.001, 30.0 * 86_400.0);
const TIME: Value = bounded("seconds", SECONDS, "").unit("s");

pub(super) const TASK: Object = strict("Task")
    .doc("A function that runs in parallel with others.")
    .fields(&[
        choice("status", TASK_STATUS, "its state"),
        whole("missed", "number of missed periods of `task.every`"),
    ])
    .methods(&[
        call("Task:cancel").doc("Ends the task; its motion stops with it."),
        call("Task:join")
            .takes(&[bounded("timeout", SECONDS, "default: no limit")
                .unit("s")
                .optional()])
            .returns(&[
                boolean("ok", "whether the task has ended without an error"),
                text("status", "as `.status`, or \"timeout\""),
                text("message", "the error of a task that failed").optional(),
            ])
            .doc("Waits until the task has ended.")
            .waiting(),
    ]);

pub(super) const TASKS: Namespace = namespace("task", "time, and functions that run in parallel")
    .functions(&[
        call("task.wait")
            .takes(&[TIME.default(0.0)])
            .returns(&[number("passed", "the time that has really passed").unit("s")])
            .doc("Waits; other tasks and handlers run in the meantime.")
            .waiting(),
        call("task.now")
            .returns(&[number("seconds", "").unit("s")])
            .doc("Returns the seconds since the script started.")
            .pure(),
        call("task.spawn")
            .takes(&[FUNCTION])
            .returns(&[HANDLE])
            .doc("Runs a function in a new task, in parallel with the others.")
            .with_rest("arguments of the function"),
        call("task.delay")
            .takes(&[TIME, FUNCTION])
            .returns(&[HANDLE])
            .doc("Runs a function later, in a new task.")
            .with_rest("arguments of the function"),
        call("task.every")
            .takes(&[
                bounded("seconds", BEAT, "the period").unit("s"),
                function(
                    "fn",
                    "(missed: number) -> ...any",
                    "gets the number of missed periods",
                ),
            ])
            .returns(&[HANDLE])
            .doc("Runs a function periodically, in a new task."),
        call("task.all")
            .returns(&[value(
                "results",
                Type::Any,
                "the first result of each function, in their order",
            )
            .optional()])
            .doc("Runs functions in parallel and waits for all of them.")
            .with_rest("the functions")
            .waiting(),
        call("task.race")
            .takes(&[FUNCTION])
            .returns(&[value(
                "results",
                Type::Any,
                "the results of the first function that ends",
            )
            .optional()])
            .doc("Runs functions in parallel until one of them ends, then cancels the others.")
            .with_rest("more functions")
            .waiting(),
        call("task.timeout")
            .takes(&[TIME, FUNCTION])
            .returns(&[
                boolean("ok", "false after a time-out"),
                value(
                    "results",
                    Type::Any,
                    "the results of the function, or \"timeout\"",
                )
                .optional(),
            ])
            .doc("Runs a function, and cancels it if it takes longer than a time limit.")
            .with_rest("arguments of the function")
            .waiting(),
    ])
    .available(Availability::Everywhere);
