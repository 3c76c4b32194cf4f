//! The link breaks around the end of a run: whether the robot, which drives on meanwhile, executes a stop
//! soon after it is in reach again. The real binary, and a simulated robot behind real sockets.

use std::collections::BTreeMap;
use std::fmt;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::os::fd::AsFd as _;
use std::path::Path;
use std::process::Stdio;
use std::sync::atomic::{AtomicU16, Ordering};
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;

use clap::ValueEnum;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rustix::process::{Pid, Signal, kill_process};
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use spykee::sim::{Handle, Options, Server, World};
use spykee::wire::Command;
use tokio::sync::oneshot;
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::super::{begin_fault, in_parallel};
use super::network::{Network, ROBOT};
use crate::mqtt::{Broker, Subscriber};
use crate::rig::{QUIET_WORLD, Run, moves};

/// How a run ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum End {
    ScriptReturns,
    ScriptError,
    ScriptStop,
    /// The script never waits again.
    ScriptLoops,
    /// The process of the script is killed.
    HostKilled,
    /// The time of `--for` is over.
    For,
    /// SIGINT, as by Ctrl-C.
    Interrupt,
    Terminate,
    Hangup,
    Quit,
    Killed,
    /// Stopped by a signal, and killed a second later.
    Frozen,
    /// The end of the input of `repl`.
    Repl,
    /// STOP at the page, or through the API.
    Page,
    /// `spykee robot stop` beside the run.
    RobotStop,
    /// STOP by a message of the MQTT broker, whose own link does not break.
    Broker,
    /// STOP through the API, and killed up to 50 ms after the answer: STOP holds in the next program.
    StopKilled,
}

impl End {
    /// For ends that the script brings about: how it goes on when it has driven for a while.
    fn ending(self) -> Option<&'static str> {
        Some(match self {
            End::ScriptReturns => "return",
            End::ScriptError => "error('the end')",
            End::ScriptStop => "script.stop('the end')",
            End::ScriptLoops => "while true do end",
            End::For => "task.wait(600)",
            _ => return None,
        })
    }

    /// Whether a service is ended like this, and no run.
    fn is_of_a_service(self) -> bool {
        matches!(self, End::Page | End::Broker | End::StopKilled)
    }

    /// Starts the run that will end like this; fails if there is no broker.
    async fn start(self, folder: &Path, robot: &str) -> Result<Started, String> {
        let (drives, wait) = ("robot.move(40, -40)", DRIVE.as_secs_f64());
        let script = match self.ending() {
            Some(ending) => format!("{drives} task.wait({wait}) {ending}\n"),
            None => format!("{drives} task.wait(600)\n"),
        };
        std::fs::write(folder.join("drive.lua"), script).unwrap();
        let limit = DRIVE.as_secs().to_string();
        let mut args = match self {
            End::Repl => vec!["repl"],
            end if end.is_of_a_service() => vec!["serve", "--config", "spykee.yaml"],
            End::For => vec!["run", "drive.lua", "--for", &limit],
            _ => vec!["run", "drive.lua"],
        };
        let mqtt = match self {
            End::Broker => Some(Mqtt::start().await?),
            _ => None,
        };
        if self.is_of_a_service() {
            let broker = mqtt.as_ref().map(|mqtt| mqtt.broker.config());
            let config = format!("{SERVICE}{}", broker.unwrap_or_default());
            std::fs::write(folder.join("spykee.yaml"), config).unwrap();
        }
        args.extend(["--robot", robot]);
        let stdin = match self {
            End::Repl => Stdio::piped(),
            _ => Stdio::null(),
        };
        let mut run = Run::start(&args, folder, stdin, &[]);
        let mut input = run.take_input();
        if let Some(input) = &mut input {
            input.write_all(format!("{drives}\n").as_bytes()).unwrap();
        }
        Ok(Started { run, input, mqtt })
    }
}

/// A run, the input of its prompt, and the broker that its config names.
struct Started {
    run: Run,
    input: Option<std::process::ChildStdin>,
    mqtt: Option<Mqtt>,
}

/// A broker, and a person's client there.
struct Mqtt {
    broker: Broker,
    person: Subscriber,
}

impl Mqtt {
    async fn start() -> Result<Mqtt, String> {
        let broker = Broker::start().ok_or("mosquitto is not installed")?;
        let person = Subscriber::connect(&broker).await;
        Ok(Mqtt { broker, person })
    }

