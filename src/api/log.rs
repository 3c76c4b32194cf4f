//! `log.*`: lines for the log.

use super::make::{call, value};
use super::model::{Availability, Function, Namespace, Type, Value};

const PARAMETERS: &[Value] = &[
    value("text", Type::Any, "what to write: any value"),
    value("fields", Type::Fields, "further values, by name").optional(),
];

const FUNCTIONS: &[Function] = &[
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
    functions: FUNCTIONS,
    constants: &[],
    example: "",
};
