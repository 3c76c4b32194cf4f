//! `vision.*`: colours, trackers, motion detectors.

use super::frame::{FRAME, MOTION, TRACK};
use super::make::{
    bounded, call, count, number, object, options, range, strict, table, text, value,
};
use super::model::{Availability, Bounds, Function, Literal, Namespace, Object, Type, Value};
use crate::vision::{MotionOptions, TrackerOptions};

const TRACKS: TrackerOptions = TrackerOptions::DEFAULT;
const MOVES: MotionOptions = MotionOptions::DEFAULT;
const LIGHTNESS: Literal = Literal::Range(0.0, 100.0);
const OPPONENT: Literal = Literal::Range(-128.0, 127.0);
const HUE: Literal = Literal::Range(0.0, 360.0);
const PERCENT: Literal = Literal::Range(0.0, 100.0);
const NEXT: Value = object("frame", &FRAME, "the next frame");

pub(super) const COLOUR: Object = strict(
    "Colour",
    "A colour without a name; made by `vision.lab`, `vision.hsv` and `vision.learn`.",
    &[],
    &[],
);

pub(super) const LEARNED: Object = table(
    "Learned",
    "The quality of a learned colour.",
    &[number("quality", "0 to 1")],
);

pub(super) const TRACKER: Object = strict(
    "Tracker",
    "Follows blobs; made by `vision.tracker`.",
    &[],
    &[
        call(
            "Tracker:update",
            &[NEXT],
            &[value("tracks", Type::List(&Type::Object(&TRACK)), "")],
            "Updates the tracks with the next frame.",
            "local balls = vision.tracker({ colour = \"red\" })\nfor _, ball in balls:update(frame) do\n\tprint(ball.id, ball.cx)\nend",
        ),
        call(
            "Tracker:best",
            &[],
            &[object("track", &TRACK, "nil while there is none").optional()],
            "Returns the blob to follow: the largest of those seen for long enough.",
            "local balls = vision.tracker({ colour = \"red\" })\nballs:update(frame)\nlocal ball = balls:best()\nprint(ball and ball.cx)",
        )
        .pure(),
        call(
            "Tracker:reset",
            &[],
            &[],
            "Forgets everything seen so far.",
            "local balls = vision.tracker({ colour = \"red\" })\nballs:reset()",
        ),
    ],
);

pub(super) const DETECTOR: Object = strict(
    "Detector",
    "Detects motion; made by `vision.motion`.",
    &[],
    &[call(
        "Detector:update",
        &[NEXT],
        &[
            object(
                "motion",
                &MOTION,
                "nil while the robot moves, and for a second afterwards",
            )
            .optional(),
            text("why", "\"moving\"").optional(),
        ],
        "Compares a frame with the previous ones.",
        "local watch = vision.motion()\nlocal motion = watch:update(frame)\nprint(motion and motion.score)",
    )],
);

const FUNCTIONS: &[Function] = &[
    call(
        "vision.lab",
        &[options(&[
            range("l", LIGHTNESS, "lightness"),
            range("a", OPPONENT, "from green to red"),
            range("b", OPPONENT, "from blue to yellow"),
        ])],
        &[object("colour", &COLOUR, "")],
        "Makes a colour from ranges of L*a*b*.",
        "local sock = vision.lab({ l = { 30, 70 }, a = { 20, 80 }, b = { 10, 60 } })\nlocal frame = robot.frame()\nprint(frame and #frame:find_blobs(sock))",
    ),
    call(
        "vision.hsv",
        &[options(&[
            range("h", HUE, "hue; may wrap, as in {340, 20}").unit("degrees"),
            range("s", PERCENT, "saturation").unit("%"),
            range("v", PERCENT, "value").unit("%"),
        ])],
        &[object("colour", &COLOUR, "")],
        "Makes a colour from ranges of hue, saturation and value.",
        "local pink = vision.hsv({ h = { 310, 350 }, s = { 30, 100 }, v = { 40, 100 } })\nlocal frame = robot.frame()\nprint(frame and #frame:find_blobs(pink))",
    ),
    call(
        "vision.tracker",
        &[options(&[
            value("colour", Type::Colours, "the colours to follow"),
            count("min_age", 1000, "frames in sight before a blob counts")
                .default(TRACKS.min_age as f64),
            count(
                "max_lost",
                1000,
                "frames out of sight before a blob is dropped",
            )
            .default(TRACKS.max_lost as f64),
            bounded(
                "max_jump",
                Bounds::Above(0.0, 10_000.0),
                "the longest move from one frame to the next",
            )
            .unit("px")
            .default(TRACKS.max_jump),
        ])
        .required()],
        &[object("tracker", &TRACKER, "")],
        "Makes a tracker, which follows blobs from frame to frame.",
        "local balls = vision.tracker({ colour = \"red\" })\nrobot.on(\"frame\", function(frame)\n\tballs:update(frame)\n\tlocal ball = balls:best()\n\tif ball then\n\t\tprint(ball.id, ball.vx)\n\tend\nend)",
    ),
    call(
        "vision.motion",
        &[options(&[
            count(
                "threshold",
                255,
                "the smallest change of a pixel's brightness (0 to 255) that counts",
            )
            .default(MOVES.threshold as f64),
            count(
                "min_pixels",
                2_000_000,
                "the smallest moving area that counts",
            )
            .unit("px")
            .default(MOVES.min_pixels as f64),
        ])],
        &[object("detector", &DETECTOR, "")],
        "Makes a motion detector, for a camera that stands still.",
        "local watch = vision.motion()\nrobot.on(\"frame\", function(frame)\n\tlocal motion = watch:update(frame)\n\tif motion and motion.score > 0.05 then\n\t\trobot.play(\"alarm\")\n\tend\nend)",
    ),
    call(
        "vision.learn",
        &[
            value(
                "frames",
                Type::OneOrMore(&Type::Object(&FRAME)),
                "1 to 16 frames that show the object",
            ),
            value(
                "roi",
                Type::Roi,
                "the part of the frames that the object fills",
            ),
        ],
        &[
            object("colour", &COLOUR, "nil if no colour could be learned").optional(),
            value(
                "info",
                Type::Any,
                "a Learned; if no colour could be learned, \"too_grey\" or \"too_mixed\"",
            ),
        ],
        "Learns the colour of an object in front of the camera.",
        "local frame = robot.wait_frame(2)\nif frame then\n\tlocal colour = vision.learn({ frame }, { 150, 110, 20, 20 })\n\tprint(colour or \"hold it nearer\")\nend",
    ),
];

pub(super) const VISION: Namespace = Namespace {
    name: "vision",
    about: "colours, trackers and motion detectors",
    availability: Availability::Behaviour,
    functions: FUNCTIONS,
    constants: &[],
    example: "",
};
