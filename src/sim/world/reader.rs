//! Reads worlds: the built-in default, from a text, or from a file.

use std::path::Path;

use super::document::World;
use super::validate;
use crate::sim::yaml::document::{self, DocumentError, DocumentKind};
use crate::sim::yaml::locate;

const DEFAULT_WORLD: &str = include_str!("../../../behaviours/worlds/living_room.yaml");

impl World {
    /// Returns the built-in default world: a living room.
    pub fn default_world() -> World {
        #[expect(clippy::expect_used, reason = "a test parses this text")]
        World::from_yaml(DEFAULT_WORLD, "living_room.yaml").expect("the built-in world is valid")
    }

    /// Parses a world; `name` is the name of the text in errors, usually its file name.
    ///
    /// # Errors
    /// [`DocumentError::Invalid`] with line and column: unknown keys, wrong types, values out of
    /// range, things outside the room, a blocked station or start.
    pub fn from_yaml(text: &str, name: &str) -> Result<World, DocumentError> {
        let world: World = locate::read(text, name)?;
        validate::check(&world).map_err(|error| {
            DocumentError::invalid(name, locate::find(text, &error.path), error.message)
        })?;
        Ok(world)
    }

    /// Reads a world from a file.
    ///
    /// # Errors
    /// As [`World::from_yaml`], or the file cannot be read.
    pub fn load(path: &Path) -> Result<World, DocumentError> {
        document::load(path, DocumentKind::World, World::from_yaml)
    }
}

#[cfg(test)]
mod tests {
    use super::super::code;
    use super::super::settings::BatterySettings;
    use super::super::validate::{MAX_LAMPS, MAX_OBJECTS};
    use super::*;

    const ROOM: &str = "room: {width: 6, depth: 4}\n";
    const STATION: &str = "station: {at: [0, 2], heading_degrees: 0}\n";

    /// Returns the error for `ROOM`, `STATION` and `more`, which starts in line 3.
    fn fault(more: &str) -> String {
        World::from_yaml(&format!("{ROOM}{STATION}{more}"), "w.yaml")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn the_built_in_worlds_are_valid() {
        assert_eq!(World::default_world().name, "living room");
        let playpen = include_str!("../../../behaviours/worlds/playpen.yaml");
        let playpen = World::from_yaml(playpen, "playpen.yaml").unwrap();
        assert_eq!(playpen.start_pose(), playpen.station.dock_pose());
    }

    #[test]
    fn missing_keys_have_defaults() {
        let world = World::from_yaml(&format!("{ROOM}{STATION}"), "w.yaml").unwrap();
        assert_eq!(world.battery, BatterySettings::default());
        assert_eq!((world.light, world.camera.fps), (1.0, 15.0));
    }

    #[test]
    fn an_unknown_key_is_rejected_with_its_place_and_a_suggestion() {
        let text = fault("balls:\n  - at: [1, 1]\n    colour: red\n    raduis: 0.1\n");
        assert!(text.starts_with("w.yaml:6:5: "), "{text}");
        assert!(
            text.contains("raduis") && text.ends_with("did you mean `radius`?"),
            "{text}"
        );
    }

    #[test]
    fn values_out_of_range_are_rejected_with_their_place() {
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
    fn wrong_types_are_rejected_with_their_place() {
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
    fn things_outside_the_room_are_rejected_with_their_place() {
        let text = fault("balls:\n  - {at: [1, 1], colour: red}\n  - {at: [7, 1], colour: red}\n");
        assert!(
            text.starts_with("w.yaml:5:10: [7, 1] is outside the room"),
            "{text}"
        );
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
    fn too_many_things_are_rejected() {
        let ball = "  - {at: [1, 1], colour: red}\n";
        let text = fault(&format!("balls:\n{}", ball.repeat(MAX_OBJECTS + 1)));
        assert!(text.contains("201 balls are too many"), "{text}");
    }

    #[test]
    fn the_error_names_a_missing_file() {
        let error = World::load(Path::new("no/such/world.yaml")).unwrap_err();
        assert!(error.to_string().contains("no/such/world.yaml"), "{error}");
    }

    #[test]
    fn errors_in_movers_and_fixtures_name_their_place() {
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
            ("balls: [3]\n", "expected keys with values"),
        ] {
            let text = fault(more);
            assert!(
                text.starts_with("w.yaml:") && text.contains(wanted),
                "{more}{text}"
            );
        }
        let long = "x".repeat(code::MAX_TEXT + 1);
        let text = fault(&format!(
            "signs: [{{at: [1, 1], heading_degrees: 0, text: {long}}}]\n"
        ));
        assert!(text.contains("101 bytes are too many for a sign"), "{text}");
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
                let mut robot = crate::sim::Robot::new(world, Default::default(), 1);
                robot.execute(&crate::wire::Command::Stream { stream: crate::wire::Stream::Video, on: true });
                robot.execute(&crate::wire::Command::Move { left: 90, right: 80 });
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
