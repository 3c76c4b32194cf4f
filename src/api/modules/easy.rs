//! `@spykee/easy`: simple calls for first programs.

use super::shapes::{OK, module};
use crate::api::make::{call, number, object, table, text, value};
use crate::api::model::{Namespace, Object, Type, Value};

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
            &[number("percent", "0 to 100").unit("%")],
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
