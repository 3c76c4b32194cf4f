//! Represents an agent at its broker: publishes its state whenever it changes, and accepts
//! commands.

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;
use std::time::Duration;

use rand::SeedableRng;
use rand::rngs::StdRng;
use rumqttc::Publish;
use tokio::task::{AbortHandle, JoinSet};
use tokio::time::{Instant, sleep_until, timeout_at};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use super::command::{BrokerCommand, CommandResult, parse_choice};
use super::connection::{Account, Connection, ConnectionEvent, QueueFull};
use super::discovery::{EVENTS, discovery};
use super::report::Report;
use super::topics::{Presence, Topics};
use crate::agent::BehaviourStatus;
use crate::clock::until;
use crate::control::{Run, RunRequest, RunResponse};
use crate::files;
use crate::rate_limit::{Backoff, TokenBucket};
use crate::robot::{AgentEvent, Bus, BusMessage, Listener, RobotInfo};
use crate::side_thread::SideThread;

/// Changes within this time are published together.
const COALESCE: Duration = Duration::from_millis(100);
const CLOSING: Duration = Duration::from_secs(1);
/// How long commands in progress at the end may take.
const RESULTS_TIMEOUT: Duration = Duration::from_millis(500);
/// Pauses between two attempts to connect grow from the first to the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);
/// After a connection that lasted this long, the next pause is short again.
const STABLE: Duration = Duration::from_secs(60);

pub(super) struct BrokerClient {
    account: Account,
    run: Run,
    listener: Listener,
    report: Report,
    /// The commands in progress: each in a separate task, a limited number at a time, dockings one after
    /// the other.
    commands: JoinSet<(BrokerCommand, RunResponse)>,
    /// The command that drives the robot.
    driving: Option<AbortHandle>,
    /// Pictures of alarms that are being read from the disk.
    alarms: JoinSet<Option<Vec<u8>>>,
    robot: Option<RobotInfo>,
    topics: Topics,
    phase: Phase,
    /// When to publish what has changed.
    due: Option<Instant>,
    subscribed: bool,
    /// What the broker keeps for others, by topic, as published on this connection.
    retained: BTreeMap<String, Vec<u8>>,
    backoff: Backoff,
    rng: StdRng,
    /// Number of events dropped because the queue was full.
    dropped: u64,
    loss_logged: bool,
    log: LimitedLog,
}

enum Phase {
    /// The robot's uid is not known yet.
    NoRobot,
    /// Waiting until this instant to connect again.
    Pause(Instant),
    Connecting(Connection),
    Up(Connection, Instant),
}

impl BrokerClient {
    pub(super) fn new(account: Account, run: Run, listener: Listener) -> BrokerClient {
        BrokerClient {
            account,
            commands: JoinSet::new(),
            driving: None,
            alarms: JoinSet::new(),
            run,
            listener,
            report: Report::default(),
            robot: None,
            topics: Topics::new(""),
            phase: Phase::NoRobot,
            due: None,
            subscribed: false,
            retained: BTreeMap::new(),
            backoff: Backoff::new(FIRST_PAUSE, LONGEST_PAUSE),
            rng: StdRng::seed_from_u64(rand::random()),
            dropped: 0,
            loss_logged: false,
            log: LimitedLog::new(),
        }
    }

