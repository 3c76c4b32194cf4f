//! `spykee sim show|list|check`: draws, lists and checks worlds.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::builder::{PathBufValueParser, PossibleValue, TypedValueParser};

use super::argument::ArgumentError;
use super::embedded::load;
use super::{Exit, Failure, print};
use crate::sim::{Handle, World};

#[derive(Debug, Clone, clap::Subcommand)]
pub(super) enum WorldAction {
    /// Draw the map of a world
    Show {
        /// World file, or the name of a built-in world [default: living_room]
        #[arg(value_name = "WORLD", value_parser = WorldParser, hide_possible_values = true)]
        world: Option<PathBuf>,

        /// File to write, which must end in .png; an existing file is replaced
        #[arg(short, long, value_name = "FILE.png", default_value = "map.png", value_parser = parse_png)]
        output: PathBuf,

        /// Print the world as YAML instead, as a start for your own: `--yaml > mine.yaml`
        #[arg(long, conflicts_with = "output")]
        yaml: bool,
    },
    /// List the built-in worlds
    List,
    /// Check world files; errors name the line
    Check {
        /// World files
        #[arg(value_name = "WORLD.yaml", required = true)]
        worlds: Vec<PathBuf>,
    },
}

/// Parses the name of a file that ends in `.png`.
pub(super) fn parse_png(text: &str) -> Result<PathBuf, ArgumentError> {
    let path = PathBuf::from(text);
    let ending = path.extension().unwrap_or_default();
    if ending.eq_ignore_ascii_case("png") {
        return Ok(path);
    }
    Err(ArgumentError::Png)
}

/// Shows, lists or checks worlds.
pub(super) fn run(action: &WorldAction) -> Result<Exit, Failure> {
    match action {
        WorldAction::Show {
            world, yaml: true, ..
        } => show_yaml(world.as_deref()),
        WorldAction::Show { world, output, .. } => show(world.as_deref(), output),
        WorldAction::List => list(),
        WorldAction::Check { worlds } => check(worlds),
    }
}

fn show(world: Option<&Path>, output: &Path) -> Result<Exit, Failure> {
    let world = load(world)?;
    save(&world.draw(), output)?;
    print(&format!(
        "The map of {} is in {}.\n",
        world.name,
        output.display()
    ))?;
    Ok(Exit::Done)
}

fn show_yaml(world: Option<&Path>) -> Result<Exit, Failure> {
    let built_in = World::builtin_names().next().unwrap_or_default();
    let name = world.map_or(built_in.into(), Path::to_string_lossy);
    match (World::builtin_yaml(&name), world) {
        (Some(yaml), _) => print(yaml)?,
        (None, Some(path)) => {
            // Refuses to print files that are not worlds.
            World::load(path).map_err(Failure::usage)?;
            let text =
                std::fs::read_to_string(path).map_err(|error| Failure::unreadable(path, error))?;
            print(&text)?;
        }
        (None, None) => {}
    }
    Ok(Exit::Done)
}

/// Writes a picture.
fn save(picture: &image::RgbImage, path: &Path) -> Result<(), Failure> {
    picture
        .save(path)
        .map_err(|error| Failure::unwritable(path, error))
}

fn list() -> Result<Exit, Failure> {
    let mut text = String::new();
    for name in World::builtin_names() {
        let about = World::builtin_description(name).unwrap_or_default();
        // Writing into a string does not fail.
        let _ = writeln!(text, "{name}\n    {about}");
    }
    text.push_str("Use one with: spykee run FILE.lua --sim NAME\n");
    print(&text)?;
    Ok(Exit::Done)
}

fn check(worlds: &[PathBuf]) -> Result<Exit, Failure> {
    let mut wrong = Vec::new();
    for path in worlds {
        match World::load(path) {
            Ok(world) => print(&format!("{}: valid, {}\n", path.display(), world.name))?,
            Err(error) => wrong.push(error.to_string()),
        }
    }
    if wrong.is_empty() {
        return Ok(Exit::Done);
    }
    Err(Failure::new(Exit::Check, wrong.join("\nerror: "))
        .help("worlds to start from are in behaviours/worlds/"))
}

/// Parses the name of a built-in world or of a file; shells complete the names.
#[derive(Debug, Clone)]
pub(super) struct WorldParser;

impl TypedValueParser for WorldParser {
    type Value = PathBuf;

    fn parse_ref(
        &self,
        command: &clap::Command,
        arg: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<PathBuf, clap::Error> {
        PathBufValueParser::new().parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(World::builtin_names().map(PossibleValue::new)))
    }
}

/// A picture file for the path of a robot.
#[derive(Debug)]
pub(super) struct TraceFile(PathBuf);

impl TraceFile {
    /// Creates the file, so that an invalid name is reported before the robot moves.
    pub(super) fn create(path: &Path) -> Result<TraceFile, Failure> {
        let made = std::fs::File::create(path);
        made.map_err(|error| Failure::unwritable(path, error))?;
        Ok(TraceFile(path.to_owned()))
    }

    /// Draws this robot's path and events so far.
    pub(super) fn write(&self, sim: &Handle) -> Result<(), Failure> {
        save(&sim.trace().draw(sim.world()), &self.0)?;
        tracing::info!("the robot's path is drawn in {}", self.0.display());
        Ok(())
    }
}
