//! `spykee sim show|list|check`: draws, lists and checks worlds; and the simulated robot inside
//! `spykee run --sim`.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::mpsc;
use std::time::Duration;

use super::{Exit, Failure, argument, print};
use crate::link::Target;
use crate::side_thread::SideThread;
use crate::sim::{DocumentError, Handle, Options, Server, World};
use crate::yaml::suggestion;

#[derive(Debug, Clone, clap::Subcommand)]
pub(super) enum WorldAction {
    /// Draw the map of a world
    Show {
        /// World file, or the name of a built-in world [default: living_room]
        #[arg(value_name = "WORLD")]
        world: Option<PathBuf>,

        /// File to write, which must end in .png; an existing file is replaced
        #[arg(short, long, value_name = "FILE.png", default_value = "map.png", value_parser = argument::png)]
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
    ))
}

fn show_yaml(world: Option<&Path>) -> Result<Exit, Failure> {
    let built_in = World::builtin_names().next().unwrap_or_default();
    let name = world.map_or(built_in.into(), Path::to_string_lossy);
    match (World::builtin_yaml(&name), world) {
        (Some(yaml), _) => print(yaml),
        (None, Some(path)) => {
            // Refuses to print files that are not worlds.
            World::load(path).map_err(Failure::usage)?;
            let text =
                std::fs::read_to_string(path).map_err(|error| Failure::unreadable(path, error))?;
            print(&text)
        }
        (None, None) => Ok(Exit::Done),
    }
}

/// Loads the world from a file, the built-in one of that name, or the default one.
pub(super) fn load(world: Option<&Path>) -> Result<World, Failure> {
    let Some(path) = world else {
        return Ok(World::default_world());
    };
    if let Some(world) = path.to_str().and_then(World::builtin)
        && !path.exists()
    {
        return Ok(world);
    }
    World::load(path).map_err(|error| {
        if matches!(error, DocumentError::Invalid { .. }) {
            return Failure::usage(error);
        }
        let names: Vec<&str> = World::builtin_names().collect();
        let near = suggestion(&path.to_string_lossy(), names.iter().copied());
        let names = names.join(", ");
        Failure::usage(error).help(format!("name a world file, or one of {names}{near}"))
    })
}

pub(super) fn save(picture: &image::RgbImage, path: &Path) -> Result<(), Failure> {
    picture
        .save(path)
        .map_err(|error| Failure::unwritable(path, error))
}

fn list() -> Result<Exit, Failure> {
    for name in World::builtin_names() {
        let about = World::builtin_description(name).unwrap_or_default();
        print(&format!("{name}\n    {about}\n"))?;
    }
    print("Use one with: spykee run FILE.lua --sim NAME\n")
}

fn check(worlds: &[PathBuf]) -> Result<Exit, Failure> {
    let mut wrong = Vec::new();
    for path in worlds {
        match World::load(path) {
            Ok(world) if world.name.is_empty() => {
                print(&format!("{}: valid, without a name\n", path.display()))?;
            }
            Ok(world) => _ = print(&format!("{}: valid, {}\n", path.display(), world.name))?,
            Err(error) => wrong.push(error.to_string()),
        }
    }
    if wrong.is_empty() {
        return Ok(Exit::Done);
    }
    Err(Failure::new(Exit::Check, wrong.join("\nerror: "))
        .help("worlds to start from are in behaviours/worlds/"))
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

/// How long the end of a simulator may take.
const END_TIMEOUT: Duration = Duration::from_secs(5);

/// A simulator on its own thread, so that drawing pictures never delays the watchdog, with real
/// sockets on loopback. Ends when dropped.
pub(super) struct EmbeddedSim {
    address: SocketAddr,
    handle: Handle,
    thread: SideThread,
}

impl EmbeddedSim {
    /// Starts a simulator in this world. Not for callers on a runtime.
    pub(super) fn start(world: World, options: Options) -> Result<EmbeddedSim, Failure> {
        let (bound, binding) = mpsc::sync_channel(1);
        let thread = SideThread::start("sim", |stop| async move {
            let server = match Server::bind(world, options).await {
                Ok(server) => server,
                Err(error) => return drop(bound.send(Err(error))),
            };
            let _ = bound.send(Ok((server.local_addr(), server.handle())));
            let _ = stop.run_until_cancelled(server.run()).await;
        });
        let cannot = |error| Failure::io("start the simulator", error);
        let thread = thread.map_err(cannot)?;
        let bound = binding.recv().map_err(Failure::internal)?;
        let (address, handle) = bound.map_err(cannot)?;
        Ok(EmbeddedSim {
            address,
            handle,
            thread,
        })
    }

    pub(super) fn target(&self) -> Target {
        Target {
            host: self.address.ip().to_string(),
            port: self.address.port(),
        }
    }

    pub(super) fn handle(&self) -> Handle {
        self.handle.clone()
    }
}

impl Drop for EmbeddedSim {
    fn drop(&mut self) {
        self.thread.finish(END_TIMEOUT);
    }
}
