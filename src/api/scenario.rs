//! What scripts of scenarios can call, in `*_test.lua` files: `scenario`, `expect`, and `sim`, the
//! simulated robot.

use super::bounds::{Bounds, SECONDS};
use super::make::{
    boolean, bounded, call, count, function, number, object, options, short_text, strict, table,
    text, value, whole,
};
use super::terms::{Availability, Namespace, Object, Type, Value};

/// Places are no farther away than this, in metres; headings, in radians.
const FAR: Bounds = Bounds::Between(-1000.0, 1000.0);
const BATTERY: Bounds = Bounds::Between(0.0, 100.0);
/// Bytes of a text.
const LONGEST: usize = 64 * 1024;
const TIME: Value = bounded("seconds", SECONDS, "virtual time").unit("s");
const BALL: Value = value("number", Type::Whole(None), "1 is the world's first ball");
const X: Value = bounded("x", FAR, "").unit("m");
const Y: Value = bounded("y", FAR, "").unit("m");

const fn whole_between(name: &'static str, low: f64, high: f64, doc: &'static str) -> Value {
    value(name, Type::Whole(Some(Bounds::Between(low, high))), doc)
}

/// How a scenario is set up.
const SETTING: Value = options(&[
    short_text(
        "world",
        LONGEST,
        "a ready world's name, or a YAML file beside the scenario",
    )
    .optional(),
    bounded(
        "battery",
        BATTERY,
        "its level at the start; the world's unless given",
    )
    .unit("%")
    .optional(),
    whole_between(
        "seeds",
        1.0,
        10_000.0,
        "it is played with the seeds from 1 to this",
    )
    .default(1.0),
    bounded(
        "limit",
        Bounds::Between(0.1, 30.0 * 86_400.0),
        "virtual time that it may take",
    )
    .unit("s")
    .default(300.0),
    count("points", 1000, "what it counts in a lesson").default(1.0),
    bounded(
        "fps",
        Bounds::Between(0.1, 30.0),
        "of the camera; the world's unless given",
    )
    .optional(),
    boolean(
        "may_fail",
        "a behaviour that fails does not fail the scenario",
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
                function("fn", "(sim: Sim) -> ()", "plays it; gets `sim`"),
            ],
            &[],
            "Declares a scenario, at the top of the file.",
            "scenario(\"comes home\", { battery = 20 }, function(sim)\n\tsim:run(\"patrol.lua\")\n\texpect(sim:wait_until(function() return sim:docked() end, 600), \"it stays out\")\nend)",
        ),
        call(
            "expect",
            &[
                value("condition", Type::Any, "anything but nil and false is true"),
                value("message", Type::Any, "what the report says").optional(),
            ],
            &[value("condition", Type::Any, "")],
            "The scenario fails here unless the condition is true.",
            "expect(1 < 2, \"numbers have changed\")",
        ),
    ],
    constants: &[],
    example: "",
};

const LEDS: Object = table(
    "Leds",
    "Which lights are on.",
    &[
        boolean("flash", ""),
        boolean("left", ""),
        boolean("right", ""),
    ],
);

const PLAYED: Object = table(
    "PlayedSound",
    "What the robot was told to play.",
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
    "A place in the world.",
    &[number("x", "").unit("m"), number("y", "").unit("m")],
);

const POSE: Object = table(
    "Pose",
    "A place in the world and a direction.",
    &[
        number("x", "").unit("m"),
        number("y", "").unit("m"),
        number("heading", "left positive").unit("rad"),
    ],
);

pub(super) const TABLES: [&Object; 5] = [&LEDS, &PLAYED, &LOGGED, &POINT, &POSE];

