//! The commands that the robot has received and not yet executed. Its program takes one at a time,
//! at the firmware's pace, in the order in which they came; an idle program takes one at once.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
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
    /// Time per command of the firmware; `None` if it executes everything at once.
    usual_period: Option<Duration>,
    /// Time per command now.
    period: Option<Duration>,
    waiting: VecDeque<QueuedCommand>,
    places: Arc<Semaphore>,
    places_now: watch::Sender<Option<Arc<Semaphore>>>,
    /// When the program is ready for the next command.
    ready: Instant,
}

impl CommandQueue {
    pub(crate) fn new(firmware: &Firmware, now: Instant) -> CommandQueue {
        let period = (firmware.commands_per_second).map(|rate| Duration::from_secs_f64(1.0 / rate));
        let places = Arc::new(Semaphore::new(firmware.queue.unwrap_or(UNLIMITED)));
        CommandQueue {
            usual_period: period,
            period,
            waiting: VecDeque::new(),
            places_now: watch::Sender::new(period.map(|_| places.clone())),
            places,
            ready: now,
        }
    }

    /// The free places, of which a connection takes one for each command before it reads on;
    /// `None` while every command is executed at once.
    pub(crate) fn places(&self) -> watch::Receiver<Option<Arc<Semaphore>>> {
        self.places_now.subscribe()
    }

    /// From now on the program takes at least this long for each command.
    pub(crate) fn slow_down(&mut self, period: Duration) {
        self.period = self.usual_period.max(Some(period));
        self.places_now.send_replace(Some(self.places.clone()));
    }

    /// The program is as fast as usual again.
    pub(crate) fn recover(&mut self, now: Instant) {
        self.period = self.usual_period;
        self.ready = self.ready.min(now + self.period.unwrap_or_default());
        let places = self.period.map(|_| self.places.clone());
        self.places_now.send_replace(places);
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
