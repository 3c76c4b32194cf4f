//! The API of scenarios, in `*_test.lua` files: `scenario`, `expect`, and `sim`, the simulated
//! robot.

use super::model::{
    Availability, Bounds, Namespace, Object, SECONDS, Type, Value, boolean, bounded, call, count,
    function, namespace, number, object, options, short_text, strict, table, text, value, whole,
};

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

pub(super) const SCENARIO: Namespace = namespace("", "scenarios, in `*_test.lua` files")
    .functions(&[
        call("scenario")
            .takes(&[
                short_text("name", 200, "unique in its file"),
                SETTING,
                function("fn", "(sim: Sim) -> ()", "the scenario itself; gets `sim`"),
            ])
            .doc("Declares a scenario, at the top of the file."),
        call("expect")
            .takes(&[
                value(
                    "condition",
                    Type::Any,
                    "anything but nil and false counts as true",
                ),
                value("message", Type::Any, "shown in the report").optional(),
            ])
            .returns(&[value("condition", Type::Any, "")])
            .doc("Fails the scenario here unless the condition is true."),
    ])
    .available(Availability::Scenario);

const LEDS: Object = table("Leds")
    .doc("The robot's lights: true for each one that is on.")
    .fields(&[
        boolean("flash", ""),
        boolean("left", ""),
        boolean("right", ""),
    ]);

const PLAYED: Object = table("PlayedSound")
    .doc("A sound that the robot was told to play.")
    .fields(&[
        text("name", ""),
        number("time", "since the start").unit("s"),
    ]);

const LOGGED: Object = table("LoggedLine")
    .doc("A line that a behaviour has written.")
    .fields(&[
        text("behaviour", "its name"),
        text("level", "debug, info, warn or error"),
        text("text", ""),
        number("time", "since the start").unit("s"),
    ]);

const POINT: Object = table("Point")
    .doc("A point of the world.")
    .fields(&[number("x", "").unit("m"), number("y", "").unit("m")]);

const POSE: Object = table("Pose")
    .doc("A point of the world and a direction.")
    .fields(&[
        number("x", "").unit("m"),
        number("y", "").unit("m"),
        number("heading", "left positive").unit("rad"),
    ]);

pub(super) const TABLES: [&Object; 5] = [&LEDS, &PLAYED, &LOGGED, &POINT, &POSE];

