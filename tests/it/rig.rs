//! A simulated robot inside the test, and the real binary that drives it. Tests wait for the
//! commands that the robot receives.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command as Process, ExitStatus, Stdio};
use std::sync::{Arc, LazyLock, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use spykee::sim::{Firmware, Handle, Options, Server, World};
use spykee::wire::{Accepted, Command, Engage, Report};
use tokio::time::timeout;

/// The limit of every wait for an expected event, generous even for a slow machine.
pub const WAIT_LIMIT: Duration = Duration::from_secs(60);

/// How often [`STALLS`] checks whether the machine stalls.
const STALL_CHECK: Duration = Duration::from_millis(20);
/// A check that comes this late shows a stall.
const STALL: Duration = Duration::from_millis(100);

/// The stalls of the machine, which stop a test and its programs alike.
static STALLS: LazyLock<Mutex<Stalls>> = LazyLock::new(|| {
    std::thread::spawn(|| {
        loop {
            std::thread::sleep(STALL_CHECK);
            Stalls::now();
        }
    });
    Mutex::new(Stalls {
        checked: Instant::now(),
        total: Duration::ZERO,
        longest: Duration::ZERO,
    })
});

#[derive(Clone, Copy)]
struct Stalls {
    checked: Instant,
    total: Duration,
    longest: Duration,
}

impl Stalls {
    fn now() -> Stalls {
        let mut stalls = STALLS.lock().unwrap();
        let gap = stalls.checked.elapsed();
        stalls.checked += gap;
        if gap > STALL {
            stalls.total += gap;
            stalls.longest = stalls.longest.max(gap);
        }
        *stalls
    }
}

/// The longest stall of the machine since the first [`Stopwatch`] was started.
pub fn longest_stall() -> Duration {
    Stalls::now().longest
}

/// Measures the time in which the machine did not stall.
pub struct Stopwatch {
    begun: Instant,
    stalled: Duration,
}

impl Stopwatch {
    pub fn start() -> Stopwatch {
        let stalls = Stalls::now();
        Stopwatch {
            begun: stalls.checked,
            stalled: stalls.total,
        }
    }

    /// For how long the machine has stalled since the start.
    pub fn stalled(&self) -> Duration {
        Stalls::now().total - self.stalled
    }

    pub fn elapsed(&self) -> Duration {
        let stalls = Stalls::now();
        let stalled = stalls.total - self.stalled;
        stalls
            .checked
            .duration_since(self.begun)
            .saturating_sub(stalled)
    }
}

/// A robot in a plain room with an almost full battery that hardly drains.
pub const QUIET_WORLD: &str = "
name: test
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
start: { at: [4, 4], heading_degrees: 90 }
battery: { level: 90, idle_drain_per_minute: 0.01, driving_drain_per_minute: 0.01 }
";

/// The same world, with a robot so near to its station that a search ends within seconds.
pub fn near_home() -> String {
    let start = "at: [4, 4], heading_degrees: 90";
    QUIET_WORLD.replace(start, "at: [1.1, 4], heading_degrees: 135")
}

/// The same world, with a robot on its station.
pub fn docked() -> String {
    QUIET_WORLD.replace("start: { at: [4, 4], heading_degrees: 90 }\n", "")
}

/// The YAML of a built-in world, but with an exact robot: for tests that are not about its body.
pub fn exact_yaml(name: &str) -> String {
    let yaml = World::builtin_yaml(name).unwrap();
    let exact = yaml.replace("preset: genuine", "preset: exact");
    assert_ne!(exact, yaml, "{name}");
    exact
}

/// The same as a world.
pub fn exact(name: &str) -> World {
    World::from_yaml(&exact_yaml(name), name).unwrap()
}

/// The answer of an undocked robot that accepts a login.
pub fn accepted() -> Report {
    Report::Accepted(Accepted {
        uid: "SPYKEE0001".to_owned(),
        name: "test".to_owned(),
        place: "test".to_owned(),
        firmware: "1.0.22".to_owned(),
        docked: false,
        tail: bytes::Bytes::new(),
    })
}

/// A simulated robot that serves until the end of the test.
pub struct Rig {
    pub sim: Handle,
    pub address: String,
    folder: tempfile::TempDir,
    server: tokio::task::JoinHandle<()>,
}

impl Drop for Rig {
    fn drop(&mut self) {
        self.server.abort();
        end_guardians(self.folder());
    }
}

/// Ends the guardians of runs in this folder. Those of killed agents would dial for ten minutes, and the
/// address may be that of another test's robot by then.
pub fn end_guardians(folder: &Path) {
    let folder = folder.to_string_lossy().into_owned();
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    for process in processes {
        let command = std::fs::read(process.path().join("cmdline")).unwrap_or_default();
        let command = String::from_utf8_lossy(&command);
        let number = process
            .file_name()
            .to_str()
            .and_then(|name| name.parse().ok());
        if command.contains("__guardian")
            && command.contains(&folder)
            && let Some(pid) = number.and_then(rustix::process::Pid::from_raw)
        {
            let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
        }
    }
}

/// How a command ended, and what it wrote.
#[derive(Debug)]
pub struct Ended {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Ended {
    /// Everything that it wrote.
    pub fn text(&self) -> String {
        [&self.out[..], &self.err].concat()
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|_| panic!("{}", self.text()))
    }
}

/// Runs a command inside the test, in the current folder: for texts and exit codes of commands that
/// start no process of the program and handle no signals.
pub fn command(args: &[&str]) -> Ended {
    let spykee::cli::TestOutput { code, out, err } = spykee::cli::run_for_test(args);
    let code = Some(code.into());
    Ended { code, out, err }
}

/// The program, without variables of this machine's environment that change its behaviour.
pub fn program(args: &[&str]) -> Process {
    let mut process = Process::new(env!("CARGO_BIN_EXE_spykee"));
    for variable in [
        "RUST_LOG",
        "NO_COLOR",
        "SPYKEE_PASSWORD",
        "SPYKEE_CONFIG",
        "RUST_BACKTRACE",
    ] {
        process.env_remove(variable);
    }
    process.args(args).stdin(Stdio::null());
    process
}

/// Runs the program in a folder to its end.
pub fn run_in(folder: &Path, args: &[&str]) -> Ended {
    let output = program(args).current_dir(folder).output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Ended {
        code: output.status.code(),
        out: text(output.stdout),
        err: text(output.stderr),
    }
}

/// Runs the binary to its end; returns its exit code and what it printed.
pub async fn run_spykee(rig: &Rig, args: &[&str]) -> (Option<i32>, String) {
    let mut run = rig.spykee(args);
    let code = run.code().await;
    (code, run.text())
}

/// Like [`run_spykee`] for a command that must succeed: its output.
pub async fn succeed(rig: &Rig, args: &[&str]) -> String {
    let (code, text) = run_spykee(rig, args).await;
    assert_eq!(code, Some(0), "{args:?}: {text}");
    text
}

impl Rig {
    pub async fn quiet() -> Rig {
        Rig::new(QUIET_WORLD, Firmware::default()).await
    }

    pub async fn near_home() -> Rig {
        Rig::new(&near_home(), Firmware::default()).await
    }

    pub async fn new(world: &str, firmware: Firmware) -> Rig {
        Rig::with_world(World::from_yaml(world, "test world").unwrap(), firmware).await
    }

    pub async fn with_world(world: World, firmware: Firmware) -> Rig {
        let options = Options {
            firmware,
            ..Options::default()
        };
        Rig::with(world, options).await
    }

    pub async fn with(world: World, options: Options) -> Rig {
        let server = Server::bind(world, options).await.unwrap();
        let sim = server.handle();
        let address = server.local_addr().to_string();
        let server = tokio::spawn(async move {
            server.run().await.unwrap();
        });
        Rig {
            sim,
            address,
            folder: tempfile::tempdir().unwrap(),
            server,
        }
    }

    /// Writes a file into the test's folder.
    pub fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    }

    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// Starts `spykee run` with one script on this robot.
    pub fn run(&self, script: &str) -> Run {
        let path = self.file("script.lua", script);
        self.spykee(&[
            "run",
            path.to_str().unwrap(),
            "--robot",
            &self.address,
            "--seed",
            "7",
        ])
    }

    /// Starts `spykee run` with the behaviours of this config on this robot.
    pub fn run_config(&self, config: &str) -> Run {
        self.file("spykee.yaml", config);
        self.spykee(&["run", "--config", "spykee.yaml", "--robot", &self.address])
    }

    /// Starts the binary with any arguments, in the test's folder.
    pub fn spykee(&self, args: &[&str]) -> Run {
        Run::start(args, self.folder.path(), Stdio::null(), &[])
    }

    /// The same, with environment variables.
    pub fn spykee_with(&self, args: &[&str], environment: &[(&str, &str)]) -> Run {
        Run::start(args, self.folder.path(), Stdio::null(), environment)
    }

    /// The same, with a pipe as its standard input.
    pub fn spykee_with_pipe(&self, args: &[&str]) -> (Run, ChildStdin) {
        let mut run = Run::start(args, self.folder.path(), Stdio::piped(), &[]);
        let pipe = run.take_input().unwrap();
        (run, pipe)
    }

    /// Waits until the robot has received a command, from an index of its journal on; returns its
    /// index.
    pub async fn heard(&self, from: usize, wanted: impl Fn(&Command) -> bool) -> usize {
        let heard = timeout(WAIT_LIMIT, self.sim.wait_heard(from, wanted)).await;
        heard.unwrap_or_else(|_| panic!("not received; instead {:?}", self.commands(from)))
    }

    pub async fn heard_stop(&self, from: usize) -> usize {
        self.heard(from, |command| *command == Command::STOP).await
    }

    pub async fn heard_motion(&self, from: usize) -> usize {
        self.heard(from, moves).await
    }

    /// Checks that nothing has stopped the robot since `from` for longer than a stall of the machine
    /// does: it still moves, and the log explains each stop.
    pub async fn drives_on(&self, run: &Run, from: usize) {
        let moving = timeout(
            WAIT_LIMIT,
            self.sim.wait_heard(self.sim.heard_count(), moves),
        )
        .await;
        let heard = self.commands(from);
        let text = run.text();
        assert!(moving.is_ok(), "it was stopped: {heard:?}\n{text}");
        let stops = heard.contains(&Command::STOP);
        assert!(
            !stops || run.has_stalled().await,
            "it was stopped: {heard:?}\n{text}"
        );
    }

    pub async fn heard_dock(&self, from: usize) -> usize {
        self.heard(from, |command| *command == Command::Engine(Engage::Dock))
            .await
    }

    pub async fn heard_cancel(&self, from: usize) -> usize {
        let cancel = Command::Engine(Engage::CancelDock);
        self.heard(from, |command| *command == cancel).await
    }

    /// Waits until the robot neither searches nor moves.
    pub async fn stands_still(&self) {
        let still = self
            .sim
            .wait_state(|state| !state.searching && !state.moving());
        let stands = timeout(WAIT_LIMIT, still).await;
        stands.expect("the tracks do not rest");
    }

    /// The commands that were received, without the questions that measure the robot's speed.
    pub fn commands(&self, from: usize) -> Vec<Command> {
        self.commands_between(from, usize::MAX)
    }

    /// The same up to an index.
    pub fn commands_between(&self, from: usize, to: usize) -> Vec<Command> {
        self.sim
            .heard_since(from)
            .into_iter()
            .take(to.saturating_sub(from))
            .map(|heard| heard.command)
            .filter(|command| *command != Command::PowerQuery)
            .collect()
    }

    /// The time at which a command was received, and the number of its write.
    pub fn at(&self, index: usize) -> (Duration, u64) {
        let heard = self.sim.heard_since(index).into_iter().next().unwrap();
        (heard.at, heard.write)
    }
}

