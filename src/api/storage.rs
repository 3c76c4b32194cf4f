//! `params.*`, `store.*`, and the functions without a namespace.

use super::make::{boolean, call, number, short_text, text, value};
use super::model::{Availability, Function, Namespace, Type, Value};

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
