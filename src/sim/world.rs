//! The place that a simulated robot lives in, read from YAML: a room with its walls and furniture,
//! balls and posts, the charging station, and the robot's battery and camera. Says what stands
//! where; what that means for driving is in `obstacles`, for seeing in `camera`.

use std::path::Path;

use serde::Deserialize;

use super::battery::BatterySettings;
use super::fittings::{Lamp, Noise, Sign, Tape};
use super::geometry::{Point, Pose};
use super::locate::{self, Step};
use super::number;
use super::obstacles::Obstacle;
use super::route::{Route, Walker};
use super::sign;
use super::slip::TrackSettings;
use super::station::Station;
use super::things::{Ball, Furniture, Place, Post, Room, Rug, Spot, Wall};
use super::view::CameraSettings;

const DEFAULT_WORLD: &str = include_str!("../../behaviours/worlds/living_room.yaml");
/// A longer file is no world: nothing needs that many things.
const MAX_FILE_LEN: u64 = 256 * 1024;
/// Things of one kind in a world, and corners of one line or path; each costs time in every frame.
const MAX_THINGS: usize = 200;
/// Lamps in a world: each has a map of its light.
const MAX_LAMPS: usize = 16;

/// A simulated place.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct World {
    /// What people call the place.
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
    /// Flat carpets: seen, but no obstacle.
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
    /// People who stand or walk about.
    #[serde(default)]
    pub walkers: Vec<Walker>,
    /// Lamps, besides the daylight that `light` is.
    #[serde(default)]
    pub lamps: Vec<Lamp>,
    /// QR codes on boards.
    #[serde(default)]
    pub signs: Vec<Sign>,
    /// What the microphone hears besides the robot.
    #[serde(default)]
    pub sounds: Vec<Noise>,
    /// The charging station.
    pub station: Station,
    /// Where the robot stands first; left out, it stands on the station.
    #[serde(default)]
    pub start: Option<Place>,
    /// Brightness of the light that is everywhere, 0..=1.
    #[serde(default = "full", deserialize_with = "number::share")]
    pub light: f64,
    /// How the battery empties and fills.
    #[serde(default)]
    pub battery: BatterySettings,
    /// How the robot sees.
    #[serde(default)]
    pub camera: CameraSettings,
    /// How unlike each other the tracks are, and how they slip.
    #[serde(default)]
    pub tracks: TrackSettings,
}

/// A world that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// The file cannot be read.
    #[error("cannot read the world {name}: {source}")]
    Read {
        /// The file.
        name: String,
        /// Why.
        source: std::io::Error,
    },
    /// The file is too long for a world.
    #[error("{name} is longer than {MAX_FILE_LEN} bytes: is it a world?")]
    TooLong {
        /// The file.
        name: String,
    },
    /// The YAML does not describe a world.
    #[error("{name}:{line}:{column}: {message}")]
    Invalid {
        /// The file, or what else the text came from.
        name: String,
        /// Counted from 1.
        line: usize,
        /// Counted from 1.
        column: usize,
        /// What was found, what was expected, what to do.
        message: String,
    },
}

impl World {
    /// The world that is built in: a living room.
    pub fn default_world() -> World {
        #[expect(clippy::expect_used, reason = "a test reads this very text")]
        World::from_yaml(DEFAULT_WORLD, "living_room.yaml").expect("the built-in world is valid")
    }

    /// Reads a world; `name` is what errors call the text, usually its file's name.
    ///
    /// # Errors
    /// [`WorldError::Invalid`] with line and column: unknown keys, wrong types, values out of
    /// range, things that stand outside the room or in the robot's way at the start.
    pub fn from_yaml(text: &str, name: &str) -> Result<World, WorldError> {
        let invalid = |(line, column): (usize, usize), message: String| WorldError::Invalid {
            name: name.to_owned(),
            line,
            column,
            message,
        };
        let world: World = serde_yaml::from_str(text)
            .map_err(|error| invalid(locate::place_of(&error), locate::explain(&error)))?;
        match world.first_fault() {
            Some((path, message)) => Err(invalid(locate::find(text, &path), message)),
            None => Ok(world),
        }
    }

    /// Reads a world from a file.
    ///
    /// # Errors
    /// As [`World::from_yaml`], or the file cannot be read.
    pub fn load(path: &Path) -> Result<World, WorldError> {
        let name = path.display().to_string();
        let text = std::fs::metadata(path).and_then(|file| match file.len() {
            0..=MAX_FILE_LEN => std::fs::read_to_string(path).map(Some),
            _ => Ok(None),
        });
        match text {
            Ok(Some(text)) => World::from_yaml(&text, &name),
            Ok(None) => Err(WorldError::TooLong { name }),
            Err(source) => Err(WorldError::Read { name, source }),
        }
    }

