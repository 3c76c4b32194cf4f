//! `@spykee/easy`: plain words for first programs.

use super::shapes::{OK, module};
use crate::api::make::{call, number, object, table, text, value};
use crate::api::terms::{Namespace, Object, Type, Value};

const SPEED: Value = value("speed", Type::Any, "from 1 to 100").optional();
const LASTING: Value = value("seconds", Type::Any, "1 unless given").optional();
const CENTIMETRES: Value = value("centimetres", Type::Any, "30 unless given").optional();
const ANGLE: Value = value("degrees", Type::Any, "90 unless given").optional();

pub(super) const EASY: Namespace = module(
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
            &[value("name", Type::Choice(crate::api::choices::SOUND), "")],
            &[],
            "Plays a sound.",
            "easy.sound(\"laugh\")",
        ),
        call(
            "easy.see",
            &[crate::api::frame::COLOURS],
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

pub(super) const SEEN: Object = table(
    "Thing",
    "What `easy.see` has found.",
    &[
        text("where", "\"left\", \"middle\" or \"right\""),
        number("size", "how much of the picture it fills").unit("%"),
    ],
);
