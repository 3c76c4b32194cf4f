//! The modules that come with the runtime and are documented for scripts, such as
//! `require("@spykee/bt")`.

use super::choices::DOCK_CODE;
use super::frame::FRAME;
use super::make::{
    boolean, bounded, call, choice, function, number, object, open, options, table, text, value,
};
use super::model::{Availability, Bounds, Function, Namespace, Object, SECONDS, Type, Value};

/// The documented modules. The modules that these use internally, such as `@spykee/compass`, are
/// not documented.
pub(super) const MODULES: [&Namespace; 5] = [&EASY, &FSM, &BT, &PID, &FLOOR];

pub(super) const OBJECTS: [&Object; 7] = [
    &SEEN,
    &MACHINE,
    &CONTROLLER,
    &FREE,
    &MEMORY,
    &FREE_AROUND,
    &BESIDE,
];

pub(super) const OK: &[Value] = &[boolean("ok", "whether it worked")];

pub(super) const fn module(
    name: &'static str,
    about: &'static str,
    functions: &'static [Function],
    example: &'static str,
) -> Namespace {
    Namespace {
        name,
        about,
        availability: Availability::Module,
        functions,
        constants: &[],
        example,
    }
}

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
    "local bt = require(\"@spykee/bt\")\nlocal function has_power() local battery = robot.battery() return battery ~= nil and (battery.percent or 100) > 30 end\nlocal function drive() return (robot.forward(1)) end\nlocal function go_home() return (robot.dock()) end\nlocal tree = bt.fallback(\n\tbt.guard(has_power, bt.timeout(10, drive)),\n\tgo_home\n)\nprint(bt.run(tree))",
);

const SPEED: Value = value("speed", Type::Any, "a number from 1 to 100; default: 50").optional();
const LASTING: Value = value("seconds", Type::Any, "a number, in s; default: 1").optional();
const CENTIMETRES: Value =
    value("centimetres", Type::Any, "a number, in cm; default: 30").optional();
const ANGLE: Value = value("degrees", Type::Any, "a number, in degrees; default: 90").optional();

pub(super) const EASY: Namespace = module(
    "easy",
    "for your first programs: simple calls that take seconds, centimetres and degrees; each line finishes before the next one begins",
    &[
        call(
            "easy.drive",
            &[CENTIMETRES],
            OK,
            "Drives a distance, backwards if negative; a robot on its station leaves it first.",
            "easy.drive(40)",
        )
        .waiting(),
        call(
            "easy.forward",
            &[LASTING, SPEED],
            OK,
            "Drives forwards for a time; a robot on its station leaves it first.",
            "easy.forward(2)",
        )
        .waiting(),
        call(
            "easy.back",
            &[LASTING, SPEED],
            OK,
            "Drives backwards for a time.",
            "easy.back(1, 30)",
        )
        .waiting(),
        call(
            "easy.left",
            &[ANGLE],
            OK,
            "Turns on the spot, to the left.",
            "easy.left(90)",
        )
        .waiting(),
        call(
            "easy.right",
            &[ANGLE],
            OK,
            "Turns on the spot, to the right.",
            "easy.right()",
        )
        .waiting(),
        call("easy.stop", &[], &[], "Stops the tracks.", "easy.stop()"),
        call("easy.wait", &[LASTING], &[], "Waits.", "easy.wait(1)").waiting(),
        call(
            "easy.light",
            &[
                value(
                    "which",
                    Type::Any,
                    "\"left\", \"right\", \"flash\" or \"all\"",
                ),
                value("on", Type::Any, "\"on\" or \"off\"; default: on").optional(),
            ],
            &[],
            "Switches a light; `easy.light(\"on\")` switches all.",
            "easy.light(\"left\", \"on\")",
        ),
        call(
            "easy.sound",
            &[value("name", Type::Choice(crate::api::choices::SOUND), "")],
            &[],
            "Plays a sound.",
            "easy.sound(\"laugh\")",
        ),
        call(
            "easy.see",
            &[crate::api::frame::COLOURS],
            &[object("thing", &SEEN, "nil if there is none").optional()],
            "Finds the largest object of a colour in the next picture.",
            "local thing = easy.see(\"red\")\nif thing then\n\tprint(thing.where, thing.size)\nend",
        )
        .waiting(),
        call(
            "easy.battery",
            &[],
            &[number("percent", "0 to 100; the last level that the robot told").unit("%")],
            "Returns the battery's level.",
            "print(easy.battery())",
        )
        .pure(),
        call(
            "easy.go_home",
            &[],
            OK,
            "Drives to the charging station.",
            "easy.go_home()",
        )
        .waiting(),
        call(
            "easy.leave_home",
            &[],
            OK,
            "Leaves the charging station.",
            "easy.leave_home()",
        )
        .waiting(),
    ],
    "local easy = require(\"@spykee/easy\")\neasy.light(\"left\", \"on\")\neasy.drive(40)\neasy.left(90)\nif easy.see(\"red\") then easy.sound(\"laugh\") end\neasy.go_home()",
);

