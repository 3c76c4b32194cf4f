//! The worlds, and where in them robots start.

use std::f64::consts::PI;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::sim::{Point, Pose, RADIUS, StationDistances, World};

use super::super::two_rooms;

const CLASSROOM: &str = include_str!("../../behaviours/worlds/classroom.yaml");
const GALLERY: &str = include_str!("../../behaviours/worlds/gallery.yaml");

/// Behind the living room's doorway.
const SECOND_ROOM: f64 = 4.9;
/// From a tight spot, something is no farther than this from the robot's body, metres.
const TIGHT: f64 = 0.03;
/// The least way home from a tight spot, metres: nearer to its station a search often finds it.
const TIGHT_WAY: f64 = 2.5;
/// Charge at the start, percent.
const LEAST_BATTERY: f64 = 15.0;
const MAX_BATTERY: f64 = 20.0;

/// A world that robots are rescued in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Name {
    LivingRoom,
    Classroom,
    Gallery,
    /// In the living room, but right beside a wall or a thing.
    TightSpots,
}

impl Name {
    pub const ALL: [Name; 4] = [
        Name::LivingRoom,
        Name::Classroom,
        Name::Gallery,
        Name::TightSpots,
    ];

    pub fn text(self) -> &'static str {
        match self {
            Name::LivingRoom => "living room",
            Name::Classroom => "classroom",
            Name::Gallery => "gallery",
            Name::TightSpots => "tight spots",
        }
    }

    /// The share of robots that must come home, percent.
    pub fn goal(self) -> f64 {
        if self == Name::LivingRoom { 97.5 } else { 95.0 }
    }
}

/// Where a robot starts, and with how much.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    pub pose: Pose,
    /// Percent.
    pub battery: f64,
    /// The way home, metres.
    pub way: f64,
    /// Of the run's noise.
    pub seed: u64,
    /// It begins on its station and drives for so long at least, until it is far from home.
    pub drives: Option<Duration>,
}

/// A world with all places that robots may start from.
pub struct Place {
    pub name: Name,
    pub world: World,
    distances: StationDistances,
    least_x: f64,
    least_way: f64,
}

impl Place {
    /// In the living room robots start in the second room, in tight spots beside a wall or a thing, and
    /// elsewhere in the third of the floor that is farthest from the station.
    pub fn named(name: Name) -> Place {
        let read = |text| World::from_yaml(text, name.text()).unwrap();
        let mut world = match name {
            Name::LivingRoom | Name::TightSpots => two_rooms(),
            Name::Classroom => read(CLASSROOM),
            Name::Gallery => read(GALLERY),
        };
        world.battery = two_rooms().battery;
        let distances = StationDistances::new(&world);
        let (least_x, least_way) = match name {
            Name::LivingRoom => (SECOND_ROOM, 0.0),
            Name::TightSpots => (0.0, TIGHT_WAY),
            Name::Classroom | Name::Gallery => (0.0, last_third(&distances)),
        };
        Place {
            name,
            least_x,
            least_way,
            world,
            distances,
        }
    }

    /// So many robots that begin on their station and drive for one to three minutes at least.
    pub fn drives(&self, count: usize, seed: u64) -> Vec<Start> {
        let mut rng = StdRng::seed_from_u64(seed);
        let drive = |_| Start {
            pose: self.world.station.dock_pose(),
            battery: rng.random_range(LEAST_BATTERY..MAX_BATTERY),
            way: 0.0,
            seed: rng.random(),
            drives: Some(Duration::from_secs(rng.random_range(60..180))),
        };
        (0..count).map(drive).collect()
    }

    /// The way home, if this is where robots are to be rescued from.
    pub fn far_from_home(&self, point: Point) -> Option<f64> {
        let way = self.distances.length(point)?;
        (point.x >= self.least_x && way >= self.least_way).then_some(way)
    }

    /// So many starts; the same for the same seed.
    pub fn starts(&self, count: usize, seed: u64) -> Vec<Start> {
        let mut rng = StdRng::seed_from_u64(seed);
        (0..count).map(|_| self.start(&mut rng)).collect()
    }

    fn start(&self, rng: &mut StdRng) -> Start {
        let (point, way) = loop {
            let x = rng.random_range(self.least_x..self.world.room.width);
            let point = Point::new(x, rng.random_range(0.0..self.world.room.depth));
            if let Some(way) = self.way_from(point) {
                break (point, way);
            }
        };
        Start {
            pose: Pose::at(point, rng.random_range(-PI..PI)),
            battery: rng.random_range(LEAST_BATTERY..MAX_BATTERY),
            way,
            seed: rng.random(),
            drives: None,
        }
    }

    /// The way home from a place where a robot may start.
    fn way_from(&self, point: Point) -> Option<f64> {
        let way = self.distances.length(point)?;
        let fits = self.has_room(point) && (self.name != Name::TightSpots || self.is_tight(point));
        (way >= self.least_way && fits).then_some(way)
    }

    /// Whether a wall or a thing is right beside a robot that stands there.
    fn is_tight(&self, point: Point) -> bool {
        let around = (0..8).map(|eighth| f64::from(eighth) * PI / 4.0);
        around
            .map(|angle| Point::new(point.x + TIGHT * angle.cos(), point.y + TIGHT * angle.sin()))
            .any(|beside| !self.distances.has_room(beside))
    }

    /// Whether a robot stands there without touching anything, balls and people included.
    fn has_room(&self, point: Point) -> bool {
        let balls = self.world.balls.iter();
        let balls = balls.map(|ball| (ball.at.point(), ball.radius));
        let people = self.world.walkers.iter();
        let mut round = balls.chain(people.map(|who| (who.at.point(), who.radius)));
        self.distances.has_room(point)
            && round.all(|(place, radius)| place.distance(point) >= radius + RADIUS)
    }
}

/// The length of way that a third of all places exceed.
fn last_third(distances: &StationDistances) -> f64 {
    let mut lengths: Vec<f64> = distances.places().map(|(_, length)| length).collect();
    lengths.sort_by(f64::total_cmp);
    lengths[lengths.len() * 2 / 3]
}
