//! The built-in worlds, which need no file.

use super::document::World;

/// Name and YAML of each world; the names are those of the files in `behaviours/worlds/`.
const BUILTIN: [(&str, &str); 8] = [
    (
        "living_room",
        include_str!("../../../behaviours/worlds/living_room.yaml"),
    ),
    (
        "playpen",
        include_str!("../../../behaviours/worlds/playpen.yaml"),
    ),
    ("yard", include_str!("../../../behaviours/worlds/yard.yaml")),
    (
        "line_loop",
        include_str!("../../../behaviours/worlds/line_loop.yaml"),
    ),
    (
        "classroom",
        include_str!("../../../behaviours/worlds/classroom.yaml"),
    ),
    ("hall", include_str!("../../../behaviours/worlds/hall.yaml")),
    (
        "night",
        include_str!("../../../behaviours/worlds/night.yaml"),
    ),
    (
        "gallery",
        include_str!("../../../behaviours/worlds/gallery.yaml"),
    ),
];

impl World {
    /// Returns the names of the built-in worlds; the first is the default.
    pub fn builtin_names() -> impl Iterator<Item = &'static str> {
        BUILTIN.iter().map(|(name, _)| *name)
    }

    /// Returns the built-in world with this name.
    pub fn builtin(name: &str) -> Option<World> {
        let (name, yaml) = BUILTIN.iter().find(|(known, _)| *known == name)?;
        World::from_yaml(yaml, &format!("{name}.yaml")).ok()
    }

    /// Returns the YAML of the built-in world with this name.
    pub fn builtin_yaml(name: &str) -> Option<&'static str> {
        let (_, yaml) = BUILTIN.iter().find(|(known, _)| *known == name)?;
        Some(yaml)
    }

    /// Returns the leading comment of a built-in world, which describes its content and purpose.
    pub fn builtin_description(name: &str) -> Option<String> {
        let (_, yaml) = BUILTIN.iter().find(|(known, _)| *known == name)?;
        let comment = yaml.lines().map_while(|line| line.strip_prefix("# "));
        Some(comment.collect::<Vec<_>>().join(" "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    }

    #[test]
    fn the_example_in_the_readme_is_valid() {
        let page = include_str!("../../../behaviours/worlds/README.md");
        let (_, yaml) = page.split_once("```yaml\n").unwrap();
        let yaml = yaml.split("```").next().unwrap();
        let world = World::from_yaml(yaml, "README.md").unwrap();
        assert!(!world.lamps.is_empty() && !world.walkers.is_empty() && !world.sounds.is_empty());
    }
}
