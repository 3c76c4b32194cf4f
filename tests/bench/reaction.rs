//! Measures the reaction time from the last byte of a frame to the first byte of the MOVE that
//! answers it: of `spykee run` with `follow_colour.lua`, of the same beside a script that
//! repeatedly uses half of its CPU budget (one that uses more is ended when the machine stalls),
//! and of a plain Python and OpenCV client that does the same calculations. All clients get the
//! same frames from one robot, in one run.
//!
//! Frames are written at once, as over a cable, and packet by packet, as Wi-Fi delivers them.
//!
//! `scripts/bench-reaction` sets up the Python environment and calls this. For `scripts/bench-live`
//! it compares runs without and with open pages (`SPYKEE_BENCH_VIEWERS=10,30`), and measures the
//! age of frames when they arrive at the pages.

#![allow(clippy::unwrap_used)]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bytes::Bytes;
use spykee::sim::{Firmware, Pose, Robot, World};
use spykee::wire::{self, Accepted, Decoder, Power, Report, Stream};

/// Answers measured for each client.
const ANSWERS: usize = 900;
/// Answers not counted at the start of each measurement.
const WARM_UP: usize = 20;
/// Time from one frame to the next: 15 frames per second.
const PERIOD: Duration = Duration::from_micros(66_667);
/// Payload of a packet on Ethernet and Wi-Fi, bytes.
const PACKET: usize = 1448;
/// Time from one packet to the next at about 8 Mbit/s, a typical net rate of 802.11b and g at home.
const PACKET_TIME: Duration = Duration::from_micros(1_450);
/// Pause before the last packet is written, for late answers to the previous frame.
const DRAIN: Duration = Duration::from_micros(100);
/// Number of different frames, sent in rotation.
const FRAMES: usize = 64;

const WORLD: &str = "
name: reaction
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
balls: [ { at: [5, 4], colour: red }, { at: [5.6, 5], colour: blue }, { at: [6, 3], colour: green } ]
posts: [ { at: [6.5, 4.6], colour: yellow } ]
start: { at: [3.4, 4], heading_degrees: 0 }
";

/// Repeatedly computes for about half of the CPU budget, then waits for a moment.
const BURNER: &str =
    "while true do local x = 0 for i = 1, 3e6 do x += i % 7 end task.wait(0.005) end";

fn main() {
    if std::env::args().any(|argument| argument == "--test") {
        return;
    }
    let frames = frames();
    let folder = tempfile::tempdir().unwrap();
    let burner = folder.path().join("burner.lua");
    std::fs::write(&burner, BURNER).unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let follow = root.join("behaviours/follow_colour.lua");
    let spykee = |scripts: &[&Path]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_spykee"));
        command.arg("run").args(scripts).current_dir(folder.path());
        command
    };
    if let Ok(numbers) = std::env::var("SPYKEE_BENCH_VIEWERS") {
        let numbers = numbers.split(',').map(|number| number.parse().unwrap());
        return compare(&frames, &numbers.collect::<Vec<usize>>(), || {
            spykee(&[&follow])
        });
    }
    let python = std::env::var_os("SPYKEE_BENCH_PYTHON");
    if python.is_none() {
        eprintln!("no Python client: call scripts/bench-reaction");
    }
    for (way, delivery) in [
        ("in one piece", Delivery::AtOnce),
        ("as Wi-Fi", Delivery::Packets),
    ] {
        let mut rows = vec![
            ("spykee", measure(&frames, delivery, spykee(&[&follow]))),
            (
                "spykee beside a burner",
                measure(&frames, delivery, spykee(&[&follow, &burner])),
            ),
        ];
        if let Some(python) = &python {
            let mut client = Command::new(python);
            client.arg(root.join("tests/bench/reaction/client.py"));
            rows.push(("Python and OpenCV", measure(&frames, delivery, client)));
        }
        print(way, &rows);
    }
}

/// How a frame's bytes are sent.
#[derive(Clone, Copy)]
enum Delivery {
    AtOnce,
    Packets,
}

