//! Represents an agent at its broker: publishes its state whenever it changes, and accepts
//! commands.

use std::time::Duration;

use rand::SeedableRng;
use rand::rngs::StdRng;
use serde_json::Value;
use tokio::time::{Instant, sleep_until, timeout_at};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use super::command::{BrokerCommand, BrokerCommandError, CommandResult};
use super::command_tasks::{CommandTasks, FinishedCommand};
use super::connection::{Account, Connection, ConnectionEvent, Message, QueueFull, Will};
use super::discovery::{EVENTS, discovery};
use super::limited_log::LimitedLog;
use super::presence::Presence;
use super::report::Report;
use super::topics::Topics;
use crate::agent::BehaviourStatus;
use crate::clock::until;
use crate::control::{Next, Run};
use crate::link::{self, Backoff};
use crate::robot::{AgentEvent, BusMessage, Listener, RobotInfo};

/// Changes within this time are published together.
const COALESCE: Duration = Duration::from_millis(100);
/// Timeout for closing the connection.
const CLOSING: Duration = Duration::from_secs(1);
/// How long commands in progress at the end may take.
const RESULTS_TIMEOUT: Duration = Duration::from_millis(500);
/// Maximum length of the name of a chosen behaviour, in bytes.
const LONGEST_CHOICE: usize = 256;
/// After a connection that lasted this long, the next pause is short again.
const STABLE: Duration = Duration::from_secs(60);

pub(super) struct BrokerClient {
    account: Account,
    run: Run,
    listener: Listener,
    report: Report,
    commands: CommandTasks,
    robot: Option<RobotInfo>,
    topics: Topics,
    phase: Phase,
    /// When to publish what has changed.
    due: Option<Instant>,
    /// What was already published on this connection.
    published: Published,
    backoff: Backoff,
    rng: StdRng,
    /// Number of events dropped because the queue was full.
    dropped: u64,
    /// Whether the loss of the connection was logged already.
    loss_logged: bool,
    log: LimitedLog,
}

/// The state of the connection.
enum Phase {
    /// The robot's uid is not known yet.
    NoRobot,
    /// Waiting until this instant to connect again.
    Pause(Instant),
    Connecting(Connection),
    Up(Connection, Instant),
}

/// What was published on this connection.
#[derive(Default)]
struct Published {
    subscribed: bool,
    discovery: Option<Value>,
    presence: bool,
    state: Option<Value>,
}

/// The next thing to handle.
enum Input {
    Stop,
    Bus(BusMessage),
    Changed,
    Finished(FinishedCommand),
    Connection(ConnectionEvent),
    Connect,
    Publish,
}

impl BrokerClient {
    pub(super) fn new(account: Account, run: Run, listener: Listener) -> BrokerClient {
        let topics = topics(&account, "");
        let pauses = link::Options {
            longest_pause: account.options.longest_pause.get(),
            ..link::Options::default()
        };
        BrokerClient {
            account,
            commands: CommandTasks::new(run.clone()),
            run,
            listener,
            report: Report::default(),
            robot: None,
            topics,
            phase: Phase::NoRobot,
            due: None,
            published: Published::default(),
            backoff: Backoff::new(&pauses),
            rng: StdRng::seed_from_u64(rand::random()),
            dropped: 0,
            loss_logged: false,
            log: LimitedLog::new(),
        }
    }

    /// Runs until it is stopped or the agent has ended.
    pub(super) async fn run(mut self, stop: &CancellationToken) {
        let mut status = self.run.status.clone();
        let mut statuses = self.run.roster.statuses();
        let mut view = self.run.view.clone();
        loop {
            let input = tokio::select! {
                biased;
                () = stop.cancelled() => Input::Stop,
                input = next_input(&mut self.phase) => input,
                finished = self.commands.next() => Input::Finished(finished),
                message = self.listener.next() => Input::Bus(message),
                Ok(()) = status.changed() => Input::Changed,
                Ok(()) = statuses.changed() => Input::Changed,
                Ok(()) = view.changed() => Input::Changed,
                () = until(self.due) => Input::Publish,
            };
            match input {
                Input::Stop | Input::Bus(BusMessage::Closed) => break,
                Input::Bus(message) => self.handle_event(message),
                Input::Changed => self.schedule_publish(),
                Input::Finished(finished) => self.answer(finished),
                Input::Connection(event) => self.handle_connection(event),
                Input::Connect => self.connect(),
                Input::Publish => self.publish(),
            }
        }
        self.shut_down().await;
    }