/// Methods that change the simulation are marked as waiting: the change is made at the simulator's
/// next step.
pub(super) const SIM: Object = strict("Sim")
    .doc("The simulated robot of a scenario, in `*_test.lua` files: `sim`.")
    .methods(&[
        call("sim:run")
            .doc("Starts behaviours; without arguments, the behaviour that the scenario's file is named after.")
            .with_rest("behaviours, each a file or a table `{ FILE, name =, priority =, restart =, params = {...} }`")
            .waiting(),
        call("sim:stop")
            .doc("Stops all behaviours as at the end of a run: their `script.on_stop` functions are called. The robot and the stores stay as they are for the next `sim:run()`.")
            .waiting(),
        call("sim:kill")
            .doc("Kills all behaviours at once, like a power cut of the computer.")
            .waiting(),
        call("sim:wait")
            .takes(&[TIME])
            .returns(&[number("passed", "").unit("s")])
            .doc("Lets virtual time pass.")
            .waiting(),
        call("sim:wait_until")
            .takes(&[function("fn", "() -> any", "tested every 0.05 s"), TIME])
            .returns(&[boolean("ok", "false after a time-out")])
            .doc("Waits until a function returns something true.")
            .waiting(),
        call("sim:time")
            .returns(&[number("seconds", "").unit("s")])
            .doc("Returns the virtual seconds since the start.")
            .pure(),
        call("sim:seed")
            .returns(&[whole("seed", "")])
            .doc("Returns the seed of this run of the scenario.")
            .pure(),
        call("sim:clock")
            .takes(&[short_text("date", 40, "in the config's time zone")])
            .doc("Sets the date and time; the clock continues from there. A scenario starts at 2026-01-01 09:00 UTC."),
        call("sim:pose")
            .returns(&[object("pose", &POSE, "")])
            .doc("Returns the robot's true pose.")
            .pure(),
        call("sim:place")
            .takes(&[options(&[
                X,
                Y,
                bounded("heading", FAR, "default: unchanged").unit("rad").optional(),
            ])
            .required()])
            .doc("Places the robot somewhere.")
            .waiting(),
        call("sim:ball")
            .takes(&[BALL])
            .returns(&[object("place", &POINT, "")])
            .doc("Returns the position of a ball of the world.")
            .pure(),
        call("sim:place_ball")
            .takes(&[BALL, options(&[X, Y]).required()])
            .doc("Places a ball of the world somewhere, at rest.")
            .waiting(),
        call("sim:battery")
            .takes(&[bounded("percent", BATTERY, "sets the level first").unit("%").optional()])
            .returns(&[number("percent", "").unit("%")])
            .doc("Returns the battery's level, and can set it.")
            .waiting(),
        call("sim:charging")
            .returns(&[boolean("charging", "")])
            .doc("Returns whether the battery charges.")
            .pure(),
        call("sim:docked")
            .returns(&[boolean("docked", "")])
            .doc("Returns whether the robot is on its charging station.")
            .pure(),
        call("sim:connected")
            .returns(&[boolean("connected", "")])
            .doc("Returns whether a client is logged in.")
            .pure(),
        call("sim:leds")
            .returns(&[object("leds", &LEDS, "")])
            .doc("Returns which lights are on.")
            .pure(),
        call("sim:sounds")
            .returns(&[value("sounds", Type::List(&Type::Object(&PLAYED)), "")])
            .doc("Returns the sounds that the robot was told to play.")
            .pure(),
        call("sim:photos")
            .returns(&[whole("count", "")])
            .doc("Returns the number of pictures that the behaviours have saved.")
            .pure(),
        call("sim:distance")
            .returns(&[number("metres", "").unit("m")])
            .doc("Returns the distance driven so far.")
            .pure(),
        call("sim:collisions")
            .returns(&[whole("count", "")])
            .doc("Returns the number of collisions so far.")
            .pure(),
        call("sim:ended")
            .takes(&[short_text("name", LONGEST, "the behaviour's name; default: any").optional()])
            .returns(&[text("reason", "`done`, `error`, `cpu`, `safety`, ...; nil while it runs").optional()])
            .doc("Returns why a behaviour has ended.")
            .pure(),
        call("sim:log")
            .takes(&[short_text("text", LONGEST, "text that the lines contain; default: all lines").optional()])
            .returns(&[value("lines", Type::List(&Type::Object(&LOGGED)), "")])
            .doc("Returns the lines that behaviours have written.")
            .pure(),
        call("sim:noise")
            .takes(&[bounded("dbfs", Bounds::Between(-90.0, -3.0), "its loudness").unit("dBFS"), TIME])
            .doc("Plays a tone at the microphone.")
            .waiting(),
        call("sim:light")
            .takes(&[bounded("factor", Bounds::Between(0.0, 10.0), "1 is the world's own brightness")])
            .doc("Multiplies the brightness of all light in the world.")
            .waiting(),
        call("sim:hide_station")
            .takes(&[boolean("hidden", "")])
            .doc("Makes the charging station impossible to find (true) or findable again (false).")
            .waiting(),
        call("sim:break_charger")
            .takes(&[boolean("broken", "")])
            .doc("Switches the charging current of the station off (true) or on (false).")
            .waiting(),
        call("sim:fault")
            .takes(&[value("fault", Type::Fields, "as in the YAML of `spykee sim --faults`")])
            .doc("Starts a fault of the network or the robot.")
            .waiting(),
    ]);
