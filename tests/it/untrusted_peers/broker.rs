//! Brokers that are malicious or speak another protocol. Written byte by byte, without the client's
//! library.

use std::time::Duration;

use spykee::wire::{Command, Sound};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};

use super::{DRIVES, drove_on};
use crate::rig::{Rig, Run, WAIT_LIMIT};

const COMMAND: &str = "spykee/SPYKEE0001/command";
const CHOICE: &str = "spykee/SPYKEE0001/behaviour/set";
/// The limits of a flood in the log, in lines and bytes.
const MAX_LINES: usize = 1000;
const MAX_BYTES: usize = 128 * 1024;

/// A length in MQTT's encoding.
fn length(mut length: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    loop {
        let more = length > 127;
        bytes.push((length % 128) as u8 | if more { 128 } else { 0 });
        length /= 128;
        if !more {
            return bytes;
        }
    }
}

fn packet(head: u8, body: &[u8]) -> Vec<u8> {
    [&[head], &length(body.len())[..], body].concat()
}

/// A message with QoS 0.
fn message(topic: &[u8], payload: &[u8]) -> Vec<u8> {
    let size = u16::try_from(topic.len()).unwrap().to_be_bytes();
    packet(0x30, &[&size, topic, payload].concat())
}

fn command(payload: &[u8]) -> Vec<u8> {
    message(COMMAND.as_bytes(), payload)
}

/// An agent that drives, and a broker that has accepted its login and its subscriptions.
struct HostileBroker {
    run: Run,
    rig: Rig,
    listener: TcpListener,
    stream: TcpStream,
    from: usize,
}

/// Reads the next packet; `None` if the connection has ended.
async fn next(stream: &mut TcpStream) -> Option<(u8, Vec<u8>)> {
    let head = stream.read_u8().await.ok()?;
    let mut size = 0;
    let mut shift = 0;
    loop {
        let byte = usize::from(stream.read_u8().await.ok()?);
        size |= (byte & 127) << shift;
        shift += 7;
        if byte < 128 {
            break;
        }
    }
    let mut body = vec![0; size];
    stream.read_exact(&mut body).await.ok()?;
    Some((head, body))
}

async fn accept(listener: &TcpListener) -> TcpStream {
    let accepted = timeout(WAIT_LIMIT, listener.accept()).await;
    accepted.expect("the agent does not connect").unwrap().0
}

impl HostileBroker {
    async fn begin() -> HostileBroker {
        let rig = Rig::quiet().await;
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = listener.local_addr().unwrap().port();
        rig.file("script.lua", DRIVES);
        let run = rig.run_config(&format!(
            "data: data\nbehaviours: [{{ file: script.lua }}]\nmqtt: {{ host: 127.0.0.1, port: {port} }}\n"
        ));
        rig.heard_motion(0).await;
        let stream = accept(&listener).await;
        let from = rig.sim.heard_count();
        HostileBroker {
            rig,
            run,
            listener,
            stream,
            from,
        }
    }

    /// Accepts the login and three subscriptions.
    async fn accept_login(&mut self) {
        let mut subscriptions = 0;
        while subscriptions < 3 {
            let received = timeout(WAIT_LIMIT, next(&mut self.stream))
                .await
                .expect("the agent sends nothing");
            let Some((head, body)) = received else {
                // The agent may be so slow that it gives up a connection and makes another.
                self.stream = accept(&self.listener).await;
                subscriptions = 0;
                continue;
            };
            match head >> 4 {
                1 => self.send(&[0x20, 2, 0, 0]).await,
                8 => {
                    subscriptions += 1;
                    self.send(&[0x90, 3, body[0], body[1], 1]).await;
                }
                _ => {}
            }
        }
    }

    async fn send(&mut self, bytes: &[u8]) {
        let _ = self.stream.write_all(bytes).await;
    }

    /// Sends a valid command until the agent obeys (true) or closes the connection (false).
    async fn obeyed(&mut self) -> bool {
        let laser = |command: &Command| *command == Command::Play(Sound::Laser);
        let mut rest = vec![0; 1 << 16];
        let until = tokio::time::Instant::now() + WAIT_LIMIT;
        while tokio::time::Instant::now() < until {
            if self.stream.write_all(&command(b"locate")).await.is_err() {
                return false;
            }
            let pause = sleep(Duration::from_millis(200));
            tokio::select! {
                () = pause => {}
                read = self.stream.read(&mut rest) => if !matches!(read, Ok(1..)) { return false },
            }
            if self.rig.commands(self.from).iter().any(laser) {
                return true;
            }
        }
        panic!(
            "the agent neither obeys nor disconnects:\n{}",
            self.run.text()
        );
    }

