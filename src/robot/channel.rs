//! The channels between the pilot and the behaviours' supervisors. Every queue is bounded; what
//! does not fit is dropped and counted, but for answers, on which a waiting call hangs.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tokio::sync::{Notify, mpsc, oneshot, watch};

use super::{BehaviourId, EndReason, Event, Intent, Priority, RobotInfo};

/// How many requests may wait for the pilot; a supervisor that finds the queue full waits.
pub const MAX_REQUESTS: usize = 256;
/// How many events may wait for one behaviour.
pub const MAX_EVENTS: usize = 256;

/// What a supervisor has to say to the pilot.
#[derive(Debug)]
pub enum Request {
    /// A behaviour is there.
    Join {
        /// Its number.
        by: BehaviourId,
        /// What people call it.
        name: String,
        /// Its priority.
        priority: Priority,
        /// What it is there for.
        role: Role,
        /// Where it is told.
        events: EventSender,
    },
    /// A behaviour asks for something.
    Intent(BehaviourId, Intent),
    /// A behaviour's host has shown life.
    Alive(BehaviourId),
    /// A behaviour is no more.
    Gone(BehaviourId),
    /// Something went wrong for good that a person should know: sound the alarm, once.
    Alarm,
    /// Who is aboard?
    Crew(oneshot::Sender<Crew>),
    /// Let nothing move the robot, not even the watchdog; or let it move again.
    Halt(bool),
    /// Release the link, so that another program can log in, or dial again. A robot that runs a
    /// behaviour, or whose battery is low off its station, is not let go of.
    Release(bool),
    /// What must not be heard or seen from now on.
    Quiet(Quiet),
    /// Stop the robot, and then this program by this function, which returns when it goes on.
    Sleep(Sleep),
}

/// Who must make no sound and show no bright light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Quiet {
    /// Sounds and lights are allowed.
    #[default]
    Off,
    /// Scripts.
    Scripts,
    /// Scripts, and the alarm neither.
    WithAlarm,
}

/// What a behaviour is there for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Role {
    /// What its user wants.
    #[default]
    Behaviour,
    /// To bring a robot with a low battery to its station, with the tracks that the watchdog lends it.
    Rescuer,
    /// A person, who asks by a tool.
    Person,
}

/// The robot and who is aboard.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Crew {
    /// As it said at its last login, if there was one.
    pub robot: Option<RobotInfo>,
    /// The behaviours that run now, persons left out.
    pub aboard: Vec<Aboard>,
}

/// A behaviour that runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Aboard {
    /// What people call it.
    pub name: String,
    /// Its priority.
    pub priority: Priority,
}

/// Stops this program, and returns when it goes on.
pub struct Sleep(pub Box<dyn FnOnce() + Send>);

impl std::fmt::Debug for Sleep {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Sleep")
    }
}

/// Makes the two ends of a behaviour's line from the pilot.
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

/// The pilot's end. Never waits.
#[derive(Debug)]
pub struct EventSender {
    events: mpsc::Sender<Event>,
    kill: watch::Sender<Option<EndReason>>,
    picture: Arc<Notify>,
    dropped: u64,
}

impl EventSender {
    /// Passes an event on, or drops it if the queue is full. An answer that does not fit ends the
    /// behaviour: it does not read, and would wait for ever.
    pub fn tell(&mut self, event: Event) {
        if let Err(mpsc::error::TrySendError::Full(event)) = self.events.try_send(event) {
            self.dropped += 1;
            if event.is_answer() {
                self.kill(EndReason::Cpu);
            }
        }
    }

    /// Says that there is a newer picture. Each behaviour is told by itself, in the order of the
    /// pilot's choice: those who wait for one `watch` are woken in an order of chance, and then no
    /// simulation is like another.
    pub fn show(&self) {
        self.picture.notify_one();
    }

    /// Has the behaviour's host ended by SIGKILL.
    pub fn kill(&self, reason: EndReason) {
        self.kill
            .send_if_modified(|kill| kill.replace(reason).is_none());
    }

    /// Events that did not fit so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

/// The supervisor's end.
#[derive(Debug)]
pub struct EventReceiver {
    events: mpsc::Receiver<Event>,
    killed: watch::Receiver<Option<EndReason>>,
    picture: Arc<Notify>,
}

/// What the pilot tells a supervisor.
#[derive(Debug, PartialEq)]
pub enum PilotMessage {
    /// Something has happened.
    Event(Event),
    /// End the host now.
    Kill(EndReason),
    /// The pilot is no more.
    Closed,
}

impl EventReceiver {
    /// Notified when there is a newer picture.
    pub fn picture(&self) -> Arc<Notify> {
        self.picture.clone()
    }

    /// The next word from the pilot; a kill overtakes every event. Cancel-safe.
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
    async fn news_that_does_not_fit_is_dropped_and_an_answer_ends_the_behaviour() {
        let (mut events, mut inbox) = events();
        (0..MAX_EVENTS + 3).for_each(|_| events.tell(Event::Docked));
        assert_eq!(events.dropped(), 3);
        assert_eq!(inbox.next().await, PilotMessage::Event(Event::Docked));
        events.tell(Event::Docked);
        events.tell(Event::MotionEnded {
            motion: MotionId(1),
            end: MotionEnd::Done,
        });
        assert_eq!(inbox.next().await, PilotMessage::Kill(EndReason::Cpu));
    }

    #[tokio::test]
    async fn without_a_pilot_the_line_is_closed() {
        let (events, mut inbox) = events();
        drop(events);
        assert_eq!(inbox.next().await, PilotMessage::Closed);
    }
}
