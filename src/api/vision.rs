//! Frames, what is found in them, and `vision.*`: colours, trackers, motion detectors.

use super::model::{
    Bounds, Function, Literal, Namespace, Object, Type, Value, boolean, bounded, call, count,
    namespace, number, object, options, range, short_text, strict, table, text, value, whole,
};
use crate::vision::{BlobOptions, MotionOptions, TrackerOptions};

const ROI: Value = value("roi", Type::Roi, "search or measure only this part").optional();
pub(super) const COLOURS: Value = value("colour", Type::Colours, "what to look for");
/// Coordinates and sizes of a part of a frame, in pixels.
pub const PIXELS: Bounds = Bounds::Between(-10_000.0, 10_000.0);
/// The angles of a direction, in radians.
const ANGLE: Bounds = Bounds::Between(-3.2, 3.2);
const USUAL: BlobOptions = BlobOptions::DEFAULT;

const FIND_BLOBS: Function = call("Frame:find_blobs")
    .takes(&[
        COLOURS,
        options(&[
            ROI,
            boolean("invert", "find what does not have the colour").default_is(USUAL.invert),
            count(
                "area_threshold",
                2_000_000,
                "the smallest area of a blob's box",
            )
            .unit("px")
            .default(USUAL.area_threshold as f64),
            count(
                "pixels_threshold",
                2_000_000,
                "the smallest number of pixels of the colour",
            )
            .unit("px")
            .default(USUAL.pixels_threshold as f64),
            boolean("merge", "merge blobs whose boxes overlap").default_is(USUAL.merge),
            count(
                "margin",
                10_000,
                "the largest gap between boxes that are merged",
            )
            .unit("px")
            .default(USUAL.margin as f64),
            count("max_blobs", 1000, "the largest number of blobs to return")
                .default(USUAL.max_blobs as f64),
        ]),
    ])
    .returns(&[value(
        "blobs",
        Type::List(&Type::Object(&BLOB)),
        "the largest first; empty if there are none",
    )])
    .doc("Finds blobs, which are patches of a colour. The names and options are those of OpenMV.")
    .pure();

pub(super) const FRAME: Object = strict("Frame")
    .doc("A picture of the camera, decoded when it is first used.")
    .fields(&[
        whole("seq", "its sequence number"),
        number("age", "time since it arrived").unit("s"),
        whole("width", "").unit("px"),
        whole("height", "").unit("px"),
        whole("bytes", "size of the JPEG"),
        number("lens_height", "of the camera above the floor, from the config's `camera`").unit("m"),
    ])
    .methods(&[
        FIND_BLOBS,
        call("Frame:find_line")
            .takes(&[COLOURS, options(&[ROI])])
            .returns(&[object("line", &LINE, "nil if there is none").optional()])
            .doc("Finds a line on the floor, for line following.")
            .pure(),
        call("Frame:find_qrcodes")
            .returns(&[value("codes", Type::List(&Type::Object(&QR_CODE)), "")])
            .doc("Reads QR codes.")
            .pure(),
        call("Frame:brightness")
            .takes(&[ROI])
            .returns(&[number("brightness", "0 is black, 1 is white")])
            .doc("Measures the brightness of the picture.")
            .pure(),
        call("Frame:sharpness")
            .takes(&[ROI])
            .returns(&[number("sharpness", "0 or more; higher is sharper")])
            .doc("Measures the sharpness of the picture, to compare pictures of one scene.")
            .pure(),
        call("Frame:get_pixel")
            .takes(&[
                bounded("x", PIXELS, "column, 0 is the left").unit("px"),
                bounded("y", PIXELS, "row, 0 is the top").unit("px"),
            ])
            .returns(&[
                whole("r", "red, 0 to 255; nil outside the picture").optional(),
                whole("g", "green").optional(),
                whole("b", "blue").optional(),
            ])
            .doc("Returns the colour of one pixel.")
            .pure(),
        call("Frame:direction")
            .takes(&[
                bounded("x", PIXELS, "column, 0 is the centre of the leftmost pixel").unit("px"),
                bounded("y", PIXELS, "row, 0 is the centre of the topmost pixel").unit("px"),
            ])
            .returns(&[
                number("bearing", "left positive; nil in a damaged picture")
                    .unit("rad")
                    .optional(),
                number("elevation", "above the horizon positive")
                    .unit("rad")
                    .optional(),
            ])
            .doc("Returns the direction of a point of the picture, for a robot on level ground, computed with the pose and the lens of the config's `camera`.")
            .pure(),
        call("Frame:floor_position")
            .takes(&[
                bounded("x", PIXELS, "column, 0 is the centre of the leftmost pixel").unit("px"),
                bounded("y", PIXELS, "row, 0 is the centre of the topmost pixel").unit("px"),
            ])
            .returns(&[
                number("ahead", "from below the lens; nil above the horizon and in a damaged picture")
                    .unit("m")
                    .optional(),
                number("left", "to the left positive").unit("m").optional(),
            ])
            .doc("Returns the place on the floor that a point of the picture shows, if it shows floor, computed with the config's `camera`.")
            .pure(),
        call("Frame:pixel_at")
            .takes(&[
                bounded("bearing", ANGLE, "left positive").unit("rad"),
                bounded("elevation", ANGLE, "above the horizon positive").unit("rad"),
            ])
            .returns(&[
                number("x", "column; nil for a direction beside or behind the camera")
                    .unit("px")
                    .optional(),
                number("y", "row; like the column it may be outside the picture")
                    .unit("px")
                    .optional(),
            ])
            .doc("Returns the point of the picture in a direction: the inverse of `frame:direction`.")
            .pure(),
        call("Frame:save")
            .takes(&[short_text("name", 100, "letters, digits, `-`, `_` and `.`")])
            .returns(&[
                text("path", "nil if it was not saved").optional(),
                text("why", "\"quota\" or \"io\"").optional(),
            ])
            .doc("Saves the picture as the camera sent it. When the folder is full, the oldest pictures are deleted. \"quota\" means that the script has used up its bytes for the day, or that the disk is nearly full."),
    ]);

