//! Fixtures of a world as defined in YAML: lines on the floor, lamps, signs and sound sources, and
//! when they are on.

use kurbo::{BezPath, ParamCurveNearest, Shape};
use qrcode::QrCode;
use serde::Deserialize;

use super::objects::{Paint, Spot, usual};
use crate::document::number;
use crate::geometry::Point;

/// A line of tape on the floor: straight legs with rounded corners.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tape {
    /// Its corners, from end to end.
    pub through: Vec<Spot>,
    /// Width in metres.
    #[serde(default = "usual::tape_width", deserialize_with = "number::tape")]
    pub width: f64,
    /// Colour of the tape.
    pub colour: Paint,
    /// Radius of the rounded corners, metres; limited by the length of the legs.
    #[serde(default, deserialize_with = "number::rounding")]
    pub rounding: f64,
    /// The last corner is connected to the first.
    #[serde(default)]
    pub closed: bool,
}

/// A lamp under the ceiling.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lamp {
    /// Its name on the map.
    #[serde(default)]
    pub name: String,
    /// The place above which it hangs.
    pub at: Spot,
    /// Brightness directly below it, 0..=1.
    #[serde(default = "number::one", deserialize_with = "number::share")]
    pub brightness: f64,
    /// Colour of its light.
    #[serde(default = "usual::lamp_paint")]
    pub colour: Paint,
    /// Distance in metres at which its light has dropped to half.
    #[serde(default = "usual::lamp_reach", deserialize_with = "number::lamp_reach")]
    pub reach: f64,
    /// When it is on; always if omitted.
    pub on: Option<Schedule>,
    /// When it is off; takes precedence over `on`.
    pub off: Option<Schedule>,
}

/// A QR code on an upright board, on a wall or a post or freestanding.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sign {
    /// Its place. Inside a wall, a piece of furniture or a post, the sign hangs on the outside of
    /// it.
    pub at: Spot,
    /// The direction that it faces, degrees.
    #[serde(deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
    /// The text of the code, at most 100 bytes.
    pub text: String,
    /// Side of the board with its white margin, metres.
    #[serde(default = "usual::sign_side", deserialize_with = "number::sign_side")]
    pub side: f64,
    /// Height of its centre above the floor, metres.
    #[serde(
        default = "usual::sign_height",
        deserialize_with = "number::sign_height"
    )]
    pub height: f64,
}

/// A sound source; the nearer the microphone, the louder it is.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Noise {
    /// Its name on the map.
    #[serde(default)]
    pub name: String,
    /// The place of the source.
    pub at: Spot,
    /// How it sounds.
    #[serde(default)]
    pub kind: NoiseKind,
    /// Frequency of a tone, or 100 times the rate of knocks, hertz.
    #[serde(default = "usual::hertz", deserialize_with = "number::hertz")]
    pub hertz: f64,
    /// Loudness at a distance of 1 m, 0..=1.
    #[serde(default = "usual::loudness", deserialize_with = "number::share")]
    pub loudness: f64,
    /// When it sounds; always if omitted.
    pub on: Option<Schedule>,
    /// When it is silent; takes precedence over `on`.
    pub off: Option<Schedule>,
}

/// How a sound source sounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseKind {
    /// A pure tone.
    #[default]
    Tone,
    /// Noise of all frequencies.
    Hiss,
    /// Short knocks.
    Knock,
}

impl Tape {
    /// Returns the centre line of the tape, with its rounded corners.
    pub(crate) fn path(&self) -> BezPath {
        let corners: Vec<kurbo::Point> = self.through.iter().map(|spot| point(*spot)).collect();
        let mut path = BezPath::new();
        let count = corners.len();
        let Some(&first) = corners.first() else {
            return path;
        };
        if !self.closed || count < 3 {
            path.move_to(first);
        }
        let bends = if self.closed && count >= 3 {
            0..count
        } else {
            1..count.saturating_sub(1)
        };
        for index in bends {
            let before = corners[(index + count - 1) % count];
            let after = corners[(index + 1) % count];
            bend(&mut path, before, corners[index], after, self.rounding);
        }
        if self.closed && count >= 3 {
            path.close_path();
        } else if count >= 2 {
            path.line_to(corners[count - 1]);
        }
        path
    }

    /// Returns the distance in metres from a place to the centre line of the tape.
    pub fn distance(&self, place: Point) -> f64 {
        let place = kurbo::Point::new(place.x, place.y);
        let path = self.path();
        let nearest = path
            .segments()
            .map(|part| part.nearest(place, 1e-3).distance_sq);
        nearest.fold(f64::MAX, f64::min).sqrt()
    }

    /// Returns the length in metres from end to end, or once around if closed.
    pub fn length(&self) -> f64 {
        self.path().perimeter(1e-3)
    }
}

/// Extends a path to a corner and around it, in an arc of at most `radius`.
fn bend(
    path: &mut BezPath,
    before: kurbo::Point,
    corner: kurbo::Point,
    after: kurbo::Point,
    radius: f64,
) {
    let start = |path: &mut BezPath, to| {
        if path.elements().is_empty() {
            path.move_to(to);
        } else {
            path.line_to(to);
        }
    };
    let back = before - corner;
    let on = after - corner;
    let room = back.hypot().min(on.hypot()) / 2.0;
    // Half of the angle between the legs determines how much of them the arc replaces.
    let half = (back.cross(on).abs().atan2(back.dot(on))) / 2.0;
    if radius <= 0.0 || room <= 0.0 || half.sin() < 1e-6 || half.cos() < 1e-6 {
        return start(path, corner);
    }
    let taken = (radius / half.tan()).min(room);
    let turned = std::f64::consts::PI - 2.0 * half;
    let handle = 4.0 / 3.0 * (turned / 4.0).tan() * taken * half.tan();
    let from = corner + back.normalize() * taken;
    let to = corner + on.normalize() * taken;
    start(path, from);
    path.curve_to(
        from - back.normalize() * handle,
        to - on.normalize() * handle,
        to,
    );
}

