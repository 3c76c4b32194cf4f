//! Represents an agent at its broker: publishes its state whenever it changes, and accepts orders.

use std::time::Duration;

use rand::SeedableRng;
use rand::rngs::StdRng;
use serde_json::Value;
use tokio::time::{Instant, sleep_until, timeout_at};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use super::command::{Answer, BrokerCommand, BrokerCommandError};
use super::discovery::{EVENTS, discovery};
use super::errands::{Errands, Over};
use super::line::{Account, Full, Line, Message, Will, Word};
use super::presence::Presence;
use super::report::Report;
use super::scribe::Scribe;
use super::topics::Topics;
use crate::agent::Member;
use crate::clock::until;
use crate::control::{Next, Run};
use crate::link::{self, Backoff};
use crate::robot::{Heard, Listener, Occurrence, RobotInfo};

/// Changes within this time are published together.
const GATHER: Duration = Duration::from_millis(100);
/// Timeout for closing the connection.
const GOODBYE: Duration = Duration::from_secs(1);
/// How long orders in progress at the end may take.
const ANSWERS: Duration = Duration::from_millis(500);
/// Maximum length of the name of a chosen behaviour, in bytes.
const LONGEST_CHOICE: usize = 256;
/// After a connection that lasted this long, the next pause is short again.
const GOOD: Duration = Duration::from_secs(60);

pub(super) struct Envoy {
    account: Account,
    run: Run,
    listener: Listener,
    report: Report,
    errands: Errands,
    robot: Option<RobotInfo>,
    topics: Topics,
    side: Side,
    /// When to publish what has changed.
    due: Option<Instant>,
    /// What was already published on this connection.
    told: Published,
    backoff: Backoff,
    rng: StdRng,
    /// Number of events dropped because the queue was full.
    dropped: u64,
    /// Whether the loss of the connection was logged already.
    complained: bool,
    scribe: Scribe,
}

/// The state of the connection.
enum Side {
    /// The robot's uid is not known yet.
    Nameless,
    /// Waiting until this instant to connect again.
    Pause(Instant),
    Dialing(Line),
    Up(Line, Instant),
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
enum Turn {
    Stop,
    Heard(Heard),
    Changed,
    Over(Over),
    Line(Word),
    Dial,
    Tell,
}

impl Envoy {
    pub(super) fn new(account: Account, run: Run, listener: Listener) -> Envoy {
        let topics = topics(&account, "");
        let pauses = link::Options {
            longest_pause: account.options.longest_pause.get(),
            ..link::Options::default()
        };
        Envoy {
            account,
            errands: Errands::new(run.clone()),
            run,
            listener,
            report: Report::default(),
            robot: None,
            topics,
            side: Side::Nameless,
            due: None,
            told: Published::default(),
            backoff: Backoff::new(&pauses),
            rng: StdRng::seed_from_u64(rand::random()),
            dropped: 0,
            complained: false,
            scribe: Scribe::new(),
        }
    }

    /// Runs until it is stopped or the agent has ended.
    pub(super) async fn live(mut self, stop: &CancellationToken) {
        let mut status = self.run.status.clone();
        let mut members = self.run.roster.members();
        let mut view = self.run.view.clone();
        loop {
            let turn = tokio::select! {
                biased;
                () = stop.cancelled() => Turn::Stop,
                turn = turn(&mut self.side) => turn,
                over = self.errands.next() => Turn::Over(over),
                heard = self.listener.next() => Turn::Heard(heard),
                Ok(()) = status.changed() => Turn::Changed,
                Ok(()) = members.changed() => Turn::Changed,
                Ok(()) = view.changed() => Turn::Changed,
                () = until(self.due) => Turn::Tell,
            };
            match turn {
                Turn::Stop | Turn::Heard(Heard::Closed) => break,
                Turn::Heard(heard) => self.hear(heard),
                Turn::Changed => self.touch(),
                Turn::Over(over) => self.answer(over),
                Turn::Line(word) => self.take(word),
                Turn::Dial => self.dial(),
                Turn::Tell => self.tell(),
            }
        }
        self.part().await;
    }

