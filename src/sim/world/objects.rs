//! The things in a world as defined in YAML, with their places, shapes, colours and routes.

use serde::{Deserialize, Deserializer};

use super::fixtures::Tape;
use crate::document::number;
use crate::geometry::obstacles::Bump;
use crate::geometry::{Point, Pose, Rectangle, Segment};

/// The outer walls, from (0, 0) to (`width`, `depth`), and the floor between them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// Size along x, metres.
    #[serde(deserialize_with = "number::room_side")]
    pub width: f64,
    /// Size along y, metres.
    #[serde(deserialize_with = "number::room_side")]
    pub depth: f64,
    /// Height of all walls, metres.
    #[serde(default = "usual::room_height", deserialize_with = "number::height")]
    pub height: f64,
    /// Kind of floor.
    #[serde(default)]
    pub floor: Floor,
    /// Colour of the walls.
    #[serde(default = "usual::wall_paint")]
    pub walls: Paint,
    /// What the walls have on them.
    #[serde(default)]
    pub decor: Decor,
}

/// The pattern of a floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Floor {
    /// Brown boards with grain and seams.
    #[default]
    Wood,
    /// Light and dark squares.
    Tiles,
    /// A uniform colour with a fine grain.
    Concrete,
    /// Grey tiles of 0.3 m with dark joints, which faintly reflect what stands on them.
    GlossyTiles,
}

/// What the walls have on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decor {
    /// Striped wallpaper, pictures, windows, doors and a light skirting board.
    #[default]
    Home,
    /// One colour, white doors, whiteboards, switches and a grey skirting board.
    Laboratory,
}

/// A straight inner wall.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Start of its centre line.
    pub from: Spot,
    /// End of its centre line.
    pub to: Spot,
    /// Thickness in metres.
    #[serde(
        default = "usual::wall_thickness",
        deserialize_with = "number::thickness"
    )]
    pub thickness: f64,
}

/// A box on the floor.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Furniture {
    /// Its centre.
    pub at: Spot,
    /// Size along its heading, metres.
    #[serde(deserialize_with = "number::side")]
    pub length: f64,
    /// Size across its heading, metres.
    #[serde(deserialize_with = "number::side")]
    pub width: f64,
    /// Height in metres; higher than the camera.
    #[serde(deserialize_with = "number::height")]
    pub height: f64,
    /// Its heading, degrees.
    #[serde(default, deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
    /// Colour of all sides.
    pub colour: Paint,
    /// Its name on the map and in collisions.
    #[serde(default)]
    pub name: String,
}

/// A carpet, parallel to the walls.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rug {
    /// Its centre.
    pub at: Spot,
    /// Size along x, metres.
    #[serde(deserialize_with = "number::side")]
    pub width: f64,
    /// Size along y, metres.
    #[serde(deserialize_with = "number::side")]
    pub depth: f64,
    /// Its main colour.
    pub colour: Paint,
    /// Height of its edge, metres: it slows a robot, or blocks one with little power.
    #[serde(default, deserialize_with = "number::bump")]
    pub height: f64,
}

/// A bar on the floor, as in a doorway: it slows a robot, or blocks one with little power.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sill {
    /// One of its ends.
    pub from: Spot,
    /// The other end.
    pub to: Spot,
    /// Height in metres.
    #[serde(deserialize_with = "number::bump")]
    pub height: f64,
    /// Colour of the bar.
    #[serde(default = "usual::sill_paint")]
    pub colour: Paint,
}

/// A ball, which a robot pushes.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ball {
    /// The place where it touches the floor.
    pub at: Spot,
    /// Radius in metres.
    #[serde(default = "usual::ball_radius", deserialize_with = "number::radius")]
    pub radius: f64,
    /// Colour of the ball.
    pub colour: Paint,
    /// The route along which it rolls.
    pub path: Option<Route>,
}

/// A round column.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Post {
    /// The centre of its foot.
    pub at: Spot,
    /// Radius in metres.
    #[serde(default = "usual::post_radius", deserialize_with = "number::radius")]
    pub radius: f64,
    /// Height in metres.
    #[serde(default = "usual::post_height", deserialize_with = "number::height")]
    pub height: f64,
    /// Colour of the column.
    pub colour: Paint,
}

impl Room {
    /// Returns the floor between the outer walls.
    pub(crate) fn footprint(&self) -> Rectangle {
        Rectangle::new(
            Point::new(self.width / 2.0, self.depth / 2.0),
            [self.width, self.depth],
            0.0,
        )
    }

    pub(crate) fn holds(&self, point: Point) -> bool {
        (0.0..=self.width).contains(&point.x) && (0.0..=self.depth).contains(&point.y)
    }
}

impl Wall {
    pub(crate) fn footprint(&self) -> Rectangle {
        let from = self.from.point();
        let to = self.to.point();
        Rectangle::new(
            from.towards(to, 0.5),
            [from.distance(to) + self.thickness, self.thickness],
            from.direction_of(to),
        )
    }

    pub(super) fn stands_between(&self, a: Point, b: Point) -> bool {
        let mut sides = self.footprint().sides().into_iter();
        sides.any(|side| side.crosses(a, b))
    }
}

impl Sill {
    /// How wide it looks, metres.
    const WIDTH: f64 = 0.04;

    pub(super) fn bump(&self) -> Bump {
        Bump {
            edge: Segment {
                from: self.from.point(),
                to: self.to.point(),
            },
            height: self.height,
        }
    }

    /// Returns the strip of the floor that it covers.
    pub(super) fn strip(&self) -> Tape {
        Tape {
            through: vec![self.from, self.to],
            width: Sill::WIDTH,
            colour: self.colour,
            rounding: 0.0,
            closed: false,
        }
    }
}

