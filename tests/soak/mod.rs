//! Weeks alone, in virtual time: patrol and guard on a robot whose network, station and battery fail
//! again and again, by lot, beside a script that itself fails. An observer looks at the robot five times
//! a second and keeps a ledger of promises.

mod observer;

use std::collections::VecDeque;
use std::fmt;
use std::path::Path;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::agent::Behaviour;
use spykee::robot::Priority;
use spykee::sim::{Firmware, Handle, Pose};
use spykee::simulation::Simulation;
use spykee::{script, simulation};
use tokio::time::{Instant, sleep, timeout};

use self::observer::{LOOK_EVERY, Observer};
use super::{begin_fault, behaviour, observed, two_rooms};

/// An hour without one of these put to the test proves nothing.
pub const CORE: [&str; 4] = [
    HOME,
    "the first command of every connection is a stop",
    "low and off the station: no script moves the robot",
    "patrol and guard never fail",
];

/// Tells how far it is, after each virtual hour: hours, restarts so far, size.
pub type Progress<'a> = &'a mut (dyn FnMut(u64, &Size) + Send);

/// How long a run may take to end, in virtual time: two seconds, as the book says, and a look.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_millis(2300);
/// Before this the process is still growing into its buffers.
const WARM: Duration = Duration::from_secs(20 * 60);

