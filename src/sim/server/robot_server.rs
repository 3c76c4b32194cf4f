//! The robot with its clients: decides which client may command it, advances the simulated time and
//! sends the robot's reports to the user. Independent of sockets.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::Instant;

use super::clients::Clients;
use super::command_queue::{CommandQueue, QueuedCommand};
use super::connection::{Channels, Event, Transport};
use super::handle::{Ends, Request};
use super::{Options, connection, handle};
use crate::sim::body::Robot;
use crate::sim::body::memory::describe;
use crate::sim::faults::proxy::Breaker;
use crate::sim::faults::scheduler::{FaultScheduler, Transition};
use crate::sim::faults::{Fault, FaultKind, proxy};
use crate::sim::geometry::Pose;
use crate::sim::world::wifi::Radio;
use crate::wire::{Accepted, Command, Login, Refusal, Report, discovery};

/// The physics time step.
pub(crate) const STEP: Duration = Duration::from_millis(20);
/// Maximum number of steps to catch up at once after a delay; time beyond that is lost.
const MAX_CATCH_UP: u32 = 10;
/// Buffer size between the proxy and the robot, bytes.
const PIPE_LEN: usize = 16 * 1024;
/// The name in discovery replies of a second user who has taken over.
const SECOND_USER: &str = "second-user";
/// How far the robot slides when it loses its station, metres.
const SLIDE: f64 = 0.12;

pub(crate) struct RobotServer {
    robot: Robot,
    clients: Clients,
    queue: CommandQueue,
    login: Login,
    uid: String,
    version: String,
    ends: Ends,
    events: mpsc::Sender<Event>,
    writes: Arc<AtomicU64>,
    connections: JoinSet<()>,
    started: Instant,
    stepped: Instant,
    /// `None` if faults are disabled and the network reaches everywhere; clients are then served
    /// without the proxy.
    scheduler: Option<FaultScheduler>,
    rebooting: bool,
    refusing: Option<Refusal>,
    slides_after: Option<Duration>,
    docked_for: Duration,
    /// The last logged MOVE; clients repeat it many times a second.
    last_move: Option<Command>,
}

impl RobotServer {
    /// Creates a server without clients. Connections send their events to `events`.
    pub(crate) fn new(
        robot: Robot,
        options: &Options,
        ends: Ends,
        events: mpsc::Sender<Event>,
    ) -> RobotServer {
        let now = Instant::now();
        let proxied = options.faults.is_some() || robot.world().wifi.is_some();
        RobotServer {
            clients: Clients::default(),
            queue: CommandQueue::new(&options.firmware, now),
            login: options.login.clone(),
            uid: options.uid.clone(),
            version: options.firmware.version.clone(),
            ends,
            events,
            writes: Arc::default(),
            connections: JoinSet::new(),
            started: now,
            stepped: now,
            scheduler: if proxied {
                Some(FaultScheduler::new(options.seed, options.unacknowledged))
            } else {
                None
            },
            robot,
            rebooting: false,
            refusing: None,
            slides_after: None,
            docked_for: Duration::ZERO,
            last_move: None,
        }
    }

    pub(crate) fn begin(&mut self, faults: impl IntoIterator<Item = Fault>) {
        self.started = Instant::now();
        self.stepped = self.started;
        for fault in faults {
            self.begin_fault(fault);
        }
    }

    pub(crate) fn is_rebooting(&self) -> bool {
        self.rebooting
    }

    /// Whether datagrams get to the robot and back.
    pub(crate) fn is_in_range(&self) -> bool {
        self.robot.radio() != Radio::OutOfRange
    }

    /// Frees the task of an ended connection; pending while there are no connections.
    pub(crate) async fn reap(&mut self) {
        if self.connections.join_next().await.is_none() {
            std::future::pending().await
        }
    }

    pub(crate) fn discovery_reply(&self) -> discovery::Reply {
        let connected_user = self.clients.user().map(str::to_owned);
        discovery::Reply {
            uid: self.uid.clone(),
            connected_user,
        }
    }

    pub(crate) fn advance(&mut self) {
        let now = Instant::now();
        for _ in 0..MAX_CATCH_UP {
            if now.duration_since(self.stepped) < STEP {
                break;
            }
            self.stepped += STEP;
            self.robot.step(STEP);
            self.slide();
            self.deliver();
        }
        if now.duration_since(self.stepped) >= STEP {
            self.stepped = now;
        }
        self.update_radio();
        for client in self.clients.overdue(now) {
            self.disconnect(client);
        }
        let transitions = self.scheduler.as_mut().map(|scheduler| scheduler.poll(now));
        self.apply_transitions(transitions.unwrap_or_default());
        self.publish();
    }

