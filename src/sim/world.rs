//! A world as defined in YAML: a room with its things, the charging station, and the robot's battery
//! and camera. `geometry::obstacles` uses them for driving, `camera` for rendering.

pub(crate) mod dynamics;
pub(crate) mod fixtures;
pub(crate) mod objects;
pub(crate) mod preset;
pub(crate) mod settings;
pub(crate) mod station;
mod validate;

use std::path::Path;
use std::time::Duration;

use serde::Deserialize;

use self::fixtures::{Lamp, Noise, Sign, Tape};
use self::objects::{Ball, Furniture, Post, Room, Route, Rug, Sill, Spot, Start, Walker, Wall};
use self::preset::Preset;
use self::settings::{BatterySettings, CameraSettings, TrackSettings};
use self::station::Station;
use crate::document::{self, DocumentError, number};
use crate::faults::FaultKind;
use crate::geometry::obstacles::{Bump, Circle, Obstacles};
use crate::geometry::{Point, Pose, Rectangle, Segment};

/// The built-in worlds of files with these names.
macro_rules! builtin {
    ($($name:literal)*) => {
        [$(($name, include_str!(concat!("../../behaviours/worlds/", $name, ".yaml"))),)*]
    };
}

/// Name and YAML of each world; the names are those of the files in `behaviours/worlds/`.
const BUILTIN: [(&str, &str); 9] = builtin! {
    "living_room" "playpen" "yard" "line_loop" "classroom"
    "hall" "night" "gallery" "laboratory"
};

/// By how much each wall between the robot and the access point shortens the range, metres.
const WALL: f64 = 3.0;
/// From this share of the range on, what is sent arrives late.
const WEAK: f64 = 0.8;
/// The most that repeating lost packets delays what is sent, at the edge of the range.
const LATEST: Duration = Duration::from_millis(1000);
/// Steps of the delay, so that a robot that drives does not change it all the time.
const STEPS: f64 = 20.0;

/// A room with all that is in it, and what the robot is like.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// Title of the map.
    #[serde(default)]
    pub name: String,
    /// What the robot is like where this world does not say it.
    #[serde(default)]
    pub preset: Preset,
    /// Outer walls and floor.
    pub room: Room,
    /// Inner walls, as high as the room.
    #[serde(default)]
    pub walls: Vec<Wall>,
    /// Furniture: boxes that stand on the floor.
    #[serde(default)]
    pub furniture: Vec<Furniture>,
    /// Carpets; not obstacles, but their edges may slow the robot.
    #[serde(default)]
    pub rugs: Vec<Rug>,
    /// Bars on the floor, as in doorways.
    #[serde(default)]
    pub sills: Vec<Sill>,
    /// Balls that lie on the floor.
    #[serde(default)]
    pub balls: Vec<Ball>,
    /// Round columns.
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
    /// Where the robot charges.
    pub station: Station,
    /// The robot's start pose; on the station if omitted.
    pub start: Option<Start>,
    /// Brightness of the ambient light, 0..=1.
    #[serde(default = "number::one", deserialize_with = "number::share")]
    pub light: f64,
    /// How the battery drains and charges.
    #[serde(default)]
    pub battery: BatterySettings,
    /// Lens, exposure and noise of the camera.
    #[serde(default)]
    pub camera: CameraSettings,
    /// How the tracks follow their commands, differ and slip.
    #[serde(default)]
    pub tracks: TrackSettings,
    /// The Wi-Fi; without it the network reaches everywhere.
    pub wifi: Option<Wifi>,
}

impl World {
    /// Returns where the robot stands at first.
    pub fn start_pose(&self) -> Pose {
        self.start
            .map_or_else(|| self.station.dock_pose(), |start| start.pose())
    }

    /// Returns which share of its speed the robot reaches at a battery level, percent, and a place.
    pub(crate) fn track_response(&self, percent: f64, place: Point) -> f64 {
        let on_rug = self.rugs.iter().any(|rug| rug.footprint().covers(place));
        self.tracks.response.share(percent, on_rug)
    }

    pub(crate) fn solid(&self, place: Point) -> bool {
        let walls = self.walls.iter().map(Wall::footprint);
        let furniture = self.furniture.iter().map(Furniture::footprint);
        walls.chain(furniture).any(|solid| solid.covers(place))
    }

    /// Returns the sides of all walls, those of the room first.
    pub(crate) fn wall_sides(&self) -> impl Iterator<Item = Segment> {
        let inner = self.walls.iter().map(Wall::footprint);
        let all = std::iter::once(self.room.footprint()).chain(inner);
        all.flat_map(Rectangle::sides)
    }

