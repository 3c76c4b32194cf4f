//! A voice for those who are elsewhere: what happens on an agent's bus goes, by rules, to webhooks,
//! topics of a broker and commands that the config names.
//!
//! A thread listens and puts messages into queues on the disk; a thread for each target sends them. What
//! if a target hangs, refuses or is gone? Its own queue waits, with growing pauses, and is bounded;
//! nothing else waits. Secrets of a target are in no log, no error and no queue.

mod broker;
mod command;
mod content;
mod delivery;
mod notice;
mod notifier;
mod options;
mod queue;
mod rules;
mod sender;
mod share;
mod template;
mod webhook;

pub use broker::{Letter, Post};
pub use delivery::Delivery;
pub use notice::{Notice, Rule};
pub use notifier::{Notifier, NotifyError};
pub use options::{Options, OptionsError, PictureWay, Target, TargetError};
pub use sender::deliver;
pub use template::UnknownName;
pub use webhook::{RequestError, request};