    fn handle_event(&mut self, message: BusMessage) {
        match message {
            BusMessage::Event(one) => {
                self.report.record_event(&one.what);
                if let AgentEvent::LinkUp { robot, .. } = &one.what {
                    self.adopt_robot(robot.clone());
                }
                self.announce(&one.what);
            }
            BusMessage::Missed(missed) => warn!(missed, "events were dropped, not sent"),
            BusMessage::Closed => {}
        }
        self.schedule_publish();
    }

    /// Takes over the identity of the robot, whose uid is the agent's name at the broker.
    fn adopt_robot(&mut self, robot: RobotInfo) {
        let another = self.robot.as_ref().map(|known| &known.uid) != Some(&robot.uid);
        if another {
            // Breaks the connection in another robot's name: the broker publishes its will.
            self.topics = topics(&self.account, &robot.uid);
            self.phase = Phase::Pause(Instant::now());
            self.published = Published::default();
        }
        self.robot = Some(robot);
    }

    fn connect(&mut self) {
        let will = Will {
            topic: self.topics.connection(),
            payload: Presence::ConnectionBroken.word(),
        };
        // The same client ID each time: a broker that still holds our old connection closes it, and
        // publishes its will, before it accepts the new one.
        let client = format!("spykee-{}", self.topics.id);
        self.published = Published::default();
        self.phase = Phase::Connecting(Connection::connect(&self.account, &client, Some(will)));
    }

    fn handle_connection(&mut self, event: ConnectionEvent) {
        match event {
            ConnectionEvent::Up => {
                if let Phase::Connecting(open) = std::mem::replace(&mut self.phase, Phase::NoRobot)
                {
                    info!("{} is connected to the broker", self.topics.id);
                    self.phase = Phase::Up(open, Instant::now());
                    self.loss_logged = false;
                    self.due = Some(Instant::now());
                }
            }
            ConnectionEvent::Lost(why) => self.connection_lost(&why),
            ConnectionEvent::Message(message) => self.handle_message(&message),
            ConnectionEvent::Subscribed | ConnectionEvent::Acknowledged => {}
        }
    }

    fn connection_lost(&mut self, why: &str) {
        if matches!(&self.phase, Phase::Up(_, since) if since.elapsed() > STABLE) {
            self.backoff.reset();
        }
        if !self.loss_logged {
            self.loss_logged = true;
            let (host, port) = self.account.options.address().unwrap_or_default();
            warn!("no broker at {host}:{port}: {why}; retrying");
        }
        let pause = self.backoff.next(&mut self.rng);
        self.phase = Phase::Pause(Instant::now() + pause);
    }

    /// Something may have changed: schedules publishing it soon.
    fn schedule_publish(&mut self) {
        let soon = Instant::now() + COALESCE;
        self.due.get_or_insert(soon);
    }

    /// Publishes what the broker does not know yet, in order; the rest later if the queue is full.
    fn publish(&mut self) {
        self.due = None;
        if self.try_publish() == Err(QueueFull) {
            self.schedule_publish();
        }
    }

    fn try_publish(&mut self) -> Result<(), QueueFull> {
        let (Phase::Up(connection, _), Some(robot)) = (&self.phase, &self.robot) else {
            return Ok(());
        };
        let topics = &self.topics;
        let published = &mut self.published;
        if !published.subscribed {
            for topic in [topics.command(), topics.behaviour(), topics.birth()] {
                connection.subscribe(&topic)?;
            }
            published.subscribed = true;
        }
        let statuses = self.run.roster.statuses().borrow().clone();
        let names: Vec<String> = statuses.iter().map(|one| one.name.clone()).collect();
        let entities = discovery(topics, robot, &names);
        if published.discovery.as_ref() != Some(&entities) {
            connection.retain(&topics.discovery(), entities.to_string().into_bytes())?;
            published.discovery = Some(entities);
        }
        let next = Next::from_view(&self.run.view.borrow());
        let state = self
            .report
            .state(&self.run.status.borrow(), &statuses, next.as_ref());
        if published.state.as_ref() != Some(&state) {
            connection.retain(&topics.state(), state.to_string().into_bytes())?;
            published.state = Some(state);
        }
        if !published.presence {
            connection.retain(&topics.connection(), Presence::Online.word().into())?;
            published.presence = true;
        }
        Ok(())
    }