    /// Returns everything that a robot can run into, at its initial place.
    pub(crate) fn obstacles(&self) -> Obstacles {
        let circle = |at: Spot, radius| Circle::new(at.point(), radius);
        let mut high: Vec<Segment> = self.wall_sides().collect();
        let walls = high.len();
        let furniture = self.furniture.iter().map(Furniture::footprint);
        high.extend(furniture.flat_map(Rectangle::sides));
        let posts = self.posts.iter();
        let balls = self.balls.iter().map(|ball| circle(ball.at, ball.radius));
        let people = self.walkers.iter().map(|who| circle(who.at, who.radius));
        Obstacles {
            high,
            walls,
            station: self.station.footprint().sides(),
            posts: posts.map(|post| circle(post.at, post.radius)).collect(),
            round: balls.chain(people).collect(),
            balls: self.balls.len(),
        }
    }

    /// Returns the edges that slow or block the robot.
    pub(crate) fn bumps(&self) -> Vec<Bump> {
        let rugs = self.rugs.iter().flat_map(Rug::bumps);
        let all = rugs.chain(self.sills.iter().map(Sill::bump));
        all.filter(|bump| bump.height > 0.0).collect()
    }

    /// Returns the strips on the floor: lines and sills.
    pub(crate) fn strips(&self) -> Vec<Tape> {
        let sills = self.sills.iter().map(Sill::strip);
        self.lines.iter().cloned().chain(sills).collect()
    }

    /// Returns what a robot can run into, except for balls and people.
    pub fn fixed_obstacles(&self) -> Obstacles {
        self.obstacles().without_movers()
    }

    /// Returns all routes of balls and walkers, each with its list and index in the document.
    pub(super) fn routes(&self) -> impl Iterator<Item = (&'static str, usize, &Route)> {
        let balls = self.balls.iter().enumerate();
        let balls = balls.filter_map(|(i, ball)| Some(("balls", i, ball.path.as_ref()?)));
        let walkers = self.walkers.iter().enumerate();
        balls.chain(walkers.filter_map(|(i, who)| Some(("walkers", i, who.path.as_ref()?))))
    }

    /// Returns what the Wi-Fi does to a robot at `place`, as a fault of the network.
    pub(crate) fn radio_fault(&self, place: Point) -> Option<FaultKind> {
        let wifi = self.wifi?;
        let from = wifi.at.point();
        let walls = self.walls.iter();
        let between = walls.filter(|wall| wall.stands_between(from, place));
        let distance = from.distance(place) + WALL * between.count() as f64;
        if distance > wifi.range {
            return Some(FaultKind::HalfOpen);
        }
        if distance <= WEAK * wifi.range {
            return None;
        }
        let weakness = (distance / wifi.range - WEAK) / (1.0 - WEAK);
        Some(FaultKind::Delay {
            by: Duration::ZERO,
            jitter: LATEST.mul_f64((weakness * STEPS).ceil() / STEPS),
        })
    }

    /// Returns the names of the built-in worlds; the first is the default.
    pub fn builtin_names() -> impl Iterator<Item = &'static str> {
        BUILTIN.iter().map(|(name, _)| *name)
    }

    /// Returns the built-in world with this name.
    pub fn builtin(name: &str) -> Option<World> {
        World::from_yaml(World::builtin_yaml(name)?, &format!("{name}.yaml")).ok()
    }

    /// Returns the YAML of the built-in world with this name.
    pub fn builtin_yaml(name: &str) -> Option<&'static str> {
        let (_, yaml) = BUILTIN.iter().find(|(known, _)| *known == name)?;
        Some(yaml)
    }

    /// Returns the leading comment of a built-in world, which describes its content and purpose.
    pub fn builtin_description(name: &str) -> Option<String> {
        let lines = World::builtin_yaml(name)?.lines();
        let comment = lines.map_while(|line| line.strip_prefix("# "));
        Some(comment.collect::<Vec<_>>().join(" "))
    }

    /// Returns the built-in default world: a living room.
    pub fn default_world() -> World {
        #[expect(clippy::expect_used, reason = "a test parses this text")]
        World::builtin(BUILTIN[0].0).expect("the built-in world is valid")
    }

    /// Parses a world; `name` is the name of the text in errors, usually its file name.
    pub fn from_yaml(text: &str, name: &str) -> Result<World, DocumentError> {
        let mut world: World = document::read(text, name)?;
        let preset = world.preset;
        preset
            .complete(&mut world, text)
            .map_err(|error| document::error(&error, name))?;
        validate::check(&world).map_err(|(path, message)| {
            DocumentError::invalid(name, document::find(text, &path), message)
        })?;
        Ok(world)
    }

    /// Reads a file; see [`World::from_yaml`].
    pub fn load(path: &Path) -> Result<World, DocumentError> {
        document::load(path, "world", World::from_yaml)
    }
}

