//! `vision.*`.

use super::super::vision::JUMP;
use super::terms::{Function, Type, Value, bounded, call, count, object, options, text, value};

const fn range(
    name: &'static str,
    unit: &'static str,
    usual: &'static str,
    doc: &'static str,
) -> Value {
    value(name, Type::Range, doc).unit(unit).default(usual)
}

const COLOUR: Value = object("colour", "Colour", "");

pub(super) const FUNCTIONS: &[Function] = &[
    call(
        "vision.lab",
        &[options(&[
            range("l", "", "{0, 100}", "lightness"),
            range("a", "", "{-128, 127}", "from green to red"),
            range("b", "", "{-128, 127}", "from blue to yellow"),
        ])],
        &[COLOUR],
        "A colour as ranges of L*a*b*.",
        "local sock = vision.lab({ l = { 30, 70 }, a = { 20, 80 }, b = { 10, 60 } })\nlocal frame = robot.frame()\nprint(frame and #frame:find_blobs(sock))",
    ),
    call(
        "vision.hsv",
        &[options(&[
            range("h", "degrees", "{0, 360}", "hue; may wrap, as in {340, 20}"),
            range("s", "%", "{0, 100}", "saturation"),
            range("v", "%", "{0, 100}", "value"),
        ])],
        &[COLOUR],
        "A colour as ranges of hue, saturation and value.",
        "local pink = vision.hsv({ h = { 310, 350 }, s = { 30, 100 }, v = { 40, 100 } })\nlocal frame = robot.frame()\nprint(frame and #frame:find_blobs(pink))",
    ),
    call(
        "vision.tracker",
        &[Value {
            need: super::terms::Need::Required,
            ..options(&[
                value("colour", Type::Colours, "what to follow"),
                count("min_age", 1000, "frames until a blob counts").default("3"),
                count("max_lost", 1000, "frames that it may be out of sight").default("5"),
                bounded("max_jump", JUMP, "from frame to frame")
                    .unit("px")
                    .default("80"),
            ])
        }],
        &[object("tracker", "Tracker", "")],
        "Follows blobs from frame to frame.",
        "local balls = vision.tracker({ colour = \"red\" })\nrobot.on(\"frame\", function(frame)\n\tballs:update(frame)\n\tlocal ball = balls:best()\n\tif ball then\n\t\tprint(ball.id, ball.vx)\n\tend\nend)",
    ),
    call(
        "vision.motion",
        &[options(&[
            count(
                "threshold",
                255,
                "how much brighter or darker a pixel must become",
            )
            .default("15"),
            count("min_pixels", 2_000_000, "the smallest thing that counts")
                .unit("px")
                .default("150"),
        ])],
        &[object("detector", "Detector", "")],
        "Notices what moves before a camera that stands still.",
        "local watch = vision.motion()\nrobot.on(\"frame\", function(frame)\n\tlocal motion = watch:update(frame)\n\tif motion and motion.score > 0.05 then\n\t\trobot.play(\"alarm\")\n\tend\nend)",
    ),
    call(
        "vision.learn",
        &[
            value(
                "frames",
                Type::OneOrMore(&Type::Object("Frame")),
                "1 to 16 frames that show the thing",
            ),
            value("roi", Type::Roi, "where it is in them"),
        ],
        &[
            object("colour", "Colour", "nil if none can be told").optional(),
            value(
                "info",
                Type::Any,
                "`{quality}` from 0 to 1; or \"too_grey\" or \"too_mixed\"",
            ),
        ],
        "Learns the colour of a thing that is held before the camera.",
        "local frame = robot.wait_frame(2)\nif frame then\n\tlocal colour = vision.learn({ frame }, { 150, 110, 20, 20 })\n\tprint(colour or \"hold it nearer\")\nend",
    ),
];

/// Of `Frame:find_blobs`.
pub(super) const BLOB_OPTIONS: Value = options(&[
    value("roi", Type::Roi, "look only here").optional(),
    super::terms::boolean("invert", "find what is not of the colour").default("false"),
    count("area_threshold", 2_000_000, "the smallest box")
        .unit("px")
        .default("10"),
    count("pixels_threshold", 2_000_000, "the fewest pixels")
        .unit("px")
        .default("10"),
    super::terms::boolean("merge", "make one of those whose boxes overlap").default("false"),
    count(
        "margin",
        10_000,
        "by how much boxes may miss each other and be merged",
    )
    .unit("px")
    .default("0"),
    count("max_blobs", 1000, "the most to find").default("32"),
]);

/// Of `Frame:find_line`.
pub(super) const LINE_OPTIONS: Value =
    options(&[value("roi", Type::Roi, "look only here").optional()]);

/// Of `Frame:save`.
pub(super) const PICTURE_NAME: Value = text("name", "letters, digits, `-`, `_` and `.`");
