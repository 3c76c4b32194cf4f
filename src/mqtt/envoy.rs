//! Speaks for an agent at its broker: says how things stand whenever that changes, and takes orders.

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

/// Changes within this time are told together.
const GATHER: Duration = Duration::from_millis(100);
/// How long the last words may take.
const GOODBYE: Duration = Duration::from_secs(1);
/// How long orders may take that are under way at the end.
const ANSWERS: Duration = Duration::from_millis(500);
/// The longest name of a behaviour that can be chosen, in bytes.
const LONGEST_CHOICE: usize = 256;
/// A connection that lived so long was a good one: the next pause is short.
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
    /// When what has changed is told.
    due: Option<Instant>,
    /// Said by the broker already, on this line.
    told: Published,
    backoff: Backoff,
    rng: StdRng,
    /// Events that found no room.
    dropped: u64,
    /// What the last break was, so that it is logged once.
    complained: bool,
    scribe: Scribe,
}

/// How it is with the line.
enum Side {
    /// The robot has not said who it is.
    Nameless,
    /// Until then.
    Pause(Instant),
    Dialing(Line),
    Up(Line, Instant),
}

/// What the broker knows on this line.
#[derive(Default)]
struct Published {
    subscribed: bool,
    discovery: Option<Value>,
    presence: bool,
    state: Option<Value>,
}

/// What has come.
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

    /// Until it is stopped, or the agent is no more.
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

    /// The robot says who it is: that is the agent's name at the broker.
    fn meet(&mut self, robot: RobotInfo) {
        let another = self.robot.as_ref().map(|known| &known.uid) != Some(&robot.uid);
        if another {
            // A line of another robot breaks, and the broker says so.
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
        // The same name each time: a broker that still holds an old line of ours lets go of it, and says
        // its will, before it lets us in.
        let client = format!("spykee-{}", self.topics.id);
        self.told = Published::default();
        self.side = Side::Dialing(Line::dial(&self.account, &client, Some(will)));
    }

    fn take(&mut self, word: Word) {
        match word {
            Word::Up => {
                if let Side::Dialing(line) = std::mem::replace(&mut self.side, Side::Nameless) {
                    info!("{} is at the broker", self.topics.id);
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
            warn!("no broker at {host}:{port}: {why}; connecting again and again");
        }
        let pause = self.backoff.next(&mut self.rng);
        self.side = Side::Pause(Instant::now() + pause);
    }

    /// Something may be another: to be told soon.
    fn touch(&mut self) {
        let soon = Instant::now() + GATHER;
        self.due.get_or_insert(soon);
    }

    /// Tells what the broker does not know yet, in this order; what finds no room is told later.
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

    /// Home Assistant's event entity, and other subscribers.
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
                "the broker is slow: an event is left out"
            );
        }
    }

    fn obey(&mut self, message: &Message) {
        if message.topic == self.topics.birth() {
            if &message.payload[..] == b"online" {
                // It knows nothing yet.
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
            // A broker may send anything; this was not subscribed to.
            return;
        };
        if message.retained {
            let topic = &message.topic;
            return self.scribe.warn(&format!(
                "an order that the broker has kept is ignored, it may be old: {topic}"
            ));
        }
        let (order, id) = match read {
            Ok(read) => read,
            Err(error) => {
                let line = format!("an order by the broker is not understood: {error}");
                return self.scribe.warn(&line);
            }
        };
        self.scribe
            .info(&format!("a person asks by the broker: {order}"));
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
            let line = format!("the broker asked for {order}, which is not done: {why}");
            self.scribe.warn(&line);
        }
        let Side::Up(line, _) = &self.side else {
            return;
        };
        let text = serde_json::to_vec(&answer).unwrap_or_default();
        let said = line.say(&self.topics.answer(), text);
        let shown = picture.map(|jpeg| line.say(&self.topics.picture(), jpeg));
        if said == Err(Full) || shown == Some(Err(Full)) {
            debug!("the broker is slow: an answer is left out");
        }
    }

    fn members(&self) -> Vec<Member> {
        self.run.roster.members().borrow().clone()
    }

    /// What happened last, and goodbye.
    async fn part(mut self) {
        // A stop ends runs: who asked for it is told all the same.
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

/// The name of a behaviour.
fn choice(payload: &[u8]) -> Result<BrokerCommand, BrokerCommandError> {
    if payload.len() > LONGEST_CHOICE {
        return Err(BrokerCommandError::TooLong);
    }
    let name = std::str::from_utf8(payload).map_err(|_| BrokerCommandError::NoText)?;
    Ok(BrokerCommand::Choose(name.trim().to_owned()))
}

/// What the line has to say, or the time to make one. Cancel-safe.
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