impl Rug {
    pub(super) fn bumps(&self) -> impl Iterator<Item = Bump> {
        let sides = self.footprint().sides();
        let height = self.height;
        sides.into_iter().map(move |edge| Bump { edge, height })
    }

    pub(crate) fn footprint(&self) -> Rectangle {
        Rectangle::new(self.at.point(), [self.width, self.depth], 0.0)
    }
}

impl Furniture {
    pub(crate) fn footprint(&self) -> Rectangle {
        Rectangle::new(
            self.at.point(),
            [self.length, self.width],
            self.heading_degrees.to_radians(),
        )
    }
}

/// Where the robot stands at first.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// The place of its centre.
    pub at: Spot,
    /// Heading in degrees, left positive; 0 is along x.
    #[serde(default, deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
}

impl Start {
    /// Returns it as a pose.
    pub fn pose(&self) -> Pose {
        Pose::at(self.at.point(), self.heading_degrees.to_radians())
    }
}

/// `[x, y]` in metres.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Spot([Coordinate; 2]);

#[derive(Debug, Clone, Copy, Deserialize)]
struct Coordinate(#[serde(deserialize_with = "number::coordinate")] f64);

impl Spot {
    /// Returns it as a point.
    pub fn point(self) -> Point {
        Point::new(self.0[0].0, self.0[1].0)
    }
}

const NAMED: [(&str, [u8; 3]); 12] = [
    ("red", [206, 28, 36]),
    ("orange", [238, 120, 20]),
    ("yellow", [240, 208, 24]),
    ("green", [36, 160, 60]),
    ("cyan", [30, 190, 210]),
    ("blue", [32, 76, 200]),
    ("magenta", [200, 40, 160]),
    ("white", [236, 236, 232]),
    ("black", [26, 26, 28]),
    ("grey", [128, 128, 126]),
    ("brown", [112, 74, 44]),
    ("beige", [206, 188, 154]),
];

/// A colour: red, green and blue, 0..=255, under full light.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Paint(pub [u8; 3]);

impl Paint {
    /// Parses a colour name or `#rrggbb`.
    pub fn parse(text: &str) -> Option<Paint> {
        if let Some((_, rgb)) = NAMED.iter().find(|(name, _)| *name == text) {
            return Some(Paint(*rgb));
        }
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6)?;
        if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        let number = u32::from_str_radix(digits, 16).ok()?;
        let [_, red, green, blue] = number.to_be_bytes();
        Some(Paint([red, green, blue]))
    }
}

impl<'de> Deserialize<'de> for Paint {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Paint, D::Error> {
        let names = NAMED.map(|(name, _)| name).join(", ");
        let expected = format!("a colour: {names}, or \"#rrggbb\" in quotes");
        yaml::known_text(from, &expected, Paint::parse)
    }
}

/// A route through the room. Who is on it waits for a robot in the way, and after some seconds turns
/// back.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Route {
    /// Its corners, in order.
    pub through: Vec<Spot>,
    /// Speed, metres per second.
    #[serde(deserialize_with = "number::speed")]
    pub speed: f64,
    /// Pause at each corner, seconds.
    #[serde(default, deserialize_with = "number::span")]
    pub pause: f64,
    /// Whether to continue from the last corner to the first; otherwise the route is reversed.
    #[serde(default)]
    pub closed: bool,
}

/// A person who stands or walks: a visible obstacle.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walker {
    /// Their name on the map and in collisions.
    #[serde(default)]
    pub name: String,
    /// Their place without a `path`, or their start with one.
    pub at: Spot,
    /// Radius in metres.
    #[serde(default = "usual::walker_radius", deserialize_with = "number::radius")]
    pub radius: f64,
    /// Height in metres.
    #[serde(default = "usual::walker_height", deserialize_with = "number::height")]
    pub height: f64,
    /// Colour of the clothes.
    #[serde(default = "usual::walker_paint")]
    pub colour: Paint,
    /// Their route.
    pub path: Option<Route>,
}

/// What keys of a world are if its file does not name them: one function for each, as serde asks.
pub(super) mod usual {
    use super::Paint;

    macro_rules! usual {
        ($($name:ident: $kind:ty = $value:expr;)+) => {
            $(pub(in crate::world) fn $name() -> $kind { $value })+
        };
    }

    usual! {
        room_height: f64 = 2.4;
        wall_paint: Paint = Paint([214, 206, 190]);
        wall_thickness: f64 = 0.1;
        ball_radius: f64 = 0.1;
        sill_paint: Paint = Paint([112, 74, 44]);
        post_radius: f64 = 0.05;
        post_height: f64 = 0.6;
        walker_radius: f64 = 0.2;
        walker_height: f64 = 1.7;
        walker_paint: Paint = Paint([92, 96, 112]);
        tape_width: f64 = 0.03;
        loudness: f64 = 0.5;
        lamp_paint: Paint = Paint([255, 255, 255]);
        lamp_reach: f64 = 2.5;
        sign_side: f64 = 0.3;
        sign_height: f64 = 0.3;
        hertz: f64 = 880.0;
        beacon_range: f64 = 6.0;
        beacon_degrees: f64 = 70.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_parsed_from_names_and_hex() {
        assert_eq!(Paint::parse("#0A141e"), Some(Paint([10, 20, 30])));
        assert_eq!(Paint::parse("red"), Some(Paint([206, 28, 36])));
        for wrong in ["rot", "#12", "#gg0000", "", "#+12345"] {
            assert_eq!(Paint::parse(wrong), None, "{wrong}");
        }
    }
}
