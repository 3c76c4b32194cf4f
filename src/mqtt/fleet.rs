//! All agents of a broker, as one client sees them.

use std::collections::BTreeMap;
use std::time::Duration;

use serde_json::Value;
use tokio::time::{Instant, timeout_at};

use super::command::{Answer, BrokerCommand};
use super::line::{Account, Full, Line, Message, Word};
use super::presence::Presence;
use super::topics::Topics;

/// How long a broker may take to let us in and say what it has.
const OPENING: Duration = Duration::from_secs(10);
/// What a broker has kept it says at once: after such a silence that was all.
const SILENCE: Duration = Duration::from_millis(700);
/// What it has kept ends by then, however much more it has to say.
const LISTENING: Duration = Duration::from_secs(5);
/// The longest state that is read, in bytes.
const LONGEST_STATE: usize = 16 << 10;
/// More agents are not listed.
const MOST: usize = 10_000;

/// Why the fleet cannot be asked.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// There is no line to the broker.
    #[error("no broker at {host}:{port}: {why}")]
    Broker {
        /// Its name.
        host: String,
        /// Its port.
        port: u16,
        /// In words.
        why: String,
    },
}

/// An agent that has been at the broker.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// Its robot's uid, as topics have it.
    pub robot: String,
    /// Whether it is there.
    pub presence: Presence,
    /// What it said last of how things stand; `Null` if that is unknown.
    pub state: Value,
}

/// A visit to a broker.
#[derive(Debug)]
pub struct Fleet {
    account: Account,
    line: Line,
    found: BTreeMap<String, Found>,
}

impl Fleet {
    /// Goes to the broker and looks who is there.
    ///
    /// # Errors
    /// See [`FleetError`].
    pub async fn visit(account: Account) -> Result<Fleet, FleetError> {
        let client = format!("spykee-fleet-{:08x}", rand::random::<u32>());
        let line = Line::dial(&account, &client, None);
        let mut fleet = Fleet {
            account,
            line,
            found: BTreeMap::new(),
        };
        fleet.look().await.map_err(|why| fleet.broken(why))?;
        Ok(fleet)
    }

    /// Everybody who was found, in the order of the names.
    pub fn found(&self) -> impl Iterator<Item = &Found> {
        self.found.values()
    }

    async fn look(&mut self) -> Result<(), String> {
        let mut until = Instant::now() + OPENING;
        let (mut missing, mut latest) = (3, None);
        loop {
            match timeout_at(until, self.line.next()).await {
                Ok(Word::Up) => {
                    for what in ["connection", "state", "answer"] {
                        let topic = format!("{}/+/{what}", self.account.options.prefix);
                        self.line.subscribe(&topic).map_err(in_words)?;
                    }
                }
                Ok(Word::Subscribed) => missing -= 1,
                Ok(Word::Message(message)) => self.note(&message),
                Ok(Word::Acknowledged) => {}
                Ok(Word::Lost(why)) => return Err(why),
                Err(_) if missing <= 0 => return Ok(()),
                Err(_) => return Err("it does not let us listen in time".to_owned()),
            }
            if missing <= 0 {
                let now = Instant::now();
                let latest = *latest.get_or_insert(now + LISTENING);
                if now >= latest {
                    return Ok(());
                }
                until = (now + SILENCE).min(latest);
            }
        }
    }

    fn note(&mut self, message: &Message) {
        let Some((robot, what)) = self.place(&message.topic) else {
            return;
        };
        let presence = match what {
            "connection" => Presence::of(&message.payload),
            _ => None,
        };
        let state = match what {
            "state" if message.payload.len() <= LONGEST_STATE => {
                serde_json::from_slice(&message.payload).ok()
            }
            _ => None,
        };
        if (presence.is_none() && state.is_none()) || self.found.len() >= MOST {
            return;
        }
        let robot = robot.to_owned();
        let found = self.found.entry(robot.clone()).or_insert(Found {
            robot,
            presence: Presence::ConnectionBroken,
            state: Value::Null,
        });
        found.presence = presence.unwrap_or(found.presence);
        found.state = state.unwrap_or(found.state.take());
    }

    /// Whose topic it is, and which.
    fn place<'a>(&self, topic: &'a str) -> Option<(&'a str, &'a str)> {
        let rest = topic.strip_prefix(&self.account.options.prefix)?;
        rest.strip_prefix('/')?.split_once('/')
    }

    /// Asks these agents for something, and waits for their answers, at most so long. Who does not answer
    /// in time is not in what it returns.
    ///
    /// # Errors
    /// If the broker goes away; what was answered until then is lost.
    pub async fn ask(
        &mut self,
        robots: &[String],
        order: &BrokerCommand,
        limit: Duration,
    ) -> Result<BTreeMap<String, Answer>, FleetError> {
        let id = format!("{:016x}", rand::random::<u64>());
        let asked = self.try_ask(robots, order, &id, limit).await;
        asked.map_err(|why| self.broken(why))
    }

    async fn try_ask(
        &mut self,
        robots: &[String],
        order: &BrokerCommand,
        id: &str,
        limit: Duration,
    ) -> Result<BTreeMap<String, Answer>, String> {
        let until = Instant::now() + limit;
        let (mut answers, mut waiting) = (BTreeMap::new(), robots.iter());
        let mut next = waiting.next();
        while answers.len() < robots.len() && Instant::now() < until {
            // What finds no room is asked when something of it has gone.
            while let Some(robot) = next {
                let topics = Topics::new(&self.account.options.prefix, "", robot);
                let payload = order.to_json(id).into_bytes();
                if self.line.say(&topics.command(), payload) == Err(Full) {
                    break;
                }
                next = waiting.next();
            }
            match timeout_at(until, self.line.next()).await {
                Ok(Word::Message(message)) => {
                    if let Some((robot, answer)) = self.answer(&message, id) {
                        answers.insert(robot, answer);
                    }
                }
                Ok(Word::Lost(why)) => return Err(why),
                Ok(_) => {}
                Err(_) => break,
            }
        }
        Ok(answers)
    }

    fn answer(&self, message: &Message, id: &str) -> Option<(String, Answer)> {
        let (robot, "answer") = self.place(&message.topic)? else {
            return None;
        };
        let answer: Answer = serde_json::from_slice(&message.payload).ok()?;
        (answer.id.as_deref() == Some(id)).then(|| (robot.to_owned(), answer))
    }

    /// Leaves.
    pub async fn leave(self) {
        self.line.close(Duration::from_secs(1)).await;
    }

    fn broken(&self, why: String) -> FleetError {
        let (host, port) = self.account.options.address().unwrap_or_default();
        let host = host.to_owned();
        FleetError::Broker { host, port, why }
    }
}

fn in_words(_: Full) -> String {
    "it takes nothing".to_owned()
}
