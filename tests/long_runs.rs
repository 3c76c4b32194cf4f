//! What the long runs share: `soak`, `month`, `rescue`, `stops` and `stuck` play an agent on a simulated robot,
//! `explore` the watchdog alone; all in virtual time, except `stops::breaks`. `tests/it` plays a short one of each, `scripts/nightly` the rest.

pub mod explore;
#[path = "worlds/mod.rs"]
pub mod flats;
pub mod month;
pub mod rescue;
pub mod soak;
pub mod stops;
pub mod stuck;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use spykee::agent::Behaviour;
use spykee::behaviour::{Launch, Library};
use spykee::robot::Priority;
use spykee::script;
use spykee::sim::{Fault, Handle, World};
use spykee::simulation::{self, Event, Recorder};

/// A behaviour that is started once, with the ready-made modules.
pub fn behaviour(source: impl Into<Vec<u8>>, options: script::Options) -> Behaviour {
    Behaviour {
        priority: Priority(0),
        launch: Launch {
            source: source.into(),
            options,
            library: Library::new(concat!(env!("CARGO_MANIFEST_DIR"), "/behaviours").into()),
        },
        checked: false,
        restart: "never".parse().unwrap(),
        reloads: None,
    }
}

/// What scripts, watchdog and robot did since the last look.
pub struct Events(Mutex<Receiver<Event>>);

impl Events {
    pub fn take(&mut self) -> Vec<Event> {
        self.0.get_mut().unwrap().try_iter().collect()
    }
}

/// A simulation whose events are kept for an observer. All faults come from the test.
pub fn observed(seed: u64, sim: spykee::sim::Options) -> (simulation::Options, Events) {
    let (sender, events) = std::sync::mpsc::sync_channel(100_000);
    let options = simulation::Options {
        seed,
        events: Some(Recorder::new(move |event| drop(sender.try_send(event)))),
        sim: spykee::sim::Options {
            faults: Some(Vec::new()),
            ..sim
        },
        ..simulation::Options::default()
    };
    (options, Events(Mutex::new(events)))
}

/// The YAML of [`two_rooms`].
pub const TWO_ROOMS: &str = include_str!("soak/world.yaml");

/// The world in which robots are alone for weeks and are rescued: two rooms, a small battery.
pub fn two_rooms() -> World {
    World::from_yaml(TWO_ROOMS, "soak").unwrap()
}

/// Begins a fault of the simulator; `SECONDS` stands for how long it lasts.
pub fn begin_fault(sim: &Handle, fault: &str, lasts: Duration) {
    let fault = fault.replace("SECONDS", &lasts.as_secs_f64().to_string());
    let faults = Fault::list_from_yaml(&format!("faults: [ {fault} ]"), "long run").unwrap();
    faults.into_iter().for_each(|fault| sim.begin(fault));
}

/// Does all jobs on so many threads; returns the results in the order of the jobs.
pub fn in_parallel<Job: Sync, Done: Send>(
    jobs: &[Job],
    threads: usize,
    work: impl Fn(&Job) -> Done + Sync,
) -> Vec<Done> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads.min(jobs.len()) {
            scope.spawn(|| {
                while let Some((at, job)) = numbered(jobs, next.fetch_add(1, Ordering::Relaxed)) {
                    let result = work(job);
                    done.lock().unwrap().push((at, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap();
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, result)| result).collect()
}

fn numbered<Job>(jobs: &[Job], at: usize) -> Option<(usize, &Job)> {
    jobs.get(at).map(|job| (at, job))
}
