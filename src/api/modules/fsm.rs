//! `@spykee/fsm`: state machines.

use super::shapes::module;
use crate::api::make::{call, function, object, open, options, text, value};
use crate::api::model::{Namespace, Object, Type, Value};

const STATE: Value = text("state", "name of a state");
const STATES: &[Value] = &[
    function(
        "enter",
        "(machine: Machine) -> ...any",
        "runs first, before anything else of the state",
    )
    .optional(),
    function(
        "task",
        "(machine: Machine) -> string?",
        "runs next; the machine goes to the state whose name it returns",
    )
    .optional(),
    function(
        "exit",
        "(machine: Machine) -> ...any",
        "runs whenever the state is left; should not wait",
    )
    .optional(),
    value(
        "on",
        Type::Fields,
        "`{event = \"state\"}`, or `{event = function(machine, payload) return \"state\" end}`",
    )
    .optional(),
    value(
        "timeout",
        Type::Fields,
        "`{seconds, \"state\"}`: after this number of seconds in the state",
    )
    .optional(),
];

pub(super) const FSM: Namespace = module(
    "fsm",
    "state machines: the robot is in one state at a time; each state defines what to do in it, and what leads to another state",
    &[call(
        "fsm.new",
        &[options(&[
            text("initial", "the name of the first state"),
            value("states", Type::Named(STATES), "by name"),
        ])
        .required()],
        &[object("machine", &MACHINE, "")],
        "Makes a machine, and checks its states and events at once.",
        "local machine = fsm.new({\n\tinitial = \"rest\",\n\tstates = { rest = { task = function(machine) machine:stop() end } },\n})\nprint(machine:run())",
    )],
    "local fsm = require(\"@spykee/fsm\")\nfsm.new({\n\tinitial = \"search\",\n\tstates = {\n\t\tsearch = {\n\t\t\ttask = function() robot.turn(2 * math.pi) return \"drive\" end,\n\t\t\ton = { battery_low = \"home\" },\n\t\t},\n\t\tdrive = {\n\t\t\ttask = function() robot.forward(1) return \"search\" end,\n\t\t\ttimeout = { 20, \"search\" },\n\t\t},\n\t\thome = { task = function(machine) robot.dock() machine:stop() end },\n\t},\n}):run()",
);

const MACHINE_MADE: &str = "local machine = require(\"@spykee/fsm\").new({ initial = \"rest\", states = { rest = { task = function(machine) machine:stop() end } } })";

pub(super) const MACHINE: Object = open(
    "Machine",
    "A state machine; made by `fsm.new`.",
    &[STATE],
    &[
        call(
            "machine:run",
            &[],
            &[STATE],
            "Runs until `machine:stop()`, and returns the last state.",
            MACHINE_MADE,
        )
        .waiting(),
        call(
            "machine:go",
            &[STATE],
            &[],
            "Changes to another state; of several requests the first one counts.",
            MACHINE_MADE,
        ),
        call(
            "machine:stop",
            &[],
            &[],
            "Ends the machine: `exit` of the current state runs, and no other state is entered.",
            MACHINE_MADE,
        ),
    ],
);
