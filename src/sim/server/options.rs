//! The server's options.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use crate::sim::body::firmware::Firmware;
use crate::sim::faults::fault::Fault;
use crate::wire::Login;

/// Options of a simulated robot and its server.
#[derive(Debug, Clone)]
pub struct Options {
    /// Address for TCP, and for UDP discovery; port 0 selects a free port.
    pub listen: SocketAddr,
    /// The one login that is accepted.
    pub login: Login,
    /// Seed of everything random: the same seed and the same commands give the same run.
    pub seed: u64,
    /// The firmware's behaviour where the real one's is not known.
    pub firmware: Firmware,
    /// Whether to answer discovery datagrams on the same port.
    pub discovery: bool,
    /// Frames per second, overriding the world's setting.
    pub fps: Option<f64>,
    /// The robot's id in AUTH_REPLY and discovery.
    pub uid: String,
    /// The faults, with times relative to [`Server::run`](crate::sim::Server::run). With `None` no
    /// fault is possible, not even through [`Handle::begin`](crate::sim::Handle::begin).
    pub faults: Option<Vec<Fault>>,
    /// Simulates the TCP_USER_TIMEOUT of the client's system: a connection is reset when bytes
    /// towards the robot have been dropped for this long; `None` disables it.
    pub unacknowledged: Option<Duration>,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
            login: Login::new("admin", "admin"),
            seed: 0,
            firmware: Firmware::default(),
            discovery: true,
            fps: None,
            uid: "SPYKEE0001".into(),
            faults: None,
            unacknowledged: None,
        }
    }
}
