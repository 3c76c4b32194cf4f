//! One robot, from its start until it charges or is flat.

use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use spykee::agent::Behaviour;
use spykee::script;
use spykee::sim::{Pose, State};
use spykee::simulation::{self, Event, EventKind, Recorder, Simulation};
use tokio::time::{sleep, timeout};

use super::super::{behaviour, in_parallel};
use super::place::{Place, Start};
use super::strategy::Strategy;

const WANDER: &str = include_str!("wander.lua");

/// Long after every battery is flat, in virtual time.
const LIMIT: Duration = Duration::from_secs(2 * 3600);

/// How long a robot may wander until it is far from home.
const LONGEST_DRIVE: Duration = Duration::from_secs(900);

/// How long it wanders on there: where it comes in, it often still sees its station's beacon.
const STAY: Duration = Duration::from_secs(15);

/// How it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Docked and charging.
    Home,
    /// The battery is at 0.
    Flat,
    /// It has not got far from home before its battery was to become low.
    NeverAway,
    /// Neither, when the time was over.
    OnItsWay,
}

/// What the watchdog did meanwhile.
#[derive(Debug, Clone, Copy, Default)]
pub struct Efforts {
    pub searches: usize,
    pub blind_moves: usize,
    pub grants: usize,
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
fn play(place: &Place, strategy: Strategy, mut start: Start) -> Played {
    let efforts = Arc::new(Mutex::new(Efforts::default()));
    let count = efforts.clone();
    let options = simulation::Options {
        seed: start.seed,
        limits: strategy.limits(),
        events: Some(Recorder::new(move |event| {
            count.lock().unwrap().count(&event)
        })),
        ..simulation::Options::default()
    };
    let (state, took) = simulation::run(
        place.world.clone(),
        options,
        async |simulation: &Simulation| {
            simulation.sim().place(start.pose);
            let run = match start.drives {
                None => simulation.start(vec![script("idle", "task.wait(1e6)", 0)], None),
                Some(least) => {
                    simulation.sim().set_battery(90.0);
                    let run = simulation.start(vec![script("wander", WANDER, start.seed)], None);
                    match drive_away(place, simulation, least).await {
                        Some((pose, way)) => (start.pose, start.way) = (pose, way),
                        None => return (simulation.sim().state(), None),
                    }
                    run
                }
            };
            simulation.sim().set_battery(start.battery);
            let began = simulation.now();
            let over = |state: &State| is_home(state) || state.battery <= 0.0;
            // Whether it came or not: the state says how it is.
            let _ = timeout(LIMIT, simulation.sim().wait_state(over)).await;
            drop(run);
            (simulation.sim().state(), Some(simulation.now() - began))
        },
    )
    .unwrap();
    let efforts = *efforts.lock().unwrap();
    Played {
        start,
        end: took.map_or(End::NeverAway, |_| end_of(&state)),
        took: took.unwrap_or_default(),
        battery: state.battery,
        pose: state.pose,
        efforts,
    }
}

/// Lets the robot wander for so long at least, until it is far from home and has been there for a while:
/// where it is then, and its way.
async fn drive_away(
    place: &Place,
    simulation: &Simulation,
    least: Duration,
) -> Option<(Pose, f64)> {
    let far = |state: &State| !state.docked && place.far_from_home(state.pose.point()).is_some();
    let wander = async {
        sleep(least).await;
        loop {
            simulation.sim().wait_state(far).await;
            sleep(STAY).await;
            let state = simulation.sim().state();
            if let Some(way) = place.far_from_home(state.pose.point()) {
                return (state.pose, way);
            }
        }
    };
    timeout(LONGEST_DRIVE, wander).await.ok()
}

/// Plays all starts on so many threads; `told` hears each time how many are done.
pub fn play_all(
    place: &Place,
    strategy: Strategy,
    starts: &[Start],
    threads: usize,
    told: &(dyn Fn(usize) + Sync),
) -> Vec<Played> {
    let done = AtomicUsize::new(0);
    in_parallel(starts, threads, |start| {
        let played = play(place, strategy, *start);
        told(done.fetch_add(1, Ordering::Relaxed) + 1);
        played
    })
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

fn script(name: &str, source: &str, seed: u64) -> Behaviour {
    let options = script::Options {
        seed,
        ..script::Options::new(name, format!("{name}.lua"))
    };
    behaviour(source, options)
}

impl Efforts {
    fn count(&mut self, event: &Event) {
        match event.kind {
            EventKind::Heard => self.searches += usize::from(event.text == "Engine(Dock)"),
            EventKind::Safety => {
                self.blind_moves += usize::from(event.text.contains("makes short blind move"));
                self.grants += usize::from(event.text.contains("a rescue behaviour may drive"));
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
            End::NeverAway => "never far from home",
            End::OnItsWay => "still on its way",
        };
        write!(
            f,
            "{} {:>5.1} % {:>4.1} m to go  {end:<16} {:>5.0} s {:>5.1} %  {}  \
             {:>3} searches {:>3} blind moves {:>3} grants",
            Spot(start.pose),
            start.battery,
            start.way,
            self.took.as_secs_f64(),
            self.battery,
            Spot(self.pose),
            efforts.searches,
            efforts.blind_moves,
            efforts.grants,
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
