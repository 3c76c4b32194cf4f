//! The agent of a real robot of a class: an ordinary one, a process of its own that lives as long as
//! the class. Nothing but its server reaches it, by the private socket that is its standard input.
//! The first connection brings the server's orders and returns what the robot does; the agent ends
//! with that connection. The others are those of viewers.

use std::io;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixListener;
use std::pin::Pin;
use std::time::Duration;

use futures_util::StreamExt as _;
use serde::{Deserialize, Serialize};
use tokio::io::AsyncWriteExt as _;
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::sync::watch;
use tokio::time::{Instant, sleep};
use tokio_util::codec::{FramedRead, LinesCodec};
use tokio_util::sync::CancellationToken;

use super::learner::{MAX_TOLD, RunPlan, what_failed};
use super::queue::Facts;
use crate::agent::{Agent, AgentError, BehaviourState, BehaviourStatus, Bus, Change, Outcome};
use crate::config::Config;
use crate::control::{Run, RunRequest};
use crate::live::{self, LOG_BEGINS, RunDefinition, WebContext};
use crate::pilot::LinkState;
use crate::robot::{AgentEvent, BusMessage, Percent, Setpoint};
use crate::side_thread::SideThread;

/// The name under which the agent's log tells what the class orders.
const CLASS: &str = "the class";
/// A person who holds the robot shows life this often.
const ALIVE: Duration = Duration::from_millis(100);

/// What the server orders: to end what runs, and then to start this.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Order {
    /// Counts the orders.
    pub(super) number: u64,
    /// The turn that it belongs to.
    pub(super) turn: Option<u64>,
    pub(super) start: Option<Start>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Start {
    /// The learner, after whom the behaviour is called: its name stands in the log.
    pub(super) driver: String,
    pub(super) plan: RunPlan,
    /// The rest of the turn: the script ends then, whatever the server does.
    pub(super) lasts: Duration,
}

/// What the agent tells its server.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct RobotNews {
    /// The newest order that is carried out.
    pub(super) done: u64,
    pub(super) facts: Facts,
    /// Why the newest script failed.
    pub(super) error: Option<String>,
}

/// An agent that obeys its class.
pub struct RobotAgent {
    control: Run,
    bus: Bus,
    /// The teacher's settings, for scripts.
    config: Config,
    orders: FramedRead<OwnedReadHalf, LinesCodec>,
    server: OwnedWriteHalf,
    /// What has been told so far.
    news: RobotNews,
    /// The turn of the newest order.
    turn: Option<u64>,
    /// A script that does not run yet.
    starting: Option<Starting>,
    _definition: watch::Sender<RunDefinition>,
    _page: SideThread,
}

/// A script that is being started.
type Starting = Pin<Box<dyn Future<Output = Result<(), String>>>>;

impl RobotAgent {
    /// Serves the agent to the class that has started this process.
    pub fn open(control: Run, bus: &Bus, config: Config) -> io::Result<RobotAgent> {
        let listener = UnixListener::from(io::stdin().as_fd().try_clone_to_owned()?);
        // It is there since before this process was started.
        let (server, _) = listener.accept()?;
        server.set_nonblocking(true)?;
        let (orders, server) = UnixStream::from_std(server)?.into_split();
        let (definition, shown) = watch::channel(RunDefinition::default());
        let context = WebContext {
            run: control.clone(),
            definition: shown,
            bus: bus.subscribe(),
            log: live::tap(),
            data: config.data_folder().to_owned(),
        };
        let page = live::serve_privately(context, listener).map_err(io::Error::other)?;
        let codec = LinesCodec::new_with_max_length(MAX_TOLD as usize);
        Ok(RobotAgent {
            control,
            bus: bus.clone(),
            config,
            orders: FramedRead::new(orders, codec),
            server,
            news: RobotNews::default(),
            turn: None,
            starting: None,
            _definition: definition,
            _page: page,
        })
    }

    /// Runs the agent until the class is gone, or the token is cancelled.
    pub async fn run(self, agent: Agent, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let ended = stop.clone();
        let obeying = async move {
            self.obey().await;
            ended.cancel();
            std::future::pending().await
        };
        tokio::select! {
            outcome = agent.run(stop) => outcome,
            never = obeying => never,
        }
    }

