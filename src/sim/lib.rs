//! The simulated robot and its world. Speaks the robot's real protocol to any client, over TCP and
//! UDP or an in-memory pipe. It imports only `wire`, small helpers and of `vision` the JPEG encoder
//! and the type `Camera`, none of its optics, so that it stays independent of what it tests.
//!
//! ```
//! use sim::{Options, Server, World};
//! use tokio::io::{AsyncReadExt, AsyncWriteExt};
//! use tokio::net::TcpStream;
//! use wire::{Command, Decoder, Led, Login, Report};
//!
//! # #[tokio::main(flavor = "current_thread")]
//! # async fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A robot in a living room, on a free port of this computer.
//! let server = Server::bind(World::default_world(), Options::default()).await?;
//! let mut client = TcpStream::connect(server.local_addr()).await?;
//! let robot = server.handle();
//! tokio::spawn(server.run());
//!
//! // A client logs in.
//! client.write_all(&Command::Login(Login::new("admin", "admin")).to_bytes()).await?;
//! let mut buffer = [0; 1024];
//! let length = client.read(&mut buffer).await?;
//! let packet = Decoder::new().decode(&mut &buffer[..length])?.expect("a whole message");
//! assert!(matches!(Report::parse(packet), Report::Accepted(_)));
//!
//! // The handle tells what the robot has heard, and what it does.
//! client.write_all(&Command::Led { led: Led::Flash, on: true }.to_bytes()).await?;
//! let state = robot.wait_state(|state| state.leds.flash).await;
//! assert_eq!(state.user.as_deref(), Some("admin"));
//! # Ok(())
//! # }
//! ```
#![warn(missing_docs)]
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

mod body;
mod camera;
mod document;
mod faults;
mod geometry;
mod map;
mod server;
mod world;

pub use body::chassis::{FULL_POWER, FULL_SPEED, Tracks};
pub use body::firmware::{Firmware, FirmwareBehaviour, PowerWhileCharging};
pub use body::trace::{Sample, Trace, TraceEvent, TraceEventKind};
pub use body::{Leds, Robot, State, Streams};
pub use camera::view::{HEIGHT, WIDTH};
pub use document::DocumentError;
pub use faults::{Direction, Fault, FaultKind, Timing};
pub use geometry::obstacles::Obstacles;
pub use geometry::{Point, Pose, RADIUS, TRACK_WIDTH};
pub use server::connection::Transport;
pub use server::handle::{Handle, ReceivedCommand};
pub use server::{Options, Server};
pub use vision::Subsampling;
pub use world::fixtures::{Lamp, Noise, NoiseKind, Schedule, Sign, Tape};
pub use world::objects::{
    Ball, Decor, Floor, Furniture, Paint, Post, Room, Route, Rug, Sill, Spot, Start, Walker, Wall,
};
pub use world::preset::Preset;
pub use world::settings::{
    BatterySettings, CameraSettings, PowerReading, TrackResponse, TrackSettings,
};
pub use world::station::{DockingSettings, Leaves, Station};
pub use world::{Wifi, World};
