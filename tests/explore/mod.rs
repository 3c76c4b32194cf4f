//! Explores the pure watchdog breadth first: every order of what a lossy robot, an adversarial script, a
//! rescue behaviour and a link can do, to a depth. A state is what the watchdog looks like with its
//! deadlines counted from now; one that was seen before is not entered again.

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::time::Duration;

use spykee::robot::{BehaviourId, CallId, DockPlan, Event, Intent, MotionId, Priority, Setpoint};
use spykee::safety::{Act, DockState, Fact, LastWords, Limits, Watchdog, WatchdogState};
use spykee::wire::{Command, Engage, EngineReport, Power};
use tokio::time::Instant;

const SCRIPT: BehaviourId = BehaviourId(0);
const RESCUER: BehaviourId = BehaviourId(9);

/// What can happen next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Nothing, until the watchdog's next deadline.
    Wait,
    Power(u8, bool),
    Engine(EngineReport),
    Up {
        docked: bool,
        percent: u8,
    },
    Down,
    Slept,
    Move(BehaviourId),
    Stop(BehaviourId),
    Dock,
    CancelDock,
    Undock,
    Gone(BehaviourId),
    Rescuer,
}

/// All of them: reports may come or be lost in any order, so a robot that loses what it is told is
/// among the robots explored.
pub const STEPS: [Step; 22] = [
    Step::Wait,
    Step::Power(90, false),
    Step::Power(15, false),
    Step::Power(5, false),
    Step::Power(15, true),
    Step::Power(60, true),
    Step::Engine(EngineReport::Docked),
    Step::Engine(EngineReport::Undocked),
    Step::Engine(EngineReport::BaseNotFound),
    Step::Up {
        docked: false,
        percent: 15,
    },
    Step::Up {
        docked: true,
        percent: 15,
    },
    Step::Down,
    Step::Slept,
    Step::Move(SCRIPT),
    Step::Move(RESCUER),
    Step::Stop(SCRIPT),
    Step::Stop(RESCUER),
    Step::Dock,
    Step::CancelDock,
    Step::Undock,
    Step::Rescuer,
    Step::Gone(RESCUER),
];

/// A watchdog, the time, and what happened on the way.
#[derive(Clone)]
struct Node {
    dog: Watchdog,
    now: Instant,
    way: Vec<Step>,
}

/// How far it got.
#[derive(Debug, Default)]
pub struct Explored {
    pub depth: usize,
    pub states: usize,
    /// What was broken, with the shortest way to it.
    pub broken: Vec<String>,
}

/// Explores to `depth` steps after the first login, or until so many states were seen.
pub fn explore(limits: &Limits, depth: usize, most_states: usize) -> Explored {
    let now = Instant::now();
    let mut first = Node {
        dog: Watchdog::new(limits.clone(), now),
        now,
        way: Vec::new(),
    };
    first.take(
        Step::Up {
            docked: false,
            percent: 90,
        },
        limits,
    );
    let mut seen = HashSet::from([first.key()]);
    let mut found = Explored::default();
    let mut edge = vec![first];
    while found.depth < depth && !edge.is_empty() && seen.len() < most_states {
        let mut next = Vec::new();
        for (node, step) in edge.iter().flat_map(|node| STEPS.map(|step| (node, step))) {
            let mut node = node.clone();
            let broken = node.take(step, limits).or_else(|| node.comes_home(limits));
            if let Some(what) = broken {
                found.broken.push(format!("{what} after {:?}", node.way));
                if found.broken.len() > 4 {
                    return found;
                }
            } else if seen.len() < most_states && seen.insert(node.key()) {
                next.push(node);
            }
        }
        (edge, found.depth, found.states) = (next, found.depth + 1, seen.len());
    }
    found
}

impl Node {
    /// Takes a step and looks at what the watchdog does: the promise it breaks, if it does.
    fn take(&mut self, step: Step, limits: &Limits) -> Option<String> {
        self.way.push(step);
        if step == Step::Wait {
            let due = self.dog.next_deadline().unwrap_or(self.now);
            self.now = due.max(self.now + Duration::from_millis(20));
        } else {
            apply(step, &mut self.dog, self.now);
        }
        let acts = self.dog.poll(self.now);
        self.judge(&acts, limits)
    }

    /// What must hold of every batch of acts.
    fn judge(&self, acts: &[Act], limits: &Limits) -> Option<String> {
        let low = self.dog.low().is_some();
        for act in acts {
            match act {
                Act::Tell(by, Event::DriveGrant { .. }) if *by != RESCUER => {
                    return Some("the tracks were granted to a script".to_owned());
                }
                Act::Send(Command::Move { left, right }) => {
                    let most = (f64::from(limits.rescue_power.get()) * 0.9).round() as i8;
                    let fast = left.abs().max(right.abs()) > most.max(27);
                    if low && fast {
                        return Some(format!("a low robot drives at {left} {right}"));
                    }
                }
                _ => {}
            }
        }
        let stays = self.dog.docked() || !low;
        if !stays && self.dog.last_words() == LastWords::Stop {
            return Some("low, off the station, and the last words do not send it home".to_owned());
        }
        None
    }

