//! `params.*`, `store.*`, and the functions without a namespace.

use super::make::{boolean, call, number, short_text, text, value};
use super::terms::{Availability, Function, Namespace, Type, Value};

const KEY: Value = short_text("key", 200, "of UTF-8, not empty");

/// What can be said of one parameter.
const PARAMETER: &[Value] = &[
    value(
        "default",
        Type::Any,
        "a number, a text, or true or false: the parameter is of that kind",
    ),
    number("min", "of a number").optional(),
    number("max", "of a number").optional(),
    text("unit", "of a number, for people").optional(),
    value(
        "choices",
        Type::List(&Type::Text(None)),
        "of a text: these and no others",
    )
    .optional(),
    boolean(
        "live",
        "a person may change it while the script runs, such as at the page: read it anew each time",
    )
    .optional(),
    text("doc", "what it is for").optional(),
];

const DECLARE: &[Function] = &[call(
    "params.declare",
    &[value("parameters", Type::Named(PARAMETER), "by name")],
    &[value(
        "values",
        Type::Any,
        "by name; from --param, the config, or the default",
    )],
    "Declares what a person may set from outside, and gives the values.",
    "local params = params.declare({\n\tspeed = { default = 40, min = 10, max = 100, unit = \"%\", doc = \"how fast\" },\n})\nrobot.move(params.speed, params.speed, 1)",
)];

const STORED: &[Function] = &[
    call(
        "store.get",
        &[
            KEY,
            value("default", Type::Any, "if nothing is kept under the key").optional(),
        ],
        &[value("value", Type::Any, "nil if there is none").optional()],
        "What was kept under a key, also in an earlier run.",
        "local runs = store.get(\"runs\", 0) + 1\nstore.set(\"runs\", runs)\nprint(\"run number\", runs)",
    ),
    call(
        "store.set",
        &[
            KEY,
            value(
                "value",
                Type::Any,
                "a text, a number, true, false, or a table of these",
            ),
        ],
        &[],
        "Keeps a value for later runs; at most 1 MiB in all.",
        "store.set(\"home\", { x = 1, y = 2 })",
    ),
    call(
        "store.delete",
        &[KEY],
        &[boolean("was_there", "whether there was anything")],
        "Forgets what is kept under a key.",
        "store.delete(\"home\")",
    ),
    call(
        "store.keys",
        &[],
        &[value("keys", Type::List(&Type::Text(None)), "in order")],
        "All keys that have a value.",
        "for _, key in store.keys() do\n\tprint(key, store.get(key))\nend",
    ),
];

const GLOBAL: &[Function] = &[
    call(
        "print",
        &[],
        &[],
        "Writes its arguments to the log, with a space between two.",
        "print(\"it is\", task.now(), \"s since I began\")",
    )
    .and("what to print"),
    call(
        "require",
        &[text(
            "path",
            "./NAME beside this file, or @spykee/NAME for what comes with the runtime",
        )],
        &[value("module", Type::Any, "what the module's file returns")],
        "Loads a module, once for each script.",
        "local pid = require(\"@spykee/pid\")\nprint(pid)",
    )
    .waiting(),
];

pub(super) const PARAMS: Namespace = Namespace {
    name: "params",
    about: "what a person may set from outside",
    availability: Availability::Behaviour,
    functions: DECLARE,
    constants: &[],
    example: "",
};

pub(super) const STORE: Namespace = Namespace {
    name: "store",
    about: "what is kept from run to run",
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
