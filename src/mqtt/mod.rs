//! The robot at a broker of MQTT: how things stand, what happens, and orders of Home Assistant, of
//! `spykee fleet` or of any other client. One agent is one device, named by its robot's uid.
//!
//! A thread of its own speaks with the broker; it only listens to the agent ([`Bus`](crate::robot::Bus),
//! status) and asks what a person may ask ([`control::Run`](crate::control::Run)): watchdog and
//! priorities hold. What if the broker hangs or is gone? Nothing waits for it: of the state the newest counts,
//! events that find no room are dropped and counted, the thread connects anew with growing pauses, and
//! the robot goes on as it did. What if this thread breaks down? Its connection closes, and the broker
//! says CONNECTIONBROKEN for it.
//!
//! An order runs once or not at all: sessions are clean, so a broker keeps no orders for an agent that is
//! away, and retained ones are ignored.

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