/// Renders the room from one place, turned slightly more to the left or right each time, so that
/// every frame requires a different answer.
fn frames() -> Vec<Bytes> {
    let world = World::from_yaml(WORLD, "reaction").unwrap();
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    robot.execute(&wire::Command::Stream {
        stream: Stream::Video,
        on: true,
    });
    let look = |turn: usize| {
        let side = if turn.is_multiple_of(2) { 1.0 } else { -1.0 };
        let heading = side * (0.04 + 0.3 * (turn as f64 / FRAMES as f64));
        robot.place(Pose {
            x: 3.4,
            y: 4.0,
            heading,
        });
        newest_frame(&mut robot)
    };
    (0..FRAMES).map(look).collect()
}

fn newest_frame(robot: &mut Robot) -> Bytes {
    robot.take_reports();
    loop {
        robot.step(Duration::from_millis(20));
        let video = |report| match report {
            Report::Video(jpeg) => Some(jpeg),
            _ => None,
        };
        if let Some(jpeg) = robot.take_reports().into_iter().find_map(video) {
            return jpeg;
        }
    }
}

/// Lets a client drive a fake robot and measures the time of its answers.
fn measure(frames: &[Bytes], delivery: Delivery, client: Command) -> Vec<Duration> {
    measure_beside(frames, delivery, client, || {}, |_| {})
}

