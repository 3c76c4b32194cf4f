//! Robots that execute so many commands a second, one after another, in virtual time: the age of a STOP
//! when it is executed, the way that the robot drives until it stands, and what a patrol loses.

use std::fmt;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::robot::channel::Request;
use spykee::script;
use spykee::sim::{
    BatterySettings, Firmware, Handle, Point, PowerReading, ReceivedCommand, TrackSettings, World,
};
use spykee::simulation::{self, Simulation};
use spykee::wire::{Command, Sound};
use tokio::time::{sleep, timeout};

use super::super::{behaviour, in_parallel, two_rooms};
use super::percentile;

/// Commands a second; `None`: at once.
pub const SPEEDS: [Option<f64>; 6] = [
    Some(3.0),
    Some(5.0),
    Some(8.0),
    Some(10.0),
    Some(20.0),
    None,
];
/// The least [`Trial::drives`] of a long run, seconds.
pub const DRIVES: f64 = 10.0;
/// A behaviour that does not drive by then is not measured.
const START_LIMIT: Duration = Duration::from_secs(60);
/// A STOP that is not executed by then is lost.
const STOP_LIMIT: Duration = Duration::from_secs(120);
/// For so long afterwards nothing may move the robot.
const WATCH: Duration = Duration::from_secs(5);
const PATROL: Duration = Duration::from_secs(600);
const POLL: Duration = Duration::from_millis(50);

/// A room of eight metres with a ball, and a battery that lasts.
const BALL_ROOM: &str = "
name: ball room
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
start: { at: [3, 4], heading_degrees: 0 }
balls: [{ at: [5, 4], colour: red }]
";

/// What drives the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Driver {
    /// After a ball that moves around the room.
    FollowColour,
    Patrol,
    Explore,
}

impl Driver {
    pub const ALL: [Driver; 3] = [Driver::FollowColour, Driver::Patrol, Driver::Explore];

    fn name(self) -> &'static str {
        match self {
            Driver::FollowColour => "follow_colour",
            Driver::Patrol => "patrol",
            Driver::Explore => "explore",
        }
    }

    fn source(self) -> &'static str {
        match self {
            Driver::FollowColour => include_str!("../../behaviours/follow_colour.lua"),
            Driver::Patrol => include_str!("../../behaviours/patrol.lua"),
            Driver::Explore => include_str!("../../behaviours/explore.lua"),
        }
    }

    fn world(self) -> World {
        let mut world = match self {
            Driver::FollowColour => World::from_yaml(BALL_ROOM, "ball room").unwrap(),
            Driver::Patrol | Driver::Explore => two_rooms(),
        };
        world.battery = BatterySettings {
            level: 95.0,
            idle_drain_per_minute: 0.01,
            driving_drain_per_minute: 0.01,
            ..world.battery
        };
        world
    }
}

/// Who stops the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopper {
    /// A person's STOP.
    Person,
    /// The end of the run, as by Ctrl-C.
    EndOfRun,
}

impl Stopper {
    pub const ALL: [Stopper; 2] = [Stopper::Person, Stopper::EndOfRun];

    fn name(self) -> &'static str {
        match self {
            Stopper::Person => "STOP",
            Stopper::EndOfRun => "end of the run",
        }
    }
}

/// One robot that is stopped.
#[derive(Debug, Clone, Copy)]
pub struct Trial {
    pub speed: Option<f64>,
    pub driver: Driver,
    pub stopper: Stopper,
    /// The shortest time for which it drives before, seconds; the longest is four times as long.
    pub drives: f64,
    pub seed: u64,
}

/// How a robot was stopped.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stopped {
    /// The behaviour did not drive.
    NeverDrove,
    /// No STOP was executed.
    Never,
    Executed {
        /// Seconds from the request to the execution.
        age: f64,
        /// Metres from the request until it stood.
        way: f64,
        /// It was moved again.
        again: bool,
    },
}

fn options(speed: Option<f64>, seed: u64) -> simulation::Options {
    let firmware = Firmware {
        commands_per_second: speed,
        ..Firmware::default()
    };
    simulation::Options {
        seed,
        sim: spykee::sim::Options {
            firmware,
            ..spykee::sim::Options::default()
        },
        ..simulation::Options::default()
    }
}

fn start(simulation: &Simulation, driver: Driver) -> simulation::Running {
    let name = driver.name();
    let script = script::Options {
        seed: simulation.seed(),
        ..script::Options::new(name, format!("{name}.lua"))
    };
    simulation.start(vec![behaviour(driver.source(), script)], None)
}

fn moves(command: &Command) -> bool {
    matches!(command, Command::Move { .. }) && *command != Command::STOP
}