/// Runs for so much virtual time on a robot with this firmware. Data of the behaviours goes to `folder`.
pub fn soak(
    lasts: Duration,
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
        while began.elapsed() < lasts {
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

/// From one trouble to the next, at most; in seconds.
const LONGEST_CALM: f64 = 240.0;
/// After the end of a trouble things need a while to be as they were.
const AFTERMATH: Duration = Duration::from_secs(45);

/// In place of `SECONDS` comes how long.
const FAULTS: [&str; 21] = [
    "{ fault: delay, seconds: 0.2, jitter: 0.3, for: SECONDS }",
    "{ fault: delay, seconds: 0.05, jitter: 0.1, towards: client, for: SECONDS }",
    "{ fault: split, for: SECONDS }",
    "{ fault: drip, bytes: 4000, for: SECONDS }",
    "{ fault: half_open, for: SECONDS }",
    "{ fault: half_open, towards: robot, for: SECONDS }",
    "{ fault: drop }",
    "{ fault: reset }",
    "{ fault: garbage, bytes: 300 }",
    "{ fault: length_lie }",
    "{ fault: huge_frames, for: SECONDS }",
    "{ fault: truncated_frames, for: SECONDS }",
    "{ fault: flipped_frames, bytes: 40, for: SECONDS }",
    "{ fault: no_power, for: SECONDS }",
    "{ fault: power_garbage, chance: 0.3, for: SECONDS }",
    "{ fault: reboot, for: SECONDS, state: lost }",
    "{ fault: reboot, for: SECONDS, state: kept }",
    "{ fault: refuse_login, for: SECONDS }",
    "{ fault: take_over, for: SECONDS }",
    "{ fault: base_not_found, for: SECONDS }",
    "{ fault: no_charge, for: SECONDS }",
];

/// All that may go wrong.
pub struct FaultFeed {
    rng: StdRng,
    next: Duration,
    bad_until: Duration,
    carried: bool,
    pub troubles: u64,
}

impl FaultFeed {
    pub fn new(seed: u64) -> FaultFeed {
        FaultFeed {
            rng: StdRng::seed_from_u64(seed),
            next: Duration::from_secs(120),
            bad_until: Duration::ZERO,
            carried: false,
            troubles: 0,
        }
    }

    /// Lets something go wrong when its time has come, and says what.
    pub fn blow(&mut self, sim: &Handle, now: Duration) -> Option<String> {
        self.carried = false;
        if now < self.next {
            return None;
        }
        let seconds = self.rng.random_range(1.0..20.0_f64).round();
        self.troubles += 1;
        if self.rng.random_bool(0.1) {
            // An old battery that collapses, never to more than it had. Nothing else is wrong.
            let rest: f64 = self.rng.random_range(15.0..20.0);
            sim.set_battery(rest.min(sim.state().battery));
            self.next = now + Duration::from_secs(300);
            return Some("the battery collapses".to_owned());
        }
        let what = if self.rng.random_bool(0.08) {
            let x = self.rng.random_range(1.2..3.2);
            let y = self.rng.random_range(1.6..3.4);
            let heading = self.rng.random_range(-3.0..3.0);
            sim.place(Pose { x, y, heading });
            self.carried = true;
            self.bad_until = now;
            "the robot is carried away".to_owned()
        } else {
            let text = FAULTS[self.rng.random_range(0..FAULTS.len())];
            let lasts = Duration::from_secs_f64(seconds);
            begin_fault(sim, text, lasts);
            self.bad_until = now + lasts;
            text.replace("SECONDS", &seconds.to_string())
        };
        let calm = self.rng.random_range(10.0..LONGEST_CALM);
        self.next = self.bad_until + Duration::from_secs_f64(calm);
        Some(what)
    }

    /// Nothing is wrong, and has not been for a while.
    pub fn is_calm(&self, now: Duration) -> bool {
        self.troubles == 0 || now > self.bad_until + AFTERMATH
    }

    /// A fault is on at this moment.
    pub fn is_bad(&self, now: Duration) -> bool {
        now < self.bad_until
    }

    /// The robot was carried somewhere at this moment.
    pub fn has_carried(&self) -> bool {
        self.carried
    }

    /// The end of all troubles.
    pub fn clear(&self, sim: &Handle) {
        sim.clear_faults();
    }
}

/// Memory, threads and descriptors.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    resident_kib: u64,
    threads: u64,
    descriptors: u64,
}

impl Size {
    /// As the kernel has it.
    pub fn now() -> Size {
        let status = std::fs::read_to_string("/proc/self/status").unwrap();
        let field = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            let number = line.and_then(|line| line.split_whitespace().next());
            number.and_then(|number| number.parse().ok()).unwrap_or(0)
        };
        Size {
            resident_kib: field("VmRSS:"),
            threads: field("Threads:"),
            descriptors: std::fs::read_dir("/proc/self/fd").unwrap().count() as u64,
        }
    }

    /// Notes whether it has grown since. Threads that write pictures and stores come and go, so threads
    /// and descriptors get some room, and memory a quarter and 16 MiB.
    pub fn compare(&self, later: &Size, ledger: &mut Ledger) {
        let mut compare = |promise, unit: &str, from: u64, to: u64, most: u64| {
            let grown = format!("{unit}: {from} after the warm-up, {to} at the end");
            ledger.note(promise, (to > most).then_some(grown));
        };
        let before = self.resident_kib;
        let room = self.resident_kib / 4 + 16 * 1024;
        compare(
            "memory does not grow",
            "KiB",
            before,
            later.resident_kib,
            before + room,
        );
        let before = self.threads;
        compare(
            "threads do not pile up",
            "threads",
            before,
            later.threads,
            before + 4,
        );
        let before = self.descriptors;
        let after = later.descriptors;
        compare(
            "descriptors do not pile up",
            "descriptors",
            before,
            after,
            before + 16,
        );
    }
}

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Size {
            resident_kib,
            threads,
            descriptors,
        } = self;
        write!(
            f,
            "{resident_kib:>6} KiB  {threads:>3} threads  {descriptors:>3} descriptors"
        )
    }
}

/// The promise that each robot which runs flat puts to the test.
pub const HOME: &str = "never flat off the station while a way exists and the energy suffices";

/// A robot that ran flat off its station.
#[derive(Debug, Clone)]
pub struct Loss {
    /// A way was there, and time and charge for it.
    pub avoidable: bool,
    /// One paragraph.
    pub story: String,
}

/// One promise.
#[derive(Debug, Clone)]
pub struct Promise {
    pub words: &'static str,
    /// How often it was looked at where it could have been broken.
    pub tested: u64,
    /// When it was broken, and how; of very many only the first.
    pub broken: Vec<String>,
    breaks: u64,
    /// What had happened before it was broken for the first time.
    before: Vec<String>,
}

/// Breaks that are kept in words.
const MAX_KEPT: usize = 5;
/// What happened last, so that a break can be understood.
const RECENT: usize = 60;

