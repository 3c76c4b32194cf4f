//! The simulator as a server: sockets, clients and the clock around one [`Robot`]. One task owns
//! everything; the connections' tasks only carry bytes.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use tokio::net::{TcpListener, UdpSocket};
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval};

use crate::wire::{Accepted, Command, Login, Report, discovery};

use super::clients::Clients;
use super::connection::{self, Event, Line, Transport};
use super::firmware::Firmware;
use super::handle::{self, Ends, Handle, Order};
use super::robot::Robot;
use super::world::World;

/// One step of the physics.
const STEP: Duration = Duration::from_millis(20);
/// Steps made up for in one go after the machine was busy; time beyond that is lost.
const MAX_CATCH_UP: u32 = 10;
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
        }
    }
}

/// A simulated robot that serves clients while [`Server::run`] runs.
pub struct Server {
    sockets: Sockets,
    site: Site,
    events: mpsc::Receiver<Event>,
    orders: mpsc::Receiver<Order>,
    handle: Handle,
}

struct Sockets {
    tcp: Option<TcpListener>,
    udp: Option<UdpSocket>,
    address: SocketAddr,
}

/// The robot with all who talk to it.
struct Site {
    robot: Robot,
    clients: Clients,
    login: Login,
    uid: String,
    version: String,
    ends: Ends,
    events: mpsc::Sender<Event>,
    writes: Arc<AtomicU64>,
    connections: JoinSet<()>,
    started: Instant,
    stepped: Instant,
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
        };
        Server::with(sockets, world, options)
    }

    fn with(sockets: Sockets, mut world: World, options: Options) -> Server {
        world.camera.fps = options.fps.unwrap_or(world.camera.fps).clamp(0.1, 60.0);
        let version = options.firmware.version.clone();
        let robot = Robot::new(world, options.firmware, options.seed);
        let (handle, mut ends) = handle::pair(robot.state());
        let orders = std::mem::replace(&mut ends.orders, mpsc::channel(1).1);
        let (events, events_end) = mpsc::channel(MAX_EVENTS);
        let now = Instant::now();
        let site = Site {
            robot,
            clients: Clients::default(),
            login: options.login,
            uid: options.uid,
            version,
            ends,
            events,
            writes: Arc::default(),
            connections: JoinSet::new(),
            started: now,
            stepped: now,
        };
        Server {
            sockets,
            site,
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
            sockets,
            mut site,
            mut events,
            mut orders,
            handle: _handle,
        } = self;
        let mut ticks = interval(STEP);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        (site.started, site.stepped) = (Instant::now(), Instant::now());
        let mut datagram = [0; 64];
        loop {
            // The clock first: no flood of commands may stop the robot's time.
            tokio::select! {
                biased;
                _ = ticks.tick() => site.pass_time(),
                Some(order) = orders.recv() => site.follow(order),
                Some(event) = events.recv() => site.take(event),
                transport = sockets.accept() => site.admit(transport),
                Some((length, from)) = sockets.receive(&mut datagram) => {
                    sockets.answer(&site, &datagram[..length], from).await;
                }
                Some(_) = site.connections.join_next() => {}
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
                });
            }
            match UdpSocket::bind(address).await {
                Ok(udp) => {
                    return Ok(Sockets {
                        tcp: Some(tcp),
                        udp: Some(udp),
                        address,
                    });
                }
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or_else(|| io::ErrorKind::AddrInUse.into()))
    }

    async fn accept(&self) -> tokio::net::TcpStream {
        let Some(tcp) = &self.tcp else {
            return std::future::pending().await;
        };
        loop {
            match tcp.accept().await {
                Ok((stream, _)) => {
                    // Without it small reports wait for each other; the connection works anyway.
                    let _ = stream.set_nodelay(true);
                    return stream;
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

    async fn answer(&self, site: &Site, datagram: &[u8], from: SocketAddr) {
        let Some(udp) = self
            .udp
            .as_ref()
            .filter(|_| discovery::is_request(datagram))
        else {
            return;
        };
        let connected_user = site.clients.user().map(str::to_owned);
        let reply = discovery::Reply {
            uid: site.uid.clone(),
            connected_user,
        };
        if let Err(error) = udp.send_to(&reply.emit(), from).await {
            tracing::debug!(target: "spykee::sim", %error, "cannot answer a discovery");
        }
    }
}

impl Site {
    fn pass_time(&mut self) {
        let now = Instant::now();
        for _ in 0..MAX_CATCH_UP {
            if now.duration_since(self.stepped) < STEP {
                break;
            }
            self.stepped += STEP;
            self.robot.step(STEP);
            self.deliver();
        }
        if now.duration_since(self.stepped) >= STEP {
            self.stepped = now;
        }
        self.clients
            .overdue(now)
            .into_iter()
            .for_each(|id| self.cut(id));
        self.publish();
    }

    fn follow(&mut self, order: Order) {
        match order {
            Order::Battery(percent) => self.robot.set_battery(percent),
            Order::ChargerWorks(works) => self.robot.set_charger_works(works),
            Order::Place(pose) => self.robot.place(pose),
            Order::Beacon(on) => self.robot.set_beacon(on),
            Order::Inject(report) => self.tell(&report),
            Order::Cut => self.clients.ids().into_iter().for_each(|id| self.cut(id)),
            Order::Connect(transport) => self.admit(transport),
        }
        self.deliver();
        self.publish();
    }

    fn take(&mut self, event: Event) {
        match event {
            Event::Gone { client } => self.cut(client),
            Event::Heard {
                client,
                write,
                opened,
                commands,
            } => {
                for command in commands {
                    self.hear(client, write, opened, command);
                }
            }
        }
        self.publish();
    }

    fn admit(&mut self, transport: impl Transport) {
        let Some((client, outbox, cut)) = self.clients.admit(Instant::now()) else {
            tracing::warn!(target: "spykee::sim", "too many connections: one is turned away");
            return;
        };
        let line = Line {
            client,
            outbox,
            events: self.events.clone(),
            muted: self.ends.muted.clone(),
            writes: self.writes.clone(),
            cut,
        };
        self.connections.spawn(connection::serve(transport, line));
    }

    /// One command of one client: kept in the journal, and obeyed if the client may.
    fn hear(&mut self, client: u64, write: u64, opened: bool, command: Command) {
        if !self.clients.knows(client) {
            return;
        }
        let at = self.started.elapsed();
        handle::lock(&self.ends.journal).write(at, write, client, command.clone());
        match command {
            Command::Login(login) => self.log_in(client, &login),
            Command::Move { .. } if !self.clients.is_user(client) || !opened => {
                tracing::info!(target: "spykee::sim", client, "MOVE before login and POWER");
                self.cut(client);
            }
            _ if !self.clients.is_user(client) => {}
            command => self.robot.obey(&command),
        }
        self.deliver();
    }

    fn log_in(&mut self, client: u64, login: &Login) {
        if let Err(refusal) = self.clients.log_in(client, login, &self.login) {
            tracing::info!(target: "spykee::sim", client, ?refusal, "login refused");
            self.clients.refuse(client, refusal);
            return;
        }
        let accepted = Accepted {
            uid: self.uid.clone(),
            name: "Spykee".into(),
            place: "home".into(),
            firmware: self.version.clone(),
            docked: self.robot.docked(),
        };
        self.robot.take_reports();
        self.tell(&Report::Accepted(accepted));
        self.robot.begin_session();
    }

    fn cut(&mut self, client: u64) {
        if self.clients.cut(client) {
            self.robot.end_session();
        }
    }

    /// Passes on what the robot says; without a user nobody hears it.
    fn deliver(&mut self) {
        for report in self.robot.take_reports() {
            self.tell(&report);
        }
    }

    fn tell(&mut self, report: &Report) {
        if !self.clients.tell(report) {
            tracing::info!(target: "spykee::sim", "the client asks and never reads: cut off");
            self.clients
                .user_id()
                .into_iter()
                .for_each(|id| self.cut(id));
        }
    }

    fn publish(&mut self) {
        let mut state = self.robot.state();
        state.user = self.clients.user().map(str::to_owned);
        state.dropped = self.clients.dropped();
        self.ends.state.send_replace(state);
        let count = handle::lock(&self.ends.journal).count();
        self.ends
            .heard
            .send_if_modified(|heard| std::mem::replace(heard, count) != count);
    }
}
