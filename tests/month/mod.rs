//! Weeks of `serve` in virtual time: a timetable, outages, a robot that is gone for a night, a clock that
//! is set back, power cuts on one data folder, a charging robot. Then the history's own account is held
//! against the simulator's, and what should not grow is measured.

mod compare;

use std::path::Path;
use std::time::Duration;

use jiff::civil::Date;
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp, ToSpan as _, Zoned};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::agent::{Agent, AgentError, BehaviourSpec, Bus, Outcome};
use spykee::clock::{Clock, Span};
use spykee::journal::{Options, RunInfo, SimulationJournal};
use spykee::robot::{Priority, Streams, Use};
use spykee::service::{ManagerNotifier, RecordFile, Service, ServicePlan, View};
use spykee::sim::World;
use spykee::simulation::Simulation;
use spykee::timetable::{Rule, Timetable};
use spykee::{clock, script, simulation};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use self::compare::{Comparison, GroundTruth, LOOK_EVERY, note};
use super::soak::{Ledger, Size};
use super::{begin_fault, behaviour, observed};

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
        let mut troubles = troubles(days, self.seed).into_iter().peekable();
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

/// Days that the journal remembers, and how large it may be.
pub const KEEPS: Options = Options {
    record: spykee::journal::When::On,
    keep_days: 10,
    max_mib: 8,
};
/// A light of the robot that is on for as long as a patrol runs: the robot's own account of runs.
const LIT_WHILE_RUNNING: &str = "robot.led('left', true) \
                         script.on_stop(function() robot.led('left', false) end) ";
const LOOK: &str = "robot.led('right', true)
local frame = robot.wait_frame(5)
local path = if frame then frame:save('look.jpg') else nil
robot.stream('video', false)
journal.add('looked', { seen = path ~= nil })
robot.led('right', false)";

/// A service that runs.
pub struct ServiceFixture {
    stop: CancellationToken,
    service: JoinHandle<Result<Outcome, AgentError>>,
    journal: SimulationJournal,
}

impl ServiceFixture {
    pub fn open(simulation: &Simulation, data: &Path, seed: u64) -> ServiceFixture {
        let bus = Bus::default();
        let about = RunInfo {
            target: "a simulated robot".to_owned(),
            simulated: true,
        };
        let journal = SimulationJournal::start(&bus, data, KEEPS, about);
        let service_plan = service_plan(data, seed);
        let mut plan = simulation.plan(Vec::new());
        plan.stays = true;
        plan.specs = service_plan.specs.clone();
        plan.pilot.settings.waits = true;
        plan.pilot.bus = bus.clone();
        let (agent, status) = Agent::new(plan);
        let service = Service {
            agent,
            status,
            clock: Clock::default(),
            service_plan,
            record: RecordFile::open_in_simulation(data),
            notifier: ManagerNotifier::default(),
            bus,
            view: View::channel().0,
            reloads: mpsc::channel(1).1,
            changes: mpsc::channel(1).1,
        };
        let stop = CancellationToken::new();
        let service = tokio::task::spawn_local(service.run(stop.clone()));
        ServiceFixture {
            stop,
            service,
            journal,
        }
    }

    /// It has ended by itself.
    pub fn is_over(&self) -> bool {
        self.service.is_finished()
    }

    /// Ended without a word: nothing is written any more.
    pub fn cut(self) {
        self.service.abort();
    }

    /// As by SIGTERM.
    pub async fn close(self) -> bool {
        self.stop.cancel();
        let ended = matches!(self.service.await, Ok(Ok(_)));
        self.journal.finish().await;
        ended
    }
}

fn service_plan(data: &Path, seed: u64) -> ServicePlan {
    let patrol = include_str!("../../behaviours/patrol.lua");
    let scripts = [
        ("patrol", format!("{LIT_WHILE_RUNNING}{patrol}")),
        ("look", LOOK.to_owned()),
    ];
    let specs = scripts
        .into_iter()
        .zip(seed..)
        .map(|((name, source), seed)| spec(name, source, seed, data));
    let rule = |run: &str, at: &str, lasts: Option<Duration>| Rule {
        run: run.to_owned(),
        at: at.parse().unwrap(),
        lasts: lasts.map(|lasts| Span::minutes(lasts.as_secs() / 60)),
    };
    ServicePlan {
        specs: specs.collect(),
        fingerprints: Default::default(),
        always: Vec::new(),
        table: Timetable {
            rules: vec![
                rule("patrol", "0 9,21 * * *", Some(PATROL)),
                rule("look", "30 14 * * *", None),
            ],
            zone: "Europe/Rome".parse().unwrap(),
            quiet: Some("22:00-07:00".parse().unwrap()),
            catch_up: Span::minutes(CATCH_UP.as_secs() / 60),
        },
        quiet_alarm: true,
        idle: spykee::config::Service::default(),
    }
}

