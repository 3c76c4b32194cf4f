//! How a simulator is served.

use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use crate::sim::body::firmware::Firmware;
use crate::sim::faults::fault::Fault;
use crate::wire::Login;

/// How a simulator is served.
#[derive(Debug, Clone)]
pub struct Options {
    /// TCP, and UDP for discovery; port 0 takes a free one.
    pub listen: SocketAddr,
    /// The one login that is accepted.
    pub login: Login,
    /// Of all noise: the same seed and the same commands give the same run.
    pub seed: u64,
    /// The firmware's behaviour where the real one's is not known.
    pub firmware: Firmware,
    /// Answer discovery datagrams on the same port.
    pub discovery: bool,
    /// Frames a second, in place of the world's.
    pub fps: Option<f64>,
    /// The robot's id in AUTH_REPLY and discovery.
    pub uid: String,
    /// What goes wrong, counted from [`Server::run`](crate::sim::Server::run); `None`: no fault is
    /// possible, not even by [`Handle::begin`](crate::sim::Handle::begin).
    pub faults: Option<Vec<Fault>>,
    /// After so long a client's own system gives up a connection on which bytes towards the robot
    /// are swallowed, as TCP_USER_TIMEOUT does where they really are lost; `None`: never.
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