    /// Waits until the service is there.
    async fn wait_for_service(&self) {
        let connection = format!("{TOPIC}/connection");
        self.person.wait_for_text(0, &connection, "ONLINE").await;
    }

    async fn send_stop(&self) {
        let command = format!("{TOPIC}/command");
        self.person.publish(&command, "stop", false).await;
    }
}

const SERVICE: &str = "service: { user: root }\nlive: { listen: '127.0.0.1:0' }\n\
                       behaviours: [{ file: drive.lua }]\n";

/// How the robot gets out of reach.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum Outage {
    /// Its Wi-Fi starts again: connections end, and new ones are refused.
    Refused,
    /// Bytes are lost, and the connection stays dead: it counts as in reach when the program's system
    /// has given up that connection.
    Silent,
    /// All packets are lost, those of new connections too.
    Packets,
}

/// One run whose link breaks around its end.
#[derive(Debug, Clone, Copy)]
pub struct Case {
    pub end: End,
    pub outage: Outage,
    /// How long the robot is out of reach.
    pub out: Duration,
    pub seed: u64,
}

/// For so long a script drives before it ends.
const DRIVE: Duration = Duration::from_secs(3);
/// So long a run drives before somebody else ends it.
const LEAD: Duration = Duration::from_secs(2);
/// The break begins this much before the end, seconds; if negative, after it.
const AHEAD: std::ops::Range<f64> = -0.05..1.0;
/// A stop is executed so soon after the robot is in reach again.
pub const GOAL: Duration = Duration::from_secs(2);
/// For so long the robot is watched then: until it stands, and that it stays there.
const WATCH: Duration = Duration::from_secs(15);
const STANDS: Duration = Duration::from_secs(4);
const START_LIMIT: Duration = Duration::from_secs(60);
const POLL: Duration = Duration::from_millis(20);
/// So long after the first byte that was lost, the system gives up a connection: `dead_after`
/// of the link's options.
const DEAD_AFTER: Duration = Duration::from_secs(3);
/// So soon after the answer to a STOP the program is killed, at the latest.
const KILLED_WITHIN: Duration = Duration::from_millis(50);
/// The exit code of a program that a kept STOP does not let start.
const HELD: i32 = 5;
/// A driving run sends something at least so often.
const REPEATS: Duration = Duration::from_millis(500);
/// The robot's topic at a broker.
const TOPIC: &str = "spykee/SPYKEE0001";

/// Whether the robot was stopped.
#[derive(Debug, Clone)]
pub enum Outcome {
    /// So long after it was in reach again; zero if before.
    After(Duration),
    /// Later than the goal; what the program and its guardian wrote.
    Late(Duration, String),
    /// Not while it was watched; what the program and its guardian wrote.
    Never(String),
    /// STOP was answered as kept, and does not hold in the next program; what that one wrote.
    NotHeld(String),
    /// The case could not be played.
    Failed(String),
}