/// Marked as waiting: the change is done at the simulator's next step.
pub(super) const SIM: Object = strict(
    "Sim",
    "The simulated robot of a scenario, in `*_test.lua` files: `sim`.",
    &[],
    &[
        call(
            "sim:run",
            &[],
            &[],
            "Starts behaviours; without any, the one whose name the scenario's file has.",
            "sim:run(\"patrol.lua\", { \"guard.lua\", priority = 5, params = { loud = true } })",
        )
        .and("behaviours, each a file or a table `{ FILE, name =, priority =, restart =, params = {...} }`")
        .waiting(),
        call(
            "sim:stop",
            &[],
            &[],
            "Ends the behaviours in order. The next `sim:run()` finds robot and stores as they are.",
            "sim:stop()",
        )
        .waiting(),
        call(
            "sim:kill",
            &[],
            &[],
            "Ends the behaviours all at once, as a power cut of the computer does.",
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
            &[function("fn", "() -> any", "looked at every 0.05 s"), TIME],
            &[boolean("ok", "false when the time was over")],
            "Waits until a function answers something true.",
            "expect(sim:wait_until(function() return sim:docked() end, 60))",
        )
        .waiting(),
        call("sim:time", &[], &[number("seconds", "").unit("s")], "Virtual seconds since the start.", "print(sim:time())").pure(),
        call("sim:seed", &[], &[whole("seed", "")], "The seed that it is played with.", "print(sim:seed())").pure(),
        call(
            "sim:clock",
            &[short_text("date", 40, "in the config's time zone")],
            &[],
            "Sets the clock on the wall, which goes on from there. It begins at 09:00 of 2026-01-01 in universal time.",
            "sim:clock(\"2026-03-29 01:30\")",
        ),
        call("sim:pose", &[], &[object("pose", &POSE, "")], "Where the robot really is.", "print(sim:pose().x)").pure(),
        call(
            "sim:place",
            &[options(&[
                X,
                Y,
                bounded("heading", FAR, "as before unless given").unit("rad").optional(),
            ])
            .required()],
            &[],
            "Carries the robot somewhere.",
            "sim:place({ x = 1, y = 2, heading = 0 })",
        )
        .waiting(),
        call("sim:ball", &[BALL], &[object("place", &POINT, "")], "Where a ball of the world is.", "print(sim:ball(1).x)").pure(),
        call(
            "sim:place_ball",
            &[BALL, options(&[X, Y]).required()],
            &[],
            "Puts a ball of the world somewhere, at rest.",
            "sim:place_ball(1, { x = 1, y = 2 })",
        )
        .waiting(),
        call(
            "sim:battery",
            &[bounded("percent", BATTERY, "sets it first").unit("%").optional()],
            &[number("percent", "").unit("%")],
            "The battery's level.",
            "sim:battery(15)",
        )
        .waiting(),
        call("sim:charging", &[], &[boolean("charging", "")], "Whether the battery charges.", "print(sim:charging())").pure(),
        call("sim:docked", &[], &[boolean("docked", "")], "Whether the robot stands on its charging station.", "print(sim:docked())").pure(),
        call("sim:connected", &[], &[boolean("connected", "")], "Whether someone is logged in.", "print(sim:connected())").pure(),
        call("sim:leds", &[], &[object("leds", &LEDS, "")], "Which lights are on.", "print(sim:leds().left)").pure(),
        call(
            "sim:sounds",
            &[],
            &[value("sounds", Type::List(&Type::Object(&PLAYED)), "")],
            "What the robot was told to play.",
            "print(#sim:sounds())",
        )
        .pure(),
        call("sim:photos", &[], &[whole("count", "")], "How many pictures the behaviours have saved.", "print(sim:photos())").pure(),
        call("sim:distance", &[], &[number("metres", "").unit("m")], "The way driven so far.", "print(sim:distance())").pure(),
        call("sim:collisions", &[], &[whole("count", "")], "How often the robot ran into something.", "print(sim:collisions())").pure(),
        call(
            "sim:ended",
            &[short_text("name", LONGEST, "of a behaviour; any unless given").optional()],
            &[text("reason", "`done`, `error`, `cpu`, `safety`, ...; nil while it runs").optional()],
            "Why a behaviour has ended.",
            "expect(sim:ended() == nil)",
        )
        .pure(),
        call(
            "sim:log",
            &[short_text("text", LONGEST, "what the lines contain").optional()],
            &[value("lines", Type::List(&Type::Object(&LOGGED)), "")],
            "The lines that behaviours have written.",
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
            &[bounded("factor", Bounds::Between(0.0, 10.0), "1 is the world's")],
            &[],
            "Multiplies the brightness of all light in the world.",
            "sim:light(0.2)",
        )
        .waiting(),
        call(
            "sim:hide_station",
            &[boolean("hidden", "")],
            &[],
            "The charging station cannot be found.",
            "sim:hide_station(true)",
        )
        .waiting(),
        call(
            "sim:break_charger",
            &[boolean("broken", "")],
            &[],
            "The charging station has no current.",
            "sim:break_charger(true)",
        )
        .waiting(),
        call(
            "sim:fault",
            &[value("fault", Type::Fields, "as in the YAML of `spykee sim --faults`")],
            &[],
            "Begins a fault of the network or the robot.",
            "sim:fault({ fault = \"drop\" })",
        )
        .waiting(),
    ],
);