/// The process ids of a process's children.
pub fn children_of(pid: rustix::process::Pid) -> Vec<rustix::process::Pid> {
    let pid = pid.as_raw_nonzero();
    let tasks = std::fs::read_dir(format!("/proc/{pid}/task"));
    let tasks = tasks.into_iter().flatten().flatten();
    let children =
        tasks.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
    let text: String = children.collect();
    let numbers = text
        .split_whitespace()
        .filter_map(|number| number.parse().ok());
    numbers.filter_map(rustix::process::Pid::from_raw).collect()
}

/// The process ids of the hosts of an agent's behaviours.
pub fn hosts_of(agent: rustix::process::Pid) -> Vec<rustix::process::Pid> {
    let mut children = children_of(agent);
    children.retain(|pid| is_called(*pid, "__host"));
    children
}

/// Whether a process runs with this first argument.
fn is_called(pid: rustix::process::Pid, argument: &str) -> bool {
    let line = std::fs::read(format!("/proc/{}/cmdline", pid.as_raw_nonzero()));
    let line = line.unwrap_or_default();
    let mut words = line.split(|byte| *byte == 0).skip(1);
    words
        .next()
        .is_some_and(|first| first == argument.as_bytes())
}

fn is_this_program(pid: rustix::process::Pid) -> bool {
    let program = std::fs::read_link(format!("/proc/{}/exe", pid.as_raw_nonzero()));
    program.is_ok_and(|program| program == Path::new(env!("CARGO_BIN_EXE_spykee")))
}