fn spec(name: &'static str, source: String, seed: u64, data: &Path) -> BehaviourSpec {
    let streams = Streams {
        // A patrol's pictures are not what is tested here.
        video: if name == "patrol" {
            Use::Off
        } else {
            Use::Auto
        },
        ..Streams::default()
    };
    let options = script::Options {
        seed,
        streams,
        data_dir: Some(data.join(name)),
        time_zone: "Europe/Rome".to_owned(),
        ..script::Options::new(name, format!("{name}.lua"))
    };
    BehaviourSpec::new(name, Priority(0), move || {
        Ok(behaviour(source.clone(), options.clone()))
    })
}

/// In Rome: within thirty days its clock goes back by an hour.
const BEGINS: &str = "2026-10-05T08:00:00[Europe/Rome]";
/// A start that was missed by less is made up for.
pub const CATCH_UP: Duration = Duration::from_secs(600);
/// How long a patrol of the timetable lasts.
pub const PATROL: Duration = Duration::from_secs(1800);
const HOUR: u64 = 3600;
const DAY_SECONDS: u64 = 24 * HOUR;

/// The first look at the wall.
pub fn begins() -> Timestamp {
    BEGINS.parse::<Zoned>().unwrap().timestamp()
}

/// Where the wall is.
pub fn rome() -> TimeZone {
    TimeZone::get("Europe/Rome").unwrap()
}

/// What happens to the robot, the network, the computer or its clock.
#[derive(Debug, Clone, PartialEq)]
pub enum Trouble {
    /// A fault of the simulator, for so long; `SECONDS` stands for it.
    Fault(&'static str, Duration),
    /// For so long the robot does not find its station. The link is as good as ever.
    StationUnseen(Duration),
    /// The battery collapses to this, percent.
    Battery(f64),
    /// The computer is dark for so long. The robot hears no last word of it.
    PowerCut(Duration),
    /// The program is killed; its guardian stops the robot. Started again at once.
    Killed,
    /// Somebody sets the clock back by a day.
    ClockBack,
}

/// A trouble and its time since the beginning.
pub type Due = (Duration, Trouble);

const OUTAGES: [&str; 7] = [
    "{ fault: drop }",
    "{ fault: reset }",
    "{ fault: half_open, for: SECONDS }",
    "{ fault: delay, seconds: 0.1, jitter: 0.2, for: SECONDS }",
    "{ fault: reboot, for: SECONDS, state: kept }",
    "{ fault: reboot, for: SECONDS, state: lost }",
    "{ fault: take_over, for: SECONDS }",
];

/// All troubles of so many days, in their order. What must not be missing is in the first two.
pub fn troubles(days: u64, seed: u64) -> Vec<Due> {
    let mut rng = StdRng::seed_from_u64(seed);
    let mut all = Vec::new();
    let minutes = |minutes: u64| Duration::from_secs(minutes * 60);
    let mut wall = Wall::new(begins());
    for day in 0..days {
        let began = Duration::from_secs(day * DAY_SECONDS);
        let gone_at_night = day % 6 == 1;
        // After the change of the clock the wall shows seven when so many days have passed.
        let hour = wall.at(began).to_zoned(rome()).hour();
        let eight = began + minutes(60) * u32::from(hour.abs_diff(8));
        let mut at = |since_eight: u64, trouble: Trouble| {
            let since = eight + Duration::from_secs(since_eight);
            all.push((since, trouble));
        };
        for _ in 0..3 {
            let what = OUTAGES[rng.random_range(0..OUTAGES.len())];
            let seconds = rng.random_range(5..90);
            let lasts = Duration::from_secs(seconds);
            at(
                rng.random_range(0..DAY_SECONDS),
                Trouble::Fault(what, lasts),
            );
        }
        // In the middle of the morning's patrol.
        if day % 2 == 0 {
            at(HOUR + 600, Trouble::PowerCut(minutes(3)));
        }
        if day % 3 == 1 {
            at(HOUR + 700, Trouble::Killed);
        }
        if day % 4 == 1 {
            at(HOUR + 900, Trouble::Battery(18.0));
        }
        // A low robot that finds no station sounds the alarm, in the evening's patrol.
        if matches!(day % 5, 0 | 3) && !gone_at_night {
            at(13 * HOUR + 300, Trouble::StationUnseen(minutes(12)));
            at(13 * HOUR + 310, Trouble::Battery(19.0));
        }
        if day % 6 == 4 {
            let broken = "{ fault: no_charge, for: SECONDS }";
            at(3 * HOUR, Trouble::Fault(broken, minutes(100)));
        }
        // From half past eight in the evening to half past eight in the morning.
        if gone_at_night {
            let gone = "{ fault: reboot, for: SECONDS, state: kept }";
            at(12 * HOUR + 1800, Trouble::Fault(gone, minutes(12 * 60)));
        }
        if day % 10 == 1 {
            at(4 * HOUR, Trouble::ClockBack);
            wall.set_back(eight + minutes(4 * 60), minutes(24 * 60));
        }
        if day % 3 == 2 {
            let dark = minutes(rng.random_range(1..90));
            at(
                rng.random_range(5 * HOUR..12 * HOUR),
                Trouble::PowerCut(dark),
            );
        }
    }
    all.retain(|(at, _)| *at < Duration::from_secs(days * DAY_SECONDS));
    all.sort_by_key(|(at, _)| *at);
    all
}

/// The starts that the timetable wants between two looks at the wall, by the calendar alone: patrols at
/// nine and at twenty-one o'clock, a look at half past fourteen.
pub fn planned(from: Timestamp, until: Timestamp) -> Vec<(Timestamp, &'static str)> {
    let mut all = Vec::new();
    let mut date: Date = from.to_zoned(rome()).date();
    while date <= until.to_zoned(rome()).date() {
        for (hour, minute, run) in [(9, 0, "patrol"), (14, 30, "look"), (21, 0, "patrol")] {
            let wall = date.at(hour, minute, 0, 0).to_zoned(rome()).unwrap();
            all.push((wall.timestamp(), run));
        }
        date = date.checked_add(1.day()).unwrap();
    }
    all.retain(|(at, _)| from < *at && *at <= until);
    all
}

/// What the wall shows, as it was set: from which moment on, and what it showed then.
#[derive(Debug, Clone)]
pub struct Wall(Vec<(Duration, Timestamp)>);

impl Wall {
    pub fn new(begins: Timestamp) -> Wall {
        Wall(vec![(Duration::ZERO, begins)])
    }