/// A robot that is served by a thread of its own.
struct Robot {
    sim: Handle,
    address: String,
    began: Instant,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Robot {
    fn serve(network: Option<&Network>) -> Robot {
        let namespace = network.map(|network| network.namespace("robot"));
        let listen = network.map_or_else(own_address, |_| ROBOT.parse().unwrap());
        let (told, ready) = mpsc::channel();
        let (end, ended) = oneshot::channel();
        let thread = std::thread::spawn(move || {
            if let Some(namespace) = namespace {
                enter(&namespace);
            }
            let mut runtime = tokio::runtime::Builder::new_current_thread();
            runtime.enable_all().build().unwrap().block_on(async {
                let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
                let options = Options {
                    listen,
                    faults: Some(Vec::new()),
                    unacknowledged: Some(DEAD_AFTER),
                    ..Options::default()
                };
                let server = Server::bind(world, options).await.unwrap();
                let address = server.local_addr().to_string();
                told.send((server.handle(), address, Instant::now()))
                    .unwrap();
                tokio::select! {
                    served = server.run() => served.unwrap(),
                    _ = ended => {}
                }
            });
        });
        let (sim, address, began) = ready.recv().unwrap();
        Robot {
            sim,
            address,
            began,
            end: Some(end),
            thread: Some(thread),
        }
    }

    /// When the tracks were stopped for good; `None` if they are not.
    fn stopped_at(&self, from: usize) -> Option<Instant> {
        let heard = self.sim.heard_since(from);
        let moved = heard.iter().rposition(|heard| moves(&heard.command))?;
        let mut rest = heard.get(moved + 1..)?.iter();
        let stop = rest.find(|heard| heard.command == Command::STOP)?;
        Some(self.began + stop.at)
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.end.take();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// A loopback address of its own: another robot may not get the port of one that is out of reach.
fn own_address() -> SocketAddr {
    static COUNT: AtomicU16 = AtomicU16::new(1);
    let [high, low] = COUNT.fetch_add(1, Ordering::Relaxed).to_be_bytes();
    SocketAddr::from(([127, 1, high, low], 0))
}

/// Moves this thread, and what it starts, into a network namespace.
fn enter(namespace: &std::fs::File) {
    move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
}

/// Kills the guardian of a run that is over for the test.
struct Guardian(Option<Pid>);

impl Drop for Guardian {
    fn drop(&mut self) {
        if let Some(pid) = self.0 {
            let _ = kill_process(pid, Signal::KILL);
        }
    }
}

/// Plays one case. With packets lost, it must run on a thread in the network's agent end.
async fn play(case: &Case, network: Option<&Network>) -> Outcome {
    let robot = Robot::serve(network);
    let folder = tempfile::tempdir().unwrap();
    let mut started = match case.end.start(folder.path(), &robot.address).await {
        Ok(started) => started,
        Err(why) => return Outcome::Failed(why),
    };
    let run = &started.run;
    let ready = async {
        let moved = robot.sim.wait_heard(0, moves).await;
        while run.guardian().is_none() {
            sleep(POLL).await;
        }
        if let Some(mqtt) = &started.mqtt {
            mqtt.wait_for_service().await;
        }
        moved
    };
    let Ok(moved) = timeout(START_LIMIT, ready).await else {
        return Outcome::Failed(format!("it does not drive: {}", run.text()));
    };
    let _guardian = Guardian(run.guardian());
    let mut rng = StdRng::seed_from_u64(case.seed);
    let lead = if case.end.ending().is_some() {
        DRIVE
    } else {
        LEAD
    };
    let ends = robot.began + robot.sim.heard_since(moved)[0].at + lead;
    let ahead = rng.random_range(AHEAD).min(case.out.as_secs_f64() * 0.8);
    let breaks = ends + Duration::from_millis(50) - Duration::from_secs_f64(ahead + 0.05);
    let back = breaks + case.out;
    let given_up = match case.outage {
        Outage::Silent => breaks + DEAD_AFTER + REPEATS,
        _ => breaks,
    };
    let breaking = async {
        sleep_until(breaks).await;
        case.outage.begin(&robot.sim, case.out, network);
        sleep_until(back).await;
        if let Some(network) = network {
            network.forward();
        }
        Instant::now().max(given_up)
    };
    let killed_after = rng.random_range(Duration::ZERO..KILLED_WITHIN);
    let ending = async {
        sleep_until(ends).await;
        bring_about(case.end, &mut started, folder.path(), killed_after).await
    };
    let (reach, ended) = tokio::join!(breaking, ending);
    if let Err(why) = ended {
        return Outcome::Failed(format!("{why}: {}", started.run.text()));
    }
    let outcome = match watch(&robot, moved, reach).await {
        Some(after) if after <= GOAL => Outcome::After(after),
        Some(after) => Outcome::Late(after, written(&started.run, folder.path())),
        None => Outcome::Never(written(&started.run, folder.path())),
    };
    match (case.end, outcome) {
        (End::StopKilled, Outcome::After(after)) => held(&robot, folder.path(), after).await,
        (_, outcome) => outcome,
    }
}

/// Presses STOP through the API, and kills the program so long after its answer.
async fn stop_and_kill(run: &Run, after: Duration) -> Result<(), String> {
    let page = page(run)?;
    let answered = tokio::task::spawn_blocking(move || post_stop(&page)).await;
    let answer = answered.map_err(|error| error.to_string())?;
    sleep(after).await;
    run.signal(Signal::KILL);
    match answer.contains("\"kept\":\"yes\"") {
        true => Ok(()),
        false => Err(format!("STOP is not answered as kept: {answer}")),
    }
}

/// Whether the STOP of a program that was killed holds in the next one.
async fn held(robot: &Robot, folder: &Path, after: Duration) -> Outcome {
    let args = ["run", "drive.lua", "--for", "1", "--robot", &robot.address];
    let mut next = Run::start(&args, folder, Stdio::null(), &[]);
    match next.code().await {
        Some(HELD) => Outcome::After(after),
        _ => Outcome::NotHeld(next.text()),
    }
}

/// What the program and its guardian have written.
fn written(run: &Run, folder: &Path) -> String {
    let guardian = std::fs::read_to_string(folder.join("spykee-data/guardian.log"));
    format!("{}\n{}", run.text(), guardian.unwrap_or_default())
}

/// Waits until the robot has been stopped, and stays there; returns how long that took, `None` if it
/// still drives.
async fn watch(robot: &Robot, moved: usize, reach: Instant) -> Option<Duration> {
    sleep_until(reach + STANDS).await;
    while reach.elapsed() < WATCH && robot.stopped_at(moved).is_none() {
        sleep(POLL).await;
    }
    let at = robot.stopped_at(moved)?;
    Some(at.saturating_duration_since(reach))
}

impl Outage {
    fn begin(self, sim: &Handle, out: Duration, network: Option<&Network>) {
        match (self, network) {
            (Outage::Refused, _) => {
                begin_fault(sim, "{ fault: reboot, state: kept, for: SECONDS }", out);
            }
            (Outage::Silent, _) => begin_fault(sim, "{ fault: half_open, for: SECONDS }", out),
            (Outage::Packets, network) => network.unwrap().lose(),
        }
    }
}

/// Ends the run, if its script does not do that.
async fn bring_about(
    end: End,
    started: &mut Started,
    folder: &Path,
    killed_after: Duration,
) -> Result<(), String> {
    let run = &started.run;
    match end {
        End::ScriptReturns | End::ScriptError | End::ScriptStop | End::ScriptLoops | End::For => {}
        End::Broker => {
            if let Some(mqtt) = &started.mqtt {
                mqtt.send_stop().await;
            }
        }
        End::StopKilled => stop_and_kill(run, killed_after).await?,
        End::HostKilled => {
            for host in run.hosts() {
                kill_process(host, Signal::KILL).map_err(|error| error.to_string())?;
            }
        }
        End::Interrupt => run.signal(Signal::INT),
        End::Terminate => run.signal(Signal::TERM),
        End::Hangup => run.signal(Signal::HUP),
        End::Quit => run.signal(Signal::QUIT),
        End::Killed => run.signal(Signal::KILL),
        End::Frozen => {
            run.signal(Signal::STOP);
            sleep(Duration::from_secs(1)).await;
            run.signal(Signal::KILL);
        }
        End::Repl => drop(started.input.take()),
        End::Page => {
            let page = page(run)?;
            std::thread::spawn(move || post_stop(&page));
        }
        End::RobotStop => {
            let stop = Run::start(&["robot", "stop"], folder, Stdio::null(), &[]);
            // It ends by itself; its result does not matter here.
            std::thread::spawn(move || {
                std::thread::sleep(WATCH);
                drop(stop);
            });
        }
    }
    Ok(())
}

/// The address of its page.
fn page(run: &Run) -> Result<String, String> {
    let text = run.text();
    let page = text.split_once("the page is at http://");
    let (_, page) = page.ok_or("there is no page")?;
    Ok(page.split('/').next().unwrap_or_default().to_owned())
}

/// Presses STOP, and returns what was answered.
fn post_stop(page: &str) -> String {
    let request = format!(
        "POST /api/stop HTTP/1.1\r\nHost: {page}\r\nContent-Type: application/json\r\n\
         Connection: close\r\nContent-Length: 2\r\n\r\n{{}}"
    );
    let mut answer = Vec::new();
    if let Ok(mut stream) = TcpStream::connect(page) {
        let _ = stream.write_all(request.as_bytes());
        let _ = stream.set_read_timeout(Some(WATCH));
        let _ = stream.read_to_end(&mut answer);
    }
    String::from_utf8_lossy(&answer).into_owned()
}

/// What came of all cases with one end, one outage and one length.
#[derive(Debug, Clone, Default)]
pub struct Cell {
    pub played: usize,
    pub late: usize,
    pub never: usize,
    pub not_held: usize,
    pub failed: usize,
    pub worst: Duration,
}

impl Cell {
    fn add(&mut self, outcome: &Outcome) {
        self.played += 1;
        match outcome {
            Outcome::After(after) => {
                self.worst = self.worst.max(*after);
            }
            Outcome::Late(after, _) => {
                self.late += 1;
                self.worst = self.worst.max(*after);
            }
            Outcome::Never(_) => self.never += 1,
            Outcome::NotHeld(_) => self.not_held += 1,
            Outcome::Failed(_) => self.failed += 1,
        }
    }

    pub fn is_kept(&self) -> bool {
        self.broken() == 0
    }

    fn broken(&self) -> usize {
        self.late + self.never + self.not_held + self.failed
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let in_time = self.played - self.broken();
        let text = format!("{in_time}/{}", self.played);
        let worst = match (self.never, self.not_held, self.failed) {
            (0, 0, 0) => format!("{:.1} s", self.worst.as_secs_f64()),
            (_, 0, 0) => "never".to_owned(),
            (_, _, 0) => "not held".to_owned(),
            _ => "broken".to_owned(),
        };
        write!(f, "{text} {worst}")
    }
}

/// Every case once for each seed.
pub fn cases(ends: &[End], outages: &[Outage], outs: &[u64], seeds: u64) -> Vec<Case> {
    let mut cases = Vec::new();
    for seed in 1..=seeds {
        for &outage in outages {
            for &out in outs {
                cases.extend(ends.iter().map(|&end| Case {
                    end,
                    outage,
                    out: Duration::from_secs(out),
                    seed,
                }));
            }
        }
    }
    cases
}

/// Plays cases on so many threads; `told` hears of each. A thread plays one case at a time; most of
/// the time it waits.
pub fn play_all(
    cases: &[Case],
    threads: usize,
    told: &(dyn Fn(&Case, &Outcome) + Sync),
) -> Vec<Outcome> {
    in_parallel(cases, threads, |case| {
        let outcome = std::thread::scope(|scope| {
            let playing = scope.spawn(|| play_here(case));
            playing
                .join()
                .unwrap_or_else(|_| Outcome::Failed("a panic".to_owned()))
        });
        told(case, &outcome);
        outcome
    })
}

/// Plays a case on this thread, which stays in the agent's end of the network.
fn play_here(case: &Case) -> Outcome {
    let network = match case.outage {
        Outage::Packets => match Network::new() {
            Ok(network) => Some(network),
            Err(why) => return Outcome::Failed(format!("no network namespaces: {why}")),
        },
        _ => None,
    };
    if let Some(network) = &network {
        enter(&network.namespace("agent"));
    }
    let mut runtime = tokio::runtime::Builder::new_current_thread();
    let runtime = runtime.enable_all().build().unwrap();
    runtime.block_on(play(case, network.as_ref()))
}

/// A table with a row for each end and a column for each outage.
pub struct Table(BTreeMap<(End, Outage, Duration), Cell>);

impl Table {
    pub fn new(cases: &[Case], outcomes: &[Outcome]) -> Table {
        let mut cells: BTreeMap<_, Cell> = BTreeMap::new();
        for (case, outcome) in cases.iter().zip(outcomes) {
            let cell = cells.entry((case.end, case.outage, case.out)).or_default();
            cell.add(outcome);
        }
        Table(cells)
    }

    pub fn is_kept(&self) -> bool {
        self.0.values().all(Cell::is_kept)
    }

    /// How many cases were played, and in how many a stop was executed in time.
    pub fn count(&self) -> (usize, usize) {
        let played = self.0.values().map(|cell| cell.played).sum();
        let bad: usize = self.0.values().map(Cell::broken).sum();
        (played, played - bad)
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut columns: Vec<(Outage, Duration)> = self
            .0
            .keys()
            .map(|(_, outage, out)| (*outage, *out))
            .collect();
        columns.sort_unstable();
        columns.dedup();
        let mut ends: Vec<End> = self.0.keys().map(|(end, _, _)| *end).collect();
        ends.dedup();
        write!(f, "{:<14}", "end of the run")?;
        for (outage, out) in &columns {
            write!(f, " {:>15}", format!("{outage:?} {} s", out.as_secs()))?;
        }
        for end in ends {
            write!(f, "\n{:<14}", format!("{end:?}"))?;
            for (outage, out) in &columns {
                let cell = self.0.get(&(end, *outage, *out));
                let text = cell.map_or_else(String::new, ToString::to_string);
                write!(f, " {text:>15}")?;
            }
        }
        Ok(())
    }
}