    /// Publishes an event for Home Assistant's event entity and other subscribers.
    fn announce(&mut self, what: &AgentEvent) {
        let Phase::Up(connection, _) = &self.phase else {
            return;
        };
        if !EVENTS.contains(&what.kind()) {
            return;
        }
        let Ok(mut event) = serde_json::to_value(what) else {
            return;
        };
        event["event_type"] = what.kind().into();
        if connection.publish(&self.topics.event(), event.to_string().into()) == Err(QueueFull) {
            self.dropped += 1;
            debug!(
                dropped = self.dropped,
                "the broker is slow: an event was dropped"
            );
        }
    }

    fn handle_message(&mut self, message: &Message) {
        if message.topic == self.topics.birth() {
            if &message.payload[..] == b"online" {
                // Home Assistant has just started and knows nothing yet.
                self.published = Published {
                    subscribed: true,
                    ..Published::default()
                };
                self.schedule_publish();
            }
            return;
        }
        let read = if message.topic == self.topics.command() {
            BrokerCommand::parse(&message.payload)
        } else if message.topic == self.topics.behaviour() {
            choice(&message.payload).map(|command| (command, None))
        } else {
            // A broker may send anything; we did not subscribe to this topic.
            return;
        };
        if message.retained {
            let topic = &message.topic;
            return self.log.warn(&format!(
                "a retained command is ignored, because it may be old: {topic}"
            ));
        }
        let (command, id) = match read {
            Ok(read) => read,
            Err(error) => {
                let line = format!("invalid command from the broker: {error}");
                return self.log.warn(&line);
            }
        };
        self.log
            .info(&format!("a person's command from the broker: {command}"));
        let statuses = self.statuses();
        if let BrokerCommand::Choose(name) = &command {
            if !self.report.choose(name, &statuses) {
                self.log.warn(&format!("no behaviour is called `{name}`"));
            }
            return self.schedule_publish();
        }
        let chosen = self.report.chosen(&statuses);
        self.commands.begin(command, id, chosen);
    }

    fn answer(&mut self, FinishedCommand { answer, picture }: FinishedCommand) {
        let CommandResult { command, text, .. } = &answer;
        if !answer.done {
            let why = text.as_deref().unwrap_or_default();
            let line = format!("the command `{command}` from the broker was not executed: {why}");
            self.log.warn(&line);
        }
        let Phase::Up(connection, _) = &self.phase else {
            return;
        };
        let text = serde_json::to_vec(&answer).unwrap_or_default();
        let sent = connection.publish(&self.topics.answer(), text);
        let shown = picture.map(|jpeg| connection.publish(&self.topics.picture(), jpeg));
        if sent == Err(QueueFull) || shown == Some(Err(QueueFull)) {
            debug!("the broker is slow: an answer was dropped");
        }
    }

    fn statuses(&self) -> Vec<BehaviourStatus> {
        self.run.roster.statuses().borrow().clone()
    }

    /// Publishes the last events and the offline state, then disconnects.
    async fn shut_down(mut self) {
        // A stop command may have caused this end; its answer is still sent.
        let deadline = Instant::now() + RESULTS_TIMEOUT;
        self.commands.cancel_driving();
        while !self.commands.is_empty() {
            match timeout_at(deadline, self.commands.next()).await {
                Ok(finished) => self.answer(finished),
                Err(_) => break,
            }
        }
        while let Some(BusMessage::Event(one)) = self.listener.try_next() {
            self.report.record_event(&one.what);
            self.announce(&one.what);
        }
        let _ = self.try_publish();
        let topic = self.topics.connection();
        if let Phase::Up(open, _) = self.phase
            && open.retain(&topic, Presence::Offline.word().into()).is_ok()
        {
            open.close(CLOSING).await;
        }
    }
}

fn topics(account: &Account, uid: &str) -> Topics {
    let options = &account.options;
    Topics::new(&options.prefix, &options.discovery_prefix, uid)
}

/// Parses the name of a chosen behaviour.
fn choice(payload: &[u8]) -> Result<BrokerCommand, BrokerCommandError> {
    if payload.len() > LONGEST_CHOICE {
        return Err(BrokerCommandError::TooLong);
    }
    let name = std::str::from_utf8(payload).map_err(|_| BrokerCommandError::NoText)?;
    Ok(BrokerCommand::Choose(name.trim().to_owned()))
}

/// Waits for a message of the connection, or for the time to connect. Cancel-safe.
async fn next_input(phase: &mut Phase) -> Input {
    match phase {
        Phase::Connecting(open) | Phase::Up(open, _) => Input::Connection(open.next().await),
        Phase::Pause(until) => {
            sleep_until(*until).await;
            Input::Connect
        }
        Phase::NoRobot => std::future::pending().await,
    }
}
