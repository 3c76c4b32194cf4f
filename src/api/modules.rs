//! The modules that come with the runtime and are documented for scripts, such as
//! `require("@spykee/bt")`.

use super::events::{DOCK_CODE, SOUND};
use super::model::{
    Availability, Bounds, Function, Namespace, Object, SECONDS, Type, Value, boolean, bounded,
    call, choice, function, namespace, number, object, options, table, text, value,
};
use super::vision::{COLOURS, FRAME};

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

const fn module(
    name: &'static str,
    about: &'static str,
    functions: &'static [Function],
) -> Namespace {
    namespace(name, about)
        .functions(functions)
        .available(Availability::Module)
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
        call("bt.run")
            .takes(&[NODE])
            .returns(OK)
            .doc("Runs a tree once.")
            .with_rest("arguments for every node")
            .waiting(),
        call("bt.action")
            .takes(&[options(&[
                function("run", "(...any) -> boolean", "the node"),
                function(
                    "halt",
                    "(...any) -> ...any",
                    "runs when the node is interrupted; should not wait",
                ),
            ])
            .required()])
            .returns(MADE)
            .doc("Makes a node that is notified when it is interrupted."),
        call("bt.sequence")
            .takes(&[NODE])
            .returns(MADE)
            .doc("Runs nodes one after another until one fails; true if none does.")
            .with_rest(NODES),
        call("bt.fallback")
            .takes(&[NODE])
            .returns(MADE)
            .doc("Runs nodes one after another until one succeeds; false if none does.")
            .with_rest(NODES),
        call("bt.parallel")
            .takes(&[
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
            ])
            .returns(MADE)
            .doc("Runs nodes in parallel until enough have succeeded or failed, then halts the others.")
            .with_rest(NODES),
        call("bt.guard")
            .takes(&[
                function("condition", "(...any) -> boolean", "returns true or false"),
                NODE,
                bounded(
                    "seconds",
                    Bounds::Above(0.0, 30.0 * 86_400.0),
                    "the period of the tests",
                )
                .unit("s")
                .default(0.1),
            ])
            .returns(MADE)
            .doc("Runs a node while a condition is true. The condition is tested first and then periodically; as soon as it is false, the node is halted and the guard fails."),
        call("bt.retry")
            .takes(&[TIMES, NODE])
            .returns(MADE)
            .doc("Runs a node until it succeeds, at most this many times."),
        call("bt.loop")
            .takes(&[TIMES, NODE])
            .returns(MADE)
            .doc("Runs a node this many times, or until it fails."),
        call("bt.timeout")
            .takes(&[bounded("seconds", SECONDS, "").unit("s"), NODE])
            .returns(MADE)
            .doc("Runs a node. If the node takes longer than this, it is halted and the result is failure."),
        call("bt.invert")
            .takes(&[NODE])
            .returns(MADE)
            .doc("Turns success into failure, and failure into success."),
        call("bt.succeed")
            .takes(&[NODE])
            .returns(MADE)
            .doc("Runs a node, and succeeds whatever its result."),
        call("bt.fail")
            .takes(&[NODE])
            .returns(MADE)
            .doc("Runs a node, and fails whatever its result."),
        call("bt.name")
            .takes(&[text("name", "a name of your choice"), NODE])
            .returns(MADE)
            .doc("Gives a node a name for the log and for errors."),
    ],
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
        call("easy.drive")
            .takes(&[CENTIMETRES])
            .returns(OK)
            .doc(
                "Drives a distance, backwards if negative; a robot on its station leaves it first.",
            )
            .waiting(),
        call("easy.forward")
            .takes(&[LASTING, SPEED])
            .returns(OK)
            .doc("Drives forwards for a time; a robot on its station leaves it first.")
            .waiting(),
        call("easy.back")
            .takes(&[LASTING, SPEED])
            .returns(OK)
            .doc("Drives backwards for a time.")
            .waiting(),
        call("easy.left")
            .takes(&[ANGLE])
            .returns(OK)
            .doc("Turns on the spot, to the left.")
            .waiting(),
        call("easy.right")
            .takes(&[ANGLE])
            .returns(OK)
            .doc("Turns on the spot, to the right.")
            .waiting(),
        call("easy.stop").doc("Stops the tracks."),
        call("easy.wait").takes(&[LASTING]).doc("Waits.").waiting(),
        call("easy.light")
            .takes(&[
                value(
                    "which",
                    Type::Any,
                    "\"left\", \"right\", \"flash\" or \"all\"",
                ),
                value("on", Type::Any, "\"on\" or \"off\"; default: on").optional(),
            ])
            .doc("Switches a light; `easy.light(\"on\")` switches all."),
        call("easy.sound")
            .takes(&[choice("name", SOUND, "")])
            .doc("Plays a sound."),
        call("easy.see")
            .takes(&[COLOURS])
            .returns(&[object("thing", &SEEN, "nil if there is none").optional()])
            .doc("Finds the largest object of a colour in the next picture.")
            .waiting(),
        call("easy.battery")
            .returns(&[number("percent", "0 to 100; the last level that the robot told").unit("%")])
            .doc("Returns the battery's level.")
            .pure(),
        call("easy.go_home")
            .returns(OK)
            .doc("Drives to the charging station.")
            .waiting(),
        call("easy.leave_home")
            .returns(OK)
            .doc("Leaves the charging station.")
            .waiting(),
    ],
);