/// Like [`measure`]; calls `begin` once the client has requested frames, and `sent` with the time
/// of each frame.
fn measure_beside(
    frames: &[Bytes],
    delivery: Delivery,
    mut client: Command,
    begin: impl FnOnce(),
    mut sent: impl FnMut(Instant),
) -> Vec<Duration> {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    client.args(["--robot", &listener.local_addr().unwrap().to_string()]);
    client
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    let mut child = Guard(client.spawn().unwrap());
    let (stream, _) = listener.accept().unwrap();
    let mut session = Session::begin(stream);
    while !session.video {
        session.wait_for(|_| true);
    }
    begin();
    let mut answers = Vec::new();
    for frame in frames.iter().cycle().take(ANSWERS + WARM_UP) {
        let due = Instant::now() + PERIOD;
        sent(Instant::now());
        answers.push(session.show(frame, delivery, due));
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    let _ = child.0.kill();
    let missed = answers.iter().filter(|answer| answer.is_none()).count();
    assert!(
        missed * 20 < answers.len(),
        "{missed} of {} unanswered",
        answers.len()
    );
    answers.into_iter().skip(WARM_UP).flatten().collect()
}

/// Ends the client when dropped.
struct Guard(Child);

impl Drop for Guard {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

const LEVEL: Power = Power {
    percent: 90,
    charging: false,
};

/// The robot's side of one connection.
struct Session {
    stream: TcpStream,
    decoder: Decoder,
    last_move: (i8, i8),
    /// The client has requested frames.
    video: bool,
}

impl Session {
    fn begin(stream: TcpStream) -> Session {
        stream.set_nodelay(true).unwrap();
        let mut session = Session {
            stream,
            decoder: Decoder::new(),
            last_move: (0, 0),
            video: false,
        };
        session.wait_for(|command| matches!(command, wire::Command::Login(_)));
        let text = String::from;
        let uid = text("BENCH");
        let name = text("bench");
        let place = text("here");
        let accepted = Accepted {
            uid,
            name,
            place,
            firmware: text("1"),
            docked: false,
            tail: bytes::Bytes::new(),
        };
        session.send(&Report::Accepted(accepted));
        session.send(&Report::Power(LEVEL));
        session
    }

    fn send(&mut self, report: &Report) {
        self.stream.write_all(&report.to_bytes()).unwrap();
    }

    /// Reads commands until one satisfies `wanted` or the time is over.
    fn listen(&mut self, due: Instant, wanted: impl Fn(&wire::Command, (i8, i8)) -> bool) -> bool {
        let mut chunk = [0; 4096];
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            self.stream.set_read_timeout(Some(left)).unwrap();
            let Ok(count) = self.stream.read(&mut chunk) else {
                return false;
            };
            assert!(count > 0, "the client has disconnected");
            let mut input = &chunk[..count];
            let mut found = false;
            while let Some(packet) = self.decoder.decode(&mut input).unwrap() {
                let command = wire::Command::parse(packet);
                found |= wanted(&command, self.last_move);
                match command {
                    wire::Command::Move { left, right } => self.last_move = (left, right),
                    wire::Command::Stream {
                        stream: Stream::Video,
                        on,
                    } => self.video = on,
                    // A robot that executes at once; one that does not answer is sent less.
                    wire::Command::PowerQuery => self.send(&Report::Power(LEVEL)),
                    _ => {}
                }
            }
            if found {
                return true;
            }
        }
    }

    /// Reads what has arrived, without waiting: a late answer to the previous frame must not count
    /// as an answer to the next one. The kernel would round a timeout up to its next tick, and the
    /// frame rate would not be steady.
    fn read_late_answers(&mut self) {
        self.stream.set_nonblocking(true).unwrap();
        self.listen(Instant::now() + PERIOD, |_, _| false);
        self.stream.set_nonblocking(false).unwrap();
    }

    fn wait_for(&mut self, wanted: impl Fn(&wire::Command) -> bool) {
        let due = Instant::now() + Duration::from_secs(60);
        assert!(
            self.listen(due, |command, _| wanted(command)),
            "the client does not answer"
        );
    }

    /// Sends a frame; returns the time until the first MOVE that differs from the previous one.
    fn show(&mut self, frame: &Bytes, delivery: Delivery, due: Instant) -> Option<Duration> {
        let bytes = Report::Video(frame.clone()).to_bytes();
        let mut packets = match delivery {
            Delivery::AtOnce => bytes.chunks(bytes.len()),
            Delivery::Packets => bytes.chunks(PACKET),
        };
        let last = packets.next_back().unwrap_or_default();
        for packet in packets {
            self.stream.write_all(packet).unwrap();
            std::thread::sleep(PACKET_TIME);
        }
        std::thread::sleep(DRAIN);
        self.read_late_answers();
        // Measured before the write: the reader may run before the writer continues.
        let shown = Instant::now();
        self.stream.write_all(last).unwrap();
        let changed = |command: &wire::Command, last_move: (i8, i8)| matches!(command, wire::Command::Move { left, right } if (*left, *right) != last_move);
        self.listen(due, changed).then(|| shown.elapsed())
    }
}

fn print(way: &str, rows: &[(&str, Vec<Duration>)]) {
    let quantile = |times: &[Duration], part: f64| {
        let mut sorted = times.to_vec();
        sorted.sort();
        sorted[((sorted.len() - 1) as f64 * part) as usize].as_secs_f64() * 1e3
    };
    let peer = rows.iter().find(|(name, _)| name.starts_with("Python"));
    println!(
        "{:24} {:>9} {:>9} {:>9} {:>9}",
        way, "p50 ms", "p99 ms", "x p50", "x p99"
    );
    for (name, times) in rows {
        let p50 = quantile(times, 0.5);
        let p99 = quantile(times, 0.99);
        let times_faster = |part, own: f64| {
            peer.map_or_else(String::new, |(_, peer)| {
                format!("{:.1}", quantile(peer, part) / own)
            })
        };
        let by50 = times_faster(0.5, p50);
        let by99 = times_faster(0.99, p99);
        println!("{name:24} {p50:9.2} {p99:9.2} {by50:>9} {by99:>9}");
    }
}

/// The times at which frames were sent; a frame's number is its position, from 1.
type Sent = Arc<Mutex<Vec<Instant>>>;
type Ages = Arc<Mutex<Vec<Duration>>>;

/// Prints one row for each number of viewers, each after a row of a new measurement without
/// viewers.
pub(crate) fn compare(frames: &[Bytes], numbers: &[usize], spykee: impl Fn() -> Command) {
    println!(
        "{:12} {:>9} {:>9} {:>12} {:>12} {:>12}",
        "viewers", "p50 ms", "p99 ms", "p50 to none", "age p50 ms", "age p95 ms"
    );
    for &number in numbers {
        let alone = measure(frames, Delivery::AtOnce, with_page(spykee(), free()));
        println!(
            "{:12} {:9.2} {:9.2}",
            "none",
            quantile(&alone, 0.5),
            quantile(&alone, 0.99)
        );
        let address = free();
        let sent = Sent::default();
        let ages = Ages::default();
        let look = ages.clone();
        let seen = sent.clone();
        let begin = move || {
            for _ in 0..number {
                let seen = seen.clone();
                let look = look.clone();
                std::thread::spawn(move || view(address, &seen, &look));
            }
            // Gives all viewers time to connect.
            std::thread::sleep(Duration::from_secs(1));
        };
        let command = with_page(spykee(), address);
        let note = |at| sent.lock().unwrap().push(at);
        let beside = measure_beside(frames, Delivery::AtOnce, command, begin, note);
        let ages = ages.lock().unwrap();
        assert!(ages.len() > number * 100, "{} frames have come", ages.len());
        println!(
            "{number:12} {:9.2} {:9.2} {:12.2} {:12.1} {:12.1}",
            quantile(&beside, 0.5),
            quantile(&beside, 0.99),
            quantile(&beside, 0.5) / quantile(&alone, 0.5),
            quantile(&ages, 0.5),
            quantile(&ages, 0.95),
        );
    }
}

fn with_page(mut command: Command, address: SocketAddr) -> Command {
    command.arg(format!("--live={address}"));
    command
}

fn free() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap()
}

