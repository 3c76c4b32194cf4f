//! All agents at a broker, as seen by one client.

use std::collections::BTreeMap;
use std::time::Duration;

use rumqttc::Publish;
use serde::Serialize;
use serde_json::Value;
use tokio::time::{Instant, timeout_at};

use super::command::{BrokerCommand, CommandResult};
use super::connection::{Account, Connection, ConnectionEvent, QueueFull};
use super::topics::{PREFIX, Presence, Topics};

const OPENING: Duration = Duration::from_secs(10);
/// A broker sends retained messages at once: after this long without a message, all have arrived.
const SILENCE_TIMEOUT: Duration = Duration::from_millis(700);
/// Upper limit of the time spent on retained messages, however many there are.
const LISTENING: Duration = Duration::from_secs(5);
/// Maximum length of a state that is read, in bytes.
const LONGEST_STATE: usize = 16 << 10;
/// Maximum number of agents listed.
const MAX_ROBOTS: usize = 10_000;

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// Its robot's uid, as used in topics.
    pub robot: String,
    #[serde(rename = "connection")]
    pub presence: Presence,
    /// The last state that it published; `Null` if unknown.
    pub state: Value,
}

/// A connection to a broker, and the agents found there.
#[derive(Debug)]
pub struct Fleet {
    account: Account,
    connection: Connection,
    found: BTreeMap<String, Found>,
}

impl Fleet {
    pub async fn connect(account: Account) -> Result<Fleet, String> {
        let client = format!("spykee-fleet-{:08x}", rand::random::<u32>());
        let connection = Connection::connect(&account, &client, None);
        let mut fleet = Fleet {
            account,
            connection,
            found: BTreeMap::new(),
        };
        fleet.collect().await.map_err(|why| fleet.broken(why))?;
        Ok(fleet)
    }

    /// Returns the agents found, in the order of their names.
    pub fn found(&self) -> impl Iterator<Item = &Found> {
        self.found.values()
    }

    async fn collect(&mut self) -> Result<(), String> {
        let mut until = Instant::now() + OPENING;
        let mut missing = 3;
        let mut latest = None;
        loop {
            match timeout_at(until, self.connection.next()).await {
                Ok(ConnectionEvent::Up) => {
                    for what in ["connection", "state", "answer"] {
                        let topic = format!("{PREFIX}/+/{what}");
                        let asked = self.connection.subscribe(&topic);
                        asked.map_err(|error| error.to_string())?;
                    }
                }
                Ok(ConnectionEvent::Subscribed) => missing -= 1,
                Ok(ConnectionEvent::Message(message)) => self.record(&message),
                Ok(ConnectionEvent::Acknowledged) => {}
                Ok(ConnectionEvent::Lost(why)) => return Err(why),
                Err(_) if missing <= 0 => return Ok(()),
                Err(_) => return Err("it did not confirm the subscriptions in time".to_owned()),
            }
            if missing <= 0 {
                let now = Instant::now();
                let latest = *latest.get_or_insert(now + LISTENING);
                if now >= latest {
                    return Ok(());
                }
                until = (now + SILENCE_TIMEOUT).min(latest);
            }
        }
    }

    fn record(&mut self, message: &Publish) {
        let Some((robot, what)) = split_topic(&message.topic) else {
            return;
        };
        let presence = match what {
            "connection" => std::str::from_utf8(&message.payload)
                .ok()
                .and_then(Presence::from_name),
            _ => None,
        };
        let state = match what {
            "state" if message.payload.len() <= LONGEST_STATE => {
                serde_json::from_slice(&message.payload).ok()
            }
            _ => None,
        };
        if (presence.is_none() && state.is_none()) || self.found.len() >= MAX_ROBOTS {
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

    /// Sends a command to these agents and waits for their answers at most this long. The result
    /// lacks agents that did not answer in time.
    ///
    /// # Errors
    /// If the connection to the broker breaks; answers received until then are lost.
    pub async fn ask(
        &mut self,
        robots: &[String],
        command: &str,
        limit: Duration,
    ) -> Result<BTreeMap<String, CommandResult>, String> {
        let id = format!("{:016x}", rand::random::<u64>());
        let command = BrokerCommand {
            command: command.to_owned(),
            id: Some(id.clone()),
        };
        // Serialising strings cannot fail.
        let payload = serde_json::to_vec(&command).unwrap_or_default();
        let until = Instant::now() + limit;
        let mut answers = BTreeMap::new();
        let mut waiting = robots.iter().peekable();
        while answers.len() < robots.len() && Instant::now() < until {
            // If the queue is full, the remaining commands follow when it has room.
            while let Some(robot) = waiting.peek() {
                let topic = Topics::new(robot).named("command");
                if self.connection.publish(&topic, payload.clone()) == Err(QueueFull) {
                    break;
                }
                waiting.next();
            }
            match timeout_at(until, self.connection.next()).await {
                Ok(ConnectionEvent::Message(message)) => {
                    if let Some((robot, answer)) = answer(&message, &id) {
                        answers.insert(robot, answer);
                    }
                }
                Ok(ConnectionEvent::Lost(why)) => return Err(self.broken(why)),
                Ok(_) => {}
                Err(_) => break,
            }
        }
        Ok(answers)
    }

    pub async fn disconnect(self) {
        self.connection.close(Duration::from_secs(1)).await;
    }

    fn broken(&self, why: String) -> String {
        let (host, port) = self.account.options.address().unwrap_or_default();
        format!("no broker at {host}:{port}: {why}")
    }
}

fn answer(message: &Publish, id: &str) -> Option<(String, CommandResult)> {
    let (robot, "answer") = split_topic(&message.topic)? else {
        return None;
    };
    let answer: CommandResult = serde_json::from_slice(&message.payload).ok()?;
    if answer.command.id.as_deref() != Some(id) {
        return None;
    }
    Some((robot.to_owned(), answer))
}

/// The robot and the name of its topic.
fn split_topic(topic: &str) -> Option<(&str, &str)> {
    topic
        .strip_prefix(PREFIX)?
        .strip_prefix('/')?
        .split_once('/')
}
