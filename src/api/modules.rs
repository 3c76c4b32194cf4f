//! The modules that come with the runtime and are documented for scripts: `require("@spykee/bt")`
//! and its like.

use super::bounds::Bounds;
use super::frame::FRAME;
use super::terms::{
    Function, Namespace, Object, Place, Type, Value, boolean, bounded, call, function, number,
    object, options, table, text, value,
};

const NODE: Value = function("node", "(...any) -> boolean", "returns true or false");
const NODES: &str = "nodes";
const MADE: &[Value] = &[function("node", "(...any) -> boolean", "a node")];
const OK: &[Value] = &[boolean("ok", "whether it worked")];
const TIMES: Value = value(
    "times",
    Type::Number(Some(Bounds::Between(1.0, 1e9))),
    "how often at most",
);

const fn module(
    name: &'static str,
    about: &'static str,
    functions: &'static [Function],
    example: &'static str,
) -> Namespace {
    Namespace {
        name,
        about,
        place: Place::Module,
        functions,
        constants: &[],
        example,
    }
}

/// An object that scripts may keep values of their own in.
const fn open(
    name: &'static str,
    doc: &'static str,
    fields: &'static [Value],
    methods: &'static [Function],
) -> Object {
    Object {
        methods,
        ..table(name, doc, fields)
    }
}

const BT: Namespace = module(
    "bt",
    "behaviour trees: a node is a function that does something, waits as long as it needs, and returns true (success) or false (failure); nodes are built of nodes, and halting a node is awaited",
    &[
        call(
            "bt.run",
            &[NODE],
            OK,
            "Runs a tree once.",
            "print(bt.run(function() return true end))",
        )
        .and("handed to every node")
        .waiting(),
        call(
            "bt.action",
            &[options(&[
                function("run", "(...any) -> boolean", "the node"),
                function(
                    "halt",
                    "(...any) -> ...any",
                    "runs when the node is cut short; should not wait",
                ),
            ])
            .required()],
            MADE,
            "A node that is told when it is cut short.",
            "local drive = bt.action({\n\trun = function() return (robot.forward(1)) end,\n\thalt = function() robot.stop() end,\n})\nprint(bt.run(drive))",
        ),
        call(
            "bt.sequence",
            &[NODE],
            MADE,
            "Runs one node after the other until one fails; true if none does.",
            "print(bt.run(bt.sequence(function() return true end)))",
        )
        .and(NODES),
        call(
            "bt.fallback",
            &[NODE],
            MADE,
            "Runs one node after the other until one succeeds; false if none does.",
            "print(bt.run(bt.fallback(function() return true end)))",
        )
        .and(NODES),
        call(
            "bt.parallel",
            &[
                options(&[
                    number("succeed", "so many must succeed; all unless given").optional(),
                    number("fail", "so many may not fail").default(1.0),
                ])
                .required(),
                NODE,
            ],
            MADE,
            "Runs nodes side by side until enough have succeeded or failed; the others are halted.",
            "print(bt.run(bt.parallel({ succeed = 1 }, function() return true end)))",
        )
        .and(NODES),
        call(
            "bt.guard",
            &[
                function("condition", "(...any) -> boolean", "returns true or false"),
                NODE,
                bounded(
                    "seconds",
                    Bounds::Above(0.0, 30.0 * 86_400.0),
                    "from one look at the condition to the next",
                )
                .unit("s")
                .default(0.1),
            ],
            MADE,
            "Runs a node while a condition is true, which is asked before and over and over; once it is false the node is halted and has failed.",
            "print(bt.run(bt.guard(function() return true end, function() return true end)))",
        ),
        call(
            "bt.retry",
            &[TIMES, NODE],
            MADE,
            "Runs a node until it succeeds.",
            "print(bt.run(bt.retry(3, function() return true end)))",
        ),
        call(
            "bt.loop",
            &[TIMES, NODE],
            MADE,
            "Runs a node so often, or until it fails.",
            "print(bt.run(bt.loop(3, function() return true end)))",
        ),
        call(
            "bt.timeout",
            &[
                bounded("seconds", Bounds::Between(0.0, f64::MAX), "").unit("s"),
                NODE,
            ],
            MADE,
            "Fails if the node takes longer, and halts it.",
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
            "Runs a node and succeeds in any case.",
            "print(bt.run(bt.succeed(function() return false end)))",
        ),
        call(
            "bt.fail",
            &[NODE],
            MADE,
            "Runs a node and fails in any case.",
            "print(bt.run(bt.fail(function() return true end)))",
        ),
        call(
            "bt.name",
            &[text("name", "a name of your own"), NODE],
            MADE,
            "Gives a node a name for the log and for errors.",
            "print(bt.run(bt.name(\"the last way\", function() return true end)))",
        ),
    ],
    "local bt = require(\"@spykee/bt\")\nlocal function has_power() local battery = robot.battery() return battery ~= nil and battery.percent > 30 end\nlocal function drive() return (robot.forward(1)) end\nlocal function go_home() return (robot.dock()) end\nlocal tree = bt.fallback(\n\tbt.guard(has_power, bt.timeout(10, drive)),\n\tgo_home\n)\nprint(bt.run(tree))",
);

