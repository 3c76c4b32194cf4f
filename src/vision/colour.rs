//! Definition of a colour: ranges in CIE Lab or in HSV, or one of nine names.
//!
//! [`Colour::contains`] computes exactly; [`super::Palette`] is the fast, tabulated form.

pub(crate) mod labeller;
pub(crate) mod learn;
pub(crate) mod palette;

use serde::{Deserialize, Serialize, Serializer};
use std::fmt;
use thiserror::Error;

use crate::picture::{hsv_of, lab_of};

/// Lowest and highest value, both inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Span(f64, f64);

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "[{}, {}]", self.0, self.1)
    }
}

impl Span {
    fn has(self, value: f64) -> bool {
        (self.0..=self.1).contains(&value)
    }

    fn has_wrapped(self, value: f64) -> bool {
        if self.0 <= self.1 {
            self.has(value)
        } else {
            value >= self.0 || value <= self.1
        }
    }
}

/// A set of colours that are treated as one when blobs are found.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "Written")]
pub enum Colour {
    /// Ranges in CIE Lab under D65.
    Lab {
        /// Lightness, 0..100.
        l: Span,
        /// Green to red, -128..127.
        a: Span,
        /// Blue to yellow, -128..127.
        b: Span,
    },
    /// Ranges in HSV.
    Hsv {
        /// Hue in degrees, 0..360; may wrap, as `340..20`. Greys have hue 0.
        h: Span,
        /// Saturation in percent.
        s: Span,
        /// Value in percent.
        v: Span,
    },
    /// One of [`Colour::NAMES`].
    Named(NamedColour),
}

/// Why ranges or a name do not define a colour.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("{0}")]
pub struct ColourError(String);

/// Ranges of hue, saturation and value, as in [`Colour::Hsv`].
type HsvRanges = [Span; 3];

/// The named colours; a pixel has one if it is within any of its ranges. Cheap cameras in dim light
/// see paint with half of its saturation, and red paint with a hue towards magenta: the further
/// ranges, which leave out skin and wood, and whatever is so near to grey that looking it up in all
/// walls and floors would take time.
const NAMED: [(&str, &[HsvRanges]); 9] = [
    (
        "red",
        &[
            [Span(340.0, 12.0), Span(50.0, 100.0), Span(25.0, 100.0)],
            [Span(318.0, 352.0), Span(22.0, 55.0), Span(32.0, 60.0)],
            [Span(318.0, 352.0), Span(32.0, 55.0), Span(22.0, 60.0)],
        ],
    ),
    (
        "orange",
        &[[Span(15.0, 42.0), Span(60.0, 100.0), Span(45.0, 100.0)]],
    ),
    (
        "yellow",
        &[
            [Span(42.0, 70.0), Span(50.0, 100.0), Span(40.0, 100.0)],
            [Span(47.0, 70.0), Span(38.0, 100.0), Span(25.0, 100.0)],
        ],
    ),
    (
        "green",
        &[[Span(70.0, 160.0), Span(40.0, 100.0), Span(20.0, 100.0)]],
    ),
    (
        "cyan",
        &[[Span(160.0, 200.0), Span(40.0, 100.0), Span(25.0, 100.0)]],
    ),
    (
        "blue",
        &[[Span(200.0, 260.0), Span(45.0, 100.0), Span(20.0, 100.0)]],
    ),
    (
        "magenta",
        &[[Span(260.0, 340.0), Span(40.0, 100.0), Span(25.0, 100.0)]],
    ),
    (
        "white",
        &[[Span(0.0, 360.0), Span(0.0, 15.0), Span(80.0, 100.0)]],
    ),
    (
        "black",
        &[[Span(0.0, 360.0), Span(0.0, 100.0), Span(0.0, 15.0)]],
    ),
];

/// A colour with a name, by its index in the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NamedColour(usize);

impl NamedColour {
    /// Its name.
    pub fn name(self) -> &'static str {
        NAMED[self.0].0
    }

    fn has(self, [hue, saturation, value]: [f64; 3]) -> bool {
        let mut ranges = NAMED[self.0].1.iter();
        ranges.any(|[h, s, v]| h.has_wrapped(hue) && s.has(saturation) && v.has(value))
    }
}

impl Colour {
    /// The names that [`Colour::named`] accepts.
    pub const NAMES: [&'static str; NAMED.len()] = {
        let mut names = [""; NAMED.len()];
        let mut i = 0;
        while i < names.len() {
            names[i] = NAMED[i].0;
            i += 1;
        }
        names
    };

    /// The colour with one of [`Colour::NAMES`]; `None` for other names.
    pub fn named(name: &str) -> Option<Colour> {
        let index = NAMED.iter().position(|named| named.0 == name)?;
        Some(Colour::Named(NamedColour(index)))
    }

