//! `params.*`, `store.*` and `require`.

use super::terms::{Function, Type, Value, call, number, text, value};

const KEY: Value = text("key", "1 to 200 bytes");

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
        Type::List(&Type::Text),
        "of a text: these and no others",
    )
    .optional(),
    text("doc", "what it is for").optional(),
];

pub(super) const FUNCTIONS: &[Function] = &[
    call(
        "params.declare",
        &[value("parameters", Type::Named(PARAMETER), "by name")],
        &[value(
            "values",
            Type::Any,
            "by name; from --param, the config, or the default",
        )],
        "Declares what a person may set from outside, and gives the values.",
        "local params = params.declare({\n\tspeed = { default = 40, min = 10, max = 100, unit = \"%\", doc = \"how fast\" },\n})\nrobot.move(params.speed, params.speed, 1)",
    ),
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
        &[],
        "Forgets what is kept under a key.",
        "store.delete(\"home\")",
    ),
    call(
        "store.keys",
        &[],
        &[value("keys", Type::List(&Type::Text), "in order")],
        "All keys under which something is kept.",
        "for _, key in store.keys() do\n\tprint(key, store.get(key))\nend",
    ),
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
