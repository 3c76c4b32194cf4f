//! `robot.*`, and the subscriptions that it returns.

use super::choices::{DOCK_CODE, LIGHT, MOTION_CODE, QUEUE, SOUND, STREAM};
use super::events::{BATTERY, DOCK_INFO, EVENT, INFO, POSE_ESTIMATE};
use super::frame::FRAME;
use super::make::{boolean, bounded, call, choice, count, object, options, strict, value};
use super::model::{Availability, Bounds, Function, Namespace, Object, SECONDS, Type, Value};
use super::task::TASK;
use crate::robot::DockPlan;

/// Power of a track, in percent.
const POWER: Bounds = Bounds::Between(-100.0, 100.0);
/// A speed, in metres or radians per second. Speeds that the robot cannot reach are reduced later,
/// so this bound only keeps the arithmetic finite.
const SPEED: Bounds = Bounds::Between(-1000.0, 1000.0);
/// A distance in metres, or an angle in radians.
const DISTANCE_OR_ANGLE: Bounds = Bounds::Between(-1e6, 1e6);
/// Speed of `forward` and `turn`, in metres or radians per second.
const MOTION_SPEED: Bounds = Bounds::Above(0.0, 1000.0);
/// The longest drive of one call, in seconds.
pub const LONGEST_DRIVE: f64 = 3600.0;
const DRIVE: Bounds = Bounds::Above(0.0, LONGEST_DRIVE);
/// Times of `robot.blink`, in seconds.
const BLINK: Bounds = Bounds::Between(0.02, 3600.0);
/// Times of docking, in seconds.
const DOCKING: Bounds = Bounds::Between(1.0, 3600.0);
/// Calls of a handler per second. A rate below the lower bound would overflow the clock's numbers.
const RATE: Bounds = Bounds::Between(0.001, 1000.0);
const PLAN: DockPlan = DockPlan::DEFAULT;
/// `ok` of calls that wait for the end of an action.
const OK: Value = boolean("ok", "whether it was completed");

const SECONDS_OF_MOTION: Value = bounded(
    "seconds",
    DRIVE,
    "drives for this time, then stops (the call waits until then); without it, the tracks keep running until the next motion command",
)
.unit("s")
.optional();
const ENDED: &[Value] = &[OK, choice("code", MOTION_CODE, "why it ended")];
/// The results of a call that returns nothing if no time was given.
const ENDED_IF_TIMED: &[Value] = &[
    boolean("ok", "whether it was completed; only with `seconds`").optional(),
    choice("code", MOTION_CODE, "why it ended").optional(),
];
const NAMED_LIGHT: Value = choice("name", LIGHT, "which one");
const NAMED_EVENT: Value = choice("name", EVENT, "name of the event");
const HANDLER: Value = value("fn", Type::Handler, "gets the event's payload");
const HANDLE: Value = object("subscription", &SUBSCRIPTION, "");
const TIMEOUT: Value = bounded("timeout", SECONDS, "default: no limit")
    .unit("s")
    .optional();
const TIMEOUT_REASON: Value = value(
    "why",
    Type::Text(None),
    "\"timeout\" if the first result is nil",
)
.optional();

const fn seconds(name: &'static str, bounds: Bounds, usual: f64, doc: &'static str) -> Value {
    bounded(name, bounds, doc).unit("s").default(usual)
}

