//! `spykee sim`: a simulated robot for any Spykee client.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::time::Duration;

use tokio::time::interval;

use super::interrupt::interruption;
use super::world::{self, WorldAction, load};
use super::{Console, Exit, Failure, LoginArgs, block_on, print};
use crate::config::Effective;
use crate::sim::{Fault, Firmware, Handle, Options, Server, State, World};

/// Interval between redraws of the status line.
const STATUS_PERIOD: Duration = Duration::from_millis(500);

/// Serve a simulated robot to any Spykee client; draw, list or check its worlds
///
/// Without a subcommand it serves.
#[derive(Debug, Clone, clap::Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct SimArgs {
    #[command(subcommand)]
    action: Option<WorldAction>,

    /// World file, or the name of a built-in world [default: living_room]
    #[arg(value_name = "WORLD")]
    world: Option<PathBuf>,

    /// Address and port to listen on, TCP and UDP; port 0 picks a free one
    #[arg(long, value_name = "IP:PORT", default_value = "127.0.0.1:9000")]
    listen: SocketAddr,

    /// Identity of the robot: several robots at one broker need different ones
    #[arg(long, value_name = "UID", default_value = "SPYKEE0001", value_parser = uid)]
    uid: String,

    /// Seed for simulator noise; the same seed and the same commands give the same run
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    seed: u64,

    /// YAML file of faults to simulate, such as a broken network or a rebooting robot; the book's
    /// chapter "Broken networks" lists them
    #[arg(long, value_name = "FILE.yaml")]
    faults: Option<PathBuf>,

    #[command(flatten)]
    firmware: FirmwareArgs,

    #[command(flatten)]
    login: LoginArgs,
}

/// Parses a robot's identity; it names files and topics.
fn uid(text: &str) -> Result<String, &'static str> {
    if (1..=32).contains(&text.len()) && text.chars().all(|c| c.is_ascii_alphanumeric()) {
        Ok(text.to_owned())
    } else {
        Err("expected 1 to 32 letters and digits, such as SPYKEE0002")
    }
}

/// Serves until interrupted, or looks at worlds.
pub(super) fn run(args: &SimArgs, console: &Console) -> Result<Exit, Failure> {
    if let Some(action) = &args.action {
        return world::run(action);
    }
    let world = load(args.world.as_deref())?;
    let faults = args.faults.as_deref().map(Fault::load_list).transpose();
    let faults = faults.map_err(|error| {
        Failure::usage(error).help("the book's chapter Broken networks lists all faults")
    })?;
    let options = Options {
        listen: args.listen,
        login: args.login.login(&Effective::default())?,
        seed: args.seed,
        faults,
        firmware: args.firmware.load()?,
        uid: args.uid.clone(),
        ..Options::default()
    };
    block_on(serve(world, options, console))?
}

async fn serve(world: World, options: Options, console: &Console) -> Result<Exit, Failure> {
    let listen = options.listen;
    let uid = options.uid.clone();
    let user = options.login.user.clone();
    let interrupted = interruption()?;
    let server = Server::bind(world, options).await.map_err(|error| {
        Failure::io(format_args!("listen on {listen}"), error)
            .help("is a simulator already running? --listen 127.0.0.1:0 picks a free port")
    })?;
    print(&greeting(server.local_addr(), &uid, &user))?;
    let handle = server.handle();
    tokio::select! {
        ended = server.run() => ended.map(|()| Exit::Done).map_err(|error| {
            Failure::internal(format_args!("the simulator failed: {error}"))
        }),
        () = show_status(&handle, console) => Ok(Exit::Done),
        () = interrupted => Ok(Exit::Interrupted),
    }
}

fn greeting(listening: SocketAddr, uid: &str, user: &str) -> String {
    let mut address = listening;
    if address.ip().is_unspecified() {
        address.set_ip(IpAddr::V4(Ipv4Addr::LOCALHOST));
    }
    format!(
        "The simulated robot {uid} listens on {listening}, TCP and UDP, for user {user}.\n\
         Drive it with: spykee run FILE.lua --robot {address}\n\
         Ctrl-C ends it.\n"
    )
}

async fn show_status(handle: &Handle, console: &Console) {
    let mut ticks = interval(STATUS_PERIOD);
    loop {
        ticks.tick().await;
        console.status(status(&handle.state()));
    }
}

fn status(state: &State) -> String {
    let user = state.user.as_deref().unwrap_or("no client");
    let charging = if state.charging { ", charging" } else { "" };
    let activity = match state {
        State {
            searching: true, ..
        } => "searching for its station",
        State { docked: true, .. } => "on its station",
        state if state.moving() => "driving",
        _ => "standing",
    };
    format!(
        "{activity} · battery {:.0} %{charging} · at {:.2} {:.2} m · user {user} · {} frames",
        state.battery, state.pose.x, state.pose.y, state.frames,
    )
}

/// The firmware of a simulated robot.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct FirmwareArgs {
    /// YAML file with the simulated robot's behaviour where the real firmware is unknown; the
    /// book's chapter "What is not known of the robot" lists the keys
    #[arg(long, value_name = "FILE.yaml")]
    pub(super) firmware: Option<PathBuf>,
}

impl FirmwareArgs {
    pub(super) fn load(&self) -> Result<Firmware, Failure> {
        let Some(path) = &self.firmware else {
            return Ok(Firmware::default());
        };
        Firmware::load(path).map_err(|error| {
            Failure::usage(error)
                .help("the book's chapter What is not known of the robot lists all keys")
        })
    }
}
