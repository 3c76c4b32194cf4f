//! `@spykee/floor`: what of the floor is free.

use super::shapes::module;
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