const PATCH: [Value; 18] = [
    whole("x", "left column of its box").unit("px"),
    whole("y", "top row of its box").unit("px"),
    whole("w", "width of its box").unit("px"),
    whole("h", "height of its box").unit("px"),
    number("cx", "column of its centroid").unit("px"),
    number("cy", "row of its centroid").unit("px"),
    whole("pixels", "number of pixels of the colour").unit("px"),
    whole("area", "area of its box").unit("px"),
    number("density", "`pixels / area`, 0 to 1"),
    number("rotation", "direction of its long axis; 0 is horizontal").unit("rad"),
    number("elongation", "0 for a disc, towards 1 for a line"),
    number("roundness", "1 for a disc, 0 for a line"),
    whole("perimeter", "number of its border pixels").unit("px"),
    whole(
        "code",
        "a bit field: one bit for each colour of the list, set if the blob has that colour",
    ),
    whole("count", "number of blobs merged into it"),
    text(
        "colour",
        "the first name that matches; nil for a colour without a name",
    )
    .optional(),
    number("bearing", "direction of its centroid, left positive").unit("rad"),
    boolean("edge", "whether it touches the border of the picture"),
];

const FOLLOWED: [Value; 23] = {
    let own = [
        whole("id", "constant while it is followed"),
        whole("age", "frames since it was first seen"),
        whole("lost", "frames since it was last seen; 0 while in sight"),
        number("vx", "to the right").unit("px/s"),
        number("vy", "downwards").unit("px/s"),
    ];
    let mut all = [own[0]; 23];
    let mut at = 0;
    while at < 23 {
        all[at] = if at < 18 { PATCH[at] } else { own[at - 18] };
        at += 1;
    }
    all
};

pub(super) const BLOB: Object = table("Blob")
    .doc("A patch of a colour in a frame.")
    .fields(&PATCH);

pub(super) const TRACK: Object = table("Track")
    .doc("A Blob that a tracker follows from frame to frame.")
    .fields(&FOLLOWED);

pub(super) const LINE: Object = table("Line").doc("A line on the floor.").fields(&[
    number("offset", "-1 is the left border, 1 the right one"),
    number("angle", "direction of the line").unit("rad"),
    number("strength", "confidence, 0 to 1"),
]);