    pub(super) async fn run(mut self, stop: &CancellationToken) {
        let mut status = self.run.status.clone();
        let mut statuses = self.run.roster.statuses();
        let mut view = self.run.view.clone();
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => break,
                event = next_event(&mut self.phase) => match event {
                    Some(event) => self.handle_connection(event),
                    None => self.connect(),
                },
                (command, response) = next_finished(&mut self.commands) => {
                    self.answer(command, response);
                }
                Some(read) = self.alarms.join_next() => self.show_alarm(read.ok().flatten()),
                message = self.listener.next() => match message {
                    Some(BusMessage::Event(one)) => self.handle_event(&one.what),
                    Some(BusMessage::Missed(missed)) => {
                        warn!(missed, "events were dropped, not sent");
                    }
                    None => break,
                },
                Ok(()) = status.changed() => self.schedule_publish(),
                Ok(()) = statuses.changed() => self.schedule_publish(),
                Ok(()) = view.changed() => self.schedule_publish(),
                () = until(self.due) => self.publish(),
            }
        }
        self.shut_down().await;
    }

    fn handle_event(&mut self, what: &AgentEvent) {
        self.report.record_event(what);
        match what {
            AgentEvent::LinkUp { robot, .. } => self.adopt_robot(robot.clone()),
            AgentEvent::Notify {
                picture: Some(path),
                ..
            } => self.read_alarm(path.clone()),
            _ => {}
        }
        self.announce(what);
        self.schedule_publish();
    }

    /// Has the picture that a script sends to people read, unless the disk is slow.
    fn read_alarm(&mut self, path: PathBuf) {
        if self.alarms.len() < MAX_ALARMS {
            self.alarms
                .spawn_blocking(move || files::read_jpeg(&path, LARGEST_PICTURE));
        }
    }

    /// The broker keeps it: whoever looks later sees the last alarm.
    fn show_alarm(&mut self, jpeg: Option<Vec<u8>>) {
        let Phase::Up(connection, _) = &self.phase else {
            return;
        };
        if jpeg.is_some_and(|jpeg| {
            connection
                .retain(&self.topics.named("alarm"), jpeg)
                .is_err()
        }) {
            debug!("the broker is slow: the picture of an alarm was dropped");
        }
    }

    /// Takes over the identity of the robot, whose uid is the agent's name at the broker.
    fn adopt_robot(&mut self, robot: RobotInfo) {
        let another = self.robot.as_ref().map(|known| &known.uid) != Some(&robot.uid);
        if another {
            // Breaks the connection in another robot's name: the broker publishes its will.
            self.topics = Topics::new(&robot.uid);
            self.phase = Phase::Pause(Instant::now());
        }
        self.robot = Some(robot);
    }

    fn connect(&mut self) {
        // The same client ID each time: a broker that still holds our old connection closes it, and
        // publishes its will, before it accepts the new one.
        let client = format!("spykee-{}", self.topics.id);
        self.subscribed = false;
        self.retained.clear();
        self.phase = Phase::Connecting(Connection::connect(
            &self.account,
            &client,
            Some(self.topics.named("connection")),
        ));
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
        let statuses = self.statuses();
        self.report.observe(&self.run.status.borrow(), &statuses);
        if self.try_publish() == Err(QueueFull) {
            self.schedule_publish();
        }
    }

    fn try_publish(&mut self) -> Result<(), QueueFull> {
        let (Phase::Up(connection, _), Some(robot)) = (&self.phase, &self.robot) else {
            return Ok(());
        };
        let topics = &self.topics;
        if !self.subscribed {
            for topic in [
                topics.named("command"),
                topics.named("behaviour/set"),
                topics.birth(),
            ] {
                connection.subscribe(&topic)?;
            }
            self.subscribed = true;
        }
        let statuses = self.statuses();
        let names: Vec<String> = statuses.iter().map(|one| one.name.clone()).collect();
        let status = *self.run.status.borrow();
        let state = self
            .report
            .state(&status, &statuses, &self.run.view.borrow());
        let page = self.account.page.as_deref();
        for (topic, payload) in [
            (
                topics.discovery(),
                discovery(topics, robot, &names, page).to_string(),
            ),
            (topics.named("state"), state.to_string()),
            (
                topics.named("connection"),
                Presence::Online.name().to_owned(),
            ),
        ] {
            let payload = payload.into_bytes();
            if self.retained.get(&topic) != Some(&payload) {
                connection.retain(&topic, payload.clone())?;
                self.retained.insert(topic, payload);
            }
        }
        Ok(())
    }

    fn announce(&mut self, what: &AgentEvent) {
        let Phase::Up(connection, _) = &self.phase else {
            return;
        };
        let mut event = serde_json::to_value(what).unwrap_or_default();
        let kind = event["event"].clone();
        if !EVENTS.iter().any(|one| kind == *one) {
            return;
        }
        event["event_type"] = kind;
        if connection.publish(&self.topics.named("event"), event.to_string().into())
            == Err(QueueFull)
        {
            self.dropped += 1;
            debug!(
                dropped = self.dropped,
                "the broker is slow: an event was dropped"
            );
        }
    }

    fn handle_message(&mut self, message: &Publish) {
        if message.topic == self.topics.birth() {
            if &message.payload[..] == b"online" {
                // Home Assistant has just started and knows nothing yet.
                self.retained.clear();
                self.schedule_publish();
            }
            return;
        }
        let is_choice = message.topic == self.topics.named("behaviour/set");
        if !is_choice && message.topic != self.topics.named("command") {
            // A broker may send anything; we did not subscribe to this topic.
            return;
        }
        // A choice moves nothing, however old it is: the broker keeps it for the next run.
        if message.retain && !is_choice {
            let topic = &message.topic;
            self.log.warn(&format!(
                "a retained command is ignored, because it may be old: {topic}"
            ));
            return;
        }
        let handled = if is_choice {
            self.choose(&message.payload)
        } else {
            self.begin(&message.payload)
        };
        if let Err(error) = handled {
            let line = format!("invalid command from the broker: {error}");
            if self.log.warn(&line) {
                self.refuse(&message.payload, error);
            }
        }
    }

    /// Answers what is no command.
    fn refuse(&mut self, payload: &[u8], error: String) {
        let words = String::from_utf8_lossy(payload);
        let command = BrokerCommand {
            command: words.chars().take(LONGEST_QUOTE).collect(),
            id: None,
        };
        let response = RunResponse::Refused { error };
        self.publish_answer(&CommandResult::new(command, &response), response);
    }

    fn choose(&mut self, payload: &[u8]) -> Result<(), String> {
        let name = parse_choice(payload)?;
        let line = format!("a person's command from the broker: choose {name}");
        self.log.info(&line);
        if !self.report.choose(name, &self.statuses()) {
            self.log.warn(&format!("no behaviour is called `{name}`"));
        }
        self.schedule_publish();
        Ok(())
    }

    fn begin(&mut self, payload: &[u8]) -> Result<(), String> {
        let command = BrokerCommand::parse(payload)?;
        let words = &command.command;
        let line = format!("a person's command from the broker: {words}");
        self.log.info(&line);
        let always = self.run.view.borrow().always.clone();
        let request = match self.report.chosen(&self.statuses(), &always) {
            None if words == "start" => Err("there is no behaviour to start".to_owned()),
            chosen => command.request(&chosen.unwrap_or_default()),
        };
        self.perform(command, request);
        Ok(())
    }

    fn perform(&mut self, command: BrokerCommand, request: Result<RunRequest, String>) {
        let drives = matches!(
            request,
            Ok(RunRequest::Dock { .. } | RunRequest::Undock { .. })
        );
        let stops = matches!(request, Ok(RunRequest::Stop | RunRequest::ResetStop));
        if drives || request == Ok(RunRequest::Stop) {
            // Cancel the previous docking or undocking: the pilot then ends it.
            self.cancel_driving();
        }
        if self.commands.len() >= MAX_STOPS {
            return;
        }
        let full = self.commands.len() >= MAX_TASKS && !stops;
        let run = self.run.clone();
        let task = self.commands.spawn(async move {
            let request = if full {
                Err("too many commands at once".to_owned())
            } else {
                request
            };
            let response = match request {
                Ok(request) => perform(&run, request).await,
                Err(error) => RunResponse::Refused { error },
            };
            (command, response)
        });
        if drives && !full {
            self.driving = Some(task);
        }
    }

    fn cancel_driving(&mut self) {
        if let Some(last) = self.driving.take() {
            last.abort();
        }
    }

    fn answer(&mut self, command: BrokerCommand, response: RunResponse) {
        let result = CommandResult::new(command, &response);
        if !result.done {
            let why = result.text.as_deref().unwrap_or_default();
            let command = &result.command.command;
            let line = format!("the command `{command}` from the broker was not executed: {why}");
            self.log.warn(&line);
        }
        self.publish_answer(&result, response);
    }

    fn publish_answer(&mut self, result: &CommandResult, response: RunResponse) {
        let Phase::Up(connection, _) = &self.phase else {
            return;
        };
        let text = serde_json::to_vec(result).unwrap_or_default();
        let mut sent = connection.publish(&self.topics.named("answer"), text);
        if let RunResponse::Picture { jpeg } = response {
            sent = sent.and(connection.publish(&self.topics.named("picture"), jpeg));
        }
        if sent == Err(QueueFull) {
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
        self.cancel_driving();
        while !self.commands.is_empty() {
            match timeout_at(deadline, next_finished(&mut self.commands)).await {
                Ok((command, response)) => self.answer(command, response),
                Err(_) => break,
            }
        }
        while let Some(BusMessage::Event(one)) = self.listener.try_next() {
            self.report.record_event(&one.what);
            self.announce(&one.what);
        }
        let _ = self.try_publish();
        let topic = self.topics.named("connection");
        if let Phase::Up(open, _) = self.phase
            && open.retain(&topic, Presence::Offline.name().into()).is_ok()
        {
            open.close(CLOSING).await;
        }
    }
}