    fn hear(&mut self, heard: Heard) {
        match heard {
            Heard::Happening(one) => {
                self.report.hear(&one.what);
                if let Occurrence::LinkUp { robot, .. } = &one.what {
                    self.meet(robot.clone());
                }
                self.announce(&one.what);
            }
            Heard::Missed(missed) => warn!(missed, "events were dropped, not sent"),
            Heard::Closed => {}
        }
        self.touch();
    }

    /// Takes over the identity of the robot, whose uid is the agent's name at the broker.
    fn meet(&mut self, robot: RobotInfo) {
        let another = self.robot.as_ref().map(|known| &known.uid) != Some(&robot.uid);
        if another {
            // Breaks the connection in another robot's name: the broker publishes its will.
            self.topics = topics(&self.account, &robot.uid);
            self.side = Side::Pause(Instant::now());
            self.told = Published::default();
        }
        self.robot = Some(robot);
    }

    fn dial(&mut self) {
        let will = Will {
            topic: self.topics.connection(),
            payload: Presence::ConnectionBroken.word(),
        };
        // The same client ID each time: a broker that still holds our old connection closes it, and
        // publishes its will, before it accepts the new one.
        let client = format!("spykee-{}", self.topics.id);
        self.told = Published::default();
        self.side = Side::Dialing(Line::dial(&self.account, &client, Some(will)));
    }

    fn take(&mut self, word: Word) {
        match word {
            Word::Up => {
                if let Side::Dialing(line) = std::mem::replace(&mut self.side, Side::Nameless) {
                    info!("{} is connected to the broker", self.topics.id);
                    self.side = Side::Up(line, Instant::now());
                    self.complained = false;
                    self.due = Some(Instant::now());
                }
            }
            Word::Lost(why) => self.lose(&why),
            Word::Message(message) => self.obey(&message),
            Word::Subscribed | Word::Acknowledged => {}
        }
    }

    fn lose(&mut self, why: &str) {
        if matches!(&self.side, Side::Up(_, since) if since.elapsed() > GOOD) {
            self.backoff.reset();
        }
        if !self.complained {
            self.complained = true;
            let (host, port) = self.account.options.address().unwrap_or_default();
            warn!("no broker at {host}:{port}: {why}; retrying");
        }
        let pause = self.backoff.next(&mut self.rng);
        self.side = Side::Pause(Instant::now() + pause);
    }

    /// Something may have changed: schedules publishing it soon.
    fn touch(&mut self) {
        let soon = Instant::now() + GATHER;
        self.due.get_or_insert(soon);
    }

    /// Publishes what the broker does not know yet, in order; the rest later if the queue is full.
    fn tell(&mut self) {
        self.due = None;
        if self.try_tell() == Err(Full) {
            self.touch();
        }
    }

    fn try_tell(&mut self) -> Result<(), Full> {
        let (Side::Up(line, _), Some(robot)) = (&self.side, &self.robot) else {
            return Ok(());
        };
        let (topics, told) = (&self.topics, &mut self.told);
        if !told.subscribed {
            for topic in [topics.command(), topics.behaviour(), topics.birth()] {
                line.subscribe(&topic)?;
            }
            told.subscribed = true;
        }
        let members = self.run.roster.members().borrow().clone();
        let names: Vec<String> = members.iter().map(|one| one.name.clone()).collect();
        let entities = discovery(topics, robot, &names);
        if told.discovery.as_ref() != Some(&entities) {
            line.keep(&topics.discovery(), entities.to_string().into_bytes())?;
            told.discovery = Some(entities);
        }
        let next = Next::of(&self.run.view.borrow());
        let state = self
            .report
            .state(&self.run.status.borrow(), &members, next.as_ref());
        if told.state.as_ref() != Some(&state) {
            line.keep(&topics.state(), state.to_string().into_bytes())?;
            told.state = Some(state);
        }
        if !told.presence {
            line.keep(&topics.connection(), Presence::Online.word().into())?;
            told.presence = true;
        }
        Ok(())
    }