const SPEED: Value = value("speed", Type::Any, "from 1 to 100").optional();
const LASTING: Value = value("seconds", Type::Any, "1 unless given").optional();
const CENTIMETRES: Value = value("centimetres", Type::Any, "30 unless given").optional();
const ANGLE: Value = value("degrees", Type::Any, "90 unless given").optional();

const EASY: Namespace = module(
    "easy",
    "for your first programs: plain words, seconds, centimetres and degrees; each line is over before the next one begins",
    &[
        call(
            "easy.drive",
            &[CENTIMETRES],
            OK,
            "Drives so far, backwards if it is less than 0; on its station the robot leaves it first.",
            "easy.drive(40)",
        )
        .waiting(),
        call(
            "easy.forward",
            &[LASTING, SPEED],
            OK,
            "Drives ahead; on its station the robot leaves it first.",
            "easy.forward(2)",
        )
        .waiting(),
        call(
            "easy.back",
            &[LASTING, SPEED],
            OK,
            "Drives back.",
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
        call("easy.stop", &[], &[], "Stands still.", "easy.stop()"),
        call(
            "easy.wait",
            &[LASTING],
            &[],
            "Does nothing for a while.",
            "easy.wait(1)",
        )
        .waiting(),
        call(
            "easy.light",
            &[
                value(
                    "which",
                    Type::Any,
                    "\"left\", \"right\", \"flash\" or \"all\"",
                ),
                value("on", Type::Any, "\"on\" or \"off\"; on unless given").optional(),
            ],
            &[],
            "Switches a light; `easy.light(\"on\")` means all.",
            "easy.light(\"left\", \"on\")",
        ),
        call(
            "easy.sound",
            &[value("name", Type::Choice(super::choices::SOUND), "")],
            &[],
            "Plays a sound.",
            "easy.sound(\"laugh\")",
        ),
        call(
            "easy.see",
            &[super::frame::COLOURS],
            &[object("thing", &SEEN, "nil if there is none").optional()],
            "The biggest thing of a colour in the next picture.",
            "local thing = easy.see(\"red\")\nif thing then\n\tprint(thing.where, thing.size)\nend",
        )
        .waiting(),
        call(
            "easy.battery",
            &[],
            &[number("percent", "0 to 100").unit("%")],
            "How full the battery is.",
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

const SEEN: Object = table(
    "Thing",
    "What `easy.see` has found.",
    &[
        text("where", "\"left\", \"middle\" or \"right\""),
        number("size", "how much of the picture it fills").unit("%"),
    ],
);

const STATE: Value = text("state", "its name");
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
        "runs then; the machine goes to the state whose name it returns",
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
        "`{seconds, \"state\"}`: after so many seconds in the state",
    )
    .optional(),
];

const FSM: Namespace = module(
    "fsm",
    "state machines: the robot is in one state at a time; each says what is done in it and what leads to another",
    &[call(
        "fsm.new",
        &[options(&[
            text("initial", "the name of the first state"),
            value("states", Type::Named(STATES), "by name"),
        ])
        .required()],
        &[object("machine", &MACHINE, "")],
        "Makes a machine; its states and events are checked at once.",
        "local machine = fsm.new({\n\tinitial = \"rest\",\n\tstates = { rest = { task = function(machine) machine:stop() end } },\n})\nprint(machine:run())",
    )],
    "local fsm = require(\"@spykee/fsm\")\nfsm.new({\n\tinitial = \"search\",\n\tstates = {\n\t\tsearch = {\n\t\t\ttask = function() robot.turn(2 * math.pi) return \"drive\" end,\n\t\t\ton = { battery_low = \"home\" },\n\t\t},\n\t\tdrive = {\n\t\t\ttask = function() robot.forward(1) return \"search\" end,\n\t\t\ttimeout = { 20, \"search\" },\n\t\t},\n\t\thome = { task = function(machine) robot.dock() machine:stop() end },\n\t},\n}):run()",
);

const MACHINE_MADE: &str = "local machine = require(\"@spykee/fsm\").new({ initial = \"rest\", states = { rest = { task = function(machine) machine:stop() end } } })";

const MACHINE: Object = open(
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
            "Changes to another state; the first one asked for counts.",
            MACHINE_MADE,
        ),
        call(
            "machine:stop",
            &[],
            &[],
            "Ends the machine: `exit` of its state runs, and no `enter` any more.",
            MACHINE_MADE,
        ),
    ],
);

