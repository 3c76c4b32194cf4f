//! One robot, from its start until it charges or is flat.

use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use spykee::agent::Behaviour;
use spykee::behaviour::{Launch, Library};
use spykee::lab::{self, Event, EventKind, Lab, Recorder};
use spykee::robot::Priority;
use spykee::script;
use spykee::sim::{Pose, State};
use tokio::time::timeout;

use super::place::{Place, Start};
use super::strategy::Strategy;

/// Long after every battery is flat, in virtual time.
const LIMIT: Duration = Duration::from_secs(2 * 3600);

/// How it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Docked and charging.
    Home,
    /// The battery is at 0.
    Flat,
    /// Neither, when the time was over.
    OnItsWay,
}

/// What the watchdog did meanwhile.
#[derive(Debug, Clone, Copy, Default)]
pub struct Efforts {
    pub searches: usize,
    pub legs: usize,
    pub loans: usize,
}

/// One start and its outcome.
#[derive(Debug, Clone, Copy)]
pub struct Played {
    pub start: Start,
    pub end: End,
    pub took: Duration,
    /// At the end.
    pub battery: f64,
    /// At the end.
    pub pose: Pose,
    pub efforts: Efforts,
}

/// Plays one start.
fn play(place: &Place, strategy: Strategy, start: Start) -> Played {
    let efforts = Arc::new(Mutex::new(Efforts::default()));
    let count = efforts.clone();
    let options = lab::Options {
        seed: start.seed,
        limits: strategy.limits(),
        events: Some(Recorder::new(move |event| {
            count.lock().unwrap().count(&event)
        })),
        ..lab::Options::default()
    };
    let (state, took) = lab::run(place.world.clone(), options, async |lab: &Lab| {
        lab.sim().place(start.pose);
        lab.sim().set_battery(start.battery);
        let run = lab.start(vec![idle()], None);
        let over = |state: &State| is_home(state) || state.battery <= 0.0;
        // Whether it came or not: the state says how it is.
        let _ = timeout(LIMIT, lab.sim().wait_state(over)).await;
        drop(run);
        (lab.sim().state(), lab.now())
    })
    .unwrap();
    let efforts = *efforts.lock().unwrap();
    Played {
        start,
        end: end_of(&state),
        took,
        battery: state.battery,
        pose: state.pose,
        efforts,
    }
}

/// Plays all starts on so many threads; `told` hears each time how many are done.
pub fn play_all(
    place: &Place,
    strategy: Strategy,
    starts: &[Start],
    threads: usize,
    told: &(dyn Fn(usize) + Sync),
) -> Vec<Played> {
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((at, start)) = take(starts, &next) {
                    let played = play(place, strategy, start);
                    let mut done = done.lock().unwrap();
                    done.push((at, played));
                    told(done.len());
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap();
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, played)| played).collect()
}

fn take(starts: &[Start], next: &AtomicUsize) -> Option<(usize, Start)> {
    let at = next.fetch_add(1, Ordering::Relaxed);
    Some((at, *starts.get(at)?))
}

fn is_home(state: &State) -> bool {
    state.docked && state.charging
}

fn end_of(state: &State) -> End {
    if is_home(state) {
        End::Home
    } else if state.battery <= 0.0 {
        End::Flat
    } else {
        End::OnItsWay
    }
}

/// A behaviour that lets the watchdog do it alone.
fn idle() -> Behaviour {
    Behaviour {
        priority: Priority(0),
        launch: Launch {
            source: "task.wait(1e6)".into(),
            options: script::Options::new("idle", "idle.lua"),
            library: Library::default(),
        },
        checked: false,
        restart: "never".parse().unwrap(),
        reloads: None,
    }
}

impl Efforts {
    fn count(&mut self, event: &Event) {
        match event.kind {
            EventKind::Heard => self.searches += usize::from(event.text == "Engine(Dock)"),
            EventKind::Safety => {
                self.legs += usize::from(event.text.contains("drives short leg"));
                self.loans += usize::from(event.text.contains("a rescue behaviour may drive"));
            }
            _ => {}
        }
    }
}

impl Played {
    pub fn is_home(&self) -> bool {
        self.end == End::Home
    }
}

/// One line: from where with how much, how long, to where.
impl fmt::Display for Played {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Played { start, efforts, .. } = self;
        let end = match self.end {
            End::Home => "home",
            End::Flat => "flat",
            End::OnItsWay => "still on its way",
        };
        write!(
            f,
            "{} {:>5.1} % {:>4.1} m to go  {end:<16} {:>5.0} s {:>5.1} %  {}  \
             {:>3} searches {:>3} legs {:>3} loans",
            Spot(start.pose),
            start.battery,
            start.way,
            self.took.as_secs_f64(),
            self.battery,
            Spot(self.pose),
            efforts.searches,
            efforts.legs,
            efforts.loans,
        )
    }
}

/// A pose for people.
struct Spot(Pose);

impl fmt::Display for Spot {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Pose { x, y, heading } = self.0;
        write!(f, "({x:>4.2}, {y:>4.2}) {:>4.0}°", heading.to_degrees())
    }
}
