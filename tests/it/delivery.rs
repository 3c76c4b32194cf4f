//! The last commands of a run are delivered: the real binary and a simulated robot in separate
//! network namespaces, and between them a relay that forwards packets, or drops those to the robot.

use std::fs::File;
use std::io::Write as _;
use std::net::TcpListener;
use std::os::fd::AsFd;
use std::path::Path;
use std::process::{Child, Command as Process, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use rustix::thread::{LinkNameSpaceType, move_into_link_name_space};
use spykee::sim::{Handle, Options, Server, World};
use spykee::wire::{Command, Engage, Power, Report};
use tokio::time::{sleep, timeout};

use crate::rig::{QUIET_WORLD, Stopwatch, WAIT_LIMIT, accepted, assert_contains, moves};

const ROBOT: &str = "10.9.0.1:9000";

/// Makes the namespaces `$N-robot`, `$N-relay` and `$N-agent`.
const SET_UP: &str = "set -e
for ns in robot relay agent; do ip netns add $N-$ns; ip -n $N-$ns link set lo up; done
ip link add r0 netns $N-robot type veth peer name r1 netns $N-relay
ip link add a0 netns $N-agent type veth peer name a1 netns $N-relay
ip -n $N-robot addr add 10.9.0.1/24 dev r0
ip -n $N-relay addr add 10.9.0.2/24 dev r1
ip -n $N-relay addr add 10.9.1.2/24 dev a1
ip -n $N-agent addr add 10.9.1.1/24 dev a0
ip -n $N-robot link set r0 up
ip -n $N-relay link set r1 up
ip -n $N-relay link set a1 up
ip -n $N-agent link set a0 up
ip -n $N-robot route add default via 10.9.0.2
ip -n $N-agent route add default via 10.9.1.2
ip netns exec $N-relay sh -c 'echo 1 > /proc/sys/net/ipv4/ip_forward'
ip netns exec $N-relay tc qdisc add dev r1 root pfifo limit 0
ip netns exec $N-relay tc qdisc del dev r1 root";
const TEAR_DOWN: &str = "for ns in robot relay agent; do ip netns del $N-$ns; done";
/// A queue without any room.
const DROP: &str = "ip netns exec $N-relay tc qdisc add dev r1 root pfifo limit 0";
const FORWARD: &str = "ip netns exec $N-relay tc qdisc del dev r1 root";

/// The three namespaces; deleted on drop.
struct Net {
    name: String,
    /// Where its agents run: they must not find the runs of other tests.
    folder: tempfile::TempDir,
}

impl Net {
    /// `None`, with a message, if the test may not create namespaces.
    fn new() -> Option<Net> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let net = Net {
            name: format!("spykee-{}-{count}", std::process::id()),
            folder: tempfile::tempdir().unwrap(),
        };
        let made = net.shell(SET_UP);
        if made.status.success() {
            return Some(net);
        }
        let why = String::from_utf8_lossy(&made.stderr);
        println!(
            "skipped, no network namespaces can be made here: {}",
            why.trim()
        );
        None
    }

    fn shell(&self, script: &str) -> Output {
        let mut shell = Process::new("sh");
        shell.args(["-c", script]).env("N", &self.name);
        shell.output().unwrap()
    }

    /// A robot in its namespace, served by a separate thread.
    fn robot(&self) -> Handle {
        let namespace = File::open(format!("/run/netns/{}-robot", self.name)).unwrap();
        let (told, handle) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            let mut runtime = tokio::runtime::Builder::new_current_thread();
            runtime.enable_all().build().unwrap().block_on(async {
                let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
                let options = Options {
                    listen: ROBOT.parse().unwrap(),
                    ..Options::default()
                };
                let server = Server::bind(world, options).await.unwrap();
                told.send(server.handle()).unwrap();
                server.run().await.unwrap();
            });
        });
        handle.recv().unwrap()
    }

    /// A server in the robot's place, on a separate thread: accepts one user, reports that on a
    /// channel, waits for permission to send the battery level, sends it, and then sends nothing
    /// more.
    fn silent_robot(&self) -> (mpsc::Receiver<()>, mpsc::Sender<()>) {
        let namespace = File::open(format!("/run/netns/{}-robot", self.name)).unwrap();
        let (let_in, entered) = mpsc::channel();
        let (may, told) = mpsc::channel();
        std::thread::spawn(move || {
            move_into_link_name_space(namespace.as_fd(), Some(LinkNameSpaceType::Network)).unwrap();
            let listener = TcpListener::bind(ROBOT).unwrap();
            let_in.send(()).unwrap();
            let (mut user, _) = listener.accept().unwrap();
            user.write_all(&accepted().to_bytes()).unwrap();
            let_in.send(()).unwrap();
            told.recv().unwrap();
            let percent = 90;
            let charging = false;
            let power = Report::Power(Power { percent, charging });
            user.write_all(&power.to_bytes()).unwrap();
            let _ = told.recv();
        });
        entered.recv_timeout(WAIT_LIMIT).unwrap();
        (entered, may)
    }

    /// Starts `spykee run` in the agent's namespace.
    fn run(&self, script: &Path) -> Agent {
        self.spykee(&["run", script.to_str().unwrap(), "--seed", "7"])
    }

    /// Starts `spykee` in the agent's namespace, for the robot.
    fn spykee(&self, arguments: &[&str]) -> Agent {
        let binary = std::env::var("SPYKEE_TEST_BINARY");
        let binary = binary.unwrap_or_else(|_| env!("CARGO_BIN_EXE_spykee").to_owned());
        let mut process = Process::new("ip");
        process.args(["netns", "exec", &format!("{}-agent", self.name), &binary]);
        process.args(arguments).args(["--robot", ROBOT]);
        process.current_dir(self.folder.path());
        process.env_remove("RUST_LOG").stdin(Stdio::null());
        process.stdout(Stdio::null()).stderr(Stdio::piped());
        Agent(process.spawn().unwrap())
    }
}