/// The next event of the connection; `None` when it is time to connect. Cancel-safe.
async fn next_event(phase: &mut Phase) -> Option<ConnectionEvent> {
    match phase {
        Phase::Connecting(open) | Phase::Up(open, _) => Some(open.next().await),
        Phase::Pause(until) => {
            sleep_until(*until).await;
            None
        }
        Phase::NoRobot => std::future::pending().await,
    }
}

const PER_DAY: u64 = 1 << 20;
/// Bytes of time and level before a line.
const PREFIX: usize = 40;

/// Logs what clients of the broker cause, within a daily budget: any client can send endless
/// commands, which must not fill the disk.
#[derive(Debug)]
struct LimitedLog(TokenBucket);

impl LimitedLog {
    fn new() -> LimitedLog {
        LimitedLog(TokenBucket::a_day(PER_DAY))
    }

    fn info(&mut self, line: &str) {
        if let Some(dropped) = self.take(line, Instant::now()) {
            info!("{line}{dropped}");
        }
    }

    /// Returns whether there was room for the line.
    fn warn(&mut self, line: &str) -> bool {
        let dropped = self.take(line, Instant::now());
        if let Some(dropped) = &dropped {
            warn!("{line}{dropped}");
        }
        dropped.is_some()
    }

    /// Returns `None` if the line must be dropped; otherwise a remark about dropped lines, to be
    /// appended, which may be empty.
    fn take(&mut self, line: &str, now: Instant) -> Option<String> {
        match self.0.take_counted((line.len() + PREFIX) as f64, now)? {
            0 => Some(String::new()),
            dropped => Some(format!(
                " ({dropped} lines about the broker's messages were dropped)"
            )),
        }
    }
}

