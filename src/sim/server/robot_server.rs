//! The robot with its clients: decides which client may command it, advances the simulated time and
//! sends the robot's reports to the user. Independent of sockets.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use wire::{Accepted, Command, Login, Refusal, Report, discovery};

use super::connection::{Channels, Event, ReportQueue, Transport};
use super::handle::{Ends, ReceivedCommand, Request};
use super::{Options, connection};
use crate::body::Robot;
use crate::body::firmware::Firmware;
use crate::faults::proxy::Breaker;
use crate::faults::scheduler::{FaultScheduler, Transition};
use crate::faults::{Fault, FaultKind, proxy};
use crate::geometry::Pose;

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
        self.robot.radio_fault() != Some(FaultKind::HalfOpen)
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
        if let Some(scheduler) = &mut self.scheduler {
            scheduler.set_radio(self.robot.radio_fault());
        }
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
                    let now = self.started.elapsed();
                    let heard = ReceivedCommand {
                        index: 0,
                        at: now,
                        received: now,
                        write,
                        client,
                        command,
                    };
                    let _place = place.take();
                    self.receive(QueuedCommand { heard, _place }, opened);
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
            let pose = self.robot.state().pose;
            let away = self.robot.world().station.leaves.directed(-SLIDE);
            let place = pose.point().ahead(pose.heading, away);
            self.robot.place(Pose::at(place, pose.heading));
        }
    }

    /// Queues a command of the client that may command the robot; a login takes effect at once.
    fn receive(&mut self, received: QueuedCommand, opened: bool) {
        let client = received.heard.client;
        if !self.clients.contains(client) {
            return;
        }
        match received.heard.command.clone() {
            Command::Login(login) => {
                self.record(received.heard);
                self.log_in(client, &login);
                self.deliver();
            }
            Command::Move { .. } if !self.clients.is_user(client) || !opened => {
                self.record(received.heard);
                tracing::info!(target: "spykee::sim", client, "MOVE before login and POWER");
                self.disconnect(client);
            }
            _ if !self.clients.is_user(client) => self.record(received.heard),
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
            let command = queued.heard.command.clone();
            let asks = matches!(
                command,
                Command::PowerQuery
                    | Command::ConfigQuery
                    | Command::LogQuery
                    | Command::NetworksQuery
            );
            let answerable = self.clients.is_user(queued.heard.client);
            self.record(queued.heard);
            if answerable || !asks {
                self.robot.execute(&command);
            }
            self.deliver();
        }
    }

    fn record(&mut self, heard: ReceivedCommand) {
        self.log_command(heard.client, &heard.command);
        self.ends.journal.lock().add(self.started.elapsed(), heard);
    }

    /// Logs a command, except a repeated MOVE.
    fn log_command(&mut self, client: u64, command: &Command) {
        if let Command::Move { .. } = command {
            if self.last_move.as_ref() == Some(command) {
                return;
            }
            self.last_move = Some(command.clone());
        }
        tracing::debug!(target: "spykee::sim::heard", client, "{command:?}");
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
        let count = self.ends.journal.lock().count();
        self.ends
            .heard
            .send_if_modified(|heard| std::mem::replace(heard, count) != count);
    }
}

/// Places in a queue whose length the firmware's settings leave open.
const UNLIMITED: usize = 4096;

/// A command whose index and time of execution are not known yet.
#[derive(Debug)]
struct QueuedCommand {
    heard: ReceivedCommand,
    /// The command's place in the queue, free again when this is dropped.
    _place: Option<OwnedSemaphorePermit>,
}

/// The commands that the robot has received and not yet executed. Its program takes one at a time,
/// at the firmware's pace, in the order in which they came; an idle program takes one at once.
struct CommandQueue {
    /// Time per command of the firmware; `None` if it executes everything at once.
    usual_period: Option<Duration>,
    /// Time per command now.
    period: Option<Duration>,
    waiting: VecDeque<QueuedCommand>,
    places: Arc<Semaphore>,
    places_now: watch::Sender<Option<Arc<Semaphore>>>,
    /// When the program is ready for the next command.
    ready: Instant,
}

impl CommandQueue {
    fn new(firmware: &Firmware, now: Instant) -> CommandQueue {
        let period = (firmware.commands_per_second).map(|rate| Duration::from_secs_f64(1.0 / rate));
        let places = Arc::new(Semaphore::new(firmware.queue.unwrap_or(UNLIMITED)));
        CommandQueue {
            usual_period: period,
            period,
            waiting: VecDeque::new(),
            places_now: watch::Sender::new(period.map(|_| places.clone())),
            places,
            ready: now,
        }
    }

    /// The free places, of which a connection takes one for each command before it reads on;
    /// `None` while every command is executed at once.
    fn places(&self) -> watch::Receiver<Option<Arc<Semaphore>>> {
        self.places_now.subscribe()
    }

    /// From now on the program takes at least this long for each command.
    fn slow_down(&mut self, period: Duration) {
        self.period = self.usual_period.max(Some(period));
        self.places_now.send_replace(Some(self.places.clone()));
    }

    /// The program is as fast as usual again.
    fn recover(&mut self, now: Instant) {
        self.period = self.usual_period;
        self.ready = self.ready.min(now + self.period.unwrap_or_default());
        let places = self.period.map(|_| self.places.clone());
        self.places_now.send_replace(places);
    }

