//! `@spykee/pid`: PID controllers.

use super::shapes::module;
use crate::api::make::{call, number, object, open, options};
use crate::api::model::{Namespace, Object};

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