fn point(spot: Spot) -> kurbo::Point {
    let Point { x, y } = spot.point();
    kurbo::Point::new(x, y)
}

impl Lamp {
    pub(crate) fn lit(&self, seconds: f64) -> bool {
        lit(self.on, self.off, seconds)
    }
}

impl Noise {
    /// Whether the source sounds at a time, in seconds.
    pub(crate) fn sounds(&self, seconds: f64) -> bool {
        lit(self.on, self.off, seconds)
    }
}

/// A schedule, in simulated seconds since the start.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// The first beginning, seconds.
    #[serde(default, deserialize_with = "number::span")]
    pub after: f64,
    /// Duration of each occurrence, seconds; unlimited if omitted.
    #[serde(default, rename = "for", deserialize_with = "number::span")]
    pub lasts: Option<f64>,
    /// Period from one beginning to the next, seconds; once only if omitted or 0.
    #[serde(default, deserialize_with = "number::span")]
    pub every: Option<f64>,
}

impl Schedule {
    /// Whether the schedule is on at a time, in seconds.
    pub fn holds(&self, seconds: f64) -> bool {
        let since = seconds - self.after;
        if since < 0.0 {
            return false;
        }
        let since = match self.every {
            Some(every) if every > 0.0 => since % every,
            _ => since,
        };
        self.lasts.is_none_or(|lasts| since < lasts)
    }
}

/// Whether something is on at a time: during `on`, or always without it, except during `off`.
pub(crate) fn lit(on: Option<Schedule>, off: Option<Schedule>, seconds: f64) -> bool {
    let in_on = on.is_none_or(|times| times.holds(seconds));
    in_on && !off.is_some_and(|times| times.holds(seconds))
}

/// Maximum length of a text in bytes; longer ones have modules too small for the camera.
pub(crate) const MAX_TEXT: usize = 100;

/// Encodes the text of a sign; `None` if it is too long.
pub(crate) fn qr_code(text: &str) -> Option<QrCode> {
    if text.len() > MAX_TEXT {
        return None;
    }
    QrCode::new(text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn tape(yaml: &str) -> Tape {
        serde_yaml::from_str(yaml).unwrap()
    }

    #[test]
    fn a_square_rounded_by_half_its_side_is_a_circle() {
        let tape = tape(
            "{through: [[1, 1], [3, 1], [3, 3], [1, 3]], closed: true, rounding: 1, colour: black}",
        );
        assert!((tape.length() - 2.0 * PI).abs() < 0.01, "{}", tape.length());
        for i in 0..24 {
            let place = Point::new(2.0, 2.0).ahead(f64::from(i), 1.0);
            assert!(tape.distance(place) < 0.01, "{place:?}");
        }
        assert!((tape.distance(Point::new(2.0, 2.0)) - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_tape_without_rounding_passes_through_its_corners_and_ends() {
        let tape = tape("{through: [[1, 1], [3, 1], [3, 3]], colour: black}");
        assert!((tape.length() - 4.0).abs() < 1e-9);
        assert!(tape.distance(Point::new(3.0, 1.0)) < 1e-6);
        assert!((tape.distance(Point::new(3.0, 3.5)) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn degenerate_corners_still_give_a_path() {
        for yaml in [
            "{through: [[1, 1], [1, 1], [1, 1]], rounding: 1, colour: black}",
            "{through: [[1, 1], [2, 1], [1, 1]], rounding: 5, closed: true, colour: black}",
            "{through: [[1, 1], [2, 1], [3, 1]], rounding: 5, colour: black}",
        ] {
            let tape = tape(yaml);
            assert!(tape.distance(Point::new(1.0, 1.0)) < 1e-6, "{yaml}");
            assert!(tape.length().is_finite());
        }
    }

    fn times(yaml: &str) -> Schedule {
        serde_yaml::from_str(yaml).unwrap()
    }

    #[test]
    fn a_schedule_begins_ends_and_repeats() {
        let times = times("{after: 10, for: 5, every: 20}");
        let on: Vec<u32> = (0..60).filter(|t| times.holds(f64::from(*t))).collect();
        assert_eq!(
            on,
            [10, 11, 12, 13, 14, 30, 31, 32, 33, 34, 50, 51, 52, 53, 54]
        );
    }

    #[test]
    fn an_omitted_duration_is_unlimited_and_an_omitted_period_means_once() {
        assert!(times("{after: 3}").holds(1e6) && !times("{after: 3}").holds(2.9));
        assert!(times("{for: 4}").holds(0.0) && !times("{for: 4}").holds(4.0));
    }

    #[test]
    fn off_takes_precedence_over_on() {
        let on = Some(times("{after: 2}"));
        let off = Some(times("{after: 4, for: 1}"));
        let seen: Vec<bool> = [1.0, 3.0, 4.5, 6.0].map(|t| lit(on, off, t)).to_vec();
        assert_eq!(seen, [false, true, false, true]);
        assert!(lit(None, None, 0.0));
    }
}
