//! Notifications for people who are elsewhere. A thread for each target takes messages from a
//! bounded queue on the disk and retries with growing pauses, so no target delays another. A
//! target's secrets appear in no log, no error and no queue.

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