    /// Where the robot stands first.
    pub fn start_pose(&self) -> Pose {
        self.start
            .map_or_else(|| self.station.dock_pose(), |start| start.pose())
    }

    /// The first thing that no single value shows: where it is in the document, and what is wrong.
    fn first_fault(&self) -> Option<(Vec<Step>, String)> {
        self.first_crowd()
            .or_else(|| self.first_misfit())
            .or_else(|| self.first_outsider())
            .or_else(|| self.blocked_start())
    }

    /// Whether a place is inside of a wall or a piece of furniture.
    pub(super) fn solid(&self, place: Point) -> bool {
        self.walls.iter().any(|wall| wall.covers(place))
            || self.furniture.iter().any(|item| item.covers(place))
    }

    /// What people call something that the robot ran into.
    pub(super) fn name_of(&self, obstacle: Obstacle) -> String {
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

    /// Metres from a place to the middle of the nearest line on the floor; `None` without lines.
    pub fn line_distance(&self, place: Point) -> Option<f64> {
        let distances = self.lines.iter().map(|line| line.distance(place));
        distances.min_by(f64::total_cmp)
    }

    /// All ways of balls and walkers, and where the document names them.
    fn routes(&self) -> impl Iterator<Item = (&'static str, usize, &Route)> {
        let balls = self.balls.iter().enumerate();
        let balls = balls.filter_map(|(i, ball)| Some(("balls", i, ball.path.as_ref()?)));
        let walkers = self.walkers.iter().enumerate();
        balls.chain(walkers.filter_map(|(i, who)| Some(("walkers", i, who.path.as_ref()?))))
    }

    /// Lines and paths that lead nowhere, signs that say too much.
    fn first_misfit(&self) -> Option<(Vec<Step>, String)> {
        let misfit = |kind, index, key, message: String| {
            let path = vec![Step::Key(kind), Step::Index(index), Step::Key(key)];
            (path, message)
        };
        let lines = self.lines.iter().enumerate();
        let lines = lines.map(|(i, line)| ("lines", i, "through", line.through.len(), 2));
        let routes = self.routes();
        let routes = routes.map(|(kind, i, route)| (kind, i, "path", route.through.len(), 1));
        let short = lines
            .chain(routes)
            .find(|(.., count, least)| !(*least..=MAX_THINGS).contains(count));
        if let Some((kind, index, key, count, least)) = short {
            let message = format!("{count} corners; expected {least} to {MAX_THINGS}");
            return Some(misfit(kind, index, key, message));
        }
        let mut signs = self.signs.iter().enumerate();
        let (index, sign) = signs.find(|(_, sign)| sign::Code::of(&sign.text).is_none())?;
        let (long, most) = (sign.text.len(), sign::MAX_TEXT);
        let message = format!("{long} bytes are too many for a sign: at most {most}");
        Some(misfit("signs", index, "text", message))
    }

    fn first_crowd(&self) -> Option<(Vec<Step>, String)> {
        let counts = [
            ("walls", self.walls.len()),
            ("furniture", self.furniture.len()),
            ("rugs", self.rugs.len()),
            ("balls", self.balls.len()),
            ("posts", self.posts.len()),
            ("lines", self.lines.len()),
            ("walkers", self.walkers.len()),
            ("signs", self.signs.len()),
            ("sounds", self.sounds.len()),
            ("lamps", self.lamps.len()),
        ];
        let most = |kind: &str| {
            if kind == "lamps" {
                MAX_LAMPS
            } else {
                MAX_THINGS
            }
        };
        let mut counts = counts.into_iter();
        let (kind, count) = counts.find(|(kind, count)| *count > most(kind))?;
        let message = format!("{count} {kind} are too many: at most {}", most(kind));
        Some((vec![Step::Key(kind)], message))
    }

    fn first_outsider(&self) -> Option<(Vec<Step>, String)> {
        let (path, point) = self
            .spots()
            .into_iter()
            .find(|(_, p)| !self.room.holds(*p))?;
        let message = format!(
            "[{}, {}] is outside the room, which goes from [0, 0] to [{}, {}]: move it inside",
            point.x, point.y, self.room.width, self.room.depth
        );
        Some((path, message))
    }

    /// Every place that must be in the room, and where the document names it.
    fn spots(&self) -> Vec<(Vec<Step>, Point)> {
        let mut spots = vec![(
            vec![Step::Key("station"), Step::Key("at")],
            self.station.at.point(),
        )];
        spots.extend(
            self.start
                .map(|s| (vec![Step::Key("start"), Step::Key("at")], s.at.point())),
        );
        let mut add = |kind, index, key, spot: Spot| {
            spots.push((
                vec![Step::Key(kind), Step::Index(index), Step::Key(key)],
                spot.point(),
            ));
        };
        for (index, wall) in self.walls.iter().enumerate() {
            add("walls", index, "from", wall.from);
            add("walls", index, "to", wall.to);
        }
        let lists: [(&'static str, Vec<Spot>); 8] = [
            (
                "furniture",
                self.furniture.iter().map(|item| item.at).collect(),
            ),
            ("rugs", self.rugs.iter().map(|rug| rug.at).collect()),
            ("balls", self.balls.iter().map(|ball| ball.at).collect()),
            ("posts", self.posts.iter().map(|post| post.at).collect()),
            (
                "walkers",
                self.walkers.iter().map(|walker| walker.at).collect(),
            ),
            ("lamps", self.lamps.iter().map(|lamp| lamp.at).collect()),
            ("signs", self.signs.iter().map(|sign| sign.at).collect()),
            ("sounds", self.sounds.iter().map(|sound| sound.at).collect()),
        ];
        for (kind, places) in lists {
            let places = places.into_iter().enumerate();
            places.for_each(|(index, spot)| add(kind, index, "at", spot));
        }
        for (index, line) in self.lines.iter().enumerate() {
            for (corner, spot) in line.through.iter().enumerate() {
                let [kind, key] = [Step::Key("lines"), Step::Key("through")];
                spots.push((
                    vec![kind, Step::Index(index), key, Step::Index(corner)],
                    spot.point(),
                ));
            }
        }
        for (kind, index, route) in self.routes() {
            for (corner, spot) in route.through.iter().enumerate() {
                let [path, through] = [Step::Key("path"), Step::Key("through")];
                let steps = [
                    Step::Key(kind),
                    Step::Index(index),
                    path,
                    through,
                    Step::Index(corner),
                ];
                spots.push((steps.to_vec(), spot.point()));
            }
        }
        spots
    }

    fn blocked_start(&self) -> Option<(Vec<Step>, String)> {
        let obstacles = super::obstacles::Obstacles::of(self);
        let free = |pose: Pose| {
            let clear = obstacles.clearance(pose.point()) >= super::body::RADIUS - 1e-6;
            clear && !self.solid(pose.point())
        };
        if !free(self.station.dock_pose()) || !free(self.station.staging_pose()) {
            let message = "something stands before the station: keep a lane of 0.4 m width and \
                           1 m length free, in the direction of its heading_degrees";
            return Some((vec![Step::Key("station"), Step::Key("at")], message.into()));
        }
        if free(self.start_pose()) {
            return None;
        }
        let message = "the robot would start inside something: move `start` at least 0.15 m away \
                       from walls and things";
        Some((vec![Step::Key("start"), Step::Key("at")], message.into()))
    }
}

fn full() -> f64 {
    1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROOM: &str = "room: {width: 6, depth: 4}\n";
    const STATION: &str = "station: {at: [0, 2], heading_degrees: 0}\n";

    /// What is said about `ROOM`, `STATION` and more, which begins in line 3.
    fn fault(more: &str) -> String {
        World::from_yaml(&format!("{ROOM}{STATION}{more}"), "w.yaml")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn the_worlds_that_come_along_are_valid() {
        assert_eq!(World::default_world().name, "living room");
        let playpen = include_str!("../../behaviours/worlds/playpen.yaml");
        let playpen = World::from_yaml(playpen, "playpen.yaml").unwrap();
        assert_eq!(playpen.start_pose(), playpen.station.dock_pose());
    }

    #[test]
    fn what_is_left_out_has_defaults() {
        let world = World::from_yaml(&format!("{ROOM}{STATION}"), "w.yaml").unwrap();
        assert_eq!(world.battery, BatterySettings::default());
        assert_eq!((world.light, world.camera.fps), (1.0, 15.0));
    }

    #[test]
    fn an_unknown_key_is_refused_with_its_place_and_the_probable_name() {
        let text = fault("balls:\n  - at: [1, 1]\n    colour: red\n    raduis: 0.1\n");
        assert!(text.starts_with("w.yaml:6:5: "), "{text}");
        assert!(
            text.contains("raduis") && text.ends_with("did you mean `radius`?"),
            "{text}"
        );
    }

    #[test]
    fn values_out_of_range_are_refused_with_their_place() {
        for (more, place) in [
            ("light: .nan\n", "w.yaml:3:8: "),
            ("light: -1\n", "w.yaml:3:8: "),
            (
                "balls: [{at: [1, 1], colour: red, radius: 9}]\n",
                "w.yaml:3:43: ",
            ),
            ("battery: {level: .inf}\n", "w.yaml:3:18: "),
            ("posts: [{at: [1, -1], colour: red}]\n", "w.yaml:3:18: "),
            ("camera:\n  fps: 1e9\n", "w.yaml:4:8: "),
        ] {
            let text = fault(more);
            assert!(text.starts_with(place), "{text}");
            assert!(text.contains("expected a number from"), "{text}");
        }
    }

    #[test]
    fn wrong_types_are_refused_with_their_place() {
        for (more, place) in [
            ("light: bright\n", "w.yaml:3:8: "),
            ("balls: 3\n", "w.yaml:3:8: "),
            ("balls: [{at: [1], colour: red}]\n", "w.yaml:3:14: "),
            ("balls: [{at: [1, 1], colour: rot}]\n", "w.yaml:3:30: "),
            ("balls: [{at: [1, 1]}]\n", "w.yaml:3:9: "),
            ("camera: {fps: [}\n", "w.yaml:3:15: "),
        ] {
            let text = fault(more);
            assert!(text.starts_with(place), "{more}{text}");
        }
    }

    #[test]
    fn things_outside_the_room_are_refused_with_their_place() {
        let text = fault("balls:\n  - {at: [1, 1], colour: red}\n  - {at: [7, 1], colour: red}\n");
        assert!(
            text.starts_with("w.yaml:5:10: [7, 1] is outside the room"),
            "{text}"
        );
    }

    #[test]
    fn a_robot_inside_of_something_is_refused() {
        let text = fault("start: {at: [3, 0.1]}\n");
        assert!(
            text.starts_with("w.yaml:3:13: the robot would start inside"),
            "{text}"
        );
        let text = fault("balls: [{at: [0.5, 2], colour: red}]\n");
        assert!(
            text.starts_with("w.yaml:2:15: something stands before the station"),
            "{text}"
        );
    }

    #[test]
    fn a_crowd_is_refused() {
        let ball = "  - {at: [1, 1], colour: red}\n";
        let text = fault(&format!("balls:\n{}", ball.repeat(MAX_THINGS + 1)));
        assert!(text.contains("201 balls are too many"), "{text}");
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = World::load(Path::new("no/such/world.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such/world.yaml"), "{error}");
    }

    #[test]
    fn what_moves_shines_and_speaks_is_checked_with_its_place() {
        for (more, wanted) in [
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
                "did you mean `through`?",
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
                "unknown field `from`",
            ),
            (
                "lamps: [{at: [1, 1], brightnes: 1}]\n",
                "did you mean `brightness`?",
            ),
            (
                "sounds: [{at: [1, 1], kind: knok}]\n",
                "did you mean `knock`?",
            ),
            ("camera: {subsampling: \"4:2:1\"}\n", "`4:2:0`"),
            ("tracks: {slip: 2}\n", "w.yaml:3:16: "),
        ] {
            let text = fault(more);
            assert!(
                text.starts_with("w.yaml:") && text.contains(wanted),
                "{more}{text}"
            );
        }
        let long = "x".repeat(sign::MAX_TEXT + 1);
        let text = fault(&format!(
            "signs: [{{at: [1, 1], heading_degrees: 0, text: {long}}}]\n"
        ));
        assert!(text.contains("101 bytes are too many for a sign"), "{text}");
        let lamps = "  - {at: [1, 1]}\n".repeat(MAX_LAMPS + 1);
        assert!(fault(&format!("lamps:\n{lamps}")).contains("17 lamps are too many"));
    }

    /// A number as worlds have it, most of them in range.
    fn number() -> impl proptest::strategy::Strategy<Value = String> {
        "[1-3]|[0-3]|[0-3]|[0-3]|[1-3][.]5|[0-3][.][0-9]|[0-3][.][0-9]{2}|[1-3][.][0-9]{2}|[0-3][.]25|[0-3][.]75|[0-5]|-1|9999|[.]nan"
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(96))]

        #[test]
        fn every_world_that_is_read_can_be_lived_in_and_drawn(
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
                let mut robot = super::super::Robot::new(world, Default::default(), 1);
                robot.obey(&crate::wire::Command::Stream { stream: crate::wire::Stream::Video, on: true });
                robot.obey(&crate::wire::Command::Move { left: 90, right: 80 });
                (0..20).for_each(|_| robot.step(std::time::Duration::from_millis(20)));
                let pose = robot.state().pose;
                proptest::prop_assert!(pose.x.is_finite() && pose.y.is_finite());
                proptest::prop_assert!(map.width() > 100 && map.height() > 100);
            }
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_read_without_panic(text in ".{0,200}", more in "[a-z:{}\\[\\], 0-9.&*-]{0,80}") {
            let _ = World::from_yaml(&text, "random");
            let _ = World::from_yaml(&format!("{ROOM}{STATION}{more}"), "random");
        }
    }
}
