//! `script.*`: the script's name, end and use of resources.

use super::make::{call, function, object, short_text};
use super::model::{Availability, Constant, Function, Namespace, Type};
use super::tables::USAGE;

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