pub(super) const SEEN: Object = table("Thing")
    .doc("An object that `easy.see` has found.")
    .fields(&[
        text("where", "\"left\", \"middle\" or \"right\""),
        number("size", "its share of the picture").unit("%"),
    ]);

const PICTURE: Value = object("frame", &FRAME, "");

pub(super) const FLOOR: Namespace = module(
    "floor",
    "finds how far the floor in front of the robot is free, from one picture and without a map",
    &[
        call("floor.look")
            .takes(&[PICTURE])
            .returns(&[object("free", &FREE, "")])
            .doc("Finds the free floor in front of the camera."),
        call("floor.memory")
            .returns(&[object("memory", &MEMORY, "")])
            .doc("Makes a memory of nearby obstacles. It is needed because the camera does not see what is beside the robot."),
        call("floor.nearest")
            .takes(&[PICTURE])
            .returns(&[number("distance", "").unit("m")])
            .doc("Returns the distance from the camera to the nearest floor that the picture shows."),
        call("floor.leave_station")
            .takes(&[boolean("backwards", "the room is to be behind the robot, not ahead").optional()])
            .returns(&[
                boolean("ok", "whether it was completed"),
                choice("code", DOCK_CODE, "how it ended"),
            ])
            .doc("Leaves the charging station, as `robot.undock` does, then looks which way is free and turns there if it must: \
             some robots back out of their station, others drive off it forward.")
            .waiting(),
        call("floor.drive_on")
            .takes(&[
                number("seconds", "").unit("s"),
                number("speed", "").unit("m/s"),
                function("done", "() -> any", "ends the drive when it returns true").optional(),
            ])
            .doc("Drives to where there is room, and keeps clear of obstacles.")
            .waiting(),
        call("floor.texture")
            .takes(&[PICTURE])
            .returns(&[value("texture", Type::List(&Type::Number(None)), "")])
            .doc("Measures the brightness of small patches of the floor, to be compared with `floor.differs`."),
        call("floor.differs")
            .takes(&[
                value("one", Type::List(&Type::Number(None)), "a texture"),
                value("other", Type::List(&Type::Number(None)), "another"),
            ])
            .returns(&[boolean("differ", "")])
            .doc("Returns whether two textures differ, as they do when the robot has moved."),
    ],
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

pub(super) const FREE: Object = table("Free")
    .doc("The free floor in front of the robot; made by `floor.look`.")
    .fields(&[
        number("ahead", "free distance ahead, across the robot's width").unit("m"),
        LEFT,
        RIGHT,
        TURN,
        KNOWN,
    ]);

pub(super) const MEMORY: Object = table("Memory")
    .doc("Obstacles near the robot, remembered for some seconds after the camera has lost sight of them. Their \
     positions come from `robot.pose()`: call `forget` when you call `robot.reset_pose()`.")
    .methods(&[
        call("memory:look")
            .takes(&[PICTURE])
            .returns(&[object("free", &FREE_AROUND, "")])
            .doc("Finds the free floor, and remembers near obstacles. Call it with each frame while the robot drives."),
        call("memory:forget")
            .doc("Forgets all obstacles: call it after something else has moved the robot."),
    ]);

pub(super) const FREE_AROUND: Object = table("FreeAround")
    .doc("The free floor, also considering the remembered obstacles; made by `memory:look`.")
    .fields(&[
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
    ]);

pub(super) const BESIDE: Object = table("Beside")
    .doc("The sides on which something is beside the robot.")
    .fields(&[boolean("left", ""), boolean("right", "")]);

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
    &[call("fsm.new")
        .takes(&[options(&[
            text("initial", "the name of the first state"),
            value("states", Type::Named(STATES), "by name"),
        ])
        .required()])
        .returns(&[object("machine", &MACHINE, "")])
        .doc("Makes a machine, and checks its states and events at once.")],
);

pub(super) const MACHINE: Object = table("Machine")
    .doc("A state machine; made by `fsm.new`.")
    .fields(&[STATE])
    .methods(&[
        call("machine:run")
            .returns(&[STATE])
            .doc("Runs until `machine:stop()`, and returns the last state.")
            .waiting(),
        call("machine:go")
            .takes(&[STATE])
            .doc("Changes to another state; of several requests the first one counts."),
        call("machine:stop").doc(
            "Ends the machine: `exit` of the current state runs, and no other state is entered.",
        ),
    ]);

pub(super) const PID: Namespace = module(
    "pid",
    "PID controllers, which keep a value at its setpoint: a distance, a bearing, a sound level",
    &[call("pid.new")
        .takes(&[options(&[
            number("kp", "gain of the error").default(0.0),
            number("ki", "gain of the integral of the error, per second").default(0.0),
            number("kd", "gain of the measurement's rate of change, in seconds").default(0.0),
            number("setpoint", "the target value").default(0.0),
            number("min", "lower limit of the output").optional(),
            number("max", "upper limit of the output").optional(),
        ])
        .required()])
        .returns(&[object("controller", &CONTROLLER, "")])
        .doc("Makes a controller.")],
);

pub(super) const CONTROLLER: Object = table("Controller")
    .doc("A PID controller; made by `pid.new`. The integral stops while the output is at its limit and the error would drive it further; the derivative is that of the measurement.")
    .methods(&[
        call("controller:update")
            .takes(&[
                number("measurement", ""),
                number("setpoint", "a new setpoint, used from now on").optional(),
            ])
            .returns(&[number("output", "")])
            .doc("Computes the output for a measurement; the time comes from `task.now()`."),
        call("controller:reset").doc("Forgets the earlier measurements: call it after a pause."),
    ]);
