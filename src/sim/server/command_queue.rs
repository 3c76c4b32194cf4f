//! The commands that the robot has received and not yet executed. Its program takes one at a time,
//! at the firmware's pace, in the order in which they came; an idle program takes one at once.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;

use crate::sim::body::firmware::Firmware;
use crate::wire::Command;

/// Places in a queue whose length the firmware's settings leave open.
const UNLIMITED: usize = 4096;

#[derive(Debug)]
pub(crate) struct QueuedCommand {
    /// Time since the start of the server at which the command was received.
    pub(crate) received: Duration,
    pub(crate) write: u64,
    pub(crate) client: u64,
    pub(crate) command: Command,
    /// The command's place in the queue, free again when this is dropped.
    pub(crate) _place: Option<OwnedSemaphorePermit>,
}

pub(crate) struct CommandQueue {
    /// Time per command; `None` for a robot that executes everything at once.
    period: Option<Duration>,
    waiting: VecDeque<QueuedCommand>,
    places: Arc<Semaphore>,
    /// When the program is ready for the next command.
    ready: Instant,
}

impl CommandQueue {
    pub(crate) fn new(firmware: &Firmware, now: Instant) -> CommandQueue {
        CommandQueue {
            period: (firmware.commands_per_second).map(|rate| Duration::from_secs_f64(1.0 / rate)),
            waiting: VecDeque::new(),
            places: Arc::new(Semaphore::new(firmware.queue.unwrap_or(UNLIMITED))),
            ready: now,
        }
    }

    /// The free places, of which a connection takes one for each command before it reads on;
    /// `None` if every command is executed at once.
    pub(crate) fn places(&self) -> Option<Arc<Semaphore>> {
        self.period.map(|_| self.places.clone())
    }

    pub(crate) fn push(&mut self, command: QueuedCommand) {
        self.waiting.push_back(command);
    }

    /// Takes the next command, if the robot's program is ready for it.
    pub(crate) fn take(&mut self, now: Instant) -> Option<QueuedCommand> {
        if now < self.ready {
            return None;
        }
        let command = self.waiting.pop_front()?;
        if let Some(period) = self.period {
            self.ready = now + period;
        }
        Some(command)
    }

    /// When the next command is due; `None` if none waits.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.waiting.front().map(|_| self.ready)
    }

    pub(crate) fn len(&self) -> usize {
        self.waiting.len()
    }

    pub(crate) fn clear(&mut self) {
        self.waiting.clear();
    }
}