/// All of them, by name.
#[derive(Debug, Clone, Default)]
pub struct Ledger {
    promises: Vec<Promise>,
    losses: Vec<Loss>,
    recent: VecDeque<String>,
}

impl Ledger {
    /// Remembers what happened, for a while.
    pub fn happened(&mut self, text: String) {
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(text);
    }

    /// Notes that a promise was looked at, and how it was broken if it was.
    pub fn note(&mut self, words: &'static str, broken: Option<String>) {
        let recent = broken.is_some().then(|| self.recent.clone());
        let promise = self.promise(words);
        promise.tested += 1;
        if let Some(how) = broken {
            promise.breaks += 1;
            if promise.breaks == 1 {
                promise.before = recent.into_iter().flatten().collect();
            }
            promise.keep(how);
        }
    }

    /// Notes that a robot ran flat off its station. If it could have come home, a promise is broken.
    pub fn lose(&mut self, Loss { avoidable, story }: Loss) {
        let name = format!("loss {}", self.losses.len() + 1);
        self.note(HOME, avoidable.then(|| name.clone()));
        let story = format!("{name}: {story}");
        self.losses.push(Loss { avoidable, story });
    }

    /// Adds what another run found, under its name.
    pub fn add(&mut self, name: &str, other: Ledger) {
        for theirs in other.promises {
            let ours = self.promise(theirs.words);
            if ours.breaks == 0 {
                ours.before = theirs.before;
            }
            ours.tested += theirs.tested;
            ours.breaks += theirs.breaks;
            let named = theirs
                .broken
                .into_iter()
                .map(|how| format!("{name}: {how}"));
            named.for_each(|how| ours.keep(how));
        }
        for Loss { avoidable, story } in other.losses {
            let story = format!("{name}, {story}");
            self.losses.push(Loss { avoidable, story });
        }
    }

    fn promise(&mut self, words: &'static str) -> &mut Promise {
        let found = self.promises.iter().position(|one| one.words == words);
        let at = found.unwrap_or_else(|| {
            self.promises.push(Promise {
                words,
                tested: 0,
                broken: Vec::new(),
                breaks: 0,
                before: Vec::new(),
            });
            self.promises.len() - 1
        });
        &mut self.promises[at]
    }

    /// Whether all were kept, and each of these was put to the test; what was not is noted as broken.
    pub fn proves(&mut self, core: &[&'static str]) -> bool {
        for words in core {
            if self.promise(words).tested == 0 {
                self.note(words, Some("never put to the test".to_owned()));
            }
        }
        self.promises.iter().all(|promise| promise.breaks == 0)
    }

    /// One line: how much was put to the test, and what came of it.
    pub fn summary(&self) -> String {
        let tested: u64 = self.promises.iter().map(|one| one.tested).sum();
        let broken: u64 = self.promises.iter().map(|one| one.breaks).sum();
        let helpless = self.losses.iter().filter(|loss| !loss.avoidable).count();
        format!(
            "{} promises looked at {tested} times, broken {broken} times; {} robots flat, {helpless} \
             of them could not be helped",
            self.promises.len(),
            self.losses.len()
        )
    }

    fn write_losses(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let helpless = self.losses.iter().filter(|loss| !loss.avoidable).count();
        let count = self.losses.len();
        writeln!(
            f,
            "{count:>9} robots flat off the station, {helpless} could not be helped"
        )?;
        for loss in &self.losses {
            writeln!(f, "{:>9}{}", "- ", loss.story)?;
        }
        Ok(())
    }
}

impl Promise {
    fn keep(&mut self, how: String) {
        if self.broken.len() < MAX_KEPT {
            self.broken.push(how);
        }
    }
}

impl fmt::Display for Ledger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:>9} {:>7}  promise", "tested", "broken")?;
        for promise in &self.promises {
            let Promise {
                words,
                tested,
                breaks,
                broken,
                before,
            } = promise;
            writeln!(f, "{tested:>9} {breaks:>7}  {words}")?;
            for how in broken {
                writeln!(f, "{:>19}  {how}", "")?;
            }
            if !before.is_empty() {
                writeln!(f, "{:>19}  before the first:", "")?;
            }
            for text in before {
                writeln!(f, "{:>19}    {text}", "")?;
            }
        }
        self.write_losses(f)
    }
}
