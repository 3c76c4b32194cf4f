//! The simulated world for the page's map: the fixed parts, sent once, and the moving parts, sent
//! repeatedly. Metres, with x to the right and y upwards; radians, counterclockwise from x.

use schemars::JsonSchema;
use serde::Serialize;

use crate::control::SimulatedRobot;
use crate::sim::{self, Handle, Paint, Point, Pose, RADIUS, Spot, TraceEventKind};
use crate::simulation::{ClockMode, SimClock};

/// Maximum number of points of the robot's path that a new viewer gets.
const WAY: usize = 600;
/// Maximum number of collisions shown: the newest.
const BUMPS: usize = 30;

/// The fixed parts of a world, and its initial state.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct WorldPlan {
    /// Its name.
    pub name: String,
    /// Width of the room.
    pub width: f64,
    /// Depth of the room.
    pub depth: f64,
    /// Radius of the robot, seen from above.
    pub radius: f64,
    /// The corners of the inner walls.
    pub walls: Vec<Vec<[f64; 2]>>,
    /// Boxes on the floor.
    pub furniture: Vec<Shape>,
    /// Carpets.
    pub rugs: Vec<Shape>,
    /// Lines of tape.
    pub lines: Vec<Tape>,
    /// Balls, in the order of their numbers.
    pub balls: Vec<Round>,
    /// Posts.
    pub posts: Vec<Round>,
    /// People.
    pub walkers: Vec<Round>,
    /// Lamps.
    pub lamps: Vec<Round>,
    /// Signs with QR codes.
    pub signs: Vec<Round>,
    /// Corners of the charging station.
    pub station: Vec<[f64; 2]>,
    /// The outline of its beacon's range.
    pub beacon: Vec<[f64; 2]>,
    /// The robot's path so far.
    pub way: Vec<[f64; 2]>,
}

/// A polygonal object.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Shape {
    /// Its name; may be empty.
    pub name: String,
    /// `#rrggbb`.
    pub colour: String,
    /// Its corners.
    pub corners: Vec<[f64; 2]>,
}

/// A round object.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Round {
    /// Its name, or a sign's text; may be empty.
    pub name: String,
    /// `#rrggbb`.
    pub colour: String,
    /// Its centre.
    pub at: [f64; 2],
    /// Its radius; for a lamp, its range.
    pub radius: f64,
}

/// A line of tape.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Tape {
    /// `#rrggbb`.
    pub colour: String,
    /// Metres.
    pub width: f64,
    /// Whether it is a closed ring.
    pub closed: bool,
    /// Its corners.
    pub through: Vec<[f64; 2]>,
    /// The radius of the rounded corners.
    pub rounding: f64,
}

/// The moving parts of the world.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Map {
    /// Simulated seconds since the start.
    pub time: f64,
    /// The state of its clock, if it has its own.
    pub clock: Option<ClockMode>,
    /// The robot: x, y, heading.
    pub robot: [f64; 3],
    /// Whether it is blocked by an obstacle.
    pub blocked: bool,
    /// Whether it is searching for its station.
    pub searching: bool,
    /// The battery's true level, percent.
    pub battery: f64,
    /// Metres driven.
    pub distance: f64,
    /// Number of collisions.
    pub collisions: u64,
    /// The positions of the balls.
    pub balls: Vec<[f64; 2]>,
    /// The positions of the people.
    pub walkers: Vec<[f64; 2]>,
    /// The position and obstacle of each collision, newest last.
    pub bumps: Vec<(f64, f64, String)>,
}

fn pair(point: Point) -> [f64; 2] {
    let millimetres = |metres: f64| (metres * 1000.0).round() / 1000.0;
    [millimetres(point.x), millimetres(point.y)]
}

