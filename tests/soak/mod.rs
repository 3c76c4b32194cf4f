//! Weeks alone, in virtual time: patrol and guard on a robot whose network, station and battery fail
//! again and again, by lot, beside a script that itself fails. An observer looks at the robot five times
//! a second and keeps a ledger of promises.

mod fault_feed;
mod homing_episode;
mod ledger;
mod observer;
mod process;

use std::path::Path;
use std::time::Duration;

use spykee::agent::Behaviour;
use spykee::robot::Priority;
use spykee::script;
use spykee::sim::Firmware;
use spykee::simulation::{self, Simulation};
use tokio::time::{Instant, sleep, timeout};

use super::{behaviour, observed, two_rooms};
use fault_feed::FaultFeed;
pub use ledger::Ledger;
use observer::{LOOK_EVERY, Observer};
pub use process::Size;

/// An hour without one of these put to the test proves nothing.
pub const CORE: [&str; 4] = [
    ledger::HOME,
    "the first command of every connection is a stop",
    "low and off the station: no script moves the robot",
    "patrol and guard never fail",
];

/// Tells how far it is, after each virtual hour: hours, restarts so far, size.
pub type Progress<'a> = &'a mut (dyn FnMut(u64, &Size) + Send);

/// How long a run may take to end, in virtual time: two seconds, as the README says, and a look.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(2300);
/// Before this the process is still growing into its buffers.
const WARM: Duration = Duration::from_secs(20 * 60);

/// Runs for so many virtual hours on a robot with this firmware. Data of the behaviours goes to `folder`.
pub fn soak(
    hours: u64,
    seed: u64,
    firmware: &Firmware,
    folder: &Path,
    progress: Progress<'_>,
) -> Ledger {
    let sim = spykee::sim::Options {
        // Enough for the rescue behaviour to find its way; a robot's camera sends more.
        fps: Some(5.0),
        firmware: firmware.clone(),
        ..spykee::sim::Options::default()
    };
    let (options, events) = observed(seed, sim);
    let behaviours = behaviours(seed, folder);
    simulation::run(two_rooms(), options, async |simulation: &Simulation| {
        let run = simulation.start(behaviours, None);
        let mut observer = Observer::new(simulation, events, firmware.power_late);
        let mut faults = FaultFeed::new(seed);
        let began = Instant::now();
        let mut first = None;
        let mut hour = 0;
        while began.elapsed() < Duration::from_secs(hours * 3600) {
            sleep(LOOK_EVERY).await;
            if let Some(what) = faults.blow(simulation.sim(), began.elapsed()) {
                observer.trouble(simulation.now(), &what);
            }
            observer.look(simulation, &faults);
            if first.is_none() && began.elapsed() >= WARM {
                first = Some(Size::now());
            }
            if began.elapsed().as_secs() / 3600 > hour {
                hour += 1;
                progress(hour, &Size::now());
            }
        }
        if let Some(first) = first {
            first.compare(&Size::now(), observer.ledger());
        }
        faults.clear(simulation.sim());
        // Whatever is wrong with the link just now: it comes back.
        let up = simulation.sim().wait_state(|state| state.user.is_some());
        let up = timeout(Duration::from_secs(120), up).await.is_ok();
        observer.ledger().note(
            "once nothing is wrong any more, the agent is back within 2 minutes",
            (!up).then(|| "it is not".to_owned()),
        );
        run.stop();
        let ended = timeout(SHUTDOWN_TIMEOUT, run.outcome()).await.is_ok();
        observer.ledger().note(
            "told to end, it has ended within 2 s",
            (!ended).then(|| "it had not".to_owned()),
        );
        sleep(Duration::from_secs(1)).await;
        let state = simulation.sim().state();
        let still = !state.moving() || state.searching;
        observer.ledger().note(
            "at the end the robot stands still, or drives home by itself",
            (!still).then(|| format!("tracks at {:?}", state.speeds)),
        );
        observer.into_ledger()
    })
    .unwrap()
}

/// The patrol, the guard, and one above them that fails.
fn behaviours(seed: u64, folder: &Path) -> Vec<Behaviour> {
    [
        ("patrol", include_str!("../../behaviours/patrol.lua"), 0),
        ("guard", include_str!("../../behaviours/guard.lua"), 0),
        ("restless", include_str!("restless.lua"), 5),
    ]
    .into_iter()
    .zip(seed..)
    .map(|((name, source, priority), seed)| {
        let options = script::Options {
            seed,
            data_dir: Some(folder.join(name)),
            ..script::Options::new(name, format!("{name}.lua"))
        };
        Behaviour {
            priority: Priority(priority),
            restart: "on-failure".parse().unwrap(),
            ..behaviour(source, options)
        }
    })
    .collect()
}