/// Plays one robot: it drives for a random time, and is stopped. Every second one reports a voltage,
/// which changes with each motion: such reports are no answers to questions. Every third one answers
/// CONFIG only, with several messages.
pub fn play(trial: &Trial) -> Stopped {
    let mut world = trial.driver.world();
    if trial.seed.is_multiple_of(2) {
        world.battery.power = PowerReading::Voltage;
    }
    let mut options = options(trial.speed, trial.seed);
    options.sim.firmware.answers_power_query = !trial.seed.is_multiple_of(3);
    simulation::run(world, options, async |simulation: &Simulation| {
        let run = start(simulation, trial.driver);
        let sim = simulation.sim();
        if timeout(START_LIMIT, sim.wait_heard(0, moves))
            .await
            .is_err()
        {
            return Stopped::NeverDrove;
        }
        let mut rng = StdRng::seed_from_u64(2 * trial.seed + trial.stopper as u64);
        let ball = (trial.driver == Driver::FollowColour).then(|| move_ball(sim, trial.seed));
        sleep(Duration::from_secs_f64(
            rng.random_range(trial.drives..4.0 * trial.drives),
        ))
        .await;
        let asked = simulation.now();
        let from = sim.heard_count();
        let way = sim.state().distance;
        match trial.stopper {
            Stopper::Person => drop(run.requests().send(Request::EmergencyStop(true)).await),
            Stopper::EndOfRun => run.stop(),
        }
        let stop = timeout(STOP_LIMIT, executed(sim, from, asked)).await;
        let Some(stop) = stop.ok().or_else(|| already_stopped(sim)) else {
            return Stopped::Never;
        };
        sleep(WATCH).await;
        if let Some(ball) = ball {
            ball.abort();
        }
        let later = sim.heard_since(stop.index + 1);
        Stopped::Executed {
            age: stop.at.saturating_sub(asked).as_secs_f64(),
            way: sim.state().distance - way,
            again: later.iter().any(|heard| moves(&heard.command)),
        }
    })
    .unwrap()
}

/// Moves the ball around the middle of the room, at the speed of a slow person.
fn move_ball(sim: &Handle, seed: u64) -> tokio::task::JoinHandle<()> {
    let sim = sim.clone();
    let start = StdRng::seed_from_u64(seed).random_range(-0.3..0.3);
    tokio::task::spawn_local(async move {
        let mut angle: f64 = start;
        loop {
            sim.put_ball(
                0,
                Point::new(4.0 + 1.8 * angle.cos(), 4.0 + 1.8 * angle.sin()),
            );
            angle += 0.1 * POLL.as_secs_f64();
            sleep(POLL).await;
        }
    })
}

/// Waits for the execution of a stop that was received at this time or later.
async fn executed(sim: &Handle, from: usize, asked: Duration) -> ReceivedCommand {
    loop {
        let heard = sim.heard_since(from);
        let stop = heard
            .into_iter()
            .find(|heard| heard.command == Command::STOP && heard.received >= asked);
        if let Some(stop) = stop {
            return stop;
        }
        sleep(POLL).await;
    }
}

/// The last MOVE, if it is a stop: nobody stops a robot again that was told to stop before.
fn already_stopped(sim: &Handle) -> Option<ReceivedCommand> {
    let heard = sim.heard();
    let mut moves = heard.into_iter().rev();
    let last = moves.find(|heard| matches!(heard.command, Command::Move { .. }));
    last.filter(|heard| heard.command == Command::STOP)
}

/// The age by which a STOP is to be executed, seconds: the queue may be 0.3 s old, or two periods on a
/// robot that is slow, and the STOP itself takes one.
pub fn age_goal(speed: Option<f64>) -> f64 {
    speed.map_or(0.1, |speed| f64::max(0.3, 2.0 / speed) + 1.0 / speed)
}

impl Stopped {
    fn is_kept(self, speed: Option<f64>) -> bool {
        match self {
            Stopped::NeverDrove | Stopped::Never => false,
            Stopped::Executed { age, again, .. } => age <= age_goal(speed) && !again,
        }
    }
}

/// The robots with one driver, one stopper and one speed.
#[derive(Debug, Clone, Default)]
pub struct Cell {
    pub ages: Vec<f64>,
    pub ways: Vec<f64>,
    pub never: usize,
    pub again: usize,
    pub never_drove: usize,
}

impl Cell {
    fn add(&mut self, stopped: Stopped) {
        match stopped {
            Stopped::NeverDrove => self.never_drove += 1,
            Stopped::Never => self.never += 1,
            Stopped::Executed { age, way, again } => {
                self.ages.push(age);
                self.ways.push(way);
                self.again += usize::from(again);
            }
        }
    }

