//! Notifications for people who are elsewhere: rules select events of an agent's bus and send them
//! to the webhooks, broker topics and commands of the config.
//!
//! A thread listens and puts messages into queues on the disk; a thread for each target sends them.
//! If a target hangs, refuses or is unreachable, its own bounded queue is retried with growing
//! pauses; nothing else waits. A target's secrets appear in no log, no error and no queue.

mod command;
mod content;
mod notice;
mod notifier;
mod options;
mod queue;
mod rules;
mod sender;
mod template;
mod webhook;

pub use command::PROGRAM_VARIABLES;
pub use content::{BrokerMessage, BrokerPublisher};
pub use notice::{Delivery, Notice, Rule};
pub use notifier::{Notifier, NotifyError};
pub use options::{Options, OptionsError, PictureMode, Target, TargetError};
pub use sender::deliver;
pub use template::UnknownName;
pub use webhook::{RequestError, request};
