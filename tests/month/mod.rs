//! Weeks of `serve` in virtual time: a timetable, outages, a robot that is gone for a night, a clock that
//! is set back, power cuts on one data folder, a charging robot. Then the history's own account is held
//! against the simulator's, and what should not grow is measured.

mod calendar;
mod compare;
mod ground_truth;
mod service_fixture;

use std::path::Path;
use std::time::Duration;

use spykee::clock;
use spykee::sim::World;
use spykee::simulation::{self, Simulation};
use tokio::time::sleep;

use super::soak::{Ledger, Size};
use super::{begin_fault, observed};
use calendar::{Trouble, Wall, begins};
use compare::Comparison;
use ground_truth::{GroundTruth, LOOK_EVERY, note};
use service_fixture::{KEEPS, ServiceFixture};

/// A month without one of these put to the test proves nothing.
pub const CORE: [&str; 14] = [
    compare::RUNS,
    compare::NO_OTHERS,
    compare::STARTS,
    compare::ENDS,
    compare::NO_REASON,
    compare::DOCKS,
    compare::DOCKED,
    compare::ALARMS,
    compare::ALARMED,
    compare::LEVELS,
    compare::BATTERY_RECORDED,
    compare::MINUTES,
    compare::SCRIPT_ROWS_RECORDED,
    RESUMES,
];
const RESUMES: &str = "after a power cut the patrol goes on with the leg that it had not finished";
const LIVES: &str = "the service ends only when it is told to";
const JOURNAL_BOUNDED: &str = "the journal stays within its size, and forgets what is too old";
const FILES: &str = "files do not pile up in the data folder, pictures aside, which have a budget";
const BACK: &str = "no error but those of robots that are gone";

const DAY: Duration = Duration::from_secs(86_400);
/// The process is as large as it gets.
const WARM: Duration = Duration::from_secs(6 * 3600);
/// The station is there, and the robot does not see it.
const UNSEEN: &str = "{ fault: base_not_found, for: SECONDS }";
/// A computer that is switched off says nothing to the robot.
const SILENT: &str = "{ fault: half_open, for: SECONDS }";

/// Tells how far it is, after each virtual day.
pub type Progress<'a> = &'a mut (dyn FnMut(u64, &Size, u64) + Send);

/// The service, and what surrounds it.
struct Month<'a> {
    simulation: &'a Simulation,
    data: &'a Path,
    seed: u64,
    service_fixture: Option<ServiceFixture>,
    truth: GroundTruth,
    wall: Wall,
    ledger: Ledger,
}

/// So many days of service on this data folder.
pub fn serve(days: u64, seed: u64, data: &Path, progress: Progress<'_>) -> Ledger {
    let world = World::from_yaml(include_str!("world.yaml"), "month").unwrap();
    let sim = spykee::sim::Options {
        fps: Some(1.0),
        ..spykee::sim::Options::default()
    };
    let (options, events) = observed(seed, sim);
    let begins = begins();
    let options = simulation::Options {
        date: Some(begins),
        ..options
    };
    simulation::run(world, options, async |simulation: &Simulation| {
        let mut month = Month {
            simulation,
            data,
            seed,
            service_fixture: Some(ServiceFixture::open(simulation, data, seed)),
            truth: GroundTruth::new(events),
            wall: Wall::new(begins),
            ledger: Ledger::default(),
        };
        note(&mut month.truth.alive, Duration::ZERO, true);
        month.live(days, progress).await;
        month.judge(days).await
    })
    .unwrap()
}