    pub(super) fn handle_request(&mut self, request: Request) {
        match request {
            Request::Inject(report) => self.send_report(&report),
            Request::DisconnectAll => self.disconnect_all(),
            Request::Begin(fault) => self.begin_fault(fault),
            Request::ClearFaults => {
                let transitions = self.scheduler.as_mut().map(FaultScheduler::clear);
                self.apply_transitions(transitions.unwrap_or_default());
            }
            Request::Connect(transport) => self.admit(transport, None),
            Request::Alter(alter) => alter(&mut self.robot),
        }
        self.deliver();
        self.publish();
    }

    pub(crate) fn handle_event(&mut self, event: Event) {
        match event {
            Event::Gone { client } => self.disconnect(client),
            Event::Commands {
                client,
                write,
                opened,
                commands,
                mut place,
            } => {
                for command in commands {
                    let received = QueuedCommand {
                        received: self.started.elapsed(),
                        write,
                        client,
                        command,
                        _place: place.take(),
                    };
                    self.receive(received, opened);
                }
            }
        }
        self.publish();
    }

    /// Serves a new connection, unless the robot is rebooting.
    pub(crate) fn admit(&mut self, transport: impl Transport, breaker: Option<Breaker>) {
        if self.rebooting {
            return;
        }
        let (client, reports, cut) = self.clients.admit(Instant::now());
        let channels = Channels {
            client,
            reports,
            events: self.events.clone(),
            muted: self.ends.muted.clone(),
            writes: self.writes.clone(),
            places: self.queue.places(),
            cut,
        };
        let Some(scheduler) = &mut self.scheduler else {
            self.connections
                .spawn(connection::serve(transport, channels));
            return;
        };
        let (near, far) = tokio::io::duplex(PIPE_LEN);
        let forwarding = proxy::forward(transport, breaker, far, scheduler.feed());
        self.connections.spawn(forwarding);
        self.connections.spawn(connection::serve(near, channels));
    }

    fn begin_fault(&mut self, fault: Fault) {
        let Some(scheduler) = &mut self.scheduler else {
            tracing::warn!(target: "spykee::sim", "this simulator was started without faults");
            return;
        };
        let now = Instant::now();
        scheduler.begin(fault, now);
        let transitions = scheduler.poll(now);
        self.apply_transitions(transitions);
    }

    /// Lets the network do what the Wi-Fi does where the robot is.
    fn update_radio(&mut self) {
        /// The most that repeating lost packets delays what is sent, at the edge of the range.
        const LATEST: Duration = Duration::from_millis(1000);
        /// Steps of the delay, so that a robot that drives does not change it all the time.
        const STEPS: f64 = 20.0;
        let Some(scheduler) = &mut self.scheduler else {
            return;
        };
        scheduler.set_radio(match self.robot.radio() {
            Radio::Good => None,
            Radio::Weak(share) => Some(FaultKind::Delay {
                by: Duration::ZERO,
                jitter: LATEST.mul_f64((share * STEPS).ceil() / STEPS),
            }),
            Radio::OutOfRange => Some(FaultKind::HalfOpen),
        });
    }

    /// Applies faults that begin or end to the robot; the proxy handles those of the byte stream.
    fn apply_transitions(&mut self, transitions: Vec<(FaultKind, Transition)>) {
        for (kind, transition) in transitions {
            tracing::info!(target: "spykee::sim", trouble = ?kind, turn = ?transition, "a fault");
            let begins = transition == Transition::Begins;
            match kind {
                FaultKind::Drop if begins => self.disconnect_all(),
                FaultKind::Reboot { forgets } => {
                    self.rebooting = begins;
                    self.disconnect_all();
                    if forgets && begins {
                        self.queue.clear();
                        self.robot.reboot();
                    }
                }
                FaultKind::SlowProgram { period } if begins => self.queue.slow_down(period),
                FaultKind::SlowProgram { .. } => {
                    self.queue.recover(Instant::now());
                    self.execute_due();
                }
                FaultKind::TakeOver => self.hand_over(begins),
                FaultKind::RefuseLogin(refusal) => {
                    self.refusing = if begins { Some(refusal) } else { None };
                }
                FaultKind::BaseNotFound => self.robot.set_beacon(!begins),
                FaultKind::NoCharge => self.robot.set_charger_works(!begins),
                FaultKind::DockLost { after } => {
                    self.slides_after = if begins { Some(after) } else { None };
                }
                _ => {}
            }
        }
        self.deliver();
    }