/// The state that `ps` shows; `?` if the process is gone.
pub fn state_of(pid: rustix::process::Pid) -> char {
    let path = format!("/proc/{}/stat", pid.as_raw_nonzero());
    let stat = std::fs::read_to_string(path).unwrap_or_default();
    let behind = stat.rsplit(") ").next().unwrap_or_default();
    behind.chars().next().unwrap_or('?')
}

/// Waits until a process is in this state.
pub async fn becomes(pid: rustix::process::Pid, state: char) {
    let became = async {
        while state_of(pid) != state {
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    let waited = timeout(WAIT_LIMIT, became).await;
    waited.unwrap_or_else(|_| panic!("{pid:?} is {}, not {state}", state_of(pid)));
}

/// The process id of an agent's guardian.
pub fn guardian_of(agent: rustix::process::Pid) -> Option<rustix::process::Pid> {
    let children = children_of(agent);
    children
        .into_iter()
        .find(|pid| is_called(*pid, "__guardian"))
}

/// A MOVE that is not a stop.
pub fn moves(command: &Command) -> bool {
    matches!(command, Command::Move { left, right } if (*left, *right) != (0, 0))
}

/// A running binary and its output so far. Killed on drop, with all processes that it has started.
pub struct Run {
    child: Child,
    /// The processes that it had started when it was sent a signal.
    descendants: Mutex<Vec<rustix::process::Pid>>,
    lines: Arc<Mutex<Vec<String>>>,
    readers: Vec<JoinHandle<()>>,
}

impl Run {
    pub fn start(args: &[&str], folder: &Path, input: Stdio, environment: &[(&str, &str)]) -> Run {
        let mut process = program(args);
        process.current_dir(folder);
        process.envs(environment.iter().copied());
        process
            .stdin(input)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child = process.spawn().unwrap();
        let lines = Arc::new(Mutex::new(Vec::new()));
        let out = collect(child.stdout.take().unwrap(), &lines);
        let err = collect(child.stderr.take().unwrap(), &lines);
        Run {
            child,
            descendants: Mutex::default(),
            lines,
            readers: vec![out, err],
        }
    }

    /// Its standard input, if that is a pipe.
    pub fn take_input(&mut self) -> Option<ChildStdin> {
        self.child.stdin.take()
    }

    /// Everything that was written to stdout and stderr so far.
    pub fn text(&self) -> String {
        self.lines.lock().unwrap().join("\n")
    }

    /// Waits until a line with this text was written.
    pub async fn says(&self, text: &str) {
        let said = async {
            while !self.text().contains(text) {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        let waited = timeout(WAIT_LIMIT, said).await;
        waited.unwrap_or_else(|_| panic!("`{text}` was not printed:\n{}", self.text()));
    }

    /// Whether it says that the machine has stalled, or one of its processes for a moment: then the
    /// tracks were stopped, and moved again.
    pub async fn has_stalled(&self) -> bool {
        const SIGNS: [&str; 3] = [
            "the machine stalled for",
            "this program hung",
            STOPPED_FOR_SILENCE,
        ];
        // The newest lines may still be on their way.
        for _ in 0..20 {
            let text = self.text();
            if SIGNS.iter().any(|sign| text.contains(sign)) {
                return true;
            }
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
        false
    }

    /// Checks to which powers the tracks were set one after the other. A stall of the machine stops
    /// them for a moment, so that then the stops do not count.
    pub async fn assert_powers(&self, powers: &[i8], expected: &[i8]) {
        if powers != expected && self.has_stalled().await {
            let without_stops = |powers: &[i8]| {
                let mut powers: Vec<i8> = powers.iter().copied().filter(|one| *one != 0).collect();
                powers.dedup();
                powers
            };
            assert_eq!(
                without_stops(powers),
                without_stops(expected),
                "{}",
                self.text()
            );
        } else {
            assert_eq!(powers, expected, "{}", self.text());
        }
    }

    pub fn signal(&self, signal: rustix::process::Signal) {
        // A guardian may outlive it after any signal that ends it.
        self.note_descendants();
        rustix::process::kill_process(self.pid(), signal).unwrap();
    }

    fn note_descendants(&self) {
        let mut descendants = self.descendants.lock().unwrap();
        let mut parents = vec![self.pid()];
        while let Some(parent) = parents.pop() {
            let children = children_of(parent);
            descendants.extend(&children);
            parents.extend(children);
        }
    }

    pub fn pid(&self) -> rustix::process::Pid {
        rustix::process::Pid::from_child(&self.child)
    }

    /// The process ids of the hosts of its behaviours.
    pub fn hosts(&self) -> Vec<rustix::process::Pid> {
        hosts_of(self.pid())
    }

    /// The process id of its guardian.
    pub fn guardian(&self) -> Option<rustix::process::Pid> {
        guardian_of(self.pid())
    }

    /// Whether it is still running.
    pub fn lives(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    /// Waits for its end and returns the exit code.
    pub async fn code(&mut self) -> Option<i32> {
        self.status().await.code()
    }

    pub async fn status(&mut self) -> ExitStatus {
        let ended = async {
            loop {
                if let Some(status) = self.child.try_wait().unwrap() {
                    return status;
                }
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        let status = timeout(WAIT_LIMIT, ended).await;
        let status = status.unwrap_or_else(|_| panic!("it does not end:\n{}", self.text()));
        self.readers
            .drain(..)
            .for_each(|reader| reader.join().unwrap());
        status
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        if self.lives() {
            self.note_descendants();
        }
        let _ = self.child.kill();
        let _ = self.child.wait();
        for pid in self.descendants.lock().unwrap().drain(..) {
            // Another process may have the number by now.
            if is_this_program(pid) {
                let _ = rustix::process::kill_process(pid, rustix::process::Signal::KILL);
            }
        }
    }
}

fn collect(
    stream: impl std::io::Read + Send + 'static,
    lines: &Arc<Mutex<Vec<String>>>,
) -> JoinHandle<()> {
    let lines = Arc::clone(lines);
    std::thread::spawn(move || {
        for line in BufReader::new(stream).lines().map_while(Result::ok) {
            lines.lock().unwrap().push(line);
        }
    })
}

/// Runs an ignored test alone in a process, so that threads and memory of other tests do not count.
pub fn in_a_process_of_its_own(test: &str) {
    let alone = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", test, "--ignored"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&alone.stdout);
    assert!(
        alone.status.success() && text.contains("1 passed"),
        "{text}"
    );
}

/// What the watchdog logs when it stops the tracks because their script is silent.
pub const STOPPED_FOR_SILENCE: &str = "a script showed no life for 250 ms";

/// The size of a test that `scripts/nightly` plays at full length.
pub fn sized<T>(on_push: T, nightly: T) -> T {
    if std::env::var_os("NIGHTLY").is_some() {
        nightly
    } else {
        on_push
    }
}

/// Fails with the whole text if one of these words is missing in it.
#[track_caller]
pub fn assert_contains(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "`{word}` is missing in:\n{text}");
    }
}