const PID: Namespace = module(
    "pid",
    "PID controllers, for \"keep this at that\": a distance, a bearing, a level of sound",
    &[call(
        "pid.new",
        &[options(&[
            number("kp", "for the error").default(0.0),
            number("ki", "for the sum of error times seconds").default(0.0),
            number("kd", "for the change of the measurement a second").default(0.0),
            number("setpoint", "what is wanted").default(0.0),
            number("min", "the least output").optional(),
            number("max", "the greatest output").optional(),
        ])
        .required()],
        &[object("controller", &CONTROLLER, "")],
        "Makes a controller.",
        "local steer = pid.new({ kp = 2, ki = 0.1, min = -1.5, max = 1.5 })\nprint(steer:update(0.3))",
    )],
    "local pid = require(\"@spykee/pid\")\nlocal steer = pid.new({ kp = 2, ki = 0.1, kd = 0.2, min = -1.5, max = 1.5 })\nrobot.on(\"frame\", function(frame)\n\tlocal ball = frame:find_blobs(\"red\")[1]\n\tif ball then\n\t\trobot.drive(0.2, -steer:update(ball.bearing))\n\tend\nend)",
);

const CONTROLLER: Object = open(
    "Controller",
    "A PID controller; made by `pid.new`. The sum stands still while the output is at its limit and the error would drive it further; the derivative is that of the measurement.",
    &[],
    &[
        call(
            "controller:update",
            &[
                number("measurement", ""),
                number("setpoint", "from now on").optional(),
            ],
            &[number("output", "")],
            "Computes what to do about a measurement; the time comes from `task.now()`.",
            "local steer = require(\"@spykee/pid\").new({ kp = 2 })\nprint(steer:update(0.3))",
        ),
        call(
            "controller:reset",
            &[],
            &[],
            "Forgets the past: call it after a pause.",
            "local steer = require(\"@spykee/pid\").new({ kp = 2 })\nsteer:reset()",
        ),
    ],
);

const PICTURE: Value = object("frame", &FRAME, "");

