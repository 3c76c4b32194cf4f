//! A world as defined in YAML: a room with its walls and furniture, balls and posts, the charging
//! station, and the robot's battery and camera. Only describes the things and their places;
//! `geometry::obstacles` uses them for driving, `camera` for rendering.

use serde::Deserialize;

use super::fixtures::{Lamp, Noise, Sign, Tape};
use super::objects::{Ball, Furniture, Post, Room, Rug, Wall};
use super::route::{Route, Walker};
use super::settings::{BatterySettings, CameraSettings, TrackSettings};
use super::spot::Start;
use super::station::Station;
use crate::sim::geometry::obstacles::{Circle, Obstacle, Obstacles, Shapes};
use crate::sim::geometry::{Point, Pose};
use crate::sim::yaml::number;

/// A simulated place.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// The world's name.
    #[serde(default)]
    pub name: String,
    /// The four outer walls and the floor.
    pub room: Room,
    /// Inner walls, as high as the room.
    #[serde(default)]
    pub walls: Vec<Wall>,
    /// Furniture: boxes that stand on the floor.
    #[serde(default)]
    pub furniture: Vec<Furniture>,
    /// Flat carpets: visible, but not obstacles.
    #[serde(default)]
    pub rugs: Vec<Rug>,
    /// Balls that lie on the floor.
    #[serde(default)]
    pub balls: Vec<Ball>,
    /// Round posts.
    #[serde(default)]
    pub posts: Vec<Post>,
    /// Lines of tape on the floor.
    #[serde(default)]
    pub lines: Vec<Tape>,
    /// People who stand or walk.
    #[serde(default)]
    pub walkers: Vec<Walker>,
    /// Lamps, in addition to the daylight `light`.
    #[serde(default)]
    pub lamps: Vec<Lamp>,
    /// QR codes on boards.
    #[serde(default)]
    pub signs: Vec<Sign>,
    /// Sound sources that the microphone hears besides the robot.
    #[serde(default)]
    pub sounds: Vec<Noise>,
    /// The charging station.
    pub station: Station,
    /// The robot's start pose; on the station if omitted.
    #[serde(default)]
    pub start: Option<Start>,
    /// Brightness of the ambient light, 0..=1.
    #[serde(default = "full", deserialize_with = "number::share")]
    pub light: f64,
    /// How the battery drains and charges.
    #[serde(default)]
    pub battery: BatterySettings,
    /// The camera's properties.
    #[serde(default)]
    pub camera: CameraSettings,
    /// How much the tracks differ and slip.
    #[serde(default)]
    pub tracks: TrackSettings,
}

impl World {
    /// Returns the robot's start pose.
    pub fn start_pose(&self) -> Pose {
        self.start
            .map_or_else(|| self.station.dock_pose(), |start| start.pose())
    }

    /// Whether a place is inside a wall or a piece of furniture.
    pub(crate) fn solid(&self, place: Point) -> bool {
        self.walls.iter().any(|wall| wall.covers(place))
            || self.furniture.iter().any(|item| item.covers(place))
    }

    /// Returns the display name of an obstacle.
    pub(crate) fn name_of(&self, obstacle: Obstacle) -> String {
        let named = |kind: &str, name: Option<&String>| match name.filter(|name| !name.is_empty()) {
            Some(name) => name.clone(),
            None => kind.to_owned(),
        };
        match obstacle {
            Obstacle::Wall => "wall".to_owned(),
            Obstacle::Station => "station".to_owned(),
            Obstacle::Furniture(index) => named(
                "furniture",
                self.furniture.get(index).map(|item| &item.name),
            ),
            Obstacle::Post(_) => "post".to_owned(),
            Obstacle::Ball(_) => "ball".to_owned(),
            Obstacle::Walker(index) => {
                named("walker", self.walkers.get(index).map(|walker| &walker.name))
            }
        }
    }

    /// Returns everything that a robot can run into, at its initial place.
    pub(crate) fn obstacles(&self) -> Obstacles {
        let inner = self.walls.iter().flat_map(|wall| wall.sides());
        let circle = |at: Point, radius| Circle::new(at, radius);
        let posts = self.posts.iter();
        let balls = self.balls.iter();
        let people = self.walkers.iter();
        Obstacles::new(Shapes {
            walls: self.room.sides().into_iter().chain(inner).collect(),
            furniture: self.furniture.iter().map(|item| item.sides()).collect(),
            station: self.station.sides(),
            posts: posts
                .map(|post| circle(post.at.point(), post.radius))
                .collect(),
            balls: balls
                .map(|ball| circle(ball.at.point(), ball.radius))
                .collect(),
            people: people
                .map(|who| circle(who.at.point(), who.radius))
                .collect(),
        })
    }

    /// Returns the obstacles without balls and people.
    pub(crate) fn fixed_obstacles(&self) -> Obstacles {
        self.obstacles().without_movers()
    }

    /// Returns all routes of balls and walkers, each with its list and index in the document.
    pub(super) fn routes(&self) -> impl Iterator<Item = (&'static str, usize, &Route)> {
        let balls = self.balls.iter().enumerate();
        let balls = balls.filter_map(|(i, ball)| Some(("balls", i, ball.path.as_ref()?)));
        let walkers = self.walkers.iter().enumerate();
        balls.chain(walkers.filter_map(|(i, who)| Some(("walkers", i, who.path.as_ref()?))))
    }
}

fn full() -> f64 {
    1.0
}
