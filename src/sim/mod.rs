//! The simulated robot and its world. Speaks the robot's real protocol to any client, over TCP and
//! UDP or an in-memory pipe. Of this crate it imports only `wire`, the JPEG encoder of `vision` and
//! small helpers (`clock`, `files`, `yaml`), so that the simulator stays independent of the agent
//! code that it tests.
//!
//! [`World`] describes a place. [`Robot`] is simulated in it, without a clock or sockets of its
//! own. [`Server`] connects the robot to clients and to `tokio::time`. [`Handle`] observes the
//! robot and injects faults. A [`Fault`] is a failure of the network or of the robot, with the time
//! at which it occurs.
//!
//! | module | content | imports |
//! | --- | --- | --- |
//! | `yaml` | numbers with ranges, errors with line and column | |
//! | `geometry` | points, poses, lines and circles on the floor | |
//! | `world` | a world and everything that moves in it | `yaml`, `geometry`, `vision` |
//! | `camera` | frames of a world from a pose | `world`, and `vision` for the encoder |
//! | `body` | the robot, its parts and its firmware | `yaml`, `world`, `camera` |
//! | `map` | drawings of worlds and runs | `world`, `camera`, `body` |
//! | `faults` | faults, and the proxy that corrupts bytes | `yaml` |
//! | `server` | sockets and the clock around the robot and its clients | all of them |

#![warn(missing_docs)]

mod body;
mod camera;
mod faults;
mod geometry;
mod map;
mod server;
mod world;
mod yaml;

pub use body::Robot;
pub use body::chassis::{FULL_POWER, FULL_SPEED, Tracks};
pub use body::firmware::{Firmware, FirmwareBehaviour};
pub use body::state::{Leds, State, Streams};
pub use body::trace::{Sample, Trace, TraceEvent, TraceEventKind};
pub use camera::view::{HEIGHT, WIDTH};
pub use faults::{Direction, Fault, FaultKind, Timing};
pub use geometry::{Point, Pose, RADIUS, TRACK_WIDTH};
pub use server::connection::Transport;
pub use server::handle::{Handle, ReceivedCommand};
pub use server::{Options, Server};
pub use world::World;
pub use world::fixtures::{Lamp, Noise, NoiseKind, Schedule, Seconds, Sign, Tape};
pub use world::objects::{
    Ball, Floor, Furniture, Paint, Post, Room, Route, Rug, Spot, Start, Walker, Wall,
};
pub use world::settings::{BatterySettings, CameraSettings, TrackSettings};
pub use world::station::Station;
pub use world::station_distances::StationDistances;
pub use yaml::{DocumentError, DocumentKind};

pub use crate::vision::Subsampling;
