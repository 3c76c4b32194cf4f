//! The channels between the pilot and the behaviours' supervisors. Every queue is bounded; what
//! does not fit is dropped and counted, except for answers: a behaviour whose queue has no room for
//! one is ended.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tokio::sync::{Notify, mpsc, oneshot, watch};

use super::{BehaviourId, EndReason, Event, Intent, Priority, RobotInfo};

/// The most requests in the pilot's queue; a supervisor that finds it full waits.
pub const MAX_REQUESTS: usize = 256;
/// The most events in a behaviour's queue.
pub const MAX_EVENTS: usize = 256;

#[derive(Debug)]
pub enum Request {
    Join {
        by: BehaviourId,
        name: String,
        priority: Priority,
        role: Role,
        events: EventSender,
    },
    Intent(BehaviourId, Intent),
    /// A behaviour's host has sent a sign of life.
    Alive(BehaviourId),
    Gone(BehaviourId),
    /// A permanent failure has occurred that a person should know of: sound the alarm, once.
    Alarm,
    Running(oneshot::Sender<RunningBehaviours>),
    /// Forbid everything, the watchdog included, to move the robot; or allow it again.
    EmergencyStop(bool),
    /// Release the link, so that another program can log in, or reconnect. The link is not released
    /// while a behaviour runs, while a stop is owed, or while the battery is low and the robot is
    /// off its station.
    Release(bool),
    /// The quiet hours from now on.
    Quiet(Quiet),
    /// Stop the robot, then suspend this program with the function, which returns when the program
    /// resumes.
    Suspend(Suspend),
}

/// What must make no sound and show no bright light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quiet {
    /// Sounds and lights are allowed.
    #[default]
    Off,
    Scripts,
    /// Scripts and the alarm are quiet.
    WithAlarm,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Role {
    /// It does what its user wants.
    #[default]
    Behaviour,
    /// It brings a robot with a low battery to its station, with the tracks that the watchdog
    /// grants it.
    Rescuer,
    /// A person, who sends requests through a tool.
    Person,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunningBehaviours {
    /// The robot's identity from the last login, if there was one.
    pub robot: Option<RobotInfo>,
    /// The behaviours that run now, without persons.
    pub behaviours: Vec<RunningBehaviour>,
}

/// A running behaviour.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct RunningBehaviour {
    /// Its name for people.
    pub name: String,
    /// Its priority.
    pub priority: Priority,
}

pub struct Suspend(pub Box<dyn FnOnce() + Send>);

impl std::fmt::Debug for Suspend {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Suspend")
    }
}

/// Makes the two ends of the channel from the pilot to a behaviour.
pub fn events() -> (EventSender, EventReceiver) {
    let (events, received) = mpsc::channel(MAX_EVENTS);
    let (kill, killed) = watch::channel(None);
    let picture = Arc::new(Notify::new());
    (
        EventSender {
            events,
            kill,
            picture: picture.clone(),
            dropped: 0,
        },
        EventReceiver {
            events: received,
            killed,
            picture,
        },
    )
}

/// The pilot's end. Never blocks.
#[derive(Debug)]
pub struct EventSender {
    events: mpsc::Sender<Event>,
    kill: watch::Sender<Option<EndReason>>,
    picture: Arc<Notify>,
    dropped: u64,
}

impl EventSender {
    /// Sends an event, or drops it if the queue is full. An answer that does not fit ends the
    /// behaviour: it does not read its events, and would wait forever.
    pub fn tell(&mut self, event: Event) {
        if let Err(mpsc::error::TrySendError::Full(event)) = self.events.try_send(event) {
            self.dropped += 1;
            if event.is_answer() {
                self.kill(EndReason::Cpu);
            }
        }
    }

    /// Announces a newer picture. Each behaviour is notified separately, in an order that the pilot
    /// chooses: tasks waiting on one `watch` are woken in random order, which would make
    /// simulations differ.
    pub fn notify_frame(&self) {
        self.picture.notify_one();
    }

    /// Has the behaviour's host ended with SIGKILL.
    pub fn kill(&self, reason: EndReason) {
        self.kill
            .send_if_modified(|kill| kill.replace(reason).is_none());
    }
}

#[derive(Debug)]
pub struct EventReceiver {
    events: mpsc::Receiver<Event>,
    killed: watch::Receiver<Option<EndReason>>,
    picture: Arc<Notify>,
}

#[derive(Debug, PartialEq)]
pub enum PilotMessage {
    Event(Event),
    /// End the host now.
    Kill(EndReason),
    Closed,
}

impl EventReceiver {
    /// Notified when there is a newer picture.
    pub fn picture(&self) -> Arc<Notify> {
        self.picture.clone()
    }

    /// The next message from the pilot; a kill overtakes every event. Cancel-safe.
    pub async fn next(&mut self) -> PilotMessage {
        if let Some(reason) = *self.killed.borrow_and_update() {
            return PilotMessage::Kill(reason);
        }
        tokio::select! {
            biased;
            changed = self.killed.changed() => match (changed, *self.killed.borrow()) {
                (Ok(()), Some(reason)) => PilotMessage::Kill(reason),
                _ => PilotMessage::Closed,
            },
            event = self.events.recv() => event.map_or(PilotMessage::Closed, PilotMessage::Event),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::{MotionEnd, MotionId};

    #[tokio::test]
    async fn a_kill_overtakes_events() {
        let (mut events, mut inbox) = events();
        events.tell(Event::Docked);
        events.kill(EndReason::Cpu);
        assert_eq!(inbox.next().await, PilotMessage::Kill(EndReason::Cpu));
    }

    #[tokio::test]
    async fn an_event_that_does_not_fit_is_dropped_but_an_answer_ends_the_behaviour() {
        let (mut events, mut inbox) = events();
        (0..MAX_EVENTS + 3).for_each(|_| events.tell(Event::Docked));
        assert_eq!(events.dropped, 3);
        assert_eq!(inbox.next().await, PilotMessage::Event(Event::Docked));
        events.tell(Event::Docked);
        events.tell(Event::MotionEnded {
            motion: MotionId(1),
            end: MotionEnd::Done,
        });
        assert_eq!(inbox.next().await, PilotMessage::Kill(EndReason::Cpu));
    }

    #[tokio::test]
    async fn without_a_pilot_the_channel_is_closed() {
        let (events, mut inbox) = events();
        drop(events);
        assert_eq!(inbox.next().await, PilotMessage::Closed);
    }
}