/// Returns the name of a thing, or else its kind.
pub(crate) fn name_or<'a>(name: &'a str, kind: &'a str) -> &'a str {
    if name.is_empty() { kind } else { name }
}

/// An access point and how far it reaches.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wifi {
    /// The place of the access point.
    pub at: Spot,
    /// Distance up to which it reaches the robot, metres, in a straight line without walls.
    #[serde(deserialize_with = "number::reach")]
    pub range: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::settings::TrackResponse;
    use crate::world::station::DockingSettings;
    use crate::world::validate::{MAX_LAMPS, MAX_OBJECTS};

    #[test]
    fn every_built_in_world_is_valid_and_has_a_description() {
        for (name, yaml) in BUILTIN {
            let world = World::from_yaml(yaml, &format!("{name}.yaml"));
            let world = world.unwrap_or_else(|error| panic!("{error}"));
            assert!(!world.name.is_empty());
            assert!(World::builtin(name).is_some());
            assert!(
                World::builtin_description(name).unwrap().len() > 40,
                "{name}"
            );
        }
        assert!(World::builtin("nowhere").is_none());
        assert_eq!(World::default_world().name, "living room");
        let playpen = World::builtin("playpen").unwrap();
        assert_eq!(playpen.start_pose(), playpen.station.dock_pose());
    }

    #[test]
    fn the_example_in_the_readme_is_valid() {
        let page = include_str!("../../behaviours/worlds/README.md");
        let (_, yaml) = page.split_once("```yaml\n").unwrap();
        let yaml = yaml.split("```").next().unwrap();
        let world = World::from_yaml(yaml, "README.md").unwrap();
        assert!(!world.lamps.is_empty() && !world.walkers.is_empty() && !world.sounds.is_empty());
        let used: Vec<&str> = yaml
            .split(|c: char| !c.is_alphanumeric() && c != '_')
            .collect();
        for key in [
            keys::<World>(),
            keys::<Room>(),
            keys::<Station>(),
            keys::<DockingSettings>(),
            keys::<BatterySettings>(),
            keys::<CameraSettings>(),
            keys::<TrackSettings>(),
            keys::<TrackResponse>(),
            keys::<Rug>(),
            keys::<Sill>(),
            keys::<Wifi>(),
        ]
        .concat()
        {
            assert!(used.contains(&key.as_str()), "{key} is not explained");
        }
    }

    /// Returns the keys that the parser of a type knows: those that its error suggests.
    fn keys<T: serde::de::DeserializeOwned + std::fmt::Debug>() -> Vec<String> {
        let error = serde_yaml::from_str::<T>("{no_such_key: 1}").unwrap_err();
        let error = error.to_string();
        let known: Vec<String> = error.split('`').map(str::to_owned).collect();
        assert_eq!(known[1], "no_such_key", "{error}");
        known.into_iter().skip(3).step_by(2).collect()
    }

    const ROOM: &str = "room: {width: 6, depth: 4}\n";
    const STATION: &str = "station: {at: [0, 2], heading_degrees: 0}\n";

    /// Returns the error for `ROOM`, `STATION` and `more`, which starts in line 3.
    fn fault(more: &str) -> String {
        World::from_yaml(&format!("{ROOM}{STATION}{more}"), "w.yaml")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn missing_keys_have_defaults() {
        let world = World::from_yaml(&format!("{ROOM}{STATION}"), "w.yaml").unwrap();
        assert_eq!(world.battery, BatterySettings::default());
        assert_eq!((world.light, world.camera.fps), (1.0, 15.0));
    }

    #[test]
    fn mistakes_in_the_docking_name_their_place() {
        let error = |docking: &str| {
            let station =
                format!("station:\n  at: [0, 2]\n  heading_degrees: 0\n  docking: {docking}\n");
            let text = format!("{ROOM}{station}");
            World::from_yaml(&text, "w.yaml").unwrap_err().to_string()
        };
        let wrong = error("{ success: 2 }");
        assert!(
            wrong.starts_with("w.yaml:5:23: ") && wrong.contains("(1 is always)"),
            "{wrong}"
        );
        let wrong = error("{ range: -1 }");
        assert!(
            wrong.starts_with("w.yaml:5:21: ") && wrong.contains("(metres)"),
            "{wrong}"
        );
        let wrong = error("{}\n  leaves: sideways");
        assert!(
            wrong.starts_with("w.yaml:6:11: ") && wrong.contains("forward"),
            "{wrong}"
        );
        let wrong = error("{ sees_obstacle: no }");
        assert!(wrong.ends_with("did you mean 'sees_obstacles'?"), "{wrong}");
    }

    #[test]
    fn a_blocked_start_or_station_is_rejected() {
        let text = fault("start: {at: [3, 0.1]}\n");
        assert!(
            text.starts_with("w.yaml:3:13: the robot would start inside"),
            "{text}"
        );
        let text = fault("balls: [{at: [0.5, 2], colour: red}]\n");
        assert!(
            text.starts_with("w.yaml:2:15: something blocks the station"),
            "{text}"
        );
    }

    #[test]
    fn the_error_names_a_missing_file() {
        let error = World::load(Path::new("no/such/world.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such/world.yaml"), "{error}");
    }

    #[test]
    fn mistakes_name_their_place() {
        for (more, wanted) in [
            (
                "balls:\n  - at: [1, 1]\n    colour: red\n    raduis: 0.1\n",
                "w.yaml:6:5: ",
            ),
            (
                "balls: [{at: [1, 1], colour: red, raduis: 0.1}]\n",
                "did you mean 'radius'?",
            ),
            (
                "balls:\n  - {at: [1, 1], colour: red}\n  - {at: [7, 1], colour: red}\n",
                "w.yaml:5:10: [7, 1] is outside the room",
            ),
            ("light: .nan\n", "w.yaml:3:8: "),
            ("light: -1\n", "expected a number from 0 to 1"),
            ("light: bright\n", "w.yaml:3:8: "),
            (
                "balls: [{at: [1, 1], colour: red, radius: 9}]\n",
                "w.yaml:3:43: ",
            ),
            ("balls: 3\n", "w.yaml:3:8: "),
            ("balls: [{at: [1], colour: red}]\n", "w.yaml:3:14: "),
            ("balls: [{at: [1, 1], colour: rot}]\n", "w.yaml:3:30: "),
            ("balls: [{at: [1, 1]}]\n", "w.yaml:3:9: "),
            ("battery: {level: .inf}\n", "w.yaml:3:18: "),
            ("posts: [{at: [1, -1], colour: red}]\n", "w.yaml:3:18: "),
            ("camera:\n  fps: 1e9\n", "w.yaml:4:8: "),
            ("camera: {fps: [}\n", "w.yaml:3:15: "),
            (
                "lines: [{through: [[1, 1]], colour: red}]\n",
                "w.yaml:3:19: 1 corners; expected 2 to 200",
            ),
            (
                "lines: [{through: [[1, 1], [9, 1]], colour: red}]\n",
                "w.yaml:3:28: [9, 1] is outside the room",
            ),
            (
                "lines: [{trough: [[1, 1], [2, 1]], colour: red}]\n",
                "did you mean 'through'?",
            ),
            (
                "walkers:\n  - {at: [1, 1], path: {through: [[1, 1], [1, 5]], speed: 1}}\n",
                "w.yaml:4:43: [1, 5] is outside the room",
            ),
            (
                "walkers: [{at: [1, 1], path: {through: [], speed: 1}}]\n",
                "0 corners; expected 1",
            ),
            (
                "walkers: [{at: [1, 1], path: {through: [[1, 1]], speed: 9}}]\n",
                "metres a second",
            ),
            (
                "lamps: [{at: [1, 1], on: {from: 3}}]\n",
                "unknown key `from`",
            ),
            (
                "lamps: [{at: [1, 1], brightnes: 1}]\n",
                "did you mean 'brightness'?",
            ),
            (
                "sounds: [{at: [1, 1], kind: knok}]\n",
                "did you mean 'knock'?",
            ),
            ("camera: {subsampling: \"4:2:1\"}\n", "'4:2:0'"),
            (
                "camera:\n  vignette: [0.5, 1, 0]\n",
                "w.yaml:4:19: camera.vignette[1]: invalid value: floating point `1.0`, \
                 expected a number from 0 to 0.95 (0 is none)",
            ),
            ("camera: {vignette: [0.5, 0.5]}\n", "array of length 3"),
            (
                "camera: {softness: 3}\n",
                "w.yaml:3:20: camera.softness: invalid value",
            ),
            ("camera: {saturation: -1}\n", "w.yaml:3:22: "),
            ("camera: {brightness: 105}\n", "w.yaml:3:22: "),
            ("tracks: {slip: 2}\n", "w.yaml:3:16: "),
            (
                "tracks:\n  dead_zone: 95\n",
                "w.yaml:4:14: tracks.dead_zone: invalid value: floating point `95.0`",
            ),
            ("tracks: {response: {rugs: 1}}\n", "did you mean 'rug'?"),
            (
                "tracks: {response: {empty: 0}}\n",
                "expected a number from 0.1 to 1",
            ),
            (
                "battery: {level: 50, power: volts}\n",
                "valid are percent, voltage",
            ),
            (
                "rugs: [{at: [1, 1], width: 1, depth: 1, colour: red, height: 0.1}]\n",
                "expected a number from 0 to 0.03 (metres)",
            ),
            (
                "sills: [{from: [1, 1], to: [1, 5], height: 0.01}]\n",
                "w.yaml:3:28: [1, 5] is outside the room",
            ),
            ("wifi: {at: [1, 1]}\n", "missing field `range`"),
            (
                "wifi: {at: [7, 1], range: 5}\n",
                "w.yaml:3:12: [7, 1] is outside the room",
            ),
            ("balls: [3]\n", "expected keys with values"),
        ] {
            let text = fault(more);
            assert!(
                text.starts_with("w.yaml:") && text.contains(wanted),
                "{more}{text}"
            );
        }
        let long = "x".repeat(crate::world::fixtures::MAX_TEXT + 1);
        let text = fault(&format!(
            "signs: [{{at: [1, 1], heading_degrees: 0, text: {long}}}]\n"
        ));
        assert!(text.contains("101 bytes are too many for a sign"), "{text}");
        let balls = "  - {at: [1, 1], colour: red}\n".repeat(MAX_OBJECTS + 1);
        assert!(fault(&format!("balls:\n{balls}")).contains("201 balls are too many"));
        let lamps = "  - {at: [1, 1]}\n".repeat(MAX_LAMPS + 1);
        assert!(fault(&format!("lamps:\n{lamps}")).contains("17 lamps are too many"));
    }

    /// Generates numbers, most of them in the ranges of worlds.
    fn number() -> impl proptest::strategy::Strategy<Value = String> {
        "[1-3]|[0-3]|[0-3]|[0-3]|[1-3][.]5|[0-3][.][0-9]|[0-3][.][0-9]{2}|[1-3][.][0-9]{2}|[0-3][.]25|[0-3][.]75|[0-5]|-1|9999|[.]nan"
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(96))]

        #[test]
        fn every_valid_world_can_be_simulated_and_drawn(
            n in proptest::collection::vec(number(), 24),
            ready in 0..12usize,
        ) {
            let mut more = vec![
                format!("lines: [{{through: [[{}, {}], [{}, {}]], closed: true, rounding: {}, colour: red}}]", n[0], n[1], n[2], n[3], n[4]),
                format!("walkers: [{{at: [{}, {}], path: {{through: [[{}, {}], [1, 1]], speed: {}}}}}]", n[5], n[6], n[7], n[8], n[9]),
                format!("lamps: [{{at: [{}, {}], on: {{after: {}, for: {}, every: {}}}}}]", n[10], n[11], n[12], n[13], n[14]),
                format!("signs: [{{at: [{}, {}], heading_degrees: {}, text: a}}]", n[15], n[16], n[17]),
                format!("walls: [{{from: [{}, {}], to: [{}, {}]}}]", n[18], n[19], n[20], n[21]),
                format!("balls: [{{at: [{}, {}], colour: red}}]", n[22], n[23]),
            ];
            more.rotate_left(ready % 6);
            more.truncate(1 + ready / 2);
            let text = format!("{ROOM}{STATION}{}\n", more.join("\n"));
            if let Ok(world) = World::from_yaml(&text, "random") {
                let map = world.draw();
                let mut robot = crate::Robot::new(world, Default::default(), 1);
                robot.execute(&wire::Command::Stream { stream: wire::Stream::Video, on: true });
                robot.execute(&wire::Command::Move { left: 90, right: 80 });
                (0..20).for_each(|_| robot.step(std::time::Duration::from_millis(20)));
                let pose = robot.state().pose;
                proptest::prop_assert!(pose.x.is_finite() && pose.y.is_finite());
                proptest::prop_assert!(map.width() > 100 && map.height() > 100);
            }
        }
    }

    proptest::proptest! {
        #[test]
        fn no_text_causes_a_panic(text in ".{0,200}", more in "[a-z:{}\\[\\], 0-9.&*-]{0,80}") {
            let _ = World::from_yaml(&text, "random");
            let _ = World::from_yaml(&format!("{ROOM}{STATION}{more}"), "random");
        }
    }
}
