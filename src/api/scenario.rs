//! The API of scenarios, in `*_test.lua` files: `scenario`, `expect`, and `sim`, the simulated
//! robot.

use super::make::{
    boolean, bounded, call, count, function, number, object, options, short_text, strict, table,
    text, value, whole,
};
use super::model::{Availability, Bounds, Namespace, Object, SECONDS, Type, Value};

/// The limits of coordinates, in metres, and of headings, in radians.
const FAR: Bounds = Bounds::Between(-1000.0, 1000.0);
const BATTERY: Bounds = Bounds::Between(0.0, 100.0);
/// The longest text, in bytes.
const LONGEST: usize = 64 * 1024;
const TIME: Value = bounded("seconds", SECONDS, "virtual time").unit("s");
const BALL: Value = value("number", Type::Whole(None), "1 is the world's first ball");
const X: Value = bounded("x", FAR, "").unit("m");
const Y: Value = bounded("y", FAR, "").unit("m");

const fn whole_between(name: &'static str, low: f64, high: f64, doc: &'static str) -> Value {
    value(name, Type::Whole(Some(Bounds::Between(low, high))), doc)
}

const SETTING: Value = options(&[
    short_text(
        "world",
        LONGEST,
        "the name of a built-in world, or a YAML file beside the scenario",
    )
    .optional(),
    bounded(
        "battery",
        BATTERY,
        "the battery's level at the start; default: the world's",
    )
    .unit("%")
    .optional(),
    whole_between(
        "seeds",
        1.0,
        10_000.0,
        "how many seeds: the scenario runs once with each seed from 1 to this number",
    )
    .default(1.0),
    bounded(
        "limit",
        Bounds::Between(0.1, 30.0 * 86_400.0),
        "the virtual time after which the scenario fails",
    )
    .unit("s")
    .default(300.0),
    count("points", 1000, "the scenario's points in a lesson").default(1.0),
    bounded(
        "fps",
        Bounds::Between(0.1, 30.0),
        "frames per second of the camera; default: the world's",
    )
    .optional(),
    boolean(
        "may_fail",
        "whether the scenario can succeed although a behaviour fails",
    )
    .default_is(false),
]);

pub(super) const SCENARIO: Namespace = Namespace {
    name: "",
    about: "scenarios, in `*_test.lua` files",
    availability: Availability::Scenario,
    functions: &[
        call(
            "scenario",
            &[
                short_text("name", 200, "unique in its file"),
                SETTING,
                function("fn", "(sim: Sim) -> ()", "the scenario itself; gets `sim`"),
            ],
            &[],
            "Declares a scenario, at the top of the file.",
            "scenario(\"comes home\", { battery = 20 }, function(sim)\n\tsim:run(\"patrol.lua\")\n\texpect(sim:wait_until(function() return sim:docked() end, 600), \"it stays out\")\nend)",
        ),
        call(
            "expect",
            &[
                value(
                    "condition",
                    Type::Any,
                    "anything but nil and false counts as true",
                ),
                value("message", Type::Any, "shown in the report").optional(),
            ],
            &[value("condition", Type::Any, "")],
            "Fails the scenario here unless the condition is true.",
            "expect(1 < 2, \"numbers have changed\")",
        ),
    ],
    constants: &[],
    example: "",
};

const LEDS: Object = table(
    "Leds",
    "The robot's lights: true for each one that is on.",
    &[
        boolean("flash", ""),
        boolean("left", ""),
        boolean("right", ""),
    ],
);

const PLAYED: Object = table(
    "PlayedSound",
    "A sound that the robot was told to play.",
    &[
        text("name", ""),
        number("time", "since the start").unit("s"),
    ],
);

const LOGGED: Object = table(
    "LoggedLine",
    "A line that a behaviour has written.",
    &[
        text("behaviour", "its name"),
        text("level", "debug, info, warn or error"),
        text("text", ""),
        number("time", "since the start").unit("s"),
    ],
);

const POINT: Object = table(
    "Point",
    "A point of the world.",
    &[number("x", "").unit("m"), number("y", "").unit("m")],
);

const POSE: Object = table(
    "Pose",
    "A point of the world and a direction.",
    &[
        number("x", "").unit("m"),
        number("y", "").unit("m"),
        number("heading", "left positive").unit("rad"),
    ],
);

pub(super) const TABLES: [&Object; 5] = [&LEDS, &PLAYED, &LOGGED, &POINT, &POSE];

