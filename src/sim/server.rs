//! The simulator as a server: connects one [`Robot`] to sockets, clients and the clock. One task owns
//! all state; the connections' tasks only transfer bytes.

pub(crate) mod connection;
pub(crate) mod handle;
mod robot_server;
mod sockets;

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{Instant, MissedTickBehavior, interval, sleep_until};
use wire::Login;

use self::connection::Event;
use self::handle::{Handle, Request};
use self::robot_server::{RobotServer, STEP};
use self::sockets::Sockets;
use crate::body::Robot;
use crate::body::firmware::Firmware;
use crate::faults::Fault;
use crate::world::World;

/// Capacity of the queue of connection events; when it is full, the connections wait.
const MAX_EVENTS: usize = 64;

/// A simulated robot that serves clients while [`Server::run`] runs.
pub struct Server {
    sockets: Sockets,
    robot_server: RobotServer,
    faults: Vec<Fault>,
    events: mpsc::Receiver<Event>,
    requests: mpsc::Receiver<Request>,
    handle: Handle,
}

impl Server {
    /// Opens the sockets. The simulated time starts with [`Server::run`].
    pub async fn bind(world: World, options: Options) -> io::Result<Server> {
        let sockets = Sockets::open(options.listen, options.discovery).await?;
        Ok(Server::with(sockets, world, options))
    }

    /// Creates a simulator without sockets, for clients that connect with [`Handle::connect`].
    pub fn detached(world: World, options: Options) -> Server {
        Server::with(Sockets::none(options.listen), world, options)
    }

    fn with(sockets: Sockets, mut world: World, options: Options) -> Server {
        world.camera.fps = options.fps.unwrap_or(world.camera.fps).clamp(0.1, 60.0);
        let robot = Robot::new(world, options.firmware.clone(), options.seed);
        let (handle, requests, ends) = handle::open(&robot);
        let (events, events_end) = mpsc::channel(MAX_EVENTS);
        let robot_server = RobotServer::new(robot, &options, ends, events);
        let faults = options.faults.unwrap_or_default();
        Server {
            sockets,
            robot_server,
            faults,
            events: events_end,
            requests,
            handle,
        }
    }

    /// Returns the address to which clients connect.
    pub fn local_addr(&self) -> SocketAddr {
        self.sockets.address
    }

    /// Returns a handle to observe and change the simulation.
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Serves until dropped; all connections end with it. An error of one
    /// client only disconnects that client.
    pub async fn run(mut self) -> io::Result<()> {
        let mut ticks = interval(STEP);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        self.robot_server.begin(std::mem::take(&mut self.faults));
        let mut datagram = [0; 64];
        loop {
            let due = self.robot_server.next_command();
            // The clock has priority: a flood of commands must not stop the simulated time.
            tokio::select! {
                biased;
                _ = ticks.tick() => {
                    self.robot_server.advance();
                    self.sockets.set_visible(!self.robot_server.is_rebooting()).await;
                }
                () = sleep_until(due.unwrap_or_else(Instant::now)), if due.is_some() => {
                    self.robot_server.handle_due();
                }
                Some(request) = self.requests.recv() => self.robot_server.handle_request(request),
                Some(event) = self.events.recv() => self.robot_server.handle_event(event),
                (stream, breaker) = self.sockets.accept() => self.robot_server.admit(stream, breaker),
                Some((length, from)) = self.sockets.receive(&mut datagram) => {
                    if !self.robot_server.is_in_range() {
                        continue;
                    }
                    let reply = self.robot_server.discovery_reply();
                    self.sockets.answer(&reply, &datagram[..length], from).await;
                }
                () = self.robot_server.reap() => {}
            }
        }
    }
}

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
    /// The faults, with times relative to [`Server::run`](crate::Server::run). With `None` no
    /// fault is possible, not even through [`Handle::begin`](crate::Handle::begin).
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