pub(super) const QR_CODE: Object = table("QrCode").doc("A QR code in a frame.").fields(&[
    text("text", "its content"),
    value(
        "corners",
        Type::List(&Type::Object(&CORNER)),
        "its four corners",
    ),
]);

pub(super) const CORNER: Object = table("Corner")
    .doc("A point of a frame.")
    .fields(&[number("x", "").unit("px"), number("y", "").unit("px")]);

pub(super) const MOTION: Object = table("Motion").doc("The motion between frames.").fields(&[
    number("score", "share of the picture that changed, 0 to 1"),
    whole("pixels", "number of pixels that changed").unit("px"),
    value(
        "blobs",
        Type::List(&Type::Object(&BLOB)),
        "the areas that changed",
    ),
]);

const TRACKS: TrackerOptions = TrackerOptions::DEFAULT;
const MOVES: MotionOptions = MotionOptions::DEFAULT;
const LIGHTNESS: Literal = Literal::Range(0.0, 100.0);
const OPPONENT: Literal = Literal::Range(-128.0, 127.0);
const HUE: Literal = Literal::Range(0.0, 360.0);
const PERCENT: Literal = Literal::Range(0.0, 100.0);
const NEXT: Value = object("frame", &FRAME, "the next frame");

pub(super) const COLOUR: Object = strict("Colour")
    .doc("A colour without a name; made by `vision.lab`, `vision.hsv` and `vision.learn`.");

pub(super) const LEARNED: Object = table("Learned")
    .doc("The quality of a learned colour.")
    .fields(&[number("quality", "0 to 1")]);

pub(super) const TRACKER: Object = strict("Tracker")
    .doc("Follows blobs; made by `vision.tracker`.")
    .methods(&[
        call("Tracker:update")
            .takes(&[NEXT])
            .returns(&[value("tracks", Type::List(&Type::Object(&TRACK)), "")])
            .doc("Updates the tracks with the next frame."),
        call("Tracker:best")
            .returns(&[object("track", &TRACK, "nil while there is none").optional()])
            .doc("Returns the blob to follow: the largest of those seen for long enough.")
            .pure(),
        call("Tracker:reset").doc("Forgets everything seen so far."),
    ]);

pub(super) const DETECTOR: Object = strict("Detector")
    .doc("Detects motion; made by `vision.motion`.")
    .methods(&[call("Detector:update")
        .takes(&[NEXT])
        .returns(&[
            object(
                "motion",
                &MOTION,
                "nil while the robot moves, and for a second afterwards",
            )
            .optional(),
            text("why", "\"moving\"").optional(),
        ])
        .doc("Compares a frame with the previous ones.")]);

pub(super) const VISION: Namespace = namespace("vision", "colours, trackers and motion detectors")
    .functions(&[
        call("vision.lab")
            .takes(&[options(&[
                range("l", LIGHTNESS, "lightness"),
                range("a", OPPONENT, "from green to red"),
                range("b", OPPONENT, "from blue to yellow"),
            ])])
            .returns(&[object("colour", &COLOUR, "")])
            .doc("Makes a colour from ranges of L*a*b*."),
        call("vision.hsv")
            .takes(&[options(&[
                range("h", HUE, "hue; may wrap, as in {340, 20}").unit("degrees"),
                range("s", PERCENT, "saturation").unit("%"),
                range("v", PERCENT, "value").unit("%"),
            ])])
            .returns(&[object("colour", &COLOUR, "")])
            .doc("Makes a colour from ranges of hue, saturation and value."),
        call("vision.tracker")
            .takes(&[options(&[
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
            .required()])
            .returns(&[object("tracker", &TRACKER, "")])
            .doc("Makes a tracker, which follows blobs from frame to frame."),
        call("vision.motion")
            .takes(&[options(&[
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
            ])])
            .returns(&[object("detector", &DETECTOR, "")])
            .doc("Makes a motion detector, for a camera that stands still."),
        call("vision.learn")
            .takes(&[
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
            ])
            .returns(&[
                object("colour", &COLOUR, "nil if no colour could be learned").optional(),
                value(
                    "info",
                    Type::Any,
                    "a Learned; if no colour could be learned, \"too_grey\" or \"too_mixed\"",
                ),
            ])
            .doc("Learns the colour of an object in front of the camera."),
    ]);
