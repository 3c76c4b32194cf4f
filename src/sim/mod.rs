//! The simulated robot and its world. Speaks the robot's real protocol to any client, over TCP and
//! UDP or a pipe in memory; imports `wire` only, so nothing of the agent can leak into what tests
//! it.
//!
//! [`World`] says what stands where, [`Robot`] lives in it and knows no clock and no socket,
//! [`Server`] connects it with clients and with `tokio::time`, [`Handle`] looks on and makes
//! trouble; a [`Fault`] is trouble with its time, of the network or of the robot.

mod battery;
mod body;
mod camera;
mod canvas;
mod clients;
mod connection;
mod docking;
mod fault_list;
mod faults;
mod firmware;
mod fittings;
mod geometry;
mod grain;
mod ground;
mod handle;
mod journal;
mod journey;
mod jpeg;
mod light;
mod locate;
mod mangle;
mod map;
mod memory;
mod microphone;
mod movers;
mod number;
mod obstacles;
mod outbox;
mod outlet;
mod paint;
mod proxy;
mod ready;
mod robot;
mod route;
mod scene;
mod schedule;
mod server;
mod sign;
mod site;
mod slip;
mod speaker;
mod state;
mod station;
mod surface;
mod texture;
mod things;
mod timing;
mod trace;
mod troubles;
mod view;
mod ways;
mod world;

pub use battery::BatterySettings;
pub use body::{FULL_POWER, FULL_SPEED, RADIUS, TRACK_WIDTH, Tracks};
pub use connection::Transport;
pub use fault_list::FaultsError;
pub use faults::{Fault, Towards, Trouble};
pub use firmware::Firmware;
pub use fittings::{Lamp, Noise, NoiseKind, Sign, Tape};
pub use geometry::{Point, Pose};
pub use handle::Handle;
pub use journal::Heard;
pub use paint::Paint;
pub use robot::Robot;
pub use route::{Route, Walker};
pub use schedule::{Schedule, Seconds};
pub use server::{Options, Server};
pub use slip::TrackSettings;
pub use state::{Leds, State, Streams};
pub use station::Station;
pub use things::{Ball, Floor, Furniture, Place, Post, Room, Rug, Spot, Wall};
pub use timing::Timing;
pub use trace::{Happening, Sample, Trace, What};
pub use view::{CameraSettings, HEIGHT, Subsampling, WIDTH};
pub use ways::Ways;
pub use world::{World, WorldError};