pub(super) const SEEN: Object = table(
    "Thing",
    "An object that `easy.see` has found.",
    &[
        text("where", "\"left\", \"middle\" or \"right\""),
        number("size", "its share of the picture").unit("%"),
    ],
);

const PICTURE: Value = object("frame", &FRAME, "");

pub(super) const FLOOR: Namespace = module(
    "floor",
    "finds how far the floor in front of the robot is free, from one picture and without a map",
    &[
        call(
            "floor.look",
            &[PICTURE],
            &[object("free", &FREE, "")],
            "Finds the free floor in front of the camera.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(floor.look(frame).ahead)\nend",
        ),
        call(
            "floor.memory",
            &[],
            &[object("memory", &MEMORY, "")],
            "Makes a memory of nearby obstacles. It is needed because the camera does not see what is beside the robot.",
            "local near = floor.memory()\nlocal frame = robot.wait_frame(2)\nif frame then\n\tprint(near:look(frame).beside.left)\nend",
        ),
        call(
            "floor.nearest",
            &[PICTURE],
            &[number("distance", "").unit("m")],
            "Returns the distance from the camera to the nearest floor that the picture shows.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(floor.nearest(frame))\nend",
        ),
        call(
            "floor.leave_station",
            &[boolean("backwards", "the room is to be behind the robot, not ahead").optional()],
            &[
                boolean("ok", "whether it was completed"),
                choice("code", DOCK_CODE, "how it ended"),
            ],
            "Leaves the charging station, as `robot.undock` does, then looks which way is free and turns there if it must: \
             some robots back out of their station, others drive off it forward.",
            "if robot.docked() and floor.leave_station() then\n\trobot.forward(0.5)\nend",
        )
        .waiting(),
        call(
            "floor.drive_on",
            &[
                number("seconds", "").unit("s"),
                number("speed", "").unit("m/s"),
                function("done", "() -> any", "ends the drive when it returns true").optional(),
            ],
            &[],
            "Drives to where there is room, and keeps clear of obstacles.",
            "floor.drive_on(10, 0.2)",
        )
        .waiting(),
        call(
            "floor.texture",
            &[PICTURE],
            &[value("texture", Type::List(&Type::Number(None)), "")],
            "Measures the brightness of small patches of the floor, to be compared with `floor.differs`.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(#floor.texture(frame))\nend",
        ),
        call(
            "floor.differs",
            &[
                value("one", Type::List(&Type::Number(None)), "a texture"),
                value("other", Type::List(&Type::Number(None)), "another"),
            ],
            &[boolean("differ", "")],
            "Returns whether two textures differ, as they do when the robot has moved.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(floor.differs(floor.texture(frame), floor.texture(frame)))\nend",
        ),
    ],
    "local floor = require(\"@spykee/floor\")\nrobot.on(\"frame\", function(frame)\n\tlocal free = floor.look(frame)\n\trobot.drive(if free.ahead > 0.8 then 0.2 else 0, free.turn)\nend)",
);

const HALF: &str = "the least free distance in that half of the picture";
const LEFT: Value = number("left", HALF).unit("m");
const RIGHT: Value = number("right", HALF).unit("m");
const TURN: Value = number(
    "turn",
    "the side with more room, from -1 (right) to 1 (left)",
);