impl Month<'_> {
    async fn live(&mut self, days: u64, progress: Progress<'_>) {
        let mut troubles = calendar::troubles(days, self.seed).into_iter().peekable();
        let mut day = 0;
        let mut first = None;
        while self.simulation.now() < DAY * u32::try_from(days).unwrap() {
            let now = self.simulation.now();
            while let Some((_, trouble)) = troubles.next_if(|(at, _)| *at <= now) {
                self.happen(trouble).await;
            }
            self.pass(LOOK_EVERY).await;
            if first.is_none() && now >= WARM {
                first = Some(Size::now());
            }
            if now >= DAY * (day + 1) {
                day += 1;
                progress(u64::from(day), &Size::now(), folder_bytes(self.data));
            }
        }
        if let Some(first) = first {
            first.compare(&Size::now(), &mut self.ledger);
        }
    }

    /// Time passes, and the robot is looked at.
    async fn pass(&mut self, time: Duration) {
        let until = self.simulation.now() + time;
        while self.simulation.now() < until {
            sleep(LOOK_EVERY).await;
            self.truth.look(self.simulation);
        }
        let over = self
            .service_fixture
            .as_ref()
            .is_some_and(ServiceFixture::is_over);
        let now = self.simulation.now();
        self.ledger
            .note(LIVES, over.then(|| format!("it had ended at {now:.0?}")));
        if over {
            self.service_fixture =
                Some(ServiceFixture::open(self.simulation, self.data, self.seed));
        }
    }

    async fn happen(&mut self, trouble: Trouble) {
        let sim = self.simulation.sim();
        let now = self.simulation.now();
        match trouble {
            Trouble::Fault(fault, lasts) => {
                begin_fault(sim, fault, lasts);
                self.truth.trouble(now, lasts);
            }
            Trouble::StationUnseen(lasts) => begin_fault(sim, UNSEEN, lasts),
            Trouble::Battery(percent) => sim.set_battery(percent.min(sim.state().battery)),
            Trouble::PowerCut(dark) => {
                begin_fault(sim, SILENT, Duration::from_secs(20));
                self.truth.trouble(now, dark);
                self.cut(dark).await;
            }
            Trouble::Killed => {
                self.truth.trouble(now, Duration::ZERO);
                self.cut(Duration::from_secs(2)).await;
            }
            Trouble::ClockBack => {
                let shown = self.wall.set_back(now, DAY);
                clock::begin_virtual(Some(shown));
            }
        }
    }

    /// The service ends without a word, and is there again after so long.
    async fn cut(&mut self, dark: Duration) {
        let before = self.truth.legs.last().map(|(_, leg)| leg.clone());
        let patrols = self.truth.lights.last().is_some_and(|(_, on)| *on);
        if let Some(service_fixture) = self.service_fixture.take() {
            service_fixture.cut();
        }
        note(&mut self.truth.alive, self.simulation.now(), false);
        self.pass(dark).await;
        let now = self.simulation.now();
        note(&mut self.truth.alive, now, true);
        self.service_fixture = Some(ServiceFixture::open(self.simulation, self.data, self.seed));
        if !patrols || dark > Duration::from_secs(600) {
            return;
        }
        // It may have been at home, where it charges first.
        let until = now + Duration::from_secs(1200);
        while self.simulation.now() < until
            && self.truth.legs.last().is_none_or(|(at, _)| *at < now)
        {
            self.pass(LOOK_EVERY).await;
        }
        let after = self.truth.legs.last().filter(|(at, _)| *at >= now);
        if let (Some(before), Some((_, after))) = (before, after) {
            let kept = *after == before || *after == next(&before);
            self.ledger.note(
                RESUMES,
                (!kept).then(|| format!("at {now:.0?}: {after} after {before}")),
            );
        }
    }

    async fn judge(mut self, days: u64) -> Ledger {
        self.simulation.sim().clear_faults();
        self.pass(Duration::from_secs(300)).await;
        let until = self.simulation.now();
        let service_fixture = self.service_fixture.take().unwrap();
        note(&mut self.truth.alive, until, false);
        let ended = service_fixture.close().await;
        self.ledger
            .note(LIVES, (!ended).then(|| "it did not end well".to_owned()));
        let kept = Duration::from_secs(KEEPS.keep_days * 86_400);
        // What was set back is a day younger, and is looked over each hour.
        let since = until.saturating_sub(kept.saturating_sub(DAY + DAY / 12));
        Comparison {
            truth: &self.truth,
            wall: &self.wall,
            ledger: &mut self.ledger,
            until,
            since,
        }
        .make(self.data);
        let errors = self.truth.errors.iter();
        let broken = errors.filter(|text| text.contains("internal") || text.contains("panic"));
        let broken: Vec<&String> = broken.collect();
        self.ledger
            .note(BACK, broken.first().map(|text| (*text).clone()));
        self.sizes(days);
        self.ledger
    }

    fn sizes(&mut self, days: u64) {
        let journal = self.data.join(".journal");
        let bytes = folder_bytes(&journal);
        let most = KEEPS.max_mib * (1 << 20);
        self.ledger.note(
            JOURNAL_BOUNDED,
            (bytes > most).then(|| format!("{bytes} bytes after {days} days")),
        );
        let mut files = files(self.data);
        files.retain(|path| path.extension().is_none_or(|kind| kind != "jpg"));
        // The journal's three at most, the record, a store, and what may be beside them.
        self.ledger.note(
            FILES,
            (files.len() > 12).then(|| format!("{} files", files.len())),
        );
    }
}

/// The leg after `round 2, leg 4`, of four.
fn next(leg: &str) -> String {
    let numbers = leg.split(|c: char| !c.is_ascii_digit());
    let numbers: Vec<u64> = numbers.filter_map(|part| part.parse().ok()).collect();
    match numbers[..] {
        [round, 4] => format!("round {}, leg 1", round + 1),
        [round, leg] => format!("round {round}, leg {}", leg + 1),
        _ => leg.to_owned(),
    }
}

fn files(folder: &Path) -> Vec<std::path::PathBuf> {
    let mut all = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        match entry.path().is_dir() {
            true => all.extend(files(&entry.path())),
            false => all.push(entry.path()),
        }
    }
    all
}

/// What is in a folder, in bytes.
pub fn folder_bytes(folder: &Path) -> u64 {
    let files = files(folder);
    let bytes = files.iter().filter_map(|file| file.metadata().ok());
    bytes.map(|file| file.len()).sum()
}
