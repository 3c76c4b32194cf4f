//! The robot at an MQTT broker: its state, its events, and commands from Home Assistant, `spykee
//! fleet` or any other client. One agent is one device, named after its robot's uid.
//!
//! A separate thread communicates with the broker; it only listens to the agent
//! ([`Bus`](crate::robot::Bus), status) and sends the requests that a person may send
//! ([`control::Run`](crate::control::Run)): watchdog and priorities apply. If the broker hangs or
//! is unreachable, nothing waits for it: only the latest state is kept, events are dropped and
//! counted when the queue is full, the thread reconnects with growing pauses, and the robot
//! continues. If this thread panics, its connection closes, and the broker publishes
//! CONNECTIONBROKEN on its behalf.
//!
//! A command is executed at most once: sessions are clean, so a broker keeps no commands for an
//! agent that is offline, and retained commands are ignored.

mod broker_client;
mod command;
mod connection;
mod discovery;
mod fleet;
mod report;
mod topics;

pub use broker_client::start;
pub use command::{BrokerCommand, CommandResult};
pub use connection::{Account, publish};
pub use fleet::{Fleet, Found};
pub use topics::Presence;
