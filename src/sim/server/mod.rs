//! The simulator as a server: sockets and the clock around one [`Robot`] and its clients. One task
//! owns everything; the connections' tasks only carry bytes.

mod clients;
pub(crate) mod connection;
pub(crate) mod handle;
pub(crate) mod journal;
mod outbox;
mod site;

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval};

use crate::wire::{Login, discovery};

use self::connection::Event;
use self::handle::{Handle, Order};
use self::site::{STEP, Site};
use crate::sim::body::firmware::Firmware;
use crate::sim::body::robot::Robot;
use crate::sim::faults::fault::Fault;
use crate::sim::faults::proxy::Breaker;
use crate::sim::world::document::World;

/// Events of connections that may wait; then the connections wait.
const MAX_EVENTS: usize = 64;
/// How often a port is tried that is free for TCP and UDP alike.
const PORT_TRIES: usize = 16;
/// A pause after the system could not accept a connection, such as for want of descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// How a simulator is served.
#[derive(Debug, Clone)]
pub struct Options {
    /// TCP, and UDP for discovery; port 0 takes a free one.
    pub listen: SocketAddr,
    /// The one login that is accepted.
    pub login: Login,
    /// Of all noise: the same seed and the same commands give the same run.
    pub seed: u64,
    /// What is not known of the real firmware.
    pub firmware: Firmware,
    /// Answer discovery datagrams on the same port.
    pub discovery: bool,
    /// Frames a second, in place of the world's.
    pub fps: Option<f64>,
    /// The robot's id in AUTH_REPLY and discovery.
    pub uid: String,
    /// What goes wrong, counted from [`Server::run`]; `None`: no fault is possible, not even by
    /// [`Handle::begin`].
    pub faults: Option<Vec<Fault>>,
    /// After so long a client's own system gives up a connection on which bytes towards the robot are
    /// swallowed, as TCP_USER_TIMEOUT does where they really are lost; `None`: never.
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

/// A simulated robot that serves clients while [`Server::run`] runs.
pub struct Server {
    sockets: Sockets,
    site: Site,
    faults: Vec<Fault>,
    events: mpsc::Receiver<Event>,
    orders: mpsc::Receiver<Order>,
    handle: Handle,
}

struct Sockets {
    tcp: Option<TcpListener>,
    udp: Option<UdpSocket>,
    address: SocketAddr,
    discovery: bool,
    /// Closed for a while, as of a robot that is gone.
    hidden: bool,
}

impl Server {
    /// Opens the sockets. The robot's time begins with [`Server::run`].
    ///
    /// # Errors
    /// The address is taken or not of this machine.
    pub async fn bind(world: World, options: Options) -> io::Result<Server> {
        let sockets = Sockets::open(options.listen, options.discovery).await?;
        Ok(Server::with(sockets, world, options))
    }

    /// A simulator without sockets, for clients that come by [`Handle::connect`].
    pub fn detached(world: World, options: Options) -> Server {
        let sockets = Sockets {
            tcp: None,
            udp: None,
            address: options.listen,
            discovery: false,
            hidden: false,
        };
        Server::with(sockets, world, options)
    }

    fn with(sockets: Sockets, mut world: World, options: Options) -> Server {
        world.camera.fps = options.fps.unwrap_or(world.camera.fps).clamp(0.1, 60.0);
        let robot = Robot::new(world, options.firmware.clone(), options.seed);
        let (handle, orders, ends) = handle::open(&robot);
        let (events, events_end) = mpsc::channel(MAX_EVENTS);
        let site = Site::new(robot, &options, ends, events);
        let faults = options.faults.unwrap_or_default();
        Server {
            sockets,
            site,
            faults,
            events: events_end,
            orders,
            handle,
        }
    }

    /// Where clients connect.
    pub fn local_addr(&self) -> SocketAddr {
        self.sockets.address
    }

    /// A handle to look at the robot and to trouble it.
    pub fn handle(&self) -> Handle {
        self.handle.clone()
    }

    /// Serves until dropped; all connections end with it.
    ///
    /// # Errors
    /// None at present: what goes wrong with one client ends that client.
    pub async fn run(self) -> io::Result<()> {
        let Server {
            mut sockets,
            mut site,
            faults,
            mut events,
            mut orders,
            handle: _handle,
        } = self;
        let mut ticks = interval(STEP);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        site.begin(faults);
        let mut datagram = [0; 64];
        loop {
            // The clock first: no flood of commands may stop the robot's time.
            tokio::select! {
                biased;
                _ = ticks.tick() => {
                    site.pass_time();
                    sockets.appear(!site.away()).await;
                }
                Some(order) = orders.recv() => site.follow(order),
                Some(event) = events.recv() => site.take(event),
                (stream, breaker) = sockets.accept() => site.admit(stream, breaker),
                Some((length, from)) = sockets.receive(&mut datagram) => {
                    sockets.answer(&site.introduction(), &datagram[..length], from).await;
                }
                () = site.reap() => {}
            }
        }
    }
}

impl Sockets {
    async fn open(listen: SocketAddr, discovery: bool) -> io::Result<Sockets> {
        let tries = if listen.port() == 0 { PORT_TRIES } else { 1 };
        let mut last = None;
        for _ in 0..tries {
            let tcp = TcpListener::bind(listen).await?;
            let address = tcp.local_addr()?;
            if !discovery {
                return Ok(Sockets {
                    tcp: Some(tcp),
                    udp: None,
                    address,
                    discovery,
                    hidden: false,
                });
            }
            match UdpSocket::bind(address).await {
                Ok(udp) => {
                    return Ok(Sockets {
                        tcp: Some(tcp),
                        udp: Some(udp),
                        address,
                        discovery,
                        hidden: false,
                    });
                }
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or_else(|| io::ErrorKind::AddrInUse.into()))
    }

    /// Closes the sockets, or opens them again at the same address; tried again if that fails.
    async fn appear(&mut self, visible: bool) {
        if !visible && self.tcp.is_some() {
            (self.tcp, self.udp) = (None, None);
            self.hidden = true;
        }
        if visible && self.hidden {
            match Sockets::open(self.address, self.discovery).await {
                Ok(sockets) => *self = sockets,
                Err(error) => {
                    tracing::warn!(target: "spykee::sim", %error, "cannot listen again yet");
                }
            }
        }
    }

    /// A client, and what resets its connection.
    async fn accept(&self) -> (TcpStream, Option<Breaker>) {
        let Some(tcp) = &self.tcp else {
            return std::future::pending().await;
        };
        loop {
            match tcp.accept().await {
                Ok((stream, _)) => {
                    // Without it small reports wait for each other; the connection works anyway.
                    let _ = stream.set_nodelay(true);
                    let socket = socket2::SockRef::from(&stream).try_clone();
                    return (stream, socket.ok().map(Breaker));
                }
                Err(error) => {
                    tracing::warn!(target: "spykee::sim", %error, "cannot accept");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    async fn receive(&self, datagram: &mut [u8]) -> Option<(usize, SocketAddr)> {
        let Some(udp) = &self.udp else {
            return std::future::pending().await;
        };
        udp.recv_from(datagram).await.ok()
    }

    /// Answers a datagram that asks who is there.
    async fn answer(&self, reply: &discovery::Reply, datagram: &[u8], from: SocketAddr) {
        let Some(udp) = self
            .udp
            .as_ref()
            .filter(|_| discovery::is_request(datagram))
        else {
            return;
        };
        if let Err(error) = udp.send_to(&reply.emit(), from).await {
            tracing::debug!(target: "spykee::sim", %error, "cannot answer a discovery");
        }
    }
}