/// Publishes the bus's events from now on at this broker, and passes commands from there to the run.
/// Connects once the robot's uid is known, and reconnects whenever the connection is lost. The
/// thread's end publishes the last messages. Does not wait for the network.
pub fn start(bus: &Bus, run: Run, account: Account) -> io::Result<SideThread> {
    let listener = bus.subscribe();
    SideThread::start("mqtt", |stop| async move {
        BrokerClient::new(account, run, listener).run(&stop).await;
    })
}

/// Maximum number of commands in progress; further ones are refused, except stops.
const MAX_TASKS: usize = 8;
/// Maximum number of commands in progress including stops; another stop would change nothing.
const MAX_STOPS: usize = 32;
/// Maximum number of pictures that are read at a time, and their largest size in bytes.
const MAX_ALARMS: usize = 2;
const LARGEST_PICTURE: u64 = 1 << 20;
/// How much of an invalid command its answer repeats, in characters.
const LONGEST_QUOTE: usize = 40;

/// Waits for the next finished command; never returns if none is in progress. Cancel-safe.
async fn next_finished(
    commands: &mut JoinSet<(BrokerCommand, RunResponse)>,
) -> (BrokerCommand, RunResponse) {
    loop {
        match commands.join_next().await {
            Some(Ok(finished)) => return finished,
            // Cancelled in favour of a newer one.
            Some(Err(_)) => {}
            None => std::future::pending().await,
        }
    }
}

/// Who commands, in the journal; the protocol does not name the client.
const BROKER: &str = "the MQTT broker";

async fn perform(run: &Run, request: RunRequest) -> RunResponse {
    let response = run.perform(request, BROKER).await;
    // A stop also ends all behaviours.
    if let RunResponse::Stopped { outcome, .. } = &response
        && let Err(why) = run.end_behaviours(BROKER).await
    {
        let error = format!("{outcome}; but {why}");
        return RunResponse::Refused { error };
    }
    response
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_flood_is_limited_and_counted_and_later_lines_are_written() {
        let mut log = LimitedLog::new();
        let mut now = Instant::now();
        let line = "x".repeat(100);
        let written = std::iter::repeat_with(|| log.take(&line, now))
            .take(10_000)
            .flatten();
        assert!((100..1000).contains(&written.count()));
        now += Duration::from_secs(3600);
        let remark = log.take(&line, now).unwrap();
        assert!(
            remark.contains("lines about the broker's messages"),
            "{remark}"
        );
        assert_eq!(log.take(&line, now).as_deref(), Some(""));
    }
}
