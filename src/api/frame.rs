//! Frames, and the tables that describe what is found in them.

use super::make::{
    boolean, bounded, call, count, number, object, options, short_text, strict, table, text, value,
    whole,
};
use super::model::{Bounds, Function, Object, Type, Value};
use crate::vision::BlobOptions;

const ROI: Value = value("roi", Type::Roi, "search or measure only this part").optional();
pub(super) const COLOURS: Value = value("colour", Type::Colours, "what to look for");
/// Coordinates and sizes of a part of a frame, in pixels.
pub const PIXELS: Bounds = Bounds::Between(-10_000.0, 10_000.0);
/// The angles of a direction, in radians.
const ANGLE: Bounds = Bounds::Between(-3.2, 3.2);
const USUAL: BlobOptions = BlobOptions::DEFAULT;

const FIND_BLOBS: Function = call(
    "Frame:find_blobs",
    &[
        COLOURS,
        options(&[
            ROI,
            boolean("invert", "find what does not have the colour").default_is(USUAL.invert),
            count("area_threshold", 2_000_000, "the smallest area of a blob's box")
                .unit("px")
                .default(USUAL.area_threshold as f64),
            count("pixels_threshold", 2_000_000, "the smallest number of pixels of the colour")
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
            count("max_blobs", 1000, "the largest number of blobs to return").default(USUAL.max_blobs as f64),
        ]),
    ],
    &[value(
        "blobs",
        Type::List(&Type::Object(&BLOB)),
        "the largest first; empty if there are none",
    )],
    "Finds blobs, which are patches of a colour. The names and options are those of OpenMV.",
    "local ball = frame:find_blobs(\"red\", { pixels_threshold = 25 })[1]\nif ball then\n\tprint(ball.cx, ball.bearing)\nend",
)
.pure();

