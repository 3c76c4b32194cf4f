//! Robots with a low battery far from home, beside a behaviour that does nothing: how many of them the
//! watchdog alone brings home, by strategy.

use std::f64::consts::PI;
use std::fmt;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::agent::Behaviour;
use spykee::safety::{Limits, PowerMeaning, Rescue};
use spykee::sim::{BatterySettings, Point, Pose, PowerReading, RADIUS, State, World};
use spykee::simulation::{Event, EventKind, Recorder, Simulation};
use spykee::{script, simulation};
use tokio::time::{sleep, timeout};

use super::flats::flat;
use super::flats::station_distances::StationDistances;
use super::{TWO_ROOMS, behaviour, in_parallel, two_rooms};

const CLASSROOM: &str = include_str!("../../behaviours/worlds/classroom.yaml");
const GALLERY: &str = include_str!("../../behaviours/worlds/gallery.yaml");

/// Behind the living room's doorway.
const SECOND_ROOM: f64 = 4.9;
/// From a tight spot, something is no farther than this from the robot's body, metres.
const TIGHT: f64 = 0.03;
/// The least way home from a tight spot, metres: nearer to its station a search often finds it.
const TIGHT_WAY: f64 = 2.5;
/// So many points below the low level, at most, is the charge at the start.
const BELOW_LOW: f64 = 5.0;

/// A world that robots are rescued in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Name {
    LivingRoom,
    Classroom,
    Gallery,
    /// In the living room, but right beside a wall or a thing.
    TightSpots,
    /// Each robot in another flat, generated from a seed.
    Flats,
}

impl Name {
    pub const ALL: [Name; 5] = [
        Name::LivingRoom,
        Name::Classroom,
        Name::Gallery,
        Name::TightSpots,
        Name::Flats,
    ];

    pub fn text(self) -> &'static str {
        match self {
            Name::LivingRoom => "living room",
            Name::Classroom => "classroom",
            Name::Gallery => "gallery",
            Name::TightSpots => "tight spots",
            Name::Flats => "flats",
        }
    }

    /// The share of robots that must come home, percent.
    pub fn goal(self) -> f64 {
        if self == Name::LivingRoom { 97.5 } else { 95.0 }
    }
}

/// How long a robot drives on one charge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Battery {
    /// As owners report of a new one: the genuine preset's, which the playpen has.
    Hour,
    HalfHour,
}

impl Battery {
    fn settings(self) -> BatterySettings {
        match self {
            Battery::Hour => World::builtin("playpen").unwrap().battery,
            Battery::HalfHour => two_rooms().battery,
        }
    }
}

/// What the robots are like, and how they come to where they are rescued from.
#[derive(Debug, clap::Args)]
pub struct Robots {
    /// What they are like: see behaviours/worlds/README.md
    #[arg(long, default_value = "exact", value_parser = ["exact", "genuine"])]
    pub preset: String,
    /// How long they drive on one charge
    #[arg(long, value_enum, default_value_t = Battery::Hour)]
    pub battery: Battery,
    /// They leave their station and drive for one to three minutes, and then on until they are far
    /// from home
    #[arg(long)]
    pub driven: bool,
}

/// Where a robot starts, and with how much.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    pub pose: Pose,
    /// Percent.
    pub battery: f64,
    /// The way home, metres.
    pub way: f64,
    /// Of the run's noise.
    pub seed: u64,
    /// It begins on its station and drives for so long at least, until it is far from home.
    pub drives: Option<Duration>,
}

/// A world with all places that robots may start from.
pub struct Place {
    pub name: Name,
    pub world: World,
    distances: StationDistances,
    least_x: f64,
    least_way: f64,
}

impl Place {
    /// In the living room robots start in the second room, in tight spots beside a wall or a thing, and
    /// elsewhere in the third of the floor that is farthest from the station. `seed` is that of the flat,
    /// `preset` the world's key of this name; what the battery reports follows from it.
    pub fn new(name: Name, seed: u64, preset: &str, battery: Battery) -> Place {
        let text = match name {
            Name::LivingRoom | Name::TightSpots => TWO_ROOMS,
            Name::Classroom => CLASSROOM,
            Name::Gallery => GALLERY,
            Name::Flats => &flat(seed).yaml,
        };
        let text = text.replace("preset: genuine\n", "");
        let text = format!("preset: {preset}\n{text}");
        let mut world = World::from_yaml(&text, name.text()).unwrap();
        world.battery = BatterySettings {
            power: world.battery.power,
            ..battery.settings()
        };
        let distances = StationDistances::new(&world);
        let (least_x, least_way) = match name {
            Name::LivingRoom => (SECOND_ROOM, 0.0),
            Name::TightSpots => (0.0, TIGHT_WAY),
            Name::Classroom | Name::Gallery | Name::Flats => (0.0, last_third(&distances)),
        };
        Place {
            name,
            least_x,
            least_way,
            world,
            distances,
        }
    }