    /// Ranges in CIE Lab: `l` 0..100, `a` and `b` -128..127, lowest first.
    pub fn lab(l: [f64; 2], a: [f64; 2], b: [f64; 2]) -> Result<Colour, ColourError> {
        Ok(Colour::Lab {
            l: rising('l', l, 0.0, 100.0)?,
            a: rising('a', a, -128.0, 127.0)?,
            b: rising('b', b, -128.0, 127.0)?,
        })
    }

    /// Ranges in HSV: `h` in degrees 0..360, may wrap; `s` and `v` in percent.
    pub fn hsv(h: [f64; 2], s: [f64; 2], v: [f64; 2]) -> Result<Colour, ColourError> {
        Ok(Colour::Hsv {
            h: bounded('h', h, 0.0, 360.0)?,
            s: rising('s', s, 0.0, 100.0)?,
            v: rising('v', v, 0.0, 100.0)?,
        })
    }

    /// Whether a pixel (red, green, blue; 0..255, sRGB) is of this colour. Exact, and slow.
    pub fn contains(&self, rgb: [u8; 3]) -> bool {
        self.matches(rgb.map(f64::from))
    }

    pub(crate) fn matches(&self, rgb: [f64; 3]) -> bool {
        match self {
            Colour::Lab { .. } => self.matches_lab(lab_of(rgb)),
            Colour::Hsv { .. } | Colour::Named(_) => self.matches_hsv(hsv_of(rgb)),
        }
    }

    /// Whether a Lab value is within the ranges; always false for a colour in HSV.
    pub(crate) fn matches_lab(&self, value: [f64; 3]) -> bool {
        matches!(self, Colour::Lab { l, a, b } if l.has(value[0]) && a.has(value[1]) && b.has(value[2]))
    }

    /// Whether an HSV value is within the ranges; always false for a colour in Lab.
    pub(crate) fn matches_hsv(&self, value: [f64; 3]) -> bool {
        match self {
            Colour::Lab { .. } => false,
            Colour::Hsv { h, s, v } => {
                h.has_wrapped(value[0]) && s.has(value[1]) && v.has(value[2])
            }
            Colour::Named(named) => named.has(value),
        }
    }
}

fn bounded(
    channel: char,
    [low, high]: [f64; 2],
    least: f64,
    most: f64,
) -> Result<Span, ColourError> {
    let fits = |value: f64| (least..=most).contains(&value);
    if fits(low) && fits(high) {
        Ok(Span(low, high))
    } else {
        Err(ColourError(format!(
            "{channel} = {low}..{high} must lie within {least}..{most}"
        )))
    }
}

fn rising(channel: char, range: [f64; 2], least: f64, most: f64) -> Result<Span, ColourError> {
    let span = bounded(channel, range, least, most)?;
    if span.0 > span.1 {
        let Span(low, high) = span;
        return Err(ColourError(format!(
            "{channel} = {low}..{high} is empty: write the smaller number first"
        )));
    }
    Ok(span)
}

/// Formats the colour for a config: `{ l: [30, 70], a: [20, 80], b: [10, 60] }` or `{ name: red }`.
impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Colour::Lab { l, a, b } => write!(f, "{{ l: {l}, a: {a}, b: {b} }}"),
            Colour::Hsv { h, s, v } => write!(f, "{{ h: {h}, s: {s}, v: {v} }}"),
            Colour::Named(named) => write!(f, "{{ name: {} }}", named.name()),
        }
    }
}

/// The serialised form of a colour: channels by letter; omitted ones have their full range.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Written {
    l: Option<[f64; 2]>,
    a: Option<[f64; 2]>,
    b: Option<[f64; 2]>,
    h: Option<[f64; 2]>,
    s: Option<[f64; 2]>,
    v: Option<[f64; 2]>,
    name: Option<String>,
}

impl TryFrom<Written> for Colour {
    type Error = ColourError;

    fn try_from(written: Written) -> Result<Colour, ColourError> {
        let lab = [written.l, written.a, written.b];
        let hsv = [written.h, written.s, written.v];
        let given = |channels: &[Option<[f64; 2]>]| channels.iter().any(Option::is_some);
        let chroma = [-128.0, 127.0];
        let percent = [0.0, 100.0];
        match (given(&lab), given(&hsv), written.name) {
            (true, false, None) => Colour::lab(
                lab[0].unwrap_or(percent),
                lab[1].unwrap_or(chroma),
                lab[2].unwrap_or(chroma),
            ),
            (false, true, None) => Colour::hsv(
                hsv[0].unwrap_or([0.0, 360.0]),
                hsv[1].unwrap_or(percent),
                hsv[2].unwrap_or(percent),
            ),
            (false, false, Some(name)) => {
                let names = Colour::NAMES.join(", ");
                Colour::named(&name).ok_or_else(|| {
                    ColourError(format!(
                        "no colour has the name {name:?}: use one of {names}"
                    ))
                })
            }
            _ => Err(ColourError(
                "a colour needs l, a, b or h, s, v or a name, not several of them".to_owned(),
            )),
        }
    }
}