/// Methods that change the simulation are marked as waiting: the change is made at the simulator's
/// next step.
pub(super) const SIM: Object = strict(
    "Sim",
    "The simulated robot of a scenario, in `*_test.lua` files: `sim`.",
    &[],
    &[
        call(
            "sim:run",
            &[],
            &[],
            "Starts behaviours; without arguments, the behaviour that the scenario's file is named after.",
            "sim:run(\"patrol.lua\", { \"guard.lua\", priority = 5, params = { loud = true } })",
        )
        .with_rest("behaviours, each a file or a table `{ FILE, name =, priority =, restart =, params = {...} }`")
        .waiting(),
        call(
            "sim:stop",
            &[],
            &[],
            "Stops all behaviours as at the end of a run: their `script.on_stop` functions are called. The robot and the stores stay as they are for the next `sim:run()`.",
            "sim:stop()",
        )
        .waiting(),
        call(
            "sim:kill",
            &[],
            &[],
            "Kills all behaviours at once, like a power cut of the computer.",
            "sim:kill()",
        )
        .waiting(),
        call(
            "sim:wait",
            &[TIME],
            &[number("passed", "").unit("s")],
            "Lets virtual time pass.",
            "sim:wait(10)",
        )
        .waiting(),
        call(
            "sim:wait_until",
            &[function("fn", "() -> any", "tested every 0.05 s"), TIME],
            &[boolean("ok", "false after a time-out")],
            "Waits until a function returns something true.",
            "expect(sim:wait_until(function() return sim:docked() end, 60))",
        )
        .waiting(),
        call("sim:time", &[], &[number("seconds", "").unit("s")], "Returns the virtual seconds since the start.", "print(sim:time())").pure(),
        call("sim:seed", &[], &[whole("seed", "")], "Returns the seed of this run of the scenario.", "print(sim:seed())").pure(),
        call(
            "sim:clock",
            &[short_text("date", 40, "in the config's time zone")],
            &[],
            "Sets the date and time; the clock continues from there. A scenario starts at 2026-01-01 09:00 UTC.",
            "sim:clock(\"2026-03-29 01:30\")",
        ),
        call("sim:pose", &[], &[object("pose", &POSE, "")], "Returns the robot's true pose.", "print(sim:pose().x)").pure(),
        call(
            "sim:place",
            &[options(&[
                X,
                Y,
                bounded("heading", FAR, "default: unchanged").unit("rad").optional(),
            ])
            .required()],
            &[],
            "Places the robot somewhere.",
            "sim:place({ x = 1, y = 2, heading = 0 })",
        )
        .waiting(),
        call("sim:ball", &[BALL], &[object("place", &POINT, "")], "Returns the position of a ball of the world.", "print(sim:ball(1).x)").pure(),
        call(
            "sim:place_ball",
            &[BALL, options(&[X, Y]).required()],
            &[],
            "Places a ball of the world somewhere, at rest.",
            "sim:place_ball(1, { x = 1, y = 2 })",
        )
        .waiting(),
        call(
            "sim:battery",
            &[bounded("percent", BATTERY, "sets the level first").unit("%").optional()],
            &[number("percent", "").unit("%")],
            "Returns the battery's level, and can set it.",
            "sim:battery(15)",
        )
        .waiting(),
        call("sim:charging", &[], &[boolean("charging", "")], "Returns whether the battery charges.", "print(sim:charging())").pure(),
        call("sim:docked", &[], &[boolean("docked", "")], "Returns whether the robot is on its charging station.", "print(sim:docked())").pure(),
        call("sim:connected", &[], &[boolean("connected", "")], "Returns whether a client is logged in.", "print(sim:connected())").pure(),
        call("sim:leds", &[], &[object("leds", &LEDS, "")], "Returns which lights are on.", "print(sim:leds().left)").pure(),
        call(
            "sim:sounds",
            &[],
            &[value("sounds", Type::List(&Type::Object(&PLAYED)), "")],
            "Returns the sounds that the robot was told to play.",
            "print(#sim:sounds())",
        )
        .pure(),
        call("sim:photos", &[], &[whole("count", "")], "Returns the number of pictures that the behaviours have saved.", "print(sim:photos())").pure(),
        call("sim:distance", &[], &[number("metres", "").unit("m")], "Returns the distance driven so far.", "print(sim:distance())").pure(),
        call("sim:collisions", &[], &[whole("count", "")], "Returns the number of collisions so far.", "print(sim:collisions())").pure(),
        call(
            "sim:ended",
            &[short_text("name", LONGEST, "the behaviour's name; default: any").optional()],
            &[text("reason", "`done`, `error`, `cpu`, `safety`, ...; nil while it runs").optional()],
            "Returns why a behaviour has ended.",
            "expect(sim:ended() == nil)",
        )
        .pure(),
        call(
            "sim:log",
            &[short_text("text", LONGEST, "text that the lines contain; default: all lines").optional()],
            &[value("lines", Type::List(&Type::Object(&LOGGED)), "")],
            "Returns the lines that behaviours have written.",
            "expect(#sim:log(\"hello\") > 0)",
        )
        .pure(),
        call(
            "sim:noise",
            &[bounded("dbfs", Bounds::Between(-90.0, -3.0), "its loudness").unit("dBFS"), TIME],
            &[],
            "Plays a tone at the microphone.",
            "sim:noise(-10, 0.5)",
        )
        .waiting(),
        call(
            "sim:light",
            &[bounded("factor", Bounds::Between(0.0, 10.0), "1 is the world's own brightness")],
            &[],
            "Multiplies the brightness of all light in the world.",
            "sim:light(0.2)",
        )
        .waiting(),
        call(
            "sim:hide_station",
            &[boolean("hidden", "")],
            &[],
            "Makes the charging station impossible to find (true) or findable again (false).",
            "sim:hide_station(true)",
        )
        .waiting(),
        call(
            "sim:break_charger",
            &[boolean("broken", "")],
            &[],
            "Switches the charging current of the station off (true) or on (false).",
            "sim:break_charger(true)",
        )
        .waiting(),
        call(
            "sim:fault",
            &[value("fault", Type::Fields, "as in the YAML of `spykee sim --faults`")],
            &[],
            "Starts a fault of the network or the robot.",
            "sim:fault({ fault = \"drop\" })",
        )
        .waiting(),
    ],
);