impl Drop for Net {
    fn drop(&mut self) {
        self.shell(TEAR_DOWN);
    }
}

/// A running binary; killed on drop.
struct Agent(Child);

impl Agent {
    fn interrupt(&self) {
        kill_process(Pid::from_child(&self.0), Signal::TERM).unwrap();
    }

    /// Its exit code, once it has ended.
    fn code(&mut self) -> Option<i32> {
        self.0.try_wait().unwrap().and_then(|status| status.code())
    }

    /// Waits for its end and returns its output.
    async fn ended(&mut self) -> String {
        let ended = async {
            while self.0.try_wait().unwrap().is_none() {
                sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(WAIT_LIMIT, ended).await.expect("it does not end");
        self.said()
    }

    /// Kills it and returns its output.
    fn killed(&mut self) -> String {
        self.0.kill().unwrap();
        self.said()
    }

    /// Its whole output, after its end.
    fn said(&mut self) -> String {
        let mut said = String::new();
        let mut stderr = self.0.stderr.take().unwrap();
        std::io::Read::read_to_string(&mut stderr, &mut said).unwrap();
        said
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A robot, a script that drives it and uses the camera, and the network between them.
struct DeliveryRig {
    net: Net,
    sim: Handle,
    folder: tempfile::TempDir,
}

const STREAMING_SCRIPT: &str = "robot.stream('video', true) robot.move(40, -40) task.wait(600)";
/// Queues speech for a minute beside the commands.
const TALKS: &str = "robot.stream('video', true) robot.stream('audio_out', true)
robot.move(40, -40)
local tone = buffer.create(32000)
while true do robot.say(tone) task.wait(0.5) end";

impl DeliveryRig {
    fn new() -> Option<DeliveryRig> {
        let net = Net::new()?;
        let sim = net.robot();
        let folder = tempfile::tempdir().unwrap();
        Some(DeliveryRig { net, sim, folder })
    }

    /// Starts a run and waits until it drives and receives frames; also returns the index of its
    /// first motion.
    async fn driving(&self, script: &str) -> (Agent, usize) {
        let path = self.folder.path().join("script.lua");
        std::fs::write(&path, script).unwrap();
        let free = self.sim.wait_state(|state| state.user.is_none());
        timeout(WAIT_LIMIT, free)
            .await
            .expect("the last user is still connected");
        let from = self.sim.heard_count();
        let frames = self.sim.state().frames;
        let mut agent = self.net.run(&path);
        let both = async {
            let moving = self.sim.wait_heard(from, moves).await;
            self.sim
                .wait_state(|state| state.frames > frames + 10)
                .await;
            moving
        };
        match timeout(WAIT_LIMIT, both).await {
            Ok(moving) => (agent, moving),
            Err(_) => panic!(
                "does not drive, or no frames: {:?}\n{:?}\n{}",
                self.sim.heard_since(from),
                self.sim.state(),
                agent.killed()
            ),
        }
    }

    /// Interrupts a run while nothing reaches the robot for this long; returns its output.
    async fn interrupt(&self, agent: &mut Agent, outage: Duration) -> String {
        assert!(self.net.shell(DROP).status.success());
        agent.interrupt();
        sleep(outage).await;
        assert!(self.net.shell(FORWARD).status.success());
        agent.ended().await
    }

    /// Whether the robot receives a command before the connection ends.
    async fn receives(&self, from: usize, wanted: Command) -> bool {
        let heard = || {
            let heard = self.sim.heard_since(from).into_iter();
            heard.map(|heard| heard.command).any(|one| one == wanted)
        };
        let ended = self.sim.wait_state(|state| state.user.is_none());
        let _ = timeout(Duration::from_secs(10), ended).await;
        heard()
    }

    /// Whether a stop arrives at the end of a run with this outage, and the output of the run.
    async fn stop_arrives(&self, script: &str, outage: Duration) -> (bool, String) {
        let (mut agent, moving) = self.driving(script).await;
        let said = self.interrupt(&mut agent, outage).await;
        (self.receives(moving, Command::STOP).await, said)
    }
}

const OUTAGES: [Duration; 2] = [Duration::from_millis(150), Duration::from_millis(400)];

#[tokio::test(flavor = "multi_thread")]
async fn the_last_stop_arrives_through_an_outage_with_the_camera_on() {
    let Some(rig) = DeliveryRig::new() else {
        return;
    };
    for script in [STREAMING_SCRIPT, TALKS] {
        for outage in OUTAGES {
            let (arrived, said) = rig.stop_arrives(script, outage).await;
            assert!(
                arrived,
                "outage of {outage:?}: no stop was received\n{said}"
            );
            assert_contains(&said, &["has executed the stop"]);
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_low_robot_is_still_sent_home_at_the_end() {
    let Some(rig) = DeliveryRig::new() else {
        return;
    };
    rig.sim.hide_station(true);
    let (mut agent, moving) = rig.driving(STREAMING_SCRIPT).await;
    let percent = 10;
    let charging = false;
    rig.sim.inject(Report::Power(Power { percent, charging }));
    let dock = |command: &Command| *command == Command::Engine(Engage::Dock);
    let first = timeout(WAIT_LIMIT, rig.sim.wait_heard(moving, dock)).await;
    rig.interrupt(&mut agent, OUTAGES[1]).await;
    let again = first.expect("no BASE_FIND") + 1;
    assert!(rig.receives(again, Command::Engine(Engage::Dock)).await);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_that_does_not_arrive_is_reported_as_lost_in_time() {
    let Some(rig) = DeliveryRig::new() else {
        return;
    };
    let (mut agent, _) = rig.driving(STREAMING_SCRIPT).await;
    assert!(rig.net.shell(DROP).status.success());
    agent.interrupt();
    let began = Stopwatch::start();
    let said = agent.ended().await;
    assert_contains(&said, &["has not confirmed the stop"]);
    assert!(
        began.elapsed() < Duration::from_secs(5),
        "{:?}",
        began.elapsed()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn robot_stop_reports_that_its_stop_has_not_arrived() {
    let Some(net) = Net::new() else { return };
    let (entered, may_tell) = net.silent_robot();
    let mut stop = net.spykee(&["robot", "stop", "--timeout", "1"]);
    entered.recv_timeout(WAIT_LIMIT).unwrap();
    assert!(net.shell(DROP).status.success());
    may_tell.send(()).unwrap();
    let said = stop.ended().await;
    assert_contains(&said, &["has not confirmed the stop"]);
    assert_eq!(stop.code(), Some(3), "{said}");
}

/// `SPYKEE_TEST_BINARY=... cargo test --test it -- --ignored --nocapture fifty` counts for any binary.
#[tokio::test(flavor = "multi_thread")]
#[ignore = "takes minutes"]
async fn fifty_of_fifty_stops_arrive() {
    let Some(rig) = DeliveryRig::new() else {
        return;
    };
    for outage in OUTAGES {
        let mut arrived = 0;
        for _ in 0..50 {
            arrived += u32::from(rig.stop_arrives(STREAMING_SCRIPT, outage).await.0);
        }
        println!("outage of {outage:?}: {arrived} of 50 stops heard");
        assert!(arrived == 50 || std::env::var_os("SPYKEE_TEST_BINARY").is_some());
    }
}