    /// Low, online and off the station: whatever was before, and if nothing more is heard of anybody,
    /// BASE_FIND or a blind move or grant follows within the time that the limits allow.
    fn comes_home(&self, limits: &Limits) -> Option<String> {
        let mut dog = self.dog.clone();
        let mut now = self.now;
        let away = dog.low().is_some() && dog.dock_state() != DockState::Charging;
        if !away || dog.state() == WatchdogState::Offline {
            return None;
        }
        let until = now + liveness(limits);
        while now < until {
            now = dog.next_deadline()?.max(now + Duration::from_millis(10));
            let acts = dog.poll(now);
            if acts.iter().any(goes_home) {
                return None;
            }
        }
        Some("low, and nothing is done to get home".to_owned())
    }

    /// The state with its times counted from now; what is past is past.
    fn key(&self) -> u64 {
        // What it has to report changes nothing that it does.
        let mut dog = self.dog.clone();
        let _ = dog.take_dock_report();
        let text = format!("{dog:?}");
        let mut hasher = DefaultHasher::new();
        let origin = self.now;
        let mut rest = text.as_str();
        while let Some(at) = rest.find("tv_sec: ") {
            rest[..at].hash(&mut hasher);
            let number = |text: &str| {
                let end = text
                    .find(|c: char| !c.is_ascii_digit())
                    .unwrap_or(text.len());
                (text[..end].parse::<i128>().unwrap_or(0), end)
            };
            let after = &rest[at + 8..];
            let (seconds, end) = number(after);
            let nanos_at = end + ", tv_nsec: ".len();
            let (nanos, length) = number(&after[nanos_at..]);
            relative(seconds * 1_000_000_000 + nanos, origin).hash(&mut hasher);
            rest = &after[nanos_at + length..];
        }
        rest.hash(&mut hasher);
        hasher.finish()
    }
}

/// Milliseconds from `origin` to a moment as its debug form gives it; 0 for what is past.
fn relative(nanos: i128, origin: Instant) -> i128 {
    let text = format!("{origin:?}");
    let part = |name: &str| -> i128 {
        let at = text.find(name).map_or(0, |at| at + name.len());
        let digits: String = text[at..]
            .chars()
            .take_while(char::is_ascii_digit)
            .collect();
        digits.parse().unwrap_or(0)
    };
    let origin = part("tv_sec: ") * 1_000_000_000 + part("tv_nsec: ");
    ((nanos - origin) / 1_000_000).max(0)
}

fn goes_home(act: &Act) -> bool {
    match act {
        Act::Send(Command::Engine(Engage::Dock)) => true,
        Act::Send(Command::Move { left, right }) => (*left, *right) != (0, 0),
        _ => false,
    }
}

/// The longest time in which nothing need be seen: a search under way, a charge waited for, a pause.
fn liveness(limits: &Limits) -> Duration {
    let search = limits.dock_timeout.get() + limits.charge_timeout.get();
    let pause = limits.dock_pause.get() + limits.rescue_time.get();
    search + pause + Duration::from_secs(60)
}

fn apply(step: Step, dog: &mut Watchdog, now: Instant) {
    let power = |percent, charging| Power { percent, charging };
    let plan = DockPlan {
        timeout: Duration::from_secs(60),
        retries: 1,
        charge_timeout: Duration::from_secs(10),
    };
    let fact = match step {
        Step::Wait => return,
        Step::Power(percent, charging) => Fact::Power(power(percent, charging)),
        Step::Engine(news) => Fact::Engine(news),
        Step::Up { docked, percent } => Fact::LinkUp {
            docked,
            power: power(percent, false),
        },
        Step::Down => Fact::LinkDown,
        Step::Slept => Fact::Suspended,
        Step::Gone(by) => Fact::Gone(by),
        Step::Rescuer => Fact::Rescuer(Some(RESCUER)),
        Step::Move(by) => {
            let intent = Intent::Move {
                motion: MotionId(1),
                setpoint: Setpoint::from_percent(80.0, 80.0).unwrap(),
                duration: None,
            };
            return dog.request(by, Priority(0), intent, now);
        }
        Step::Stop(by) => return dog.request(by, Priority(0), Intent::Stop, now),
        Step::Dock => {
            let call = CallId(1);
            return dog.request(SCRIPT, Priority(0), Intent::Dock { call, plan }, now);
        }
        Step::CancelDock => return dog.request(SCRIPT, Priority(0), Intent::CancelDock, now),
        Step::Undock => {
            let intent = Intent::Undock {
                call: CallId(2),
                timeout: Duration::from_secs(20),
            };
            return dog.request(SCRIPT, Priority(0), intent, now);
        }
    };
    dog.apply(fact, now);
}