fn colour(paint: Paint) -> String {
    let Paint([red, green, blue]) = paint;
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn rectangle(middle: Point, length: f64, width: f64, heading: f64) -> Vec<[f64; 2]> {
    let corner = |along: f64, across: f64| {
        let side = middle.ahead(heading, along * length / 2.0);
        pair(side.ahead(heading + std::f64::consts::FRAC_PI_2, across * width / 2.0))
    };
    vec![
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
        corner(-1.0, -1.0),
        corner(1.0, -1.0),
    ]
}

fn wall_corners(wall: &sim::Wall) -> Vec<[f64; 2]> {
    let from = wall.from.point();
    let to = wall.to.point();
    let middle = Point::new((from.x + to.x) / 2.0, (from.y + to.y) / 2.0);
    let length = from.distance(to) + wall.thickness;
    rectangle(middle, length, wall.thickness, from.direction_of(to))
}

impl From<&sim::Furniture> for Shape {
    fn from(item: &sim::Furniture) -> Shape {
        let heading = item.heading_degrees.to_radians();
        Shape {
            name: item.name.clone(),
            colour: colour(item.colour),
            corners: rectangle(item.at.point(), item.length, item.width, heading),
        }
    }
}

impl From<&sim::Rug> for Shape {
    fn from(rug: &sim::Rug) -> Shape {
        Shape {
            name: String::new(),
            colour: colour(rug.colour),
            corners: rectangle(rug.at.point(), rug.width, rug.depth, 0.0),
        }
    }
}

impl From<&sim::Tape> for Tape {
    fn from(line: &sim::Tape) -> Tape {
        Tape {
            colour: colour(line.colour),
            width: line.width,
            closed: line.closed,
            through: line.through.iter().map(|spot| pair(spot.point())).collect(),
            rounding: line.rounding,
        }
    }
}

impl Round {
    fn new(name: &str, paint: Paint, at: Spot, radius: f64) -> Round {
        Round {
            name: name.to_owned(),
            colour: colour(paint),
            at: pair(at.point()),
            radius,
        }
    }
}

fn rounds<T>(objects: &[T], round: impl Fn(&T) -> Round) -> Vec<Round> {
    objects.iter().map(round).collect()
}

pub(super) fn world_plan(sim: &Handle) -> WorldPlan {
    let world = sim.world();
    WorldPlan {
        name: world.name.clone(),
        width: world.room.width,
        depth: world.room.depth,
        radius: RADIUS,
        walls: world.walls.iter().map(wall_corners).collect(),
        furniture: world.furniture.iter().map(Shape::from).collect(),
        rugs: world.rugs.iter().map(Shape::from).collect(),
        lines: world.lines.iter().map(Tape::from).collect(),
        balls: rounds(&world.balls, |it| {
            Round::new("", it.colour, it.at, it.radius)
        }),
        posts: rounds(&world.posts, |it| {
            Round::new("", it.colour, it.at, it.radius)
        }),
        walkers: rounds(&world.walkers, |it| {
            Round::new(&it.name, it.colour, it.at, it.radius)
        }),
        lamps: rounds(&world.lamps, |it| {
            Round::new(&it.name, it.colour, it.at, it.reach)
        }),
        signs: rounds(&world.signs, |it| {
            Round::new(&it.text, Paint([255; 3]), it.at, it.side / 2.0)
        }),
        station: world.station.outline().into_iter().map(pair).collect(),
        beacon: world.beacon_cone().into_iter().map(pair).collect(),
        way: way(sim),
    }
}

/// Returns the robot's path, evenly thinned out, with the newest point.
fn way(sim: &Handle) -> Vec<[f64; 2]> {
    sim.look_back(|trace| {
        let places: Vec<Point> = trace.samples().map(|sample| sample.pose.point()).collect();
        let step = places.len().div_ceil(WAY).max(1);
        let kept = places.iter().rev().step_by(step).map(|place| pair(*place));
        let mut way: Vec<[f64; 2]> = kept.collect();
        way.reverse();
        way
    })
}

pub(super) fn map(simulation: &SimulatedRobot) -> Map {
    let sim = &simulation.robot;
    let state = sim.state();
    let Pose { x, y, heading } = state.pose;
    let [x, y] = pair(Point::new(x, y));
    let (balls, walkers, bumps) = sim.look_back(|trace| {
        let pairs = |points: &[Point]| points.iter().copied().map(pair).collect::<Vec<_>>();
        let bump = |kind: &TraceEventKind, at: Point| match kind {
            TraceEventKind::Collision(name) => Some((pair(at), name.clone())),
            _ => None,
        };
        let bumps = trace.events().iter().rev();
        let bumps = bumps
            .filter_map(|it| bump(&it.kind, it.pose.point()))
            .take(BUMPS);
        let mut bumps: Vec<(f64, f64, String)> = bumps.map(|([x, y], name)| (x, y, name)).collect();
        bumps.reverse();
        (pairs(trace.balls()), pairs(trace.walkers()), bumps)
    });
    Map {
        time: (state.time.as_secs_f64() * 10.0).round() / 10.0,
        clock: simulation.sim_clock.as_ref().map(SimClock::mode),
        robot: [x, y, (heading * 1000.0).round() / 1000.0],
        blocked: state.blocked,
        searching: state.searching,
        battery: (state.battery * 10.0).round() / 10.0,
        distance: (state.distance * 100.0).round() / 100.0,
        collisions: state.collisions,
        balls,
        walkers,
        bumps,
    }
}