const KNOWN: Value = boolean(
    "known",
    "false if the floor ahead is hidden down to the lower edge of the picture; then `ahead` is 0",
);

pub(super) const FREE: Object = table(
    "Free",
    "The free floor in front of the robot; made by `floor.look`.",
    &[
        number("ahead", "free distance ahead, across the robot's width").unit("m"),
        LEFT,
        RIGHT,
        TURN,
        KNOWN,
    ],
);

pub(super) const MEMORY: Object = open(
    "Memory",
    "Obstacles near the robot, remembered for some seconds after the camera has lost sight of them. Their \
     positions come from `robot.pose()`: call `forget` when you call `robot.reset_pose()`.",
    &[],
    &[
        call(
            "memory:look",
            &[PICTURE],
            &[object("free", &FREE_AROUND, "")],
            "Finds the free floor, and remembers near obstacles. Call it with each frame while the robot drives.",
            "local memory = require(\"@spykee/floor\").memory()\nlocal frame = robot.wait_frame(2)\nif frame then\n\tprint(memory:look(frame).ahead)\nend",
        ),
        call(
            "memory:forget",
            &[],
            &[],
            "Forgets all obstacles: call it after something else has moved the robot.",
            "local memory = require(\"@spykee/floor\").memory()\nmemory:forget()",
        ),
    ],
);

pub(super) const FREE_AROUND: Object = table(
    "FreeAround",
    "The free floor, also considering the remembered obstacles; made by `memory:look`.",
    &[
        number(
            "ahead",
            "free distance ahead, across the robot's width, considering seen and remembered obstacles",
        )
        .unit("m"),
        LEFT,
        RIGHT,
        TURN,
        KNOWN,
        object(
            "beside",
            &BESIDE,
            "the sides to which the robot must not turn",
        ),
    ],
);

pub(super) const BESIDE: Object = table(
    "Beside",
    "The sides on which something is beside the robot.",
    &[boolean("left", ""), boolean("right", "")],
);

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

pub(super) const PID: Namespace = module(
    "pid",
    "PID controllers, which keep a value at its setpoint: a distance, a bearing, a sound level",
    &[call(
        "pid.new",
        &[options(&[
            number("kp", "gain of the error").default(0.0),
            number("ki", "gain of the integral of the error, per second").default(0.0),
            number("kd", "gain of the measurement's rate of change, in seconds").default(0.0),
            number("setpoint", "the target value").default(0.0),
            number("min", "lower limit of the output").optional(),
            number("max", "upper limit of the output").optional(),
        ])
        .required()],
        &[object("controller", &CONTROLLER, "")],
        "Makes a controller.",
        "local steer = pid.new({ kp = 2, ki = 0.1, min = -1.5, max = 1.5 })\nprint(steer:update(0.3))",
    )],
    "local pid = require(\"@spykee/pid\")\nlocal steer = pid.new({ kp = 2, ki = 0.1, kd = 0.2, min = -1.5, max = 1.5 })\nrobot.on(\"frame\", function(frame)\n\tlocal ball = frame:find_blobs(\"red\")[1]\n\tif ball then\n\t\trobot.drive(0.2, -steer:update(ball.bearing))\n\tend\nend)",
);

pub(super) const CONTROLLER: Object = open(
    "Controller",
    "A PID controller; made by `pid.new`. The integral stops while the output is at its limit and the error would drive it further; the derivative is that of the measurement.",
    &[],
    &[
        call(
            "controller:update",
            &[
                number("measurement", ""),
                number("setpoint", "a new setpoint, used from now on").optional(),
            ],
            &[number("output", "")],
            "Computes the output for a measurement; the time comes from `task.now()`.",
            "local steer = require(\"@spykee/pid\").new({ kp = 2 })\nprint(steer:update(0.3))",
        ),
        call(
            "controller:reset",
            &[],
            &[],
            "Forgets the earlier measurements: call it after a pause.",
            "local steer = require(\"@spykee/pid\").new({ kp = 2 })\nsteer:reset()",
        ),
    ],
);