    /// Gives the robot to a user without a connection here, or ends that user's session.
    fn hand_over(&mut self, taken: bool) {
        if !taken {
            self.clients.give_back();
        } else if self.clients.take_over(SECOND_USER) {
            self.robot.end_session();
        }
    }

    /// Applies `DockLost`: slides the robot off its station some time after each docking.
    fn slide(&mut self) {
        self.docked_for = if self.robot.docked() {
            self.docked_for + STEP
        } else {
            Duration::ZERO
        };
        if self
            .slides_after
            .is_some_and(|after| self.docked_for > after)
        {
            let Pose { x, y, heading } = self.robot.state().pose;
            let away = self.robot.world().station.leaves.directed(-SLIDE);
            let x = x + away * heading.cos();
            let y = y + away * heading.sin();
            self.robot.place(Pose::new(x, y, heading));
        }
    }

    /// Queues a command of the client that may command the robot; a login takes effect at once.
    fn receive(&mut self, received: QueuedCommand, opened: bool) {
        let client = received.client;
        if !self.clients.contains(client) {
            return;
        }
        match received.command.clone() {
            Command::Login(login) => {
                self.record(received);
                self.log_in(client, &login);
                self.deliver();
            }
            Command::Move { .. } if !self.clients.is_user(client) || !opened => {
                self.record(received);
                tracing::info!(target: "spykee::sim", client, "MOVE before login and POWER");
                self.disconnect(client);
            }
            _ if !self.clients.is_user(client) => self.record(received),
            _ => {
                self.queue.push(received);
                self.execute_due();
            }
        }
    }

    /// When the robot's program takes the next command from its queue; `None` if none waits.
    pub(super) fn next_command(&self) -> Option<Instant> {
        self.queue.due()
    }

    pub(super) fn handle_due(&mut self) {
        self.execute_due();
        self.publish();
    }

    /// Executes the commands that are due.
    fn execute_due(&mut self) {
        while let Some(queued) = self.queue.take(Instant::now()) {
            let command = queued.command.clone();
            let asks = matches!(
                command,
                Command::PowerQuery
                    | Command::ConfigQuery
                    | Command::LogQuery
                    | Command::NetworksQuery
            );
            let answerable = self.clients.is_user(queued.client);
            self.record(queued);
            if answerable || !asks {
                self.robot.execute(&command);
            }
            self.deliver();
        }
    }

    fn record(&mut self, queued: QueuedCommand) {
        self.log_command(queued.client, &queued.command);
        handle::lock(&self.ends.journal).add(self.started.elapsed(), queued);
    }

    /// Logs a command, except a repeated MOVE.
    fn log_command(&mut self, client: u64, command: &Command) {
        if let Command::Move { .. } = command {
            if self.last_move.as_ref() == Some(command) {
                return;
            }
            self.last_move = Some(command.clone());
        }
        tracing::debug!(target: "spykee::sim::heard", client, "{}", describe(command));
    }

    fn log_in(&mut self, client: u64, login: &Login) {
        let refused = match self.refusing {
            Some(refusal) => Err(refusal),
            None => self.clients.log_in(client, login, &self.login),
        };
        if let Err(refusal) = refused {
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
            tail: Bytes::from_static(Accepted::RECORDED_TAIL),
        };
        self.robot.take_reports();
        self.send_report(&Report::Accepted(accepted));
        self.robot.begin_session();
    }

    fn disconnect_all(&mut self) {
        for client in self.clients.ids() {
            self.disconnect(client);
        }
    }

    fn disconnect(&mut self, client: u64) {
        if self.clients.disconnect(client) {
            self.robot.end_session();
        }
    }

    fn deliver(&mut self) {
        for report in self.robot.take_reports() {
            self.send_report(&report);
        }
    }

    fn send_report(&mut self, report: &Report) {
        if !matches!(report, Report::Video(_) | Report::Audio(_)) {
            tracing::debug!(target: "spykee::sim::said", "{report:?}");
        }
        if !self.clients.send_report(report) {
            tracing::info!(target: "spykee::sim", "the client sends requests but never reads: disconnected");
            if let Some(user) = self.clients.user_id() {
                self.disconnect(user);
            }
        }
    }

    fn publish(&mut self) {
        let mut state = self.robot.state();
        state.queued = self.queue.len();
        state.user = self.clients.user().map(str::to_owned);
        state.dropped = self.clients.dropped();
        self.ends.state.send_replace(state);
        let count = handle::lock(&self.ends.journal).count();
        self.ends
            .heard
            .send_if_modified(|heard| std::mem::replace(heard, count) != count);
    }
}
