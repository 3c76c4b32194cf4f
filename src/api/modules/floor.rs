//! `@spykee/floor`: finds the free floor in front of the robot.

use super::shapes::module;
use crate::api::frame::FRAME;
use crate::api::make::{boolean, call, function, number, object, open, table, value};
use crate::api::model::{Namespace, Object, Type, Value};

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

pub(super) const FREE: Object = table(
    "Free",
    "The free floor in front of the robot; made by `floor.look`.",
    &[
        number("ahead", "free distance ahead, across the robot's width").unit("m"),
        LEFT,
        RIGHT,
        TURN,
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
