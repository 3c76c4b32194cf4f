//! `script.*` and `print`.

use super::terms::{Constant, Function, Type, call, function, object, text};

pub(super) const CONSTANTS: &[Constant] = &[Constant {
    path: "script.name",
    kind: Type::Text,
    doc: "The script's name: its file's, without `.lua`.",
    example: "print(script.name)",
}];

pub(super) const FUNCTIONS: &[Function] = &[
    call(
        "script.stop",
        &[text("reason", "stands in the log").optional()],
        &[],
        "Ends the script; the calling task does not go on.",
        "script.stop(\"seen enough\")",
    ),
    call(
        "script.on_stop",
        &[function(
            "fn",
            "(reason: string) -> ...any",
            "gets why the script ends, has 0.5 s and cannot move",
        )],
        &[],
        "Calls a function when the script ends, whatever the reason.",
        "script.on_stop(function(reason)\n\tprint(\"goodbye:\", reason)\nend)",
    ),
    call(
        "script.usage",
        &[],
        &[object("usage", "Usage", "")],
        "What the script has used so far.",
        "print(script.usage().memory_bytes // 1024, \"KiB\")",
    ),
    call(
        "print",
        &[],
        &[],
        "Writes its arguments to the log, with a space between two.",
        "print(\"it is\", task.now(), \"s since I began\")",
    )
    .and("what to print"),
];