    /// Publishes an event for Home Assistant's event entity and other subscribers.
    fn announce(&mut self, what: &Occurrence) {
        let Side::Up(line, _) = &self.side else {
            return;
        };
        if !EVENTS.contains(&what.kind()) {
            return;
        }
        let Ok(mut event) = serde_json::to_value(what) else {
            return;
        };
        event["event_type"] = what.kind().into();
        if line.say(&self.topics.event(), event.to_string().into()) == Err(Full) {
            self.dropped += 1;
            debug!(
                dropped = self.dropped,
                "the broker is slow: an event was dropped"
            );
        }
    }

    fn obey(&mut self, message: &Message) {
        if message.topic == self.topics.birth() {
            if &message.payload[..] == b"online" {
                // Home Assistant has just started and knows nothing yet.
                self.told = Published {
                    subscribed: true,
                    ..Published::default()
                };
                self.touch();
            }
            return;
        }
        let read = if message.topic == self.topics.command() {
            BrokerCommand::parse(&message.payload)
        } else if message.topic == self.topics.behaviour() {
            choice(&message.payload).map(|order| (order, None))
        } else {
            // A broker may send anything; we did not subscribe to this topic.
            return;
        };
        if message.retained {
            let topic = &message.topic;
            return self.scribe.warn(&format!(
                "a retained order is ignored, because it may be old: {topic}"
            ));
        }
        let (order, id) = match read {
            Ok(read) => read,
            Err(error) => {
                let line = format!("invalid order from the broker: {error}");
                return self.scribe.warn(&line);
            }
        };
        self.scribe
            .info(&format!("a person's order from the broker: {order}"));
        let members = self.members();
        if let BrokerCommand::Choose(name) = &order {
            if !self.report.choose(name, &members) {
                self.scribe
                    .warn(&format!("no behaviour is called `{name}`"));
            }
            return self.touch();
        }
        let chosen = self.report.chosen(&members);
        self.errands.begin(order, id, chosen);
    }

    fn answer(&mut self, Over { answer, picture }: Over) {
        let Answer { order, text, .. } = &answer;
        if !answer.done {
            let why = text.as_deref().unwrap_or_default();
            let line = format!("the order `{order}` from the broker was not executed: {why}");
            self.scribe.warn(&line);
        }
        let Side::Up(line, _) = &self.side else {
            return;
        };
        let text = serde_json::to_vec(&answer).unwrap_or_default();
        let said = line.say(&self.topics.answer(), text);
        let shown = picture.map(|jpeg| line.say(&self.topics.picture(), jpeg));
        if said == Err(Full) || shown == Some(Err(Full)) {
            debug!("the broker is slow: an answer was dropped");
        }
    }

    fn members(&self) -> Vec<Member> {
        self.run.roster.members().borrow().clone()
    }

    /// Publishes the last events and the offline state, then disconnects.
    async fn part(mut self) {
        // A stop order may have caused this end; its answer is still sent.
        let deadline = Instant::now() + ANSWERS;
        self.errands.give_up_driving();
        while !self.errands.is_empty() {
            match timeout_at(deadline, self.errands.next()).await {
                Ok(over) => self.answer(over),
                Err(_) => break,
            }
        }
        while let Some(Heard::Happening(one)) = self.listener.try_next() {
            self.report.hear(&one.what);
            self.announce(&one.what);
        }
        let _ = self.try_tell();
        let topic = self.topics.connection();
        if let Side::Up(line, _) = self.side
            && line.keep(&topic, Presence::Offline.word().into()).is_ok()
        {
            line.close(GOODBYE).await;
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
async fn turn(side: &mut Side) -> Turn {
    match side {
        Side::Dialing(line) | Side::Up(line, _) => Turn::Line(line.next().await),
        Side::Pause(until) => {
            sleep_until(*until).await;
            Turn::Dial
        }
        Side::Nameless => std::future::pending().await,
    }
}
