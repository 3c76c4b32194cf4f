//! The robot with all who talk to it: decides who may command it, passes time on to it and its
//! reports to its user. Knows no sockets.

use std::sync::Arc;
use std::sync::atomic::AtomicU64;
use std::time::Duration;

use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::wire::{Accepted, Command, Login, Report, discovery};

use super::clients::Clients;
use super::connection::{self, Event, Line, Transport};
use super::handle::{self, Ends, Order};
use super::robot::Robot;
use super::server::Options;

/// One step of the physics.
pub(super) const STEP: Duration = Duration::from_millis(20);
/// Steps made up for in one go after the machine was busy; time beyond that is lost.
const MAX_CATCH_UP: u32 = 10;

/// The robot with all who talk to it.
pub(super) struct Site {
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

impl Site {
    /// Nobody is connected yet. Connections report to `events`.
    pub(super) fn new(
        robot: Robot,
        options: &Options,
        ends: Ends,
        events: mpsc::Sender<Event>,
    ) -> Site {
        let now = Instant::now();
        Site {
            robot,
            clients: Clients::default(),
            login: options.login.clone(),
            uid: options.uid.clone(),
            version: options.firmware.version.clone(),
            ends,
            events,
            writes: Arc::default(),
            connections: JoinSet::new(),
            started: now,
            stepped: now,
        }
    }

    /// The robot's time begins now.
    pub(super) fn begin(&mut self) {
        (self.started, self.stepped) = (Instant::now(), Instant::now());
    }

    /// Frees what an ended connection leaves behind; pending while there is none.
    pub(super) async fn reap(&mut self) {
        if self.connections.join_next().await.is_none() {
            std::future::pending().await
        }
    }

    /// What discovery says.
    pub(super) fn introduction(&self) -> discovery::Reply {
        let connected_user = self.clients.user().map(str::to_owned);
        discovery::Reply {
            uid: self.uid.clone(),
            connected_user,
        }
    }

    /// Steps the robot up to the present.
    pub(super) fn pass_time(&mut self) {
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

    /// Does what a handle asks.
    pub(super) fn follow(&mut self, order: Order) {
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

    /// Takes what a connection tells.
    pub(super) fn take(&mut self, event: Event) {
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

    /// Serves a new connection, if there is room.
    pub(super) fn admit(&mut self, transport: impl Transport) {
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
