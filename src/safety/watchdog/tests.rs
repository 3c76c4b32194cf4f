//! The rules by example, with facts and times in and acts out; and their promises over random
//! histories.

mod battery;
mod docking;
mod handover;
mod histories;
mod link;
mod recharge;
mod recovery;

use std::time::Duration;

use tokio::time::Instant;

use super::*;
use crate::robot::{CallId, DockPlan, MotionId};

const SECOND: Duration = Duration::from_secs(1);
const MS: Duration = Duration::from_millis(1);
const WHO: BehaviourId = BehaviourId(0);

/// What happens to a watchdog.
#[derive(Debug, Clone)]
enum Input {
    Fact(Fact),
    Request(BehaviourId, Priority, Intent),
}

impl From<Fact> for Input {
    fn from(fact: Fact) -> Input {
        Input::Fact(fact)
    }
}

impl Input {
    fn apply(self, dog: &mut Watchdog, now: Instant) {
        match self {
            Input::Fact(fact) => dog.apply(fact, now),
            Input::Request(by, priority, intent) => dog.request(by, priority, intent, now),
        }
    }
}

/// A watchdog and a clock that only moves when told.
struct Rig {
    dog: Watchdog,
    now: Instant,
}

impl Rig {
    /// Logged in off the station, with this level.
    fn online(percent: u8) -> Rig {
        let mut rig = Rig::with(Limits::default());
        rig.handle(login(false, power(percent)));
        rig.now += 20 * MS;
        rig
    }

    fn with(limits: Limits) -> Rig {
        let now = Instant::now();
        Rig {
            dog: Watchdog::new(limits, now),
            now,
        }
    }

    fn handle(&mut self, input: impl Into<Input>) -> Vec<Act> {
        input.into().apply(&mut self.dog, self.now);
        self.dog.poll(self.now)
    }

    /// A report, one second later.
    fn report(&mut self, power: Power) -> Vec<Act> {
        self.now += SECOND;
        self.handle(Fact::Power(power))
    }

    /// Logged in on the station, with this level.
    fn docked(power: Power) -> Rig {
        let mut rig = Rig::with(Limits::default());
        rig.handle(login(true, power));
        rig.now += SECOND;
        rig
    }

    fn ask(&mut self, intent: Intent) -> Vec<Act> {
        self.ask_as(WHO, 0, intent)
    }

    fn ask_as(&mut self, by: BehaviourId, priority: i16, intent: Intent) -> Vec<Act> {
        self.handle(Input::Request(by, Priority(priority), intent))
    }

    fn dock(&mut self, call: u64) -> Vec<Act> {
        self.ask(Intent::Dock {
            call: CallId(call),
            plan: DockPlan::default(),
        })
    }

    fn undock(&mut self, call: u64) -> Vec<Act> {
        self.ask(Intent::Undock {
            call: CallId(call),
            timeout: 20 * SECOND,
        })
    }

    fn drive(&mut self, motion: u64, duration: Option<Duration>) -> Vec<Act> {
        let setpoint = Setpoint::from_percent(50.0, 50.0).unwrap();
        self.ask(Intent::Move {
            motion: MotionId(motion),
            setpoint,
            duration,
        })
    }

    fn stall(&mut self, gap: Duration, guardian_wrote: bool) -> Vec<Act> {
        self.now += gap;
        self.handle(Fact::Stalled {
            gap,
            guardian_wrote,
        })
    }

    /// Lets time pass as the pilot does, from deadline to deadline, with the host alive or not.
    fn pass(&mut self, span: Duration, alive: bool) -> Vec<Act> {
        let end = self.now + span;
        let mut acts = Vec::new();
        loop {
            let beat = self.now + 50 * MS;
            let next = self
                .dog
                .next_deadline()
                .map_or(end, |due| due.max(self.now))
                .min(end);
            self.now = if alive { next.min(beat).min(end) } else { next };
            if alive {
                acts.extend(self.handle(Fact::Alive(WHO)));
            }
            acts.extend(self.dog.poll(self.now));
            let due = self.dog.next_deadline();
            assert!(due.is_none_or(|due| due > self.now), "would tick forever");
            if self.now >= end {
                return acts;
            }
        }
    }
}

