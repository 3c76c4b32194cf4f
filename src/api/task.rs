//! `task.*` and the Task object.

use super::choices::TASK_STATUS;
use super::make::{
    boolean, bounded, call, choice, function, number, object, strict, text, value, whole,
};
use super::model::{Availability, Bounds, Function, Namespace, Object, SECONDS, Type, Value};

const FUNCTION: Value = function("fn", "(...any) -> ...any", "the function to run");
const HANDLE: Value = object("task", &TASK, "");
/// The shortest and the longest period of `task.every`, in seconds.
const BEAT: Bounds = Bounds::Between(0.001, 30.0 * 86_400.0);
const TIME: Value = bounded("seconds", SECONDS, "").unit("s");

const FUNCTIONS: &[Function] = &[
    call(
        "task.wait",
        &[TIME.default(0.0)],
        &[number("passed", "the time that has really passed").unit("s")],
        "Waits; other tasks and handlers run in the meantime.",
        "task.wait(0.5)",
    )
    .waiting(),
    call(
        "task.now",
        &[],
        &[number("seconds", "").unit("s")],
        "Returns the seconds since the script started.",
        "local began = task.now()\ntask.wait(1)\nprint(task.now() - began)",
    )
    .pure(),
    call(
        "task.spawn",
        &[FUNCTION],
        &[HANDLE],
        "Runs a function in a new task, in parallel with the others.",
        "local lights = task.spawn(function()\n\trobot.led(\"left\", true)\n\ttask.wait(1)\n\trobot.led(\"left\", false)\nend)\nlights:join()",
    )
    .with_rest("arguments of the function"),
    call(
        "task.delay",
        &[TIME, FUNCTION],
        &[HANDLE],
        "Runs a function later, in a new task.",
        "task.delay(2, robot.play, \"bip_2\")",
    )
    .with_rest("arguments of the function"),
    call(
        "task.every",
        &[
            bounded("seconds", BEAT, "the period").unit("s"),
            function("fn", "(missed: number) -> ...any", "gets the number of missed periods"),
        ],
        &[HANDLE],
        "Runs a function periodically, in a new task.",
        "local beat = task.every(1, function()\n\tprint(\"tick\")\nend)\ntask.wait(3)\nbeat:cancel()",
    ),
    call(
        "task.all",
        &[],
        &[value("results", Type::Any, "the first result of each function, in their order").optional()],
        "Runs functions in parallel and waits for all of them.",
        "task.all(function()\n\ttask.wait(1)\nend, function()\n\trobot.blink(\"all\"):join()\nend)",
    )
    .with_rest("the functions")
    .waiting(),
    call(
        "task.race",
        &[FUNCTION],
        &[value("results", Type::Any, "the results of the first function that ends").optional()],
        "Runs functions in parallel until one of them ends, then cancels the others.",
        "task.race(function()\n\ttask.wait(1)\nend, function()\n\trobot.wait_for(\"docked\")\nend)",
    )
    .with_rest("more functions")
    .waiting(),
    call(
        "task.timeout",
        &[TIME, FUNCTION],
        &[
            boolean("ok", "false after a time-out"),
            value("results", Type::Any, "the results of the function, or \"timeout\"").optional(),
        ],
        "Runs a function, and cancels it if it takes longer than a time limit.",
        "local ok = task.timeout(5, function()\n\trobot.forward(1)\nend)\nprint(ok)",
    )
    .with_rest("arguments of the function")
    .waiting(),
];

pub(super) const TASK: Object = strict(
    "Task",
    "A function that runs in parallel with others.",
    &[
        choice("status", TASK_STATUS, "its state"),
        whole("missed", "number of missed periods of `task.every`"),
    ],
    &[
        call(
            "Task:cancel",
            &[],
            &[],
            "Ends the task; its motion stops with it.",
            "local beat = task.every(1, print)\nbeat:cancel()",
        ),
        call(
            "Task:join",
            &[bounded("timeout", SECONDS, "default: no limit")
                .unit("s")
                .optional()],
            &[
                boolean("ok", "whether the task has ended without an error"),
                text("status", "as `.status`, or \"timeout\""),
                text("message", "the error of a task that failed").optional(),
            ],
            "Waits until the task has ended.",
            "robot.blink(\"left\"):join()",
        )
        .waiting(),
    ],
);

pub(super) const TASKS: Namespace = Namespace {
    name: "task",
    about: "time, and functions that run in parallel",
    availability: Availability::Everywhere,
    functions: FUNCTIONS,
    constants: &[],
    example: "",
};