    pub fn at(&self, moment: Duration) -> Timestamp {
        let (since, shown) = self.0[self.part_of(moment)];
        shown + SignedDuration::try_from(moment - since).unwrap()
    }

    fn part_of(&self, moment: Duration) -> usize {
        self.0
            .iter()
            .rposition(|(since, _)| *since <= moment)
            .unwrap()
    }

    /// Somebody sets it back; what it shows from now on.
    pub fn set_back(&mut self, moment: Duration, by: Duration) -> Timestamp {
        let shown = self.at(moment) - by;
        self.0.push((moment, shown));
        shown
    }

    /// The moments at which the timetable wants starts, until this one.
    pub fn planned(&self, until: Duration) -> Vec<(Duration, &'static str)> {
        let ends = self
            .0
            .iter()
            .skip(1)
            .map(|(since, _)| *since)
            .chain([until]);
        let parts = self.0.iter().zip(ends);
        let starts = parts.flat_map(|((since, shown), end)| {
            let last = *shown + SignedDuration::try_from(end - *since).unwrap();
            planned(*shown, last).into_iter().map(|(at, run)| {
                let after = Duration::try_from(at.duration_since(*shown)).unwrap();
                (*since + after, run)
            })
        });
        starts.collect()
    }

    /// The moments of a journal's rows, which are in the order in which they were written: a time that
    /// is hours before the one before is of a clock that was set back. The newest are of the last
    /// part; the oldest may be of any, since a journal forgets.
    pub fn moments(&self, rows: impl DoubleEndedIterator<Item = Timestamp>) -> Vec<Duration> {
        let mut part = self.0.len() - 1;
        let mut oldest = Timestamp::MAX;
        let rows = rows.rev().map(|at| {
            let set_back = at.duration_since(oldest) > SignedDuration::from_hours(12);
            if set_back && part > 0 {
                (part, oldest) = (part - 1, at);
            }
            oldest = oldest.min(at);
            let (since, shown) = self.0[part];
            let after = at.duration_since(shown);
            since.saturating_add(Duration::try_from(after).unwrap_or(Duration::ZERO))
        });
        let mut moments: Vec<Duration> = rows.collect();
        moments.reverse();
        moments
    }
}