fn quantile(times: &[Duration], part: f64) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort();
    sorted[((sorted.len() - 1) as f64 * part) as usize].as_secs_f64() * 1e3
}

/// Simulates a page that watches the camera until the connection is closed.
fn view(address: SocketAddr, sent: &Sent, ages: &Ages) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    let hello = format!(
        "GET /live HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    );
    stream.write_all(hello.as_bytes()).unwrap();
    let mut byte = [0];
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).unwrap();
        head.push(byte[0]);
    }
    send(
        &mut stream,
        0x81,
        b"{\"type\":\"watch\",\"camera\":true,\"map\":true,\"log\":true}",
    );
    while let Some((kind, payload)) = receive(&mut stream) {
        match kind {
            2 => {
                let number = u32::from_be_bytes(payload[..4].try_into().unwrap()) as usize;
                let at = number
                    .checked_sub(1)
                    .and_then(|index| sent.lock().unwrap().get(index).copied());
                if let Some(at) = at {
                    ages.lock().unwrap().push(at.elapsed());
                }
                send(&mut stream, 0x81, b"{\"type\":\"frame_shown\"}");
            }
            9 => send(&mut stream, 0x8a, &payload),
            _ => {}
        }
    }
}

/// Sends a short WebSocket message with a zero mask.
fn send(stream: &mut TcpStream, head: u8, payload: &[u8]) {
    let mut frame = vec![head, 0x80 | payload.len() as u8, 0, 0, 0, 0];
    frame.extend(payload);
    let _ = stream.write_all(&frame);
}

/// Receives a WebSocket message: the type and the payload; `None` at the end.
fn receive(stream: &mut TcpStream) -> Option<(u8, Vec<u8>)> {
    let mut head = [0; 2];
    stream.read_exact(&mut head).ok()?;
    let length = match head[1] {
        126 => {
            let mut length = [0; 2];
            stream.read_exact(&mut length).ok()?;
            usize::from(u16::from_be_bytes(length))
        }
        127 => {
            let mut length = [0; 8];
            stream.read_exact(&mut length).ok()?;
            u64::from_be_bytes(length) as usize
        }
        length => usize::from(length),
    };
    let mut payload = vec![0; length];
    stream.read_exact(&mut payload).ok()?;
    Some((head[0] & 0x0f, payload))
}
