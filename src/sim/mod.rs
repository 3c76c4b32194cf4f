//! The simulated robot and its world. Speaks the robot's real protocol to any client, over TCP and
//! UDP or an in-memory pipe. It imports only `wire`, small helpers and of `vision` the JPEG encoder
//! and the type `Camera`, none of its optics, so that it stays independent of the agent code that it
//! tests.

mod body;
mod camera;
mod faults;
mod geometry;
mod map;
mod server;
mod world;
mod yaml;

pub use body::chassis::{FULL_POWER, FULL_SPEED, Tracks};
pub use body::firmware::{Firmware, FirmwareBehaviour, PowerWhileCharging};
pub use body::trace::{Sample, Trace, TraceEvent, TraceEventKind};
pub use body::{Leds, Robot, State, Streams};
pub use camera::view::{HEIGHT, WIDTH};
pub use faults::{Direction, Fault, FaultKind, Timing};
pub use geometry::obstacles::Obstacles;
pub use geometry::{Point, Pose, RADIUS, TRACK_WIDTH};
pub use server::connection::Transport;
pub use server::handle::{Handle, ReceivedCommand};
pub use server::{Options, Server};
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
pub use yaml::DocumentError;

pub use crate::vision::Subsampling;