    /// Carries out orders and tells what happens, until the server is gone.
    async fn obey(mut self) {
        let mut status = self.control.status.clone();
        let mut statuses = self.control.roster.statuses();
        let mut events = self.bus.subscribe();
        let mut told = None;
        loop {
            self.news.facts = self.facts();
            if told.as_ref() != Some(&self.news) {
                let line = serde_json::to_string(&self.news).unwrap_or_default() + "\n";
                if self.server.write_all(line.as_bytes()).await.is_err() {
                    return;
                }
                told = Some(self.news.clone());
            }
            tokio::select! {
                // Orders first: a script that has not begun to start never does, after another order.
                biased;
                line = self.orders.next() => {
                    let Some(Ok(line)) = line else { return };
                    let Ok(order) = serde_json::from_str::<Order>(&line) else { return };
                    self.carry_out(order).await;
                    // What has ended is no news any more.
                    events = self.bus.subscribe();
                }
                done = started(&mut self.starting) => {
                    self.starting = None;
                    self.news.error = done.err();
                }
                Some(message) = events.next() => self.hear(&message),
                Ok(()) = status.changed() => {}
                Ok(()) = statuses.changed() => {}
            }
        }
    }

    async fn carry_out(&mut self, order: Order) {
        self.end_script().await;
        if order.turn != self.turn {
            self.turn = order.turn;
            // Whoever drives next sees nothing of the script before: neither its end nor its output.
            let _ = self.control.roster.define(Vec::new()).await;
            tracing::info!(target: LOG_BEGINS, "a turn begins or ends");
        }
        self.news.done = order.number;
        self.news.error = None;
        self.starting = order.start.map(|start| self.start(start));
    }

    fn hear(&mut self, message: &BusMessage) {
        if let BusMessage::Event(event) = message
            && let AgentEvent::Ended {
                reason, message, ..
            } = &event.what
        {
            self.news.error = what_failed(*reason, message.as_deref());
        }
    }

    fn is_running(&self) -> bool {
        let statuses = self.control.roster.statuses();
        let statuses = statuses.borrow();
        let active = |one: &BehaviourStatus| one.state != BehaviourState::Idle;
        self.starting.is_some() || statuses.iter().any(active)
    }

    fn facts(&self) -> Facts {
        let status = *self.control.status.borrow();
        let battery = status.battery;
        Facts {
            connected: status.link == LinkState::Up,
            percent: battery
                .and_then(|battery| battery.percent)
                .map(Percent::get),
            charging: battery.is_some_and(|battery| battery.charging),
            docked: status.docked,
            low: status.low,
            stopped: status.emergency_stop,
            stands: !self.is_running() && !status.owes_stop,
        }
    }

    /// Ends what runs. The robot stands at once, whatever a script says in its last moment.
    async fn end_script(&mut self) {
        if !self.is_running() {
            return;
        }
        // What has not begun to start never does.
        self.starting = None;
        let Ok(mut person) = self.control.pilot_client(CLASS).await else {
            return;
        };
        let _ = person.drive(Setpoint::STOP).await;
        let holding = async {
            loop {
                sleep(ALIVE).await;
                let _ = person.alive().await;
            }
        };
        tokio::select! {
            ended = self.control.end_behaviours(CLASS) => if let Err(error) = ended {
                tracing::warn!("{error}");
            },
            () = holding => {}
        }
    }

    /// Starts a script; a robot on its station leaves it first.
    fn start(&self, start: Start) -> Starting {
        let control = self.control.clone();
        let spec = start.plan.spec(&start.driver, &self.config);
        let ends = Instant::now() + start.lasts;
        Box::pin(async move {
            if control.status.borrow().docked {
                let undock = RunRequest::Undock { seconds: None };
                if let Some(error) = control.perform(undock, CLASS).await.error() {
                    return Err(error);
                }
            }
            let defined = control.roster.define(spec.into_iter().collect()).await;
            defined.map_err(|error| error.to_string())?;
            let lasts = ends.saturating_duration_since(Instant::now());
            let change = control
                .roster
                .change(Change::Start, &start.driver, Some(lasts), CLASS);
            change.await.map_err(|error| error.to_string())
        })
    }
}

/// The result of a start; never returns without one.
async fn started(starting: &mut Option<Starting>) -> Result<(), String> {
    match starting {
        Some(starting) => starting.await,
        None => std::future::pending().await,
    }
}
