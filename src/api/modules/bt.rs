//! `@spykee/bt`: behaviour trees.

use super::shapes::{OK, module};
use crate::api::bounds::{Bounds, SECONDS};
use crate::api::make::{bounded, call, function, number, options, text, value};
use crate::api::model::{Namespace, Type, Value};

const NODE: Value = function("node", "(...any) -> boolean", "returns true or false");
const NODES: &str = "nodes";
const MADE: &[Value] = &[function("node", "(...any) -> boolean", "a node")];
const TIMES: Value = value(
    "times",
    Type::Number(Some(Bounds::Between(1.0, 1e9))),
    "the largest number of runs",
);

pub(super) const BT: Namespace = module(
    "bt",
    "behaviour trees: a node is a function that does something, waits as long as it needs, and returns true (success) or false (failure); nodes are built from other nodes, and halting a node waits until it has ended",
    &[
        call(
            "bt.run",
            &[NODE],
            OK,
            "Runs a tree once.",
            "print(bt.run(function() return true end))",
        )
        .with_rest("arguments for every node")
        .waiting(),
        call(
            "bt.action",
            &[options(&[
                function("run", "(...any) -> boolean", "the node"),
                function(
                    "halt",
                    "(...any) -> ...any",
                    "runs when the node is interrupted; should not wait",
                ),
            ])
            .required()],
            MADE,
            "Makes a node that is notified when it is interrupted.",
            "local drive = bt.action({\n\trun = function() return (robot.forward(1)) end,\n\thalt = function() robot.stop() end,\n})\nprint(bt.run(drive))",
        ),
        call(
            "bt.sequence",
            &[NODE],
            MADE,
            "Runs nodes one after another until one fails; true if none does.",
            "print(bt.run(bt.sequence(function() return true end)))",
        )
        .with_rest(NODES),
        call(
            "bt.fallback",
            &[NODE],
            MADE,
            "Runs nodes one after another until one succeeds; false if none does.",
            "print(bt.run(bt.fallback(function() return true end)))",
        )
        .with_rest(NODES),
        call(
            "bt.parallel",
            &[
                options(&[
                    number(
                        "succeed",
                        "how many successes make it succeed; default: all",
                    )
                    .optional(),
                    number("fail", "how many failures make it fail").default(1.0),
                ])
                .required(),
                NODE,
            ],
            MADE,
            "Runs nodes in parallel until enough have succeeded or failed, then halts the others.",
            "print(bt.run(bt.parallel({ succeed = 1 }, function() return true end)))",
        )
        .with_rest(NODES),
        call(
            "bt.guard",
            &[
                function("condition", "(...any) -> boolean", "returns true or false"),
                NODE,
                bounded(
                    "seconds",
                    Bounds::Above(0.0, 30.0 * 86_400.0),
                    "the period of the tests",
                )
                .unit("s")
                .default(0.1),
            ],
            MADE,
            "Runs a node while a condition is true. The condition is tested first and then periodically; as soon as it is false, the node is halted and the guard fails.",
            "print(bt.run(bt.guard(function() return true end, function() return true end)))",
        ),
        call(
            "bt.retry",
            &[TIMES, NODE],
            MADE,
            "Runs a node until it succeeds, at most this many times.",
            "print(bt.run(bt.retry(3, function() return true end)))",
        ),
        call(
            "bt.loop",
            &[TIMES, NODE],
            MADE,
            "Runs a node this many times, or until it fails.",
            "print(bt.run(bt.loop(3, function() return true end)))",
        ),
        call(
            "bt.timeout",
            &[bounded("seconds", SECONDS, "").unit("s"), NODE],
            MADE,
            "Runs a node. If the node takes longer than this, it is halted and the result is failure.",
            "print(bt.run(bt.timeout(5, function() return true end)))",
        ),
        call(
            "bt.invert",
            &[NODE],
            MADE,
            "Turns success into failure, and failure into success.",
            "print(bt.run(bt.invert(function() return false end)))",
        ),
        call(
            "bt.succeed",
            &[NODE],
            MADE,
            "Runs a node, and succeeds whatever its result.",
            "print(bt.run(bt.succeed(function() return false end)))",
        ),
        call(
            "bt.fail",
            &[NODE],
            MADE,
            "Runs a node, and fails whatever its result.",
            "print(bt.run(bt.fail(function() return true end)))",
        ),
        call(
            "bt.name",
            &[text("name", "a name of your choice"), NODE],
            MADE,
            "Gives a node a name for the log and for errors.",
            "print(bt.run(bt.name(\"the last way\", function() return true end)))",
        ),
    ],
    "local bt = require(\"@spykee/bt\")\nlocal function has_power() local battery = robot.battery() return battery ~= nil and battery.percent > 30 end\nlocal function drive() return (robot.forward(1)) end\nlocal function go_home() return (robot.dock()) end\nlocal tree = bt.fallback(\n\tbt.guard(has_power, bt.timeout(10, drive)),\n\tgo_home\n)\nprint(bt.run(tree))",
);