impl Serialize for Colour {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        let written = Written::from(*self);
        if !serializer.is_human_readable() {
            return written.serialize(serializer);
        }
        let mut map = serializer.serialize_map(None)?;
        let lab = [("l", written.l), ("a", written.a), ("b", written.b)];
        let hsv = [("h", written.h), ("s", written.s), ("v", written.v)];
        for (channel, range) in lab.into_iter().chain(hsv) {
            if let Some(range) = range {
                map.serialize_entry(channel, &range)?;
            }
        }
        if let Some(name) = written.name {
            map.serialize_entry("name", &name)?;
        }
        map.end()
    }
}

impl From<Colour> for Written {
    fn from(colour: Colour) -> Written {
        let range = |Span(low, high)| Some([low, high]);
        match colour {
            Colour::Lab { l, a, b } => Written {
                l: range(l),
                a: range(a),
                b: range(b),
                ..Written::default()
            },
            Colour::Hsv { h, s, v } => Written {
                h: range(h),
                s: range(s),
                v: range(v),
                ..Written::default()
            },
            Colour::Named(named) => Written {
                name: Some(named.name().to_owned()),
                ..Written::default()
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pure_colours_have_one_name_each() {
        let pure = [
            ("red", [255, 0, 0]),
            ("orange", [255, 128, 0]),
            ("yellow", [255, 255, 0]),
            ("green", [0, 255, 0]),
            ("cyan", [0, 255, 255]),
            ("blue", [0, 0, 255]),
            ("magenta", [255, 0, 255]),
            ("white", [255, 255, 255]),
            ("black", [0, 0, 0]),
        ];
        for (name, rgb) in pure {
            let names: Vec<_> = Colour::NAMES
                .into_iter()
                .filter(|other| Colour::named(other).unwrap().contains(rgb))
                .collect();
            assert_eq!(names, [name], "{rgb:?}");
        }
        assert_eq!(Colour::named("mauve"), None);
    }

    /// Lights, as factors of red, green and blue: even, warm, cool, dim, and the corner of a frame.
    const LIGHTS: [[f64; 3]; 6] = [
        [1.0, 1.0, 1.0],
        [1.0, 0.86, 0.65],
        [0.85, 0.95, 1.0],
        [0.5, 0.5, 0.5],
        [1.0, 0.92, 0.93],
        [0.48, 0.545, 0.605],
    ];

    /// How many of these surfaces have the colour: in all lights, lit fully and on their shaded
    /// side, as a camera sees them that keeps this share of the saturation.
    fn found(name: &str, surfaces: &[[u8; 3]], saturation: f64, shades: &[f64]) -> usize {
        let colour = Colour::named(name).unwrap();
        let mut found = 0;
        for surface in surfaces {
            let [r, g, b] = surface.map(f64::from);
            let grey = 0.3 * r + 0.586 * g + 0.114 * b;
            let pale = [r, g, b].map(|channel| grey + (channel - grey) * saturation);
            for light in LIGHTS {
                for shade in shades {
                    let seen = [0, 1, 2].map(|i| (pale[i] * light[i] * shade).round() as u8);
                    found += usize::from(colour.contains(seen));
                }
            }
        }
        found
    }

    #[test]
    fn a_red_fire_extinguisher_is_red_on_a_genuine_frame() {
        // Means of parts of extinguishers 3 m away, measured on genuine frames.
        let red = Colour::named("red").unwrap();
        for rgb in [
            [96, 74, 82],
            [81, 51, 66],
            [78, 46, 61],
            [95, 60, 75],
            [87, 49, 64],
        ] {
            assert!(red.contains(rgb), "{rgb:?}");
        }
    }

    #[test]
    fn paint_is_found_in_many_lights_also_by_a_camera_that_sees_it_pale() {
        // RAL 3000, 3001 and 3020, 1003, 1018, 1023 and 1026 roughly, and the paints of worlds.
        let red = [[175, 43, 30], [155, 36, 35], [193, 18, 28], [206, 28, 36]];
        let yellow = [
            [250, 210, 1],
            [243, 218, 11],
            [239, 232, 50],
            [240, 208, 24],
        ];
        let shades = [1.0, 0.8, 0.6];
        let all = 4 * LIGHTS.len() * shades.len();
        for (saturation, reds, yellows) in [(1.0, 60, 60), (0.7, 55, 60), (0.45, 38, 38)] {
            let red = found("red", &red, saturation, &shades);
            let yellow = found("yellow", &yellow, saturation, &shades);
            assert!(red >= reds && yellow >= yellows, "{red} {yellow} of {all}");
        }
    }

    #[test]
    fn skin_and_wood_are_neither_red_nor_yellow() {
        // The Monk Skin Tone Scale, the two of the ColorChecker, and rosy ones.
        let skin = [
            [246, 237, 228],
            [243, 231, 219],
            [247, 234, 208],
            [234, 218, 186],
            [215, 189, 150],
            [160, 126, 86],
            [130, 92, 67],
            [96, 65, 52],
            [58, 49, 42],
            [41, 36, 32],
            [115, 82, 68],
            [194, 150, 130],
            [230, 150, 140],
            [210, 140, 125],
            [200, 120, 110],
        ];
        // Maple, pine, oak, teak, walnut, and the planks and furniture of worlds.
        let wood = [
            [222, 184, 135],
            [210, 180, 140],
            [184, 148, 95],
            [139, 69, 19],
            [112, 74, 44],
            [154, 137, 118],
            [138, 115, 88],
        ];
        for saturation in [1.0, 0.7, 0.45] {
            for name in ["red", "yellow"] {
                let skin = found(name, &skin, saturation, &[1.0, 0.7]);
                let wood = found(name, &wood, saturation, &[1.0, 0.7]);
                assert_eq!((skin, wood), (0, 0), "{name} at {saturation}");
            }
        }
        // Cherry and mahogany come close to red paint: rarely.
        let reddish = [[146, 70, 50], [120, 60, 40]];
        assert!(found("red", &reddish, 1.0, &[1.0, 0.7]) <= 4);
    }

    #[test]
    fn a_hue_may_wrap() {
        let red = Colour::hsv([340.0, 20.0], [50.0, 100.0], [30.0, 100.0]).unwrap();
        assert!(
            red.contains([255, 0, 40]) && red.contains([255, 40, 0]) && !red.contains([0, 255, 0])
        );
    }

    #[test]
    fn impossible_ranges_are_refused_with_their_channel() {
        let refused = |colour: Result<Colour, ColourError>, says: &str| {
            let text = colour.unwrap_err().to_string();
            assert!(text.contains(says), "{text:?} does not say {says:?}");
        };
        refused(
            Colour::lab([70.0, 30.0], [0.0, 1.0], [0.0, 1.0]),
            "l = 70..30 is empty",
        );
        refused(
            Colour::lab([0.0, 100.0], [-129.0, 1.0], [0.0, 1.0]),
            "a = -129..1 must lie within -128..127",
        );
        refused(
            Colour::hsv([0.0, 361.0], [0.0, 1.0], [0.0, 1.0]),
            "h = 0..361",
        );
        refused(
            Colour::hsv([0.0, f64::NAN], [0.0, 1.0], [0.0, 1.0]),
            "h = 0..NaN",
        );
        refused(
            Colour::hsv([0.0, 360.0], [9.0, 1.0], [0.0, 1.0]),
            "s = 9..1 is empty",
        );
    }

    #[test]
    fn a_config_holds_colours_by_channel() {
        let read = |text| serde_yaml::from_str::<Colour>(text);
        let ball = read("{ l: [30, 70], a: [20, 80], b: [10, 60] }").unwrap();
        assert_eq!(
            ball,
            Colour::lab([30.0, 70.0], [20.0, 80.0], [10.0, 60.0]).unwrap()
        );
        assert_eq!(
            read("h: [340, 20]").unwrap(),
            Colour::hsv([340.0, 20.0], [0.0, 100.0], [0.0, 100.0]).unwrap()
        );
        assert!(
            read("{ l: [30, 70], h: [0, 9] }")
                .unwrap_err()
                .to_string()
                .contains("not several")
        );
        assert!(
            read("{ name: mauve }")
                .unwrap_err()
                .to_string()
                .contains("one of red, orange")
        );
        assert!(
            read("{ hue: [0, 9] }")
                .unwrap_err()
                .to_string()
                .contains("unknown field `hue`")
        );
        assert!(
            read("{ l: [30, 170] }")
                .unwrap_err()
                .to_string()
                .contains("0..100")
        );
    }

    #[test]
    fn a_colour_survives_every_serialisation() {
        for colour in [
            Colour::named("red").unwrap(),
            Colour::hsv([340.0, 20.0], [50.0, 100.0], [30.0, 100.0]).unwrap(),
            Colour::lab([0.5, 7.0], [-20.0, 8.0], [1.0, 6.0]).unwrap(),
        ] {
            let compact = postcard::to_allocvec(&colour).unwrap();
            assert_eq!(postcard::from_bytes::<Colour>(&compact).unwrap(), colour);
            assert_eq!(
                serde_yaml::from_str::<Colour>(&serde_yaml::to_string(&colour).unwrap()).unwrap(),
                colour
            );
            assert_eq!(
                serde_yaml::from_str::<Colour>(&colour.to_string()).unwrap(),
                colour
            );
        }
    }
}
