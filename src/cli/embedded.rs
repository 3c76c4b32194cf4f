//! The simulator inside `spykee run --sim`: runs on its own thread, so that drawing pictures never
//! delays the watchdog, and uses real sockets on loopback.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::mpsc;
use std::thread::JoinHandle;

use tokio::runtime::Builder;
use tokio_util::sync::CancellationToken;

use super::Failure;
use crate::script::suggestion;
use crate::sim::{Firmware, Handle, Options, Server, World};
use crate::wire::Login;

/// Further options of a simulated robot.
#[derive(Debug, Clone, Default)]
pub(super) struct Simulated {
    /// Whether a person may start faults.
    pub(super) faults: bool,
    /// Behaviour of the firmware where the real one is unknown.
    pub(super) firmware: Firmware,
}

/// A running simulator; ends when dropped.
pub(super) struct EmbeddedSim {
    address: SocketAddr,
    handle: Handle,
    stop: CancellationToken,
    thread: Option<JoinHandle<()>>,
}

impl EmbeddedSim {
    /// Starts a simulator in this world; it accepts this one login.
    pub(super) fn start(
        world: World,
        login: &Login,
        seed: u64,
        kind: Simulated,
    ) -> Result<EmbeddedSim, Failure> {
        let options = Options {
            login: login.clone(),
            seed,
            faults: if kind.faults { Some(Vec::new()) } else { None },
            firmware: kind.firmware,
            ..Options::default()
        };
        let stop = CancellationToken::new();
        let (started, starting) = mpsc::sync_channel(1);
        let stopped = stop.clone();
        let serve = move || {
            let runtime = Builder::new_current_thread().enable_all().build();
            let served = runtime.map(|runtime| {
                runtime.block_on(async {
                    let bound = Server::bind(world, options).await;
                    let Ok(server) = bound else {
                        let _ = started.send(bound.map(|_| None));
                        return;
                    };
                    let _ = started.send(Ok(Some((server.local_addr(), server.handle()))));
                    let _ = stopped.run_until_cancelled(server.run()).await;
                });
            });
            if let Err(error) = served {
                tracing::error!("the simulator cannot run: {error}");
            }
        };
        let thread = std::thread::Builder::new().name("sim".into()).spawn(serve);
        let thread = thread.map_err(no_sim)?;
        match starting.recv() {
            Ok(Ok(Some((address, handle)))) => Ok(EmbeddedSim {
                address,
                handle,
                stop,
                thread: Some(thread),
            }),
            Ok(Err(error)) => Err(no_sim(error)),
            Ok(Ok(None)) | Err(_) => Err(no_sim(std::io::Error::other("it did not start"))),
        }
    }

    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    pub(super) fn handle(&self) -> Handle {
        self.handle.clone()
    }
}

impl Drop for EmbeddedSim {
    fn drop(&mut self) {
        self.stop.cancel();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn no_sim(error: std::io::Error) -> Failure {
    Failure::io("start the simulator", error)
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
        let names: Vec<&str> = World::builtin_names().collect();
        let near = suggestion(&path.to_string_lossy(), names.iter().copied());
        let names = names.join(", ");
        Failure::usage(error).help(format!("name a world file, or one of {names}{near}"))
    })
}
