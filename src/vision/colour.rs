//! Definition of a colour: ranges in CIE Lab or in HSV, or one of nine names.
//!
//! [`Colour::contains`] computes exactly; [`super::Palette`] is the fast, tabulated form.

#[cfg(target_arch = "x86_64")]
mod avx2;
pub(crate) mod labeller;
pub(crate) mod learn;
pub(crate) mod palette;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use thiserror::Error;

use crate::vision::picture::{hsv_of, lab_of};

/// Lowest and highest value, both inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Span(f64, f64);

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
#[derive(Debug, Clone, Copy, PartialEq)]
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
}

/// Why three ranges do not define a colour.
#[derive(Debug, Clone, PartialEq, Error)]
#[non_exhaustive]
pub enum ColourError {
    /// A bound is outside the channel's limits or is not a number.
    #[error("{channel} = {low}..{high} must lie within {least}..{most}")]
    OutOfRange {
        /// The channel's letter.
        channel: char,
        /// The lower bound as given.
        low: f64,
        /// The upper bound as given.
        high: f64,
        /// The channel's lower limit.
        least: f64,
        /// The channel's upper limit.
        most: f64,
    },
    /// The lower bound is above the upper one.
    #[error("{channel} = {low}..{high} is empty: write the smaller number first")]
    Empty {
        /// The channel's letter.
        channel: char,
        /// The lower bound as given.
        low: f64,
        /// The upper bound as given.
        high: f64,
    },
    /// Channels of both spaces, or of neither.
    #[error("a colour needs l, a, b or h, s, v, not both")]
    Mixed,
}

type Range = [f64; 2];

/// The named colours: hue range in degrees, saturation and value in percent.
const NAMED: [(&str, Range, Range, Range); 9] = [
    ("red", [340.0, 15.0], [50.0, 100.0], [25.0, 100.0]),
    ("orange", [15.0, 42.0], [60.0, 100.0], [45.0, 100.0]),
    ("yellow", [42.0, 70.0], [50.0, 100.0], [40.0, 100.0]),
    ("green", [70.0, 160.0], [40.0, 100.0], [20.0, 100.0]),
    ("cyan", [160.0, 200.0], [40.0, 100.0], [25.0, 100.0]),
    ("blue", [200.0, 260.0], [45.0, 100.0], [20.0, 100.0]),
    ("magenta", [260.0, 340.0], [40.0, 100.0], [25.0, 100.0]),
    ("white", [0.0, 360.0], [0.0, 15.0], [80.0, 100.0]),
    ("black", [0.0, 360.0], [0.0, 100.0], [0.0, 15.0]),
];

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
        let &(_, h, s, v) = NAMED.iter().find(|named| named.0 == name)?;
        let span = |[low, high]: [f64; 2]| Span(low, high);
        Some(Colour::Hsv {
            h: span(h),
            s: span(s),
            v: span(v),
        })
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
            Colour::Hsv { .. } => self.matches_hsv(hsv_of(rgb)),
        }
    }

    /// Whether a Lab value is within the ranges; always false for a colour in HSV.
    pub(crate) fn matches_lab(&self, value: [f64; 3]) -> bool {
        matches!(self, Colour::Lab { l, a, b } if l.has(value[0]) && a.has(value[1]) && b.has(value[2]))
    }

    /// Whether an HSV value is within the ranges; always false for a colour in Lab.
    pub(crate) fn matches_hsv(&self, value: [f64; 3]) -> bool {
        matches!(self, Colour::Hsv { h, s, v } if h.has_wrapped(value[0]) && s.has(value[1]) && v.has(value[2]))
    }

    fn channels(&self) -> [(char, Span); 3] {
        match *self {
            Colour::Lab { l, a, b } => [('l', l), ('a', a), ('b', b)],
            Colour::Hsv { h, s, v } => [('h', h), ('s', s), ('v', v)],
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
        Err(ColourError::OutOfRange {
            channel,
            low,
            high,
            least,
            most,
        })
    }
}

fn rising(channel: char, range: [f64; 2], least: f64, most: f64) -> Result<Span, ColourError> {
    let span = bounded(channel, range, least, most)?;
    if span.0 > span.1 {
        return Err(ColourError::Empty {
            channel,
            low: span.0,
            high: span.1,
        });
    }
    Ok(span)
}

/// Formats the colour for a config: `{ l: [30, 70], a: [20, 80], b: [10, 60] }`.
impl fmt::Display for Colour {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [(c0, s0), (c1, s1), (c2, s2)] = self.channels();
        write!(
            f,
            "{{ {c0}: [{}, {}], {c1}: [{}, {}], {c2}: [{}, {}] }}",
            s0.0, s0.1, s1.0, s1.1, s2.0, s2.1
        )
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
}

impl TryFrom<Written> for Colour {
    type Error = ColourError;

    fn try_from(written: Written) -> Result<Colour, ColourError> {
        let lab = [written.l, written.a, written.b];
        let hsv = [written.h, written.s, written.v];
        let given = |channels: &[Option<[f64; 2]>]| channels.iter().any(Option::is_some);
        let chroma = [-128.0, 127.0];
        let percent = [0.0, 100.0];
        match (given(&lab), given(&hsv)) {
            (true, false) => Colour::lab(
                lab[0].unwrap_or(percent),
                lab[1].unwrap_or(chroma),
                lab[2].unwrap_or(chroma),
            ),
            (false, true) => Colour::hsv(
                hsv[0].unwrap_or([0.0, 360.0]),
                hsv[1].unwrap_or(percent),
                hsv[2].unwrap_or(percent),
            ),
            _ => Err(ColourError::Mixed),
        }
    }
}

impl<'de> Deserialize<'de> for Colour {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Colour, D::Error> {
        Written::deserialize(deserializer)?
            .try_into()
            .map_err(serde::de::Error::custom)
    }
}

impl Serialize for Colour {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeMap;
        let channels = self
            .channels()
            .map(|(channel, span)| (channel, Some([span.0, span.1])));
        if serializer.is_human_readable() {
            let mut map = serializer.serialize_map(Some(3))?;
            for (channel, span) in channels {
                map.serialize_entry(&channel, &span)?;
            }
            return map.end();
        }
        let [x, y, z] = channels.map(|(_, span)| span);
        match self {
            Colour::Lab { .. } => Written {
                l: x,
                a: y,
                b: z,
                ..Written::default()
            },
            Colour::Hsv { .. } => Written {
                h: x,
                s: y,
                v: z,
                ..Written::default()
            },
        }
        .serialize(serializer)
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
                .contains("not both")
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
