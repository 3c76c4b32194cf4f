//! `robot.*`, and the subscriptions that it returns.

use super::events::{
    BATTERY, DOCK_CODE, DOCK_INFO, EVENT, INFO, LIGHT, MOTION_CODE, POSE_ESTIMATE, QUEUE, SOUND,
    STREAM,
};
use super::model::{
    Bounds, Namespace, Object, SECONDS, Type, Value, boolean, bounded, call, choice, count,
    namespace, object, options, strict, value,
};
use super::script::TASK;
use super::vision::FRAME;
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

pub(super) const SUBSCRIPTION: Object = strict("Subscription")
    .doc("A subscription to an event; made by `robot.on` and `robot.once`.")
    .methods(&[
        call("Subscription:off").doc("Ends the subscription: its function is not called again.")
    ]);

pub(super) const ROBOT: Namespace =
    namespace("robot", "motion, lights, sounds, docking, events, pictures").functions(&[
        call("robot.move")
            .takes(&[
                bounded("left", POWER, "power of the left track").unit("%"),
                bounded("right", POWER, "power of the right track").unit("%"),
                SECONDS_OF_MOTION,
            ])
            .returns(ENDED_IF_TIMED)
            .doc("Sets the power of both tracks. With `seconds` it waits until the time is over, and can end early as `blocked`, like `robot.forward`.")
            .waiting(),
        call("robot.drive")
            .takes(&[
                bounded("linear", SPEED, "forwards").unit("m/s"),
                bounded("angular", SPEED, "to the left").unit("rad/s"),
                SECONDS_OF_MOTION,
            ])
            .returns(ENDED_IF_TIMED)
            .doc("Drives a curve. If the speed would need more than full power, it is reduced; the curve stays the same.")
            .waiting(),
        call("robot.forward")
            .takes(&[
                bounded("metres", DISTANCE_OR_ANGLE, "backwards if negative").unit("m"),
                bounded("speed", MOTION_SPEED, "default: half of full speed").unit("m/s").optional(),
            ])
            .returns(ENDED)
            .doc("Drives straight for a distance, and waits until the tracks stand. With the camera on, it ends early as `blocked` when the pictures show that something holds the robot. In a curve or in the dark this works less often. If the robot pushes from the start against a uniform surface, it works late or never.")
            .waiting(),
        call("robot.turn")
            .takes(&[
                bounded("angle", DISTANCE_OR_ANGLE, "to the left; to the right if negative").unit("rad"),
                bounded("speed", MOTION_SPEED, "default: half of full speed").unit("rad/s").optional(),
            ])
            .returns(ENDED)
            .doc("Turns on the spot, and waits until the tracks stand. It can end early as `blocked`, like `robot.forward`.")
            .waiting(),
        call("robot.stop")
            .doc("Stops the tracks; always works."),
        call("robot.pose")
            .returns(&[object("pose", &POSE_ESTIMATE, "relative to the pose at the last `robot.reset_pose()`, or at the start of the script")])
            .doc("Estimates the robot's pose by dead reckoning: from the script's commands to the tracks and, while the camera is on, from the turns that the pictures show. The delay of the pictures is measured automatically. Motion that the script did not command is not counted, and makes the errors grow.")
            .pure(),
        call("robot.reset_pose")
            .doc("Makes the robot's present position the origin of `robot.pose()`, and its heading the x axis."),
        call("robot.led")
            .takes(&[NAMED_LIGHT, boolean("on", "")])
            .doc("Switches a light."),
        call("robot.blink")
            .takes(&[
                NAMED_LIGHT,
                options(&[
                    seconds("on", BLINK, 0.2, "time on"),
                    seconds("off", BLINK, 0.2, "time off"),
                    count("count", 1_000_000, "number of blinks").default(3.0),
                ]),
            ])
            .returns(&[object("task", &TASK, "`:cancel()` ends it")])
            .doc("Blinks a light, in a new task."),
        call("robot.play")
            .takes(&[choice("sound", SOUND, "")])
            .doc("Plays one of the robot's sounds."),
        call("robot.stop_sound")
            .doc("Stops the sound, but not the watchdog's alarm. While the alarm sounds, `robot.play`, `robot.stop_sound`, `robot.say` and `robot.volume` have no effect."),
        call("robot.volume")
            .takes(&[bounded("percent", Bounds::Between(0.0, 100.0), "").unit("%")])
            .doc("Sets the volume. The watchdog's alarm sets it to 100 %, where it stays."),
        call("robot.say")
            .takes(&[value("samples", Type::Buffer, "signed 16-bit samples, mono, 16000 per second")])
            .doc("Plays samples on the speaker; needs the stream `audio_out`."),
        call("robot.stream")
            .takes(&[choice("name", STREAM, "which one"), boolean("on", "")])
            .doc("Switches a video or audio stream on or off. Handlers and waiting calls switch on the stream that they need; it goes off two seconds after they last needed it."),
        call("robot.battery")
            .returns(&[object("battery", &BATTERY, "nil before the robot's first report").optional()])
            .doc("Returns the battery's level, and whether it charges.")
            .pure(),
        call("robot.docked")
            .returns(&[boolean("docked", "")])
            .doc("Returns whether the robot is on its charging station.")
            .pure(),
        call("robot.connected")
            .returns(&[boolean("connected", "")])
            .doc("Returns whether the robot is connected.")
            .pure(),
        call("robot.info")
            .returns(&[object("info", &INFO, "nil before the first connection").optional()])
            .doc("Identifies the robot.")
            .pure(),
        call("robot.dock")
            .takes(&[options(&[
                seconds("timeout", DOCKING, PLAN.timeout.as_secs() as f64, "the longest time to search in one try"),
                count("retries", 20, "further tries after the first").default(PLAN.retries as f64),
                seconds("charge_timeout", DOCKING, PLAN.charge_timeout.as_secs() as f64, "the longest time to wait for charging to begin"),
            ])])
            .returns(&[
                OK,
                choice("code", DOCK_CODE, "how it ended"),
                object("info", &DOCK_INFO, "nil if docking could not begin").optional(),
            ])
            .doc("Drives to the charging station, and waits until the robot charges.")
            .waiting(),
        call("robot.undock")
            .takes(&[options(&[seconds("timeout", DOCKING, 20.0, "")])])
            .returns(&[OK, choice("code", DOCK_CODE, "how it ended")])
            .doc("Leaves the charging station, and waits until the robot is off it. Some robots back out of it and \
             face it then, others drive off it forward; `floor.leave_station` also turns where the way is free.")
            .waiting(),
        call("robot.cancel_dock")
            .doc("Cancels docking; a waiting `robot.dock` returns `cancelled`."),
        call("robot.on")
            .takes(&[
                NAMED_EVENT,
                HANDLER,
                options(&[
                    bounded("rate", RATE, "the highest number of calls per second; without it there is no limit").unit("Hz").optional(),
                    choice("queue", QUEUE, "`all` queues every event, `latest` only the newest; default: latest for frame, audio and noise, all for other events").optional(),
                ]),
            ])
            .returns(&[HANDLE])
            .doc("Calls a function at each event of this name."),
        call("robot.once")
            .takes(&[NAMED_EVENT, HANDLER])
            .returns(&[HANDLE])
            .doc("Calls a function at the next event of this name, once."),
        call("robot.wait_for")
            .takes(&[NAMED_EVENT, TIMEOUT])
            .returns(&[
                value("payload", Type::Payload, "nil after a time-out").optional(),
                TIMEOUT_REASON,
            ])
            .doc("Waits for the next event of this name.")
            .waiting(),
        call("robot.frame")
            .returns(&[object("frame", &FRAME, "nil if none arrived within the last second").optional()])
            .doc("Returns the latest picture of the camera."),
        call("robot.wait_frame")
            .takes(&[TIMEOUT])
            .returns(&[object("frame", &FRAME, "nil after a time-out").optional(), TIMEOUT_REASON])
            .doc("Waits for the next picture of the camera.")
            .waiting(),
    ]);