    /// Whether every STOP was executed in time and nothing moved the robot afterwards.
    pub fn is_kept(&self, speed: Option<f64>) -> bool {
        let in_time = percentile(&self.ages, 99).is_some_and(|age| age <= age_goal(speed));
        in_time && self.never + self.again + self.never_drove == 0
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = |values: &[f64], percent| percentile(values, percent).unwrap_or(f64::NAN);
        let (ages, ways) = (&self.ages, &self.ways);
        let age = format!("{:.2} / {:.2}", value(ages, 50), value(ages, 99));
        let way = format!("{:.2} / {:.2}", value(ways, 50), value(ways, 99));
        write!(f, "{age:>14} s {way:>13} m")?;
        for (count, what) in [
            (self.never, "never executed"),
            (self.again, "moved again"),
            (self.never_drove, "never drove"),
        ] {
            if count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        Ok(())
    }
}

/// Plays robots of all these kinds, so many seeds each; see [`Trial::drives`].
pub fn play_all(
    speeds: &[Option<f64>],
    drivers: &[Driver],
    drives: f64,
    seeds: u64,
    threads: usize,
) -> Vec<(Trial, Cell)> {
    let mut trials = Vec::new();
    for &driver in drivers {
        for stopper in Stopper::ALL {
            for &speed in speeds {
                trials.extend((1..=seeds).map(|seed| Trial {
                    speed,
                    driver,
                    stopper,
                    drives,
                    seed,
                }));
            }
        }
    }
    let stopped = in_parallel(&trials, threads, play);
    let mut cells: Vec<(Trial, Cell)> = Vec::new();
    for (trial, stopped) in trials.iter().zip(stopped) {
        if !stopped.is_kept(trial.speed) {
            eprintln!("late: {trial:?}: {stopped:?}");
        }
        if trial.seed == 1 {
            cells.push((*trial, Cell::default()));
        }
        if let Some((_, cell)) = cells.last_mut() {
            cell.add(stopped);
        }
    }
    cells
}

pub fn heading() -> String {
    format!(
        "{:<15} {:<15} {:>8} {:>16} {:>15}",
        "driver", "stopped by", "speed", "age p50 / p99", "way p50 / p99"
    )
}

fn speed_name(speed: Option<f64>) -> String {
    speed.map_or("at once".to_owned(), |speed| format!("{speed} /s"))
}

pub fn row(trial: &Trial, cell: &Cell) -> String {
    let kept = if cell.is_kept(trial.speed) {
        ""
    } else {
        "  LATE"
    };
    let driver = trial.driver.name();
    let stopper = trial.stopper.name();
    let speed = speed_name(trial.speed);
    format!("{driver:<15} {stopper:<15} {speed:>8} {cell}{kept}")
}

/// What a patrol did in ten minutes.
#[derive(Debug, Clone, Copy, Default)]
pub struct Patrolled {
    pub metres: f64,
    pub pictures: usize,
    pub collisions: u64,
}

/// Plays a patrol of ten minutes, of a robot whose tracks and first direction come from the seed.
pub fn patrol(speed: Option<f64>, seed: u64) -> Patrolled {
    let mut world = Driver::Patrol.world();
    world.tracks = TrackSettings {
        unequal: 0.03,
        slip: 0.02,
        ..TrackSettings::default()
    };
    if let Some(start) = &mut world.start {
        start.heading_degrees = StdRng::seed_from_u64(seed).random_range(-180.0..180.0);
    }
    simulation::run(
        world,
        options(speed, seed),
        async |simulation: &Simulation| {
            let run = start(simulation, Driver::Patrol);
            sleep(PATROL).await;
            drop(run);
            let sim = simulation.sim();
            let state = sim.state();
            let picture = Command::Play(Sound::Snapshot);
            let heard = sim.heard();
            Patrolled {
                metres: state.distance,
                pictures: heard
                    .iter()
                    .filter(|heard| heard.command == picture)
                    .count(),
                collisions: state.collisions,
            }
        },
    )
    .unwrap()
}

/// Plays patrols at all speeds; a line for each speed.
pub fn patrols(speeds: &[Option<f64>], seeds: u64, threads: usize) -> Vec<String> {
    let jobs: Vec<(Option<f64>, u64)> = speeds
        .iter()
        .flat_map(|speed| (1..=seeds).map(|seed| (*speed, seed)))
        .collect();
    let played = in_parallel(&jobs, threads, |(speed, seed)| patrol(*speed, *seed));
    let seeds = seeds as usize;
    let lines = played.chunks(seeds).zip(speeds).map(|(runs, speed)| {
        let mean =
            |value: fn(&Patrolled) -> f64| runs.iter().map(value).sum::<f64>() / seeds as f64;
        format!(
            "patrol, ten minutes {:>8}: {:>6.1} m, {:>5.1} pictures, {:>4.1} collisions",
            speed_name(*speed),
            mean(|run| run.metres),
            mean(|run| run.pictures as f64),
            mean(|run| run.collisions as f64)
        )
    });
    lines.collect()
}