const FLOOR: Namespace = module(
    "floor",
    "sees how far the floor before the robot is free, in one picture, without knowing the room",
    &[
        call(
            "floor.look",
            &[PICTURE],
            &[object("free", &FREE, "")],
            "What is free before the camera.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(floor.look(frame).ahead)\nend",
        ),
        call(
            "floor.memory",
            &[],
            &[object("memory", &MEMORY, "")],
            "Makes a memory of what stands near: a camera does not see what is beside the robot.",
            "local near = floor.memory()\nlocal frame = robot.wait_frame(2)\nif frame then\n\tprint(near:look(frame).beside.left)\nend",
        ),
        call(
            "floor.nearest",
            &[PICTURE],
            &[number("distance", "").unit("m")],
            "How near before the camera the picture begins to show the floor.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(floor.nearest(frame))\nend",
        ),
        call(
            "floor.drive_on",
            &[
                number("seconds", "").unit("s"),
                number("speed", "").unit("m/s"),
                function("done", "() -> any", "ends it when it answers true").optional(),
            ],
            &[],
            "Drives to where there is room.",
            "floor.drive_on(10, 0.2)",
        )
        .waiting(),
        call(
            "floor.texture",
            &[PICTURE],
            &[value("texture", Type::List(&Type::Number(None)), "")],
            "What the floor looks like.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(#floor.texture(frame))\nend",
        ),
        call(
            "floor.differs",
            &[
                value("one", Type::List(&Type::Number(None)), "a texture"),
                value("other", Type::List(&Type::Number(None)), "another"),
            ],
            &[boolean("differ", "")],
            "Whether two textures differ: they do when the robot has moved.",
            "local frame = robot.wait_frame(2)\nif frame then\n\tprint(floor.differs(floor.texture(frame), floor.texture(frame)))\nend",
        ),
    ],
    "local floor = require(\"@spykee/floor\")\nrobot.on(\"frame\", function(frame)\n\tlocal free = floor.look(frame)\n\trobot.drive(if free.ahead > 0.8 then 0.2 else 0, free.turn)\nend)",
);

const FREE: Object = table(
    "Free",
    "What `floor.look` sees.",
    &[
        number("ahead", "as wide as the robot").unit("m"),
        number("left", "the least in that half of the picture").unit("m"),
        number("right", "the least in that half of the picture").unit("m"),
        number(
            "turn",
            "from -1, more room to the right, to 1, more to the left",
        ),
    ],
);

const MEMORY: Object = open(
    "Memory",
    "What stands near the robot, for some seconds also where its camera does not look any more. Places are those of \
     `robot.pose()`: let it forget when you call `robot.reset_pose()`.",
    &[],
    &[
        call(
            "memory:look",
            &[PICTURE],
            &[object("free", &FREE_AROUND, "")],
            "What is free; look at each frame while the robot drives.",
            "local memory = require(\"@spykee/floor\").memory()\nlocal frame = robot.wait_frame(2)\nif frame then\n\tprint(memory:look(frame).ahead)\nend",
        ),
        call(
            "memory:forget",
            &[],
            &[],
            "Forgets all: after somebody else has moved the robot.",
            "local memory = require(\"@spykee/floor\").memory()\nmemory:forget()",
        ),
    ],
);

const FREE_AROUND: Object = table(
    "FreeAround",
    "What `memory:look` sees and remembers.",
    &[
        number(
            "ahead",
            "as wide as the robot, up to what is seen or remembered",
        )
        .unit("m"),
        number("left", "the least in that half of the picture").unit("m"),
        number("right", "the least in that half of the picture").unit("m"),
        number(
            "turn",
            "from -1, more room to the right, to 1, more to the left",
        ),
        object("beside", &BESIDE, "where the robot must not bend to"),
    ],
);

const BESIDE: Object = table(
    "Beside",
    "On which sides something is beside the robot.",
    &[boolean("left", ""), boolean("right", "")],
);

/// Those that are documented. What they are made of, such as `@spykee/compass`, is not.
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