const FUNCTIONS: &[Function] = &[
    call(
        "robot.move",
        &[
            bounded("left", POWER, "power of the left track").unit("%"),
            bounded("right", POWER, "power of the right track").unit("%"),
            SECONDS_OF_MOTION,
        ],
        ENDED_IF_TIMED,
        "Sets the power of both tracks. With `seconds` it waits until the time is over, and can end early as `blocked`, like `robot.forward`.",
        "robot.move(40, 40, 2) -- two seconds straight ahead\nrobot.move(20, -20) -- turns to the right until changed\ntask.wait(1)\nrobot.stop()",
    )
    .waiting(),
    call(
        "robot.drive",
        &[
            bounded("linear", SPEED, "forwards").unit("m/s"),
            bounded("angular", SPEED, "to the left").unit("rad/s"),
            SECONDS_OF_MOTION,
        ],
        ENDED_IF_TIMED,
        "Drives a curve. If the speed would need more than full power, it is reduced; the curve stays the same.",
        "robot.drive(0.2, 0.5, 3) -- a curve to the left",
    )
    .waiting(),
    call(
        "robot.forward",
        &[
            bounded("metres", DISTANCE_OR_ANGLE, "backwards if negative").unit("m"),
            bounded("speed", MOTION_SPEED, "default: half of full speed").unit("m/s").optional(),
        ],
        ENDED,
        "Drives straight for a distance, and waits until the tracks stand. With the camera on, it ends early as `blocked` when the pictures show that something holds the robot. In a curve or in the dark this works less often. If the robot pushes from the start against a uniform surface, it works late or never.",
        "local ok, code = robot.forward(0.5)\nprint(ok, code)",
    )
    .waiting(),
    call(
        "robot.turn",
        &[
            bounded("angle", DISTANCE_OR_ANGLE, "to the left; to the right if negative").unit("rad"),
            bounded("speed", MOTION_SPEED, "default: half of full speed").unit("rad/s").optional(),
        ],
        ENDED,
        "Turns on the spot, and waits until the tracks stand. It can end early as `blocked`, like `robot.forward`.",
        "robot.turn(math.rad(90)) -- a quarter turn to the left",
    )
    .waiting(),
    call(
        "robot.stop",
        &[],
        &[],
        "Stops the tracks; always works.",
        "robot.move(30, 30)\ntask.wait(1)\nrobot.stop()",
    ),
    call(
        "robot.pose",
        &[],
        &[object("pose", &POSE_ESTIMATE, "relative to the pose at the last `robot.reset_pose()`, or at the start of the script")],
        "Estimates the robot's pose by dead reckoning: from the script's commands to the tracks and, while the camera is on, from the turns that the pictures show. The delay of the pictures is measured automatically. Motion that the script did not command is not counted, and makes the errors grow.",
        "robot.reset_pose()\nrobot.forward(0.5)\nlocal pose = robot.pose()\nprint(pose.x, pose.y, math.deg(pose.heading), pose.error)",
    )
    .pure(),
    call(
        "robot.reset_pose",
        &[],
        &[],
        "Makes the robot's present position the origin of `robot.pose()`, and its heading the x axis.",
        "robot.reset_pose()",
    ),
    call(
        "robot.led",
        &[NAMED_LIGHT, boolean("on", "")],
        &[],
        "Switches a light.",
        "robot.led(\"left\", true)",
    ),
    call(
        "robot.blink",
        &[
            NAMED_LIGHT,
            options(&[
                seconds("on", BLINK, 0.2, "time on"),
                seconds("off", BLINK, 0.2, "time off"),
                count("count", 1_000_000, "number of blinks").default(3.0),
            ]),
        ],
        &[object("task", &TASK, "`:cancel()` ends it")],
        "Blinks a light, in a new task.",
        "robot.blink(\"all\", { on = 0.1, off = 0.3, count = 5 }):join()",
    ),
    call(
        "robot.play",
        &[choice("sound", SOUND, "")],
        &[],
        "Plays one of the robot's sounds.",
        "robot.play(\"laugh\")",
    ),
    call(
        "robot.stop_sound",
        &[],
        &[],
        "Stops the sound, but not the watchdog's alarm. While the alarm sounds, `robot.play`, `robot.stop_sound`, `robot.say` and `robot.volume` have no effect.",
        "robot.play(\"music\")\ntask.wait(2)\nrobot.stop_sound()",
    ),
    call(
        "robot.volume",
        &[bounded("percent", Bounds::Between(0.0, 100.0), "").unit("%")],
        &[],
        "Sets the volume. The watchdog's alarm sets it to 100 %, where it stays.",
        "robot.volume(60)",
    ),
    call(
        "robot.say",
        &[value("samples", Type::Buffer, "signed 16-bit samples, mono, 16000 per second")],
        &[],
        "Plays samples on the speaker; needs the stream `audio_out`.",
        "robot.stream(\"audio_out\", true)\nlocal tone = buffer.create(3200)\nfor at = 0, 1599 do\n\tbuffer.writei16(tone, 2 * at, 8000 * math.sin(at * 0.17))\nend\nrobot.say(tone)",
    ),
    call(
        "robot.stream",
        &[choice("name", STREAM, "which one"), boolean("on", "")],
        &[],
        "Switches a video or audio stream on or off. Handlers and waiting calls switch on the stream that they need; it goes off two seconds after they last needed it.",
        "robot.stream(\"video\", true)",
    ),
    call(
        "robot.battery",
        &[],
        &[object("battery", &BATTERY, "nil before the robot's first report").optional()],
        "Returns the battery's level, and whether it charges.",
        "local battery = robot.battery()\nif battery then\n\tprint(battery.percent or \"unknown\", \"%\")\nend",
    )
    .pure(),
    call(
        "robot.docked",
        &[],
        &[boolean("docked", "")],
        "Returns whether the robot is on its charging station.",
        "if robot.docked() then\n\trobot.undock()\nend",
    )
    .pure(),
    call(
        "robot.connected",
        &[],
        &[boolean("connected", "")],
        "Returns whether the robot is connected.",
        "print(robot.connected())",
    )
    .pure(),
    call(
        "robot.info",
        &[],
        &[object("info", &INFO, "nil before the first connection").optional()],
        "Identifies the robot.",
        "local info = robot.info()\nif info then\n\tprint(\"I am\", info.name)\nend",
    )
    .pure(),
    call(
        "robot.dock",
        &[options(&[
            seconds("timeout", DOCKING, PLAN.timeout.as_secs() as f64, "the longest time to search in one try"),
            count("retries", 20, "further tries after the first").default(PLAN.retries as f64),
            seconds("charge_timeout", DOCKING, PLAN.charge_timeout.as_secs() as f64, "the longest time to wait for charging to begin"),
        ])],
        &[
            OK,
            choice("code", DOCK_CODE, "how it ended"),
            object("info", &DOCK_INFO, "nil if docking could not begin").optional(),
        ],
        "Drives to the charging station, and waits until the robot charges.",
        "local docked, code = robot.dock({ retries = 3 })\nif not docked then\n\tlog.warn(`not home: {code}`)\nend",
    )
    .waiting(),
    call(
        "robot.undock",
        &[options(&[seconds("timeout", DOCKING, 20.0, "")])],
        &[OK, choice("code", DOCK_CODE, "how it ended")],
        "Leaves the charging station, and waits until the robot is off it. Some robots back out of it and \
         face it then, others drive off it forward; `floor.leave_station` also turns where the way is free.",
        "if robot.docked() then\n\trobot.undock()\nend",
    )
    .waiting(),
    call(
        "robot.cancel_dock",
        &[],
        &[],
        "Cancels docking; a waiting `robot.dock` returns `cancelled`.",
        "task.delay(20, robot.cancel_dock)\nrobot.dock()",
    ),
    call(
        "robot.on",
        &[
            NAMED_EVENT,
            HANDLER,
            options(&[
                bounded("rate", RATE, "the highest number of calls per second; without it there is no limit").unit("Hz").optional(),
                choice("queue", QUEUE, "`all` queues every event, `latest` only the newest; default: latest for frame, audio and noise, all for other events").optional(),
            ]),
        ],
        &[HANDLE],
        "Calls a function at each event of this name.",
        "robot.on(\"battery_low\", function(battery)\n\tlog.warn(`{battery.percent or \"?\"} % left`)\nend)",
    ),
    call(
        "robot.once",
        &[NAMED_EVENT, HANDLER],
        &[HANDLE],
        "Calls a function at the next event of this name, once.",
        "robot.once(\"frame\", function(frame)\n\tprint(frame.width, frame.height)\nend)",
    ),
    call(
        "robot.wait_for",
        &[NAMED_EVENT, TIMEOUT],
        &[
            value("payload", Type::Payload, "nil after a time-out").optional(),
            TIMEOUT_REASON,
        ],
        "Waits for the next event of this name.",
        "local battery, why = robot.wait_for(\"battery\", 30)\nprint(battery and battery.percent or why)",
    )
    .waiting(),
    call(
        "robot.frame",
        &[],
        &[object("frame", &FRAME, "nil if none arrived within the last second").optional()],
        "Returns the latest picture of the camera.",
        "local frame = robot.frame()\nif frame then\n\tprint(frame:brightness())\nend",
    ),
    call(
        "robot.wait_frame",
        &[TIMEOUT],
        &[object("frame", &FRAME, "nil after a time-out").optional(), TIMEOUT_REASON],
        "Waits for the next picture of the camera.",
        "local frame = robot.wait_frame(2)\nif frame then\n\tframe:save(\"here.jpg\")\nend",
    )
    .waiting(),
];

pub(super) const SUBSCRIPTION: Object = strict(
    "Subscription",
    "A subscription to an event; made by `robot.on` and `robot.once`.",
    &[],
    &[call(
        "Subscription:off",
        &[],
        &[],
        "Ends the subscription: its function is not called again.",
        "local listening = robot.on(\"noise\", print)\nlistening:off()",
    )],
);

pub(super) const ROBOT: Namespace = Namespace {
    name: "robot",
    about: "motion, lights, sounds, docking, events, pictures",
    availability: Availability::Behaviour,
    functions: FUNCTIONS,
    constants: &[],
    example: "",
};