    /// So many robots that begin on their station and drive for one to three minutes at least.
    pub fn drives(&self, count: usize, seed: u64) -> Vec<Start> {
        let mut rng = StdRng::seed_from_u64(seed);
        let drive = |_| Start {
            pose: self.world.station.dock_pose(),
            battery: low_charge(&mut rng),
            way: 0.0,
            seed: rng.random(),
            drives: Some(Duration::from_secs(rng.random_range(60..180))),
        };
        (0..count).map(drive).collect()
    }

    /// Robots that start here.
    pub fn cases(self, starts: &[Start]) -> Vec<Case> {
        let place = Arc::new(self);
        let case = |start: &Start| Case {
            place: place.clone(),
            start: *start,
        };
        starts.iter().map(case).collect()
    }

    /// The way home, if this is where robots are to be rescued from.
    pub fn far_from_home(&self, point: Point) -> Option<f64> {
        let way = self.distances.length(point)?;
        (point.x >= self.least_x && way >= self.least_way).then_some(way)
    }

    /// So many starts; the same for the same seed.
    pub fn starts(&self, count: usize, seed: u64) -> Vec<Start> {
        let mut rng = StdRng::seed_from_u64(seed);
        (0..count).map(|_| self.start(&mut rng)).collect()
    }

    fn start(&self, rng: &mut StdRng) -> Start {
        let (point, way) = loop {
            let x = rng.random_range(self.least_x..self.world.room.width);
            let point = Point::new(x, rng.random_range(0.0..self.world.room.depth));
            if let Some(way) = self.way_from(point) {
                break (point, way);
            }
        };
        Start {
            pose: Pose::at(point, rng.random_range(-PI..PI)),
            battery: low_charge(rng),
            way,
            seed: rng.random(),
            drives: None,
        }
    }

    /// The way home from a place where a robot may start.
    fn way_from(&self, point: Point) -> Option<f64> {
        let way = self.distances.length(point)?;
        let fits = self.has_room(point) && (self.name != Name::TightSpots || self.is_tight(point));
        (way >= self.least_way && fits).then_some(way)
    }

    /// Whether a wall or a thing is right beside a robot that stands there.
    fn is_tight(&self, point: Point) -> bool {
        let around = (0..8).map(|eighth| f64::from(eighth) * PI / 4.0);
        around
            .map(|angle| Point::new(point.x + TIGHT * angle.cos(), point.y + TIGHT * angle.sin()))
            .any(|beside| !self.distances.has_room(beside))
    }

    /// Whether a robot stands there without touching anything, balls and people included.
    fn has_room(&self, point: Point) -> bool {
        let balls = self.world.balls.iter();
        let balls = balls.map(|ball| (ball.at.point(), ball.radius));
        let people = self.world.walkers.iter();
        let mut round = balls.chain(people.map(|who| (who.at.point(), who.radius)));
        self.distances.has_room(point)
            && round.all(|(place, radius)| place.distance(point) >= radius + RADIUS)
    }
}

/// The charge of a robot that has become low a while ago, percent.
fn low_charge(rng: &mut StdRng) -> f64 {
    let low = f64::from(Limits::default().low.get());
    rng.random_range(low - BELOW_LOW..low)
}

/// The length of way that a third of all places exceed.
fn last_third(distances: &StationDistances) -> f64 {
    let mut lengths: Vec<f64> = distances.places().map(|(_, length)| length).collect();
    lengths.sort_by(f64::total_cmp);
    lengths[lengths.len() * 2 / 3]
}

/// A robot to be rescued.
pub struct Case {
    pub place: Arc<Place>,
    pub start: Start,
}

