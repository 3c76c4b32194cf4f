//! The robot at an MQTT broker: its state, its events, and orders from Home Assistant, `spykee
//! fleet` or any other client. One agent is one device, named after its robot's uid.
//!
//! A thread of its own speaks with the broker; it only listens to the agent
//! ([`Bus`](crate::robot::Bus), status) and asks what a person may ask
//! ([`control::Run`](crate::control::Run)): watchdog and priorities hold. If the broker hangs or is
//! gone, nothing waits for it: only the latest state is kept, events that find no room are dropped
//! and counted, the thread reconnects with growing pauses, and the robot continues. If this thread
//! panics, its connection closes, and the broker publishes CONNECTIONBROKEN for it.
//!
//! An order runs once or not at all: sessions are clean, so a broker keeps no orders for an agent
//! that is away, and retained ones are ignored.

mod command;
mod discovery;
mod envoy;
mod errands;
mod fleet;
mod line;
mod post;
mod presence;
mod report;
mod scribe;
mod thread;
mod topics;

pub use command::{Answer, BrokerCommand, BrokerCommandError};
pub use fleet::{Fleet, FleetError, Found};
pub use line::Account;
pub use post::{PostError, publish};
pub use presence::Presence;
pub use thread::{Mqtt, MqttError};
