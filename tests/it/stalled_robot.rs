//! A robot whose program does not read for a while, though its camera goes on: what the agent wrote
//! last is still on its way when the agent is killed.

use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use rustix::process::{Pid, Signal};
use socket2::{Domain, Socket, Type};
use spykee::wire::{Command, Decoder, Engage, Power, Report};
use tokio::time::{sleep, timeout};

use crate::rig::{Rig, Stopwatch, WAIT_LIMIT, accepted, moves, state_of};

/// Speech soon fills the robot's small receive buffer.
const TALKS: &str = "robot.stream('video', true) robot.stream('audio_out', true)
robot.move(40, 40)
local tone = buffer.create(32000)
while true do robot.say(tone) task.wait(0.5) end";

/// The receive buffer counts as full when its content has not grown for this long.
const NO_LONGER_GROWS: Duration = Duration::from_millis(250);
/// Time for a guardian to end at once, if it does; much less than it stays for.
const AT_ONCE: Duration = Duration::from_millis(300);

/// A listener whose connections have small receive buffers.
fn small_listener() -> TcpListener {
    let socket = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
    socket.set_recv_buffer_size(2048).unwrap();
    let address: SocketAddr = "127.0.0.1:0".parse().unwrap();
    socket.bind(&address.into()).unwrap();
    socket.listen(1).unwrap();
    socket.into()
}

/// The robot's side of a connection.
struct Robot {
    stream: TcpStream,
    decoder: Decoder,
}

impl Robot {
    fn accept(listener: &TcpListener) -> Robot {
        let (stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(WAIT_LIMIT)).unwrap();
        let decoder = Decoder::new();
        let mut robot = Robot { stream, decoder };
        robot.send(&accepted());
        robot.send_level(90);
        robot
    }

    fn send(&mut self, report: &Report) {
        self.stream.write_all(&report.to_bytes()).unwrap();
    }

    fn send_level(&mut self, percent: u8) {
        let charging = false;
        self.send(&Report::Power(Power { percent, charging }));
    }

    /// Sends video until the connection ends, on a thread.
    fn film(&self) {
        let mut stream = self.stream.try_clone().unwrap();
        let frame = Report::Video(bytes::Bytes::from_static(&[7; 5000])).to_bytes();
        std::thread::spawn(move || {
            while stream.write_all(&frame).is_ok() {
                std::thread::sleep(Duration::from_millis(60));
            }
        });
    }

    /// The next commands; `None` at the end of the connection.
    fn read(&mut self) -> Option<Vec<Command>> {
        let mut chunk = [0; 4096];
        let count = self.stream.read(&mut chunk).unwrap_or(0);
        let mut bytes = &chunk[..count];
        let mut commands = Vec::new();
        while let Some(packet) = self.decoder.decode(&mut bytes).unwrap() {
            commands.push(Command::parse(packet));
        }
        // As a fast robot: otherwise little is sent to it.
        for _ in commands.iter().filter(|one| **one == Command::PowerQuery) {
            let charging = false;
            let power = Report::Power(Power {
                percent: 90,
                charging,
            });
            let _ = self.stream.write_all(&power.to_bytes());
        }
        (count > 0).then_some(commands)
    }

    /// Reads until a motion was received.
    fn read_motion(&mut self) {
        while !self.read().expect("no motion").iter().any(moves) {}
    }

    /// Waits until the receive buffer is full.
    async fn filled(&self) {
        let mut len = 0;
        let mut since = Stopwatch::start();
        while len == 0 || since.elapsed() < NO_LONGER_GROWS {
            let now = rustix::io::ioctl_fionread(&self.stream).unwrap();
            if now != len {
                (len, since) = (now, Stopwatch::start());
            }
            sleep(Duration::from_millis(5)).await;
        }
    }
}

async fn gone(process: Pid) {
    while !matches!(state_of(process), '?' | 'Z') {
        sleep(Duration::from_millis(5)).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_low_robot_is_sent_home_though_the_agent_is_killed_before_that_has_arrived() {
    let rig = Rig::quiet().await;
    let listener = small_listener();
    let script = rig.file("script.lua", TALKS);
    let address = listener.local_addr().unwrap().to_string();
    let run = rig.spykee(&["run", script.to_str().unwrap(), "--robot", &address]);
    let mut robot = Robot::accept(&listener);
    robot.film();
    robot.read_motion();
    let filled = timeout(WAIT_LIMIT, robot.filled()).await;
    filled.expect("the receive buffer does not fill");
    robot.send_level(10);
    run.says("stops and goes home").await;
    let guardian = run.guardian().expect("no guardian");
    run.signal(Signal::KILL);
    let _ = timeout(AT_ONCE, gone(guardian)).await;
    let mut tracks = Vec::new();
    while let Some(mut commands) = robot.read() {
        commands.retain(|one| matches!(one, Command::Move { .. } | Command::Engine(_)));
        tracks.append(&mut commands);
    }
    let home = [Command::STOP, Command::Engine(Engage::Dock)];
    assert!(tracks.ends_with(&home), "{tracks:?}");
    timeout(WAIT_LIMIT, gone(guardian)).await.unwrap();
}