impl Case {
    /// So many robots, the same for the same seed.
    pub fn draw(name: Name, robots: &Robots, count: usize, seed: u64) -> Vec<Case> {
        let draw = |count, seed| {
            let place = Place::new(name, seed, &robots.preset, robots.battery);
            let starts = if robots.driven {
                place.drives(count, seed)
            } else {
                place.starts(count, seed)
            };
            place.cases(&starts)
        };
        if name == Name::Flats {
            let seeds = seed..seed + count as u64;
            return seeds.flat_map(|seed| draw(1, seed)).collect();
        }
        draw(count, seed)
    }
}

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
fn play(case: &Case, strategy: Strategy) -> Played {
    let place = &case.place;
    let mut start = case.start;
    let efforts = Arc::new(Mutex::new(Efforts::default()));
    let count = efforts.clone();
    let options = simulation::Options {
        seed: start.seed,
        limits: Limits {
            power: power_meaning(&place.world),
            ..strategy.limits()
        },
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

/// What a config says that `spykee doctor --first` has written for the robot in this world.
fn power_meaning(world: &World) -> PowerMeaning {
    match world.battery.power {
        PowerReading::Percent => PowerMeaning::Auto,
        PowerReading::Voltage => PowerMeaning::Voltage,
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

/// Plays all cases on so many threads; `told` hears each time how many are done.
pub fn play_all(
    cases: &[Case],
    strategy: Strategy,
    threads: usize,
    told: &(dyn Fn(usize) + Sync),
) -> Vec<Played> {
    let done = AtomicUsize::new(0);
    in_parallel(cases, threads, |case| {
        let played = play(case, strategy);
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

/// See [`Strategy::limits`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Strategy {
    /// It stands and searches.
    None,
    /// It makes short blind moves between its searches.
    BlindMoves,
    /// What every robot gets that is not told otherwise.
    Builtin,
}

impl Strategy {
    /// For robots that were put where they are: nobody knows how they came there.
    pub const PUT: [Strategy; 3] = [Strategy::None, Strategy::BlindMoves, Strategy::Builtin];
    /// For robots that have driven there.
    pub const DRIVEN: [Strategy; 2] = [Strategy::BlindMoves, Strategy::Builtin];

    pub fn text(self) -> &'static str {
        match self {
            Strategy::None => "none",
            Strategy::BlindMoves => "blind moves",
            Strategy::Builtin => "builtin",
        }
    }

    /// The one place that says how a strategy is configured.
    pub fn limits(self) -> Limits {
        match self {
            Strategy::None => Limits {
                blind_moves: false,
                rescue: Rescue::Off,
                ..Limits::default()
            },
            Strategy::BlindMoves => Limits {
                rescue: Rescue::Off,
                ..Limits::default()
            },
            Strategy::Builtin => Limits::default(),
        }
    }
}

/// The table's first line.
pub fn heading() -> String {
    format!(
        "{:<12} {:<9} {:>10} {:>7} {:>9} {:>7} {:>8} {:>9} {:>6} {:>6}",
        "world",
        "strategy",
        "home",
        "share",
        "median",
        "p90",
        "battery",
        "searches",
        "moves",
        "grants"
    )
}

/// A line of it: one strategy in one world.
#[derive(Debug, Clone)]
pub struct Row {
    pub world: Name,
    pub strategy: Strategy,
    pub starts: usize,
    pub home: usize,
    /// Until home, of those who came home, in seconds; sorted.
    seconds: Vec<f64>,
    /// What was left then, in percent; sorted.
    batteries: Vec<f64>,
    /// Of all.
    efforts: Efforts,
}

impl Row {
    /// Without those that never were away.
    pub fn new(world: Name, strategy: Strategy, played: &[Played]) -> Row {
        let played: Vec<&Played> = played
            .iter()
            .filter(|one| one.end != End::NeverAway)
            .collect();
        let home: Vec<&&Played> = played.iter().filter(|one| one.is_home()).collect();
        let mut efforts = Efforts::default();
        for one in &played {
            efforts.searches += one.efforts.searches;
            efforts.blind_moves += one.efforts.blind_moves;
            efforts.grants += one.efforts.grants;
        }
        Row {
            world,
            strategy,
            starts: played.len(),
            home: home.len(),
            seconds: sorted(home.iter().map(|one| one.took.as_secs_f64())),
            batteries: sorted(home.iter().map(|one| one.battery)),
            efforts,
        }
    }

    /// The share that came home, percent.
    pub fn percent(&self) -> f64 {
        100.0 * self.home as f64 / self.starts as f64
    }

    /// Whether the default strategy brings home too few.
    pub fn misses_its_goal(&self) -> bool {
        self.strategy == Strategy::Builtin && self.percent() < self.world.goal()
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Efforts {
            searches,
            blind_moves,
            grants,
        } = self.efforts;
        write!(
            f,
            "{:<12} {:<9} {:>3} of {:>3} {:>5.1} % {:>7} s {:>5} s {:>6} % {searches:>9} {blind_moves:>6} \
             {grants:>6}",
            self.world.text(),
            self.strategy.text(),
            self.home,
            self.starts,
            self.percent(),
            number(quantile(&self.seconds, 0.5), 0),
            number(quantile(&self.seconds, 0.9), 0),
            number(quantile(&self.batteries, 0.5), 1),
        )
    }
}

fn sorted(numbers: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    numbers
}

/// The least that this share of them does not exceed.
fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let at = (sorted.len() as f64 * share).ceil() as usize;
    sorted.get(at.saturating_sub(1)).copied()
}

fn number(number: Option<f64>, digits: usize) -> String {
    number.map_or("-".to_owned(), |number| format!("{number:.digits$}"))
}
