//! `@spykee/floor`: what of the floor is free.

use super::shapes::{module, open};
use crate::api::frame::FRAME;
use crate::api::make::{boolean, call, function, number, object, table, value};
use crate::api::terms::{Namespace, Object, Type, Value};

const PICTURE: Value = object("frame", &FRAME, "");

pub(super) const FLOOR: Namespace = module(
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

pub(super) const FREE: Object = table(
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

pub(super) const MEMORY: Object = open(
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
            "Forgets everything: call it after something else has moved the robot.",
            "local memory = require(\"@spykee/floor\").memory()\nmemory:forget()",
        ),
    ],
);

pub(super) const FREE_AROUND: Object = table(
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

pub(super) const BESIDE: Object = table(
    "Beside",
    "On which sides something is beside the robot.",
    &[boolean("left", ""), boolean("right", "")],
);