    /// Checks that the robot drove on and that the log is short; then ends the agent.
    async fn end(mut self, what: &str) {
        let bytes = self.run.text().len();
        let lines = self.run.text().lines().count();
        assert!(
            bytes <= MAX_BYTES && lines <= MAX_LINES,
            "{what}: {bytes} bytes, {lines} lines:\n{}",
            self.run
                .text()
                .lines()
                .take(60)
                .collect::<Vec<_>>()
                .join("\n")
        );
        drove_on(&self.rig, &mut self.run, self.from, what).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_broker_that_refuses_logins_or_speaks_another_protocol_changes_nothing() {
    let refused = |code: u8| packet(0x20, &[0, code]);
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("silent", Vec::new()),
        ("refused: version", refused(1)),
        ("refused: client ID", refused(2)),
        ("refused: unavailable", refused(3)),
        ("refused: password", refused(4)),
        ("refused: rights", refused(5)),
        ("refused: unknown reason", refused(200)),
        (
            "a web server",
            b"HTTP/1.1 400 Bad Request\r\n\r\n<html>".to_vec(),
        ),
        ("TLS", b"\x15\x03\x01\x00\x02\x02\x28".to_vec()),
        (
            "an endless length",
            vec![0x20, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff],
        ),
        (
            "an announcement of 256 MB",
            vec![0x30, 0xff, 0xff, 0xff, 0x7f, 0, 1, b'a'],
        ),
        ("a message before the CONNACK", command(b"stop")),
        ("half a CONNACK", vec![0x20, 2, 0]),
        ("a CONNACK that is too long", packet(0x20, &[0; 100])),
        ("zeros", vec![0; 4096]),
        ("ones", vec![0xff; 4096]),
    ];
    for (what, packets) in cases {
        let mut broker = HostileBroker::begin().await;
        broker.send(&packets).await;
        if what != "silent" {
            let _ = timeout(Duration::from_millis(500), next(&mut broker.stream)).await;
        }
        broker.end(what).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn malformed_messages_are_ignored_or_end_the_connection_and_never_stop_the_robot() {
    let deep = format!("{{\"command\": {}", "[".repeat(900));
    let long = vec![b'a'; 60_000];
    let huge = vec![b'a'; 10 << 20];
    let retained = |payload: &[u8]| {
        let mut bytes = command(payload);
        bytes[0] |= 1;
        bytes
    };
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("not a command", command(b"fly")),
        ("an empty command", command(b"")),
        ("zeros", command(&[0; 100])),
        ("not UTF-8", command(&[0xff, 0xfe, 0xc0, 0x80])),
        ("escape sequences", command(b"\x1b[2Jrun \x1b]0;title\x07")),
        (
            "right-to-left text",
            command("run \u{202e}lortap".as_bytes()),
        ),
        ("a command that is too long", command(&long)),
        ("deep JSON", command(deep.as_bytes())),
        ("invalid JSON", command(b"{\"command\": stop}")),
        (
            "JSON with a wrong type",
            command(b"{\"command\": 7, \"id\": {}}"),
        ),
        (
            "a behaviour name with a path",
            command(b"run ../../etc/passwd"),
        ),
        (
            "a behaviour name with markup",
            command(b"run <script>alert(1)</script>"),
        ),
        (
            "a behaviour name with SQL",
            command(b"run x'); DROP TABLE event;--"),
        ),
        ("a long choice", message(CHOICE.as_bytes(), &long)),
        (
            "a choice that is not text",
            message(CHOICE.as_bytes(), &[0xff; 40_000]),
        ),
        ("a retained command", retained(b"stop")),
        (
            "a command to a topic pattern",
            message(b"spykee/+/command", b"stop"),
        ),
        ("a command to all topics", message(b"#", b"stop")),
        (
            "a command to another robot",
            message(b"spykee/SPYKEE0002/command", b"stop"),
        ),
        (
            "a command at another topic",
            message(b"spykee/SPYKEE0001/state", b"stop"),
        ),
        ("a command without a topic", message(b"", b"stop")),
        ("a topic that is not text", message(&[0xff, 0xc0], b"stop")),
        (
            "a topic longer than its message",
            vec![0x30, 4, 0xff, 0xff, b'a', b'b'],
        ),
        (
            "an invalid birth message",
            message(b"homeassistant/status", &long),
        ),
        (
            "a message with QoS 3",
            [&[0x36][..], &command(b"stop")[1..]].concat(),
        ),
        ("a huge message", command(&huge)),
        ("an unexpected PUBACK", packet(0x40, &[0x77, 0x77])),
        ("an unexpected PUBREC", packet(0x50, &[0x77, 0x77])),
        ("a refused subscription", packet(0x90, &[0, 9, 0x80])),
        ("a second CONNACK", packet(0x20, &[0, 0])),
        (
            "a CONNECT, which only clients send",
            packet(0x10, b"\0\x04MQTT\x04\0\0\0\0\0"),
        ),
        ("an unknown packet type", packet(0xf0, b"")),
    ];
    for some in cases.chunks(4) {
        let mut played = JoinSet::new();
        for (what, packets) in some.iter().cloned() {
            played.spawn(sends_malformed(what, packets));
        }
        played.join_all().await;
    }
}

async fn sends_malformed(what: &str, packets: Vec<u8>) {
    let mut broker = HostileBroker::begin().await;
    broker.accept_login().await;
    broker.send(&packets).await;
    let connected = broker.obeyed().await;
    if !connected {
        // The agent connects again.
        drop(std::mem::replace(
            &mut broker.stream,
            accept(&broker.listener).await,
        ));
    }
    let text = broker.run.text();
    assert!(
        !text.contains('\u{1b}') && !text.contains('\u{202e}'),
        "{what}: {text}"
    );
    broker.end(what).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_flood_of_messages_does_not_fill_the_log_or_affect_driving() {
    let choice = message(CHOICE.as_bytes(), &[b'a'; 200]);
    let birth = message(b"homeassistant/status", b"online");
    let mut retained = command(b"stop");
    retained[0] |= 1;
    let pings = packet(0xd0, b"");
    for (what, one) in [
        ("invalid commands", command(b"fly to the moon")),
        ("commands that cannot be executed", command(b"run nobody")),
        ("choices of an unknown behaviour", choice),
        ("retained commands", retained),
        ("birth messages", birth),
        (
            "commands to another robot",
            message(b"spykee/SPYKEE0002/command", b"stop"),
        ),
        ("PINGRESPs without a ping", pings),
    ] {
        let mut broker = HostileBroker::begin().await;
        broker.accept_login().await;
        let many = one.repeat(1000);
        let (mut reader, mut writer) = broker.stream.split();
        let mut rest = vec![0; 1 << 16];
        let flood = async {
            for _ in 0..10 {
                if writer.write_all(&many).await.is_err() {
                    break;
                }
            }
        };
        let drain = async { while matches!(reader.read(&mut rest).await, Ok(1..)) {} };
        let flooded = async {
            tokio::select! { () = flood => {}, () = drain => {} }
        };
        timeout(WAIT_LIMIT, flooded)
            .await
            .unwrap_or_else(|_| panic!("{what}: the agent reads nothing"));
        broker.obeyed().await;
        broker.end(what).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_fleet_is_listed_in_time_even_if_the_broker_never_stops_sending() {
    let rig = Rig::quiet().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let port = listener.local_addr().unwrap().port();
    rig.file(
        "fleet.yaml",
        &format!("mqtt: {{ host: 127.0.0.1, port: {port} }}\n"),
    );
    let mut list = rig.spykee(&["fleet", "list", "--config", "fleet.yaml"]);
    let mut stream = accept(&listener).await;
    let talks = async {
        while let Some((head, body)) = next(&mut stream).await {
            match head >> 4 {
                1 => stream.write_all(&[0x20, 2, 0, 0]).await.unwrap(),
                8 => {
                    stream
                        .write_all(&[0x90, 3, body[0], body[1], 1])
                        .await
                        .unwrap();
                    if body[1] == 3 {
                        break;
                    }
                }
                _ => {}
            }
        }
        let hostile = message(b"spykee/<b>\x1b[2J\xe2\x80\xae/connection", b"ONLINE");
        let _ = stream.write_all(&hostile).await;
        let deep = message(b"spykee/A/state", "[".repeat(60_000).as_bytes());
        let _ = stream.write_all(&deep).await;
        let state = message(
            b"spykee/A/state",
            b"{\"state\": \"\\u001b[2J\", \"battery\": {}, \"running\": 7}",
        );
        for _ in 0.. {
            if stream.write_all(&state).await.is_err() {
                break;
            }
            sleep(Duration::from_millis(50)).await;
        }
    };
    let code = tokio::select! {
        code = list.code() => code,
        () = talks => list.code().await,
    };
    let text = list.text();
    assert_eq!(code, Some(0), "{text}");
    assert!(
        text.contains("ONLINE") && !text.contains('\u{1b}') && !text.contains('\u{202e}'),
        "{text}"
    );
}