    fn push(&mut self, command: QueuedCommand) {
        self.waiting.push_back(command);
    }

    /// Takes the next command, if the robot's program is ready for it.
    fn take(&mut self, now: Instant) -> Option<QueuedCommand> {
        if now < self.ready {
            return None;
        }
        let command = self.waiting.pop_front()?;
        if let Some(period) = self.period {
            self.ready = now + period;
        }
        Some(command)
    }

    /// When the next command is due; `None` if none waits.
    fn due(&self) -> Option<Instant> {
        self.waiting.front().map(|_| self.ready)
    }

    fn len(&self) -> usize {
        self.waiting.len()
    }

    fn clear(&mut self) {
        self.waiting.clear();
    }
}

/// Maximum number of simultaneous connections, including those that have not logged in.
const MAX_CLIENTS: usize = 8;
/// A connection without a login is closed after this time.
const LOGIN_LIMIT: Duration = Duration::from_secs(30);

struct Client {
    reports: Arc<ReportQueue>,
    cut: CancellationToken,
    since: Instant,
}

/// The connected clients, and which of them is the one user (`PROTOCOL.md`, *Network*: users at
/// once).
#[derive(Default)]
struct Clients {
    all: BTreeMap<u64, Client>,
    user: Option<(u64, String)>,
    next: u64,
    dropped: u64,
}

/// The id of a user without a connection here.
const EXTERNAL_USER: u64 = u64::MAX;

/// A new client's id, its report queue and the token that disconnects it.
type Admission = (u64, Arc<ReportQueue>, CancellationToken);

impl Clients {
    /// Registers a connection. If there are too many, the oldest one without a login ends.
    fn admit(&mut self, now: Instant) -> Admission {
        let oldest = self.all.keys().find(|id| !self.is_user(**id)).copied();
        if self.all.len() >= MAX_CLIENTS
            && let Some(oldest) = oldest
        {
            tracing::warn!(target: "spykee::sim", client = oldest, "too many connections: the oldest without a login ends");
            self.disconnect(oldest);
        }
        let client = Client {
            reports: Arc::default(),
            cut: CancellationToken::new(),
            since: now,
        };
        let id = self.next;
        let admission = (id, client.reports.clone(), client.cut.clone());
        self.next += 1;
        self.all.insert(id, client);
        admission
    }

    /// Whether `id` is the user, who may command the robot.
    fn is_user(&self, id: u64) -> bool {
        self.user.as_ref().is_some_and(|(user, _)| *user == id)
    }

    fn contains(&self, id: u64) -> bool {
        self.all.contains_key(&id)
    }

    fn user(&self) -> Option<&str> {
        self.user.as_ref().map(|(_, name)| name.as_str())
    }

    /// Makes `id` the user, if the login is correct and there is no other user.
    fn log_in(&mut self, id: u64, login: &Login, right: &Login) -> Result<(), Refusal> {
        if login != right {
            return Err(Refusal::WrongPassword);
        }
        if self.user.as_ref().is_some_and(|(user, _)| *user != id) {
            return Err(Refusal::InUse);
        }
        self.user = Some((id, login.user.clone()));
        Ok(())
    }

    /// Makes a user without a connection here the user; returns whether another was disconnected.
    fn take_over(&mut self, name: &str) -> bool {
        let disconnected = self.user_id().is_some_and(|id| self.disconnect(id));
        self.user = Some((EXTERNAL_USER, name.to_owned()));
        disconnected
    }

    fn give_back(&mut self) {
        if self.is_user(EXTERNAL_USER) {
            self.user = None;
        }
    }

    /// Sends the refusal to `id`, and closes the connection when it has been written.
    fn refuse(&mut self, id: u64, refusal: Refusal) {
        if let Some(client) = self.all.get(&id) {
            client.reports.push(&Report::Refused(refusal));
            client.reports.close();
        }
    }

    /// Sends a report to the user; false if the user does not read and must be disconnected.
    fn send_report(&self, report: &Report) -> bool {
        let Some(client) = self.user.as_ref().and_then(|(id, _)| self.all.get(id)) else {
            return true;
        };
        client.reports.push(report)
    }

    fn disconnect(&mut self, id: u64) -> bool {
        if let Some(client) = self.all.remove(&id) {
            client.cut.cancel();
            self.dropped += client.reports.dropped();
        }
        let was_user = self.is_user(id);
        if was_user {
            self.user = None;
        }
        was_user
    }

    fn ids(&self) -> Vec<u64> {
        self.all.keys().copied().collect()
    }

    fn user_id(&self) -> Option<u64> {
        self.user.as_ref().map(|(id, _)| *id)
    }

    /// Returns the clients that have exceeded the time limit for logging in.
    fn overdue(&self, now: Instant) -> Vec<u64> {
        let late = |client: &Client| now.duration_since(client.since) > LOGIN_LIMIT;
        let all = self.all.iter();
        all.filter(|(id, client)| !self.is_user(**id) && late(client))
            .map(|(id, _)| *id)
            .collect()
    }

    /// Returns the number of frames and audio chunks dropped so far, over all connections.
    fn dropped(&self) -> u64 {
        let connected = self.all.values().map(|client| client.reports.dropped());
        self.dropped + connected.sum::<u64>()
    }
}
