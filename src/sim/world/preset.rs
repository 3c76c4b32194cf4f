//! Presets: what the robot is like where the world does not say it.

use serde::Deserialize;
use serde_yaml::Value;

use super::World;

const GENUINE: &str = include_str!("genuine.yaml");

/// What the robot is like where the world does not say it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Preset {
    /// Perfect tracks, a level camera, and a docking that always succeeds.
    #[default]
    Exact,
    /// The most likely values of a genuine robot.
    Genuine,
}

impl Preset {
    /// Sets what `text`, from which the world was parsed, does not say itself.
    pub(super) fn complete(self, world: &mut World, text: &str) -> Result<(), serde_yaml::Error> {
        if self == Preset::Exact {
            return Ok(());
        }
        let mut document: Value = serde_yaml::from_str(text)?;
        add_missing(&mut document, serde_yaml::from_str(GENUINE)?);
        world.station.docking = serde_yaml::from_value(document["station"]["docking"].clone())?;
        world.battery = serde_yaml::from_value(document["battery"].clone())?;
        world.camera = serde_yaml::from_value(document["camera"].clone())?;
        world.tracks = serde_yaml::from_value(document["tracks"].clone())?;
        Ok(())
    }
}

/// Adds the keys that `given` does not have, at all depths.
fn add_missing(given: &mut Value, usual: Value) {
    if let Value::Mapping(given) = given
        && let Value::Mapping(usual) = usual
    {
        for (key, value) in usual {
            match given.get_mut(&key) {
                Some(given) => add_missing(given, value),
                None => drop(given.insert(key, value)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::{BatterySettings, CameraSettings, TrackSettings};
    use super::super::station::DockingSettings;
    use super::*;
    use crate::world::settings::PowerReading;

    const ROOM: &str = "room: {width: 6, depth: 4}\n";
    const STATION: &str = "station: {at: [0, 2], heading_degrees: 0}\n";

    fn read(text: &str) -> World {
        World::from_yaml(text, "w.yaml").unwrap()
    }

    fn text(value: &Value) -> String {
        serde_yaml::to_string(value).unwrap().trim().to_owned()
    }

    /// Returns the lines of a YAML document of maps as `a.b.c` with their values.
    fn flat(value: &Value, path: &str, to: &mut Vec<[String; 2]>) {
        match value {
            Value::Mapping(map) => {
                for (key, value) in map {
                    let key = key.as_str().unwrap();
                    let path = if path.is_empty() {
                        key.to_owned()
                    } else {
                        format!("{path}.{key}")
                    };
                    flat(value, &path, to);
                }
            }
            Value::Sequence(items) => {
                let items: Vec<String> = items.iter().map(text).collect();
                to.push([path.to_owned(), format!("[{}]", items.join(", "))]);
            }
            _ => to.push([path.to_owned(), text(value)]),
        }
    }

    #[test]
    fn without_a_preset_the_robot_is_exact() {
        let exact = read(&format!("preset: exact\n{ROOM}{STATION}"));
        let world = read(&format!("{ROOM}{STATION}"));
        assert_eq!(world.preset, Preset::Exact);
        for world in [world, exact] {
            assert_eq!(world.station.docking, DockingSettings::default());
            assert_eq!(world.battery, BatterySettings::default());
            assert_eq!(world.camera, CameraSettings::default());
            assert_eq!(world.tracks, TrackSettings::default());
        }
    }

    #[test]
    fn genuine_sets_what_the_world_does_not_say() {
        let world = read(&format!("{ROOM}{STATION}preset: genuine\n"));
        assert!(!world.station.docking.sees_obstacles);
        assert_eq!(world.battery.power, PowerReading::Voltage);
        assert_eq!(world.tracks.dead_zone, 20.0);
        assert!((15.0..=20.0).contains(&world.camera.fps) && world.camera.latency > 0.0);
        assert!(world.camera.pitch != 0.0 && world.camera.roll != 0.0);
    }

    #[test]
    fn what_the_world_says_wins_over_the_preset() {
        let world = read(&format!(
            "preset: genuine\n{ROOM}\
             station: {{at: [0, 2], heading_degrees: 0, docking: {{success: 1}}}}\n\
             battery: {{level: 40, power: percent}}\n\
             camera: {{pitch: 0}}\n\
             tracks: {{response: {{rug: 0.5}}}}\n"
        ));
        assert_eq!(world.station.docking.success, 1.0);
        assert!(!world.station.docking.sees_obstacles);
        assert_eq!(world.battery.level, 40.0);
        assert_eq!(world.battery.power, PowerReading::Percent);
        assert_eq!((world.camera.pitch, world.camera.roll), (0.0, -1.5));
        assert_eq!(world.tracks.response.rug, 0.5);
        assert_eq!(world.tracks.response.empty, 0.7);
        assert_eq!(world.tracks.dead_zone, 20.0);
    }

    #[test]
    fn texts_that_look_like_numbers_stay_texts() {
        let sign = "signs: [{at: [3, 2], heading_degrees: 0, text: 12, side: 0.3, height: 0.3}]\n";
        let world = read(&format!("name: 7\npreset: genuine\n{ROOM}{STATION}{sign}"));
        assert_eq!((&*world.name, &*world.signs[0].text), ("7", "12"));
    }

    #[test]
    fn mistakes_name_their_place_also_with_a_preset() {
        for (more, place, words) in [
            ("preset: genuin\n", "w.yaml:3:", "did you mean 'genuine'?"),
            (
                "preset: genuine\ncamera: {pitch: 90}\n",
                "w.yaml:4:17: ",
                "-45 to 30",
            ),
            (
                "preset: genuine\ntracks: {dead: 1}\n",
                "w.yaml:4:10: ",
                "dead",
            ),
            (
                "preset: genuine\nfurniture: [{at: [3, 2], length: 1, width: 1, height: 0.27, \
                 colour: red}]\ncamera: {fps: 8}\n",
                "w.yaml:5:9: ",
                "use a lower camera",
            ),
        ] {
            let error = World::from_yaml(&format!("{ROOM}{STATION}{more}"), "w.yaml");
            let text = error.unwrap_err().to_string();
            assert!(text.starts_with(place) && text.contains(words), "{text}");
        }
    }

    #[test]
    fn every_built_in_world_has_a_genuine_robot_and_is_valid_with_an_exact_one() {
        for name in World::builtin_names() {
            let yaml = World::builtin_yaml(name).unwrap();
            assert_eq!(read(yaml).preset, Preset::Genuine, "{name}");
            let exact = yaml.replace("preset: genuine\n", "preset: exact\n");
            assert_eq!(read(&exact).preset, Preset::Exact, "{name}");
        }
    }

    #[test]
    fn every_value_and_its_source_is_in_the_readme() {
        let page = include_str!("../../../behaviours/worlds/README.md");
        let mut values = Vec::new();
        flat(&serde_yaml::from_str(GENUINE).unwrap(), "", &mut values);
        let rows = values.len();
        for [key, value] in values {
            let row = format!("| `{key}` | {value} | ");
            let source = page.split_once(&row);
            let (_, source) = source.unwrap_or_else(|| panic!("no row {row}"));
            let kinds = ["measured", "reported", "assumed"];
            assert!(kinds.iter().any(|kind| source.starts_with(kind)), "{row}");
        }
        let (_, table) = page.split_once("| key | value | source |\n").unwrap();
        let table = table.lines().take_while(|line| line.starts_with('|'));
        assert_eq!(table.count(), rows + 1, "rows of keys that no preset has");
    }
}