pub(super) const FRAME: Object = strict(
    "Frame",
    "A picture of the camera, decoded when it is first used.",
    &[
        whole("seq", "its sequence number"),
        number("age", "time since it arrived").unit("s"),
        whole("width", "").unit("px"),
        whole("height", "").unit("px"),
        whole("bytes", "size of the JPEG"),
        number("lens_height", "of the camera above the floor, from the config's `camera`").unit("m"),
    ],
    &[
        FIND_BLOBS,
        call(
            "Frame:find_line",
            &[COLOURS, options(&[ROI])],
            &[object("line", &LINE, "nil if there is none").optional()],
            "Finds a line on the floor, for line following.",
            "local line = frame:find_line(\"black\")\nif line then\n\trobot.drive(0.1, -line.offset)\nend",
        )
        .pure(),
        call(
            "Frame:find_qrcodes",
            &[],
            &[value("codes", Type::List(&Type::Object(&QR_CODE)), "")],
            "Reads QR codes.",
            "for _, code in frame:find_qrcodes() do\n\tprint(code.text)\nend",
        )
        .pure(),
        call(
            "Frame:brightness",
            &[ROI],
            &[number("brightness", "0 is black, 1 is white")],
            "Measures the brightness of the picture.",
            "if frame:brightness() < 0.1 then\n\trobot.led(\"flash\", true)\nend",
        )
        .pure(),
        call(
            "Frame:sharpness",
            &[ROI],
            &[number("sharpness", "0 or more; higher is sharper")],
            "Measures the sharpness of the picture, to compare pictures of one scene.",
            "print(frame:sharpness())",
        )
        .pure(),
        call(
            "Frame:get_pixel",
            &[
                bounded("x", PIXELS, "column, 0 is the left").unit("px"),
                bounded("y", PIXELS, "row, 0 is the top").unit("px"),
            ],
            &[
                whole("r", "red, 0 to 255; nil outside the picture").optional(),
                whole("g", "green").optional(),
                whole("b", "blue").optional(),
            ],
            "Returns the colour of one pixel.",
            "local r, g, b = frame:get_pixel(160, 120)\nprint(r, g, b)",
        )
        .pure(),
        call(
            "Frame:direction",
            &[
                bounded("x", PIXELS, "column, 0 is the centre of the leftmost pixel").unit("px"),
                bounded("y", PIXELS, "row, 0 is the centre of the topmost pixel").unit("px"),
            ],
            &[
                number("bearing", "left positive; nil in a damaged picture")
                    .unit("rad")
                    .optional(),
                number("elevation", "above the horizon positive")
                    .unit("rad")
                    .optional(),
            ],
            "Returns the direction of a point of the picture, for a robot on level ground, computed with the pose and the lens of the config's `camera`.",
            "local bearing, elevation = frame:direction(160, 100)\nif bearing and elevation then\n\tprint(math.deg(bearing), math.deg(elevation))\nend",
        )
        .pure(),
        call(
            "Frame:floor_position",
            &[
                bounded("x", PIXELS, "column, 0 is the centre of the leftmost pixel").unit("px"),
                bounded("y", PIXELS, "row, 0 is the centre of the topmost pixel").unit("px"),
            ],
            &[
                number("ahead", "from below the lens; nil above the horizon and in a damaged picture")
                    .unit("m")
                    .optional(),
                number("left", "to the left positive").unit("m").optional(),
            ],
            "Returns the place on the floor that a point of the picture shows, if it shows floor, computed with the config's `camera`.",
            "local ahead, left = frame:floor_position(160, 200)\nif ahead and left then\n\tprint(`the floor there is {math.sqrt(ahead ^ 2 + left ^ 2)} m away`)\nend",
        )
        .pure(),
        call(
            "Frame:pixel_at",
            &[
                bounded("bearing", ANGLE, "left positive").unit("rad"),
                bounded("elevation", ANGLE, "above the horizon positive").unit("rad"),
            ],
            &[
                number("x", "column; nil for a direction beside or behind the camera")
                    .unit("px")
                    .optional(),
                number("y", "row; like the column it may be outside the picture")
                    .unit("px")
                    .optional(),
            ],
            "Returns the point of the picture in a direction: the inverse of `frame:direction`.",
            "local x, y = frame:pixel_at(math.rad(10), 0)\nif x and y then\n\tprint(frame:get_pixel(x, y))\nend",
        )
        .pure(),
        call(
            "Frame:save",
            &[short_text("name", 100, "letters, digits, `-`, `_` and `.`")],
            &[
                text("path", "nil if it was not saved").optional(),
                text("why", "\"quota\" or \"io\"").optional(),
            ],
            "Saves the picture as the camera sent it. When the folder is full, the oldest pictures are deleted. \"quota\" means that the script has used up its bytes for the day, or that the disk is nearly full.",
            "local path, why = frame:save(\"ball.jpg\")\nprint(path or why)",
        ),
    ],
);

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

pub(super) const BLOB: Object = table("Blob", "A patch of a colour in a frame.", &PATCH);

pub(super) const TRACK: Object = table(
    "Track",
    "A Blob that a tracker follows from frame to frame.",
    &FOLLOWED,
);

pub(super) const LINE: Object = table(
    "Line",
    "A line on the floor.",
    &[
        number("offset", "-1 is the left border, 1 the right one"),
        number("angle", "direction of the line").unit("rad"),
        number("strength", "confidence, 0 to 1"),
    ],
);

pub(super) const QR_CODE: Object = table(
    "QrCode",
    "A QR code in a frame.",
    &[
        text("text", "its content"),
        value(
            "corners",
            Type::List(&Type::Object(&CORNER)),
            "its four corners",
        ),
    ],
);

pub(super) const CORNER: Object = table(
    "Corner",
    "A point of a frame.",
    &[number("x", "").unit("px"), number("y", "").unit("px")],
);

pub(super) const MOTION: Object = table(
    "Motion",
    "The motion between frames.",
    &[
        number("score", "share of the picture that changed, 0 to 1"),
        whole("pixels", "number of pixels that changed").unit("px"),
        value(
            "blobs",
            Type::List(&Type::Object(&BLOB)),
            "the areas that changed",
        ),
    ],
);