fn login(docked: bool, power: Power) -> Fact {
    Fact::LinkUp { docked, power }
}

fn power(percent: u8) -> Power {
    Power {
        percent,
        charging: false,
    }
}

fn charging(percent: u8) -> Power {
    Power {
        percent,
        charging: true,
    }
}

fn sent(acts: &[Act]) -> Vec<Command> {
    acts.iter().filter_map(Act::command).collect()
}

fn events(acts: &[Act]) -> Vec<Event> {
    let event = |act: &Act| match act {
        Act::Tell(_, event) => Some(event.clone()),
        _ => None,
    };
    acts.iter().filter_map(event).collect()
}

fn ended(motion: u64, end: MotionEnd) -> Event {
    Event::MotionEnded {
        motion: MotionId(motion),
        end,
    }
}

fn dock_ended(acts: &[Act]) -> Option<(DockEnd, u32)> {
    events(acts).into_iter().find_map(|event| match event {
        Event::DockEnded { outcome, .. } => Some((outcome.end, outcome.attempts)),
        _ => None,
    })
}

fn undock_ended(acts: &[Act]) -> Option<DockEnd> {
    events(acts).into_iter().find_map(|event| match event {
        Event::UndockEnded { end, .. } => Some(end),
        _ => None,
    })
}

const FORWARD: Command = Command::Move {
    left: 45,
    right: 45,
};
const FIND: Command = Command::Engine(Engage::Dock);
const CANCEL: Command = Command::Engine(Engage::CancelDock);
const LEAVE: Command = Command::Engine(Engage::Undock);

/// A low battery, and the station was not found in the first four searches: the alarm.
fn lost(percent: u8, limits: Limits) -> (Rig, Vec<Act>) {
    let mut rig = Rig::with(limits);
    rig.handle(login(false, power(percent)));
    for _ in 0..3 {
        rig.pass(SECOND, false);
        rig.handle(Fact::Engine(EngineReport::BaseNotFound));
        rig.pass(30 * SECOND, false);
        assert_ne!(rig.dog.state(), WatchdogState::Alarm);
    }
    let acts = rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert_eq!(rig.dog.state(), WatchdogState::Alarm);
    (rig, acts)
}

/// A robot that has just begun to search, with a low battery and without a rescue behaviour.
fn searching(percent: u8, limits: Limits) -> Rig {
    let mut rig = Rig::with(limits);
    rig.handle(login(false, power(percent)));
    rig.now += SECOND;
    rig
}

fn standing() -> Limits {
    Limits {
        blind_moves: false,
        ..Limits::default()
    }
}

fn count(acts: &[Act], wanted: &Command) -> usize {
    let sent = sent(acts);
    sent.iter().filter(|command| *command == wanted).count()
}

/// The setpoints sent to the tracks, without repetitions.
fn tracks(acts: &[Act]) -> Vec<(i8, i8)> {
    let setpoint = |command| match command {
        Command::Move { left, right } => Some((left, right)),
        _ => None,
    };
    let mut tracks: Vec<(i8, i8)> = sent(acts).into_iter().filter_map(setpoint).collect();
    tracks.dedup();
    tracks
}

fn reasons(acts: &[Act]) -> Vec<String> {
    let reason = |act: &Act| match act {
        Act::Announce(Event::Safety { reason, .. }) => Some(reason.clone()),
        _ => None,
    };
    acts.iter().filter_map(reason).collect()
}

const LEG: Command = Command::Move {
    left: 27,
    right: 27,
};

fn reconnects(acts: &[Act]) -> bool {
    acts.iter().any(|act| matches!(act, Act::Reconnect(_)))
}
