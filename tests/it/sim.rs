//! The simulated robot from the outside: literal bytes of `PROTOCOL.md` to the real server, over
//! TCP where sockets matter, and over a pipe with a paused clock where time matters.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::VecDeque;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{Rng, RngExt, SeedableRng};
use spykee::sim::{Firmware, Handle, Options, Pose, Server, Tracks, World};
use spykee::wire::{Command, EngineReport, Power, Report};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream};
use tokio::net::{TcpStream, UdpSocket};
use tokio::time::{sleep, timeout};

use crate::rig::{exact, exact_yaml};

/// More than anything here takes; a promise that is not kept by then is broken.
pub(super) const LIMIT: Duration = Duration::from_secs(300);

pub(super) const LOGIN: &[u8] = b"PK\x0A\x00\x0C\x05admin\x05admin";
const WRONG_LOGIN: &[u8] = b"PK\x0A\x00\x0C\x05admin\x05wrong";
const REFUSED_PASSWORD: &[u8] = &[0x50, 0x4B, 0x0B, 0x00, 0x02, 0x00, 0x01];
const REFUSED_BUSY: &[u8] = &[0x50, 0x4B, 0x0B, 0x00, 0x02, 0x00, 0x03];
pub(super) const FORWARD_50: &[u8] = &[0x50, 0x4B, 0x05, 0x00, 0x02, 0x32, 0x32];
pub(super) const TURN_LEFT_90: &[u8] = &[0x50, 0x4B, 0x05, 0x00, 0x02, 0xA6, 0x5A];
pub(super) const STAND: &[u8] = &[0x50, 0x4B, 0x05, 0x00, 0x02, 0x00, 0x00];
const FLASH_ON: &[u8] = &[0x50, 0x4B, 0x04, 0x00, 0x02, 0x00, 0x01];
pub(super) const VIDEO_ON: &[u8] = &[0x50, 0x4B, 0x0F, 0x00, 0x02, 0x01, 0x01];
pub(super) const AUDIO_ON: &[u8] = &[0x50, 0x4B, 0x0F, 0x00, 0x02, 0x02, 0x01];
pub(super) const UNDOCK: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x05];
pub(super) const DOCK: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x06];
pub(super) const CANCEL: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x07];
pub(super) const LEFT_STATION: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x01];
pub(super) const ON_STATION: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x02];
const FULL: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x03];
const NOT_FOUND: &[u8] = &[0x50, 0x4B, 0x10, 0x00, 0x01, 0x08];
const LASER: &[u8] = &[0x50, 0x4B, 0x07, 0x00, 0x01, 0x02];
const MUSIC: &[u8] = &[0x50, 0x4B, 0x07, 0x00, 0x01, 0x40];
const STOP: &[u8] = &[0x50, 0x4B, 0x08, 0x00, 0x00];
pub(super) const POWER_QUERY: &[u8] = &[0x50, 0x4B, 0x03, 0x00, 0x00];
const VOLUME_50: &[u8] = &[0x50, 0x4B, 0x09, 0x00, 0x01, 0x32];
const POWER_80: &[u8] = &[0x50, 0x4B, 0x03, 0x00, 0x01, 0x50];
const POWER_80_CHARGING: &[u8] = &[0x50, 0x4B, 0x03, 0x00, 0x01, 0xB0];
const ACCEPTED_DOCKED: &[u8] = &[
    0x50, 0x4B, 0x0B, 0x00, 0x22, 0x01, 0x0A, 0x53, 0x50, 0x59, 0x4B, 0x45, 0x45, 0x30, 0x30, 0x30,
    0x31, 0x06, 0x53, 0x70, 0x79, 0x6B, 0x65, 0x65, 0x04, 0x68, 0x6F, 0x6D, 0x65, 0x06, 0x31, 0x2E,
    0x30, 0x2E, 0x32, 0x32, 0x00, 0x01, 0x02,
];

/// A client that only handles bytes.
pub(super) struct Client<S> {
    pub(super) stream: S,
}

impl<S: AsyncRead + AsyncWrite + Unpin> Client<S> {
    pub(super) async fn send(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).await.unwrap();
    }

    /// The next message, including its header; `None` at the end of the connection.
    pub(super) async fn next(&mut self) -> Option<Vec<u8>> {
        let mut message = vec![0; 5];
        match timeout(LIMIT, self.stream.read_exact(&mut message))
            .await
            .expect("no message")
        {
            Ok(_) => {}
            Err(_) => return None,
        }
        assert_eq!(message[..2], *b"PK");
        let length = usize::from(message[3]) << 8 | usize::from(message[4]);
        message.resize(5 + length, 0);
        self.stream.read_exact(&mut message[5..]).await.ok()?;
        Some(message)
    }

    /// Reads until exactly this message arrives; false if the connection ends first.
    pub(super) async fn waits_for(&mut self, wanted: &[u8]) -> bool {
        while let Some(message) = self.next().await {
            if message == wanted {
                return true;
            }
        }
        false
    }

    pub(super) async fn next_of_kind(&mut self, kind: u8) -> Vec<u8> {
        loop {
            let message = self.next().await.expect("the connection ended");
            if message[2] == kind {
                return message;
            }
        }
    }

    /// Logs in and reads the reply and the first POWER.
    pub(super) async fn log_in(mut self) -> Client<S> {
        self.send(LOGIN).await;
        let reply = self.next().await.unwrap();
        assert_eq!((reply[2], reply[5]), (11, 1), "{reply:02X?}");
        let power = self.next().await.unwrap();
        assert_eq!((power[2], power.len()), (3, 6));
        self
    }

    /// Everything until the connection ends.
    async fn rest(mut self) -> Vec<u8> {
        let mut bytes = Vec::new();
        // A reset also ends the connection.
        let _ = timeout(LIMIT, self.stream.read_to_end(&mut bytes))
            .await
            .expect("the connection does not end");
        bytes
    }
}

/// A pen with the robot on its station at 90 %, and a battery that lasts for hours.
pub(super) fn playpen() -> World {
    exact("playpen")
}

/// The same pen with the robot in its middle.
pub(super) fn free_playpen() -> World {
    let yaml = exact_yaml("playpen");
    let start = "\nstart: { at: [1.2, 1.25], heading_degrees: 20 }\n";
    World::from_yaml(&format!("{yaml}{start}"), "playpen.yaml").unwrap()
}

struct Tcp {
    address: std::net::SocketAddr,
    handle: Handle,
}

impl Tcp {
    async fn serve(world: World) -> Tcp {
        let server = Server::bind(world, Options::default()).await.unwrap();
        let address = server.local_addr();
        let handle = server.handle();
        tokio::spawn(server.run());
        Tcp { address, handle }
    }

    async fn connect(&self) -> Client<TcpStream> {
        let stream = TcpStream::connect(self.address).await.unwrap();
        stream.set_nodelay(true).unwrap();
        Client { stream }
    }
}

/// A simulator without sockets, for paused clocks.
pub(super) fn detached(world: World, firmware: Firmware) -> Handle {
    let server = Server::detached(
        world,
        Options {
            firmware,
            ..Options::default()
        },
    );
    let handle = server.handle();
    tokio::spawn(server.run());
    handle
}

pub(super) fn connect(handle: &Handle) -> Client<DuplexStream> {
    let (stream, robots) = tokio::io::duplex(64 * 1024);
    handle.connect(robots);
    Client { stream }
}

pub(super) async fn robot(world: World) -> (Handle, Client<DuplexStream>) {
    let handle = detached(world, Firmware::default());
    let client = connect(&handle).log_in().await;
    (handle, client)
}

fn moved(left: i8, right: i8) -> impl Fn(&Command) -> bool {
    move |command| *command == Command::Move { left, right }
}

#[tokio::test]
async fn the_right_login_gets_the_golden_reply_and_then_power() {
    let sim = Tcp::serve(playpen()).await;
    let mut client = sim.connect().await;
    client.send(LOGIN).await;
    assert_eq!(client.next().await.unwrap(), ACCEPTED_DOCKED);
    assert_eq!(
        client.next().await.unwrap(),
        [0x50, 0x4B, 0x03, 0x00, 0x01, 0xA6]
    ); // -90
    assert_eq!(sim.handle.state().user.as_deref(), Some("admin"));
}

#[tokio::test]
async fn a_wrong_password_is_refused_and_the_connection_closed() {
    let sim = Tcp::serve(playpen()).await;
    let mut client = sim.connect().await;
    client.send(WRONG_LOGIN).await;
    assert_eq!(client.rest().await, REFUSED_PASSWORD);
}

#[tokio::test]
async fn a_second_user_is_refused_until_the_first_disconnects() {
    let sim = Tcp::serve(playpen()).await;
    let mut first = sim.connect().await.log_in().await;
    let mut second = sim.connect().await;
    second.send(LOGIN).await;
    assert_eq!(second.rest().await, REFUSED_BUSY);
    first.send(FLASH_ON).await;
    timeout(LIMIT, sim.handle.wait_state(|state| state.leds.flash))
        .await
        .unwrap();
    drop(first);
    timeout(LIMIT, sim.handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
    sim.connect().await.log_in().await;
}

#[tokio::test]
async fn discovery_names_the_robot_and_its_user() {
    let sim = Tcp::serve(playpen()).await;
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    socket.connect(sim.address).await.unwrap();
    let ask = async || {
        let mut reply = vec![0; 64];
        socket.send(&[0x44, 0x53, 0x43, 0x56, 0x01]).await.unwrap();
        let length = timeout(LIMIT, socket.recv(&mut reply))
            .await
            .unwrap()
            .unwrap();
        reply.truncate(length);
        reply
    };
    // Other datagrams are not answered: the next reply belongs to the request.
    socket.send(b"DSCV\x02\x05uid=x").await.unwrap();
    assert_eq!(ask().await, b"DSCV\x02\x0Euid=SPYKEE0001");
    let _client = sim.connect().await.log_in().await;
    assert_eq!(
        ask().await,
        b"DSCV\x02\x23uid=SPYKEE0001,connected-user=admin"
    );
}

#[tokio::test]
async fn move_before_the_login_disconnects() {
    let sim = Tcp::serve(free_playpen()).await;
    let mut client = sim.connect().await;
    client.send(FORWARD_50).await;
    assert!(client.rest().await.is_empty());
    assert!(!sim.handle.state().moving());
}

#[tokio::test]
async fn move_in_one_write_with_the_login_disconnects() {
    let sim = Tcp::serve(free_playpen()).await;
    let mut client = sim.connect().await;
    client.send(&[LOGIN, FORWARD_50].concat()).await;
    client.rest().await;
    let state = timeout(LIMIT, sim.handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
    assert_eq!(state.commanded, Tracks::new(0, 0));
}

#[tokio::test(start_paused = true)]
async fn move_between_the_reply_and_the_first_power_disconnects() {
    let late = Firmware {
        power_after_login: Duration::from_secs(2),
        ..Firmware::default()
    };
    let handle = detached(free_playpen(), late);
    let mut hasty = connect(&handle);
    hasty.send(LOGIN).await;
    assert_eq!(hasty.next().await.unwrap()[2], 11);
    hasty.send(FORWARD_50).await;
    assert_eq!(hasty.next().await, None);
    let mut patient = connect(&handle).log_in().await;
    patient.send(FORWARD_50).await;
    timeout(LIMIT, handle.wait_state(|state| state.speeds.left > 0.2))
        .await
        .unwrap();
}

#[tokio::test]
async fn commands_split_or_joined_in_any_way_are_all_received() {
    let sim = Tcp::serve(free_playpen()).await;
    let mut client = sim.connect().await.log_in().await;
    let from = sim.handle.heard_count();
    for byte in [FLASH_ON, VOLUME_50].concat() {
        client.send(&[byte]).await;
    }
    let volume = |command: &Command| *command == Command::Volume(50);
    timeout(LIMIT, sim.handle.wait_heard(from, volume))
        .await
        .unwrap();
    client.send(&[STAND, LASER, STAND].concat()).await;
    timeout(LIMIT, sim.handle.wait_heard(from + 4, moved(0, 0)))
        .await
        .unwrap();
    let heard = sim.handle.heard_since(from);
    assert_eq!(heard.len(), 5);
    assert!(heard[1].write < heard[2].write, "two writes");
    assert!(
        heard[2].write == heard[3].write && heard[3].write == heard[4].write,
        "one write"
    );
    assert_eq!(sim.handle.state().volume, 50);
}

#[tokio::test(start_paused = true)]
async fn unusual_moves_of_real_clients_drive() {
    let (handle, mut client) = robot(free_playpen()).await;
    client
        .send(&[0x50, 0x4B, 0x05, 0x00, 0x03, 0x7F, 0x7F, 0x00])
        .await;
    let state = timeout(LIMIT, handle.wait_state(|state| state.speeds.left > 0.3))
        .await
        .unwrap();
    assert_eq!(state.commanded, Tracks::new(127, 127));
    client.send(TURN_LEFT_90).await;
    timeout(
        LIMIT,
        handle.wait_state(|s| s.speeds.left < -0.3 && s.speeds.right > 0.3),
    )
    .await
    .unwrap();
    client.send(STAND).await;
    timeout(LIMIT, handle.wait_state(|state| !state.moving()))
        .await
        .unwrap();
}

#[tokio::test(start_paused = true)]
async fn walls_stop_the_robot() {
    let (handle, mut client) = robot(free_playpen()).await;
    client.send(FORWARD_50).await;
    let state = timeout(LIMIT, handle.wait_state(|state| state.blocked))
        .await
        .unwrap();
    sleep(Duration::from_secs(5)).await;
    let later = handle.state();
    assert_eq!(later.collisions, 1);
    let dx = later.pose.x - state.pose.x;
    let dy = later.pose.y - state.pose.y;
    assert!(dx.hypot(dy) < 0.01, "{state:?} {later:?}");
}

#[tokio::test(start_paused = true)]
async fn the_robot_undocks_backwards_and_reports_it() {
    let (handle, mut client) = robot(playpen()).await;
    let docked_at = handle.state().pose;
    client.send(UNDOCK).await;
    assert!(client.waits_for(LEFT_STATION).await);
    let state = handle.state();
    assert!(
        state.pose.x > docked_at.x + 0.3 && !state.docked && !state.charging,
        "{state:?}"
    );
    handle.set_battery(80.0);
    assert!(client.waits_for(POWER_80).await);
}

#[tokio::test(start_paused = true)]
async fn the_robot_docks_from_the_middle_of_the_room_and_charges() {
    let (handle, mut client) = robot(exact("living_room")).await;
    client.send(&[STAND, DOCK].concat()).await;
    assert!(client.waits_for(ON_STATION).await);
    let state = handle.state();
    assert!((10..60).contains(&state.time.as_secs()), "{state:?}");
    assert!(state.docked && state.charging);
    handle.set_battery(80.0);
    assert!(client.waits_for(POWER_80_CHARGING).await);
    assert!(client.waits_for(FULL).await);
    assert_eq!(handle.state().battery, 100.0);
}

#[tokio::test(start_paused = true)]
async fn a_hidden_station_is_not_found() {
    let (handle, mut client) = robot(free_playpen()).await;
    handle.hide_station(true);
    client.send(DOCK).await;
    assert!(client.waits_for(NOT_FOUND).await);
    let state = timeout(LIMIT, handle.wait_state(|state| !state.moving()))
        .await
        .unwrap();
    assert!(!state.searching && !state.docked);
}

#[tokio::test(start_paused = true)]
async fn cancel_and_move_end_the_search_and_base_find_after_move_does_not() {
    let (handle, mut client) = robot(exact("living_room")).await;
    for end in [CANCEL, STAND] {
        client.send(&[STAND, DOCK].concat()).await;
        timeout(
            LIMIT,
            handle.wait_state(|state| state.searching && state.moving()),
        )
        .await
        .unwrap();
        client.send(end).await;
        timeout(LIMIT, handle.wait_state(|s| !s.searching && !s.moving()))
            .await
            .unwrap();
    }
    assert!(!handle.state().docked);
}

#[tokio::test(start_paused = true)]
async fn a_broken_charger_docks_without_charging() {
    let (handle, mut client) = robot(free_playpen()).await;
    handle.set_charging_broken(true);
    client.send(DOCK).await;
    assert!(client.waits_for(ON_STATION).await);
    sleep(Duration::from_secs(20)).await;
    let state = handle.state();
    assert!(
        state.docked && !state.charging && !state.power.charging,
        "{state:?}"
    );
}

#[tokio::test(start_paused = true)]
async fn power_is_sent_on_change_and_periodically() {
    let (handle, mut client) = robot(playpen()).await;
    for _ in 0..5 {
        assert_eq!(client.next_of_kind(3).await[5], 0xA6);
    }
    assert!(
        handle.state().time >= Duration::from_secs(20),
        "{:?}",
        handle.state().time
    );
    handle.set_battery(80.0);
    assert_eq!(client.next().await.unwrap(), POWER_80_CHARGING);
    let before = handle.state().time;
    client.send(POWER_QUERY).await; // one client asks
    assert_eq!(client.next().await.unwrap(), POWER_80_CHARGING);
    assert!(handle.state().time - before < Duration::from_secs(1));
}

#[tokio::test(start_paused = true)]
async fn only_music_reports_its_end() {
    let (handle, mut client) = robot(playpen()).await;
    client.send(LASER).await;
    timeout(LIMIT, handle.wait_state(|state| state.sound.is_some()))
        .await
        .unwrap();
    timeout(LIMIT, handle.wait_state(|state| state.sound.is_none()))
        .await
        .unwrap();
    client.send(MUSIC).await;
    timeout(LIMIT, handle.wait_state(|state| state.sound.is_some()))
        .await
        .unwrap();
    client.send(STOP).await;
    let silent = timeout(LIMIT, handle.wait_state(|state| state.sound.is_none()))
        .await
        .unwrap();
    client.send(MUSIC).await;
    assert!(client.waits_for(STOP).await);
    let lasted = handle.state().time - silent.time;
    assert!(lasted >= Duration::from_secs(19), "{lasted:?}");
}

#[tokio::test(start_paused = true)]
async fn streams_are_sent_while_they_are_on() {
    let (handle, mut client) = robot(playpen()).await;
    assert_eq!(
        client.next().await.unwrap()[2],
        3,
        "no stream is on after the login"
    );
    client.send(&[VIDEO_ON, AUDIO_ON].concat()).await;
    let mut frames = 0;
    let mut chunks = 0;
    let started = handle.state().time;
    while frames < 30 {
        let message = client.next().await.unwrap();
        match message[2] {
            1 => chunks += 1,
            2 => {
                assert_eq!(message[5..7], [0xFF, 0xD8]);
                assert_eq!(message[message.len() - 2..], [0xFF, 0xD9]);
                frames += 1;
            }
            _ => {}
        }
    }
    let seconds = (handle.state().time - started).as_secs_f64();
    assert!((1.5..2.5).contains(&seconds), "30 frames in {seconds} s");
    assert!((11..=18).contains(&chunks), "{chunks}");
    client
        .send(&[0x50, 0x4B, 0x0F, 0x00, 0x02, 0x01, 0x00])
        .await;
    timeout(LIMIT, handle.wait_state(|state| !state.streams.video))
        .await
        .unwrap();
    assert!(handle.state().streams.audio_in);
}

#[tokio::test(start_paused = true)]
async fn a_client_that_pauses_reading_gets_the_newest_frame_later() {
    let (handle, mut client) = robot(free_playpen()).await;
    client.send(&[VIDEO_ON, AUDIO_ON].concat()).await;
    sleep(Duration::from_secs(20)).await;
    let state = handle.state();
    assert!(
        state.frames > 250 && state.dropped > state.frames / 2,
        "{state:?}"
    );
    // 64 KiB are in the pipe, one batch is being written, one is queued.
    let mut held = 0;
    while let Ok(Some(message)) = timeout(Duration::from_millis(1), client.next()).await {
        held += message.len();
    }
    assert!((64 * 1024..256 * 1024).contains(&held), "{held}");
    assert_eq!(client.next_of_kind(2).await[5..7], [0xFF, 0xD8]);
}

#[tokio::test(start_paused = true)]
async fn a_client_that_sends_requests_and_never_reads_is_disconnected() {
    let (handle, mut client) = robot(playpen()).await;
    let question = [0x50, 0x4B, 0x11, 0x00, 0x00].repeat(1000);
    for _ in 0..1000 {
        if client.stream.write_all(&question).await.is_err() {
            break;
        }
    }
    timeout(LIMIT, handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
    connect(&handle).log_in().await;
}

#[tokio::test(start_paused = true)]
async fn requests_are_answered_and_settings_accepted() {
    let (_, mut client) = robot(playpen()).await;
    client.send(b"PK\x0D\x00\x00").await;
    let config = [client.next_of_kind(13).await, client.next_of_kind(13).await];
    for (message, begins) in config
        .iter()
        .zip(["version=1.0.22&volume=", "name=Spykee&"])
    {
        let text = String::from_utf8(message[5..].to_vec()).unwrap();
        assert!(text.starts_with(begins), "{text}");
        let pairs: Option<Vec<_>> = text.split('&').map(|pair| pair.split_once('=')).collect();
        assert!(
            pairs.is_some(),
            "a client that splits each message dies of {text}"
        );
    }
    client.send(b"PK\x0E\x00\x00").await;
    assert!(client.next_of_kind(14).await[5..].starts_with(b"home:"));
    client.send(b"PK\x0D\x00\x0Bname=Robbie").await; // CONFIG to set
    client.send(b"PK\x06\x00\x05\x06\x03abc").await; // FILE
    client.send(b"PK\x12\x00\x01\x50").await; // MOTOR_SPEED
    client.send(b"PK\x0C\x00\x00").await; // MUTE
    client.send(b"PK\x63\x00\x02xy").await; // unknown type
    client.send(b"PK\x11\x00\x00").await;
    let log = client.next_of_kind(17).await;
    let log = String::from_utf8_lossy(&log[5..]);
    for line in [
        "config set: name",
        "file 6 stored, 3 bytes",
        "MotorSpeed",
        "Mute",
        "kind: 99",
    ] {
        assert!(log.contains(line), "{line}: {log}");
    }
}

#[tokio::test(start_paused = true)]
async fn the_robot_drives_on_without_its_user_unless_the_firmware_stops_it() {
    for stops_on_disconnect in [false, true] {
        let handle = detached(
            free_playpen(),
            Firmware {
                stops_on_disconnect,
                ..Firmware::default()
            },
        );
        let mut client = connect(&handle).log_in().await;
        client.send(TURN_LEFT_90).await;
        timeout(LIMIT, handle.wait_state(|state| state.moving()))
            .await
            .unwrap();
        drop(client);
        timeout(LIMIT, handle.wait_state(|state| state.user.is_none()))
            .await
            .unwrap();
        sleep(Duration::from_secs(30)).await;
        assert_eq!(handle.state().moving(), !stops_on_disconnect);
    }
}

#[tokio::test(start_paused = true)]
async fn a_firmware_that_needs_repeats_stops_without_them() {
    let limit = Some(Duration::from_millis(500));
    let firmware = Firmware {
        stops_without_repeat: limit,
        ..Firmware::default()
    };
    let handle = detached(free_playpen(), firmware);
    let mut client = connect(&handle).log_in().await;
    for _ in 0..10 {
        client.send(TURN_LEFT_90).await;
        sleep(Duration::from_millis(200)).await;
    }
    assert!(handle.state().moving());
    sleep(Duration::from_secs(2)).await;
    assert!(!handle.state().moving());
}

#[tokio::test(start_paused = true)]
async fn a_handle_changes_the_simulation() {
    let (handle, mut client) = robot(playpen()).await;
    handle.inject(Report::Engine(EngineReport::Unknown(42)));
    assert!(client.waits_for(&[0x50, 0x4B, 0x10, 0x00, 0x01, 42]).await);
    handle.inject(Report::Power(Power {
        percent: 10,
        charging: false,
    }));
    assert!(
        client
            .waits_for(&[0x50, 0x4B, 0x03, 0x00, 0x01, 0x0A])
            .await
    );

    handle.place(Pose::new(1.2, 1.25, 0.0));
    assert!(client.waits_for(LEFT_STATION).await);
    assert_eq!(client.next_of_kind(3).await[5], 90);

    handle.mute(true);
    let from = handle.heard_count();
    client.send(FLASH_ON).await;
    assert!(
        timeout(Duration::from_secs(60), client.next())
            .await
            .is_err(),
        "mute means mute"
    );
    assert_eq!(handle.heard_count(), from);
    handle.mute(false);
    timeout(LIMIT, handle.wait_state(|state| state.leds.flash))
        .await
        .unwrap();

    handle.disconnect_all();
    while client.next().await.is_some() {}
    timeout(LIMIT, handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
}

#[tokio::test]
async fn garbage_closes_the_connection() {
    let sim = Tcp::serve(playpen()).await;
    let mut stranger = sim.connect().await;
    stranger.send(b"GET / HTTP/1.1\r\n\r\n").await;
    assert!(stranger.rest().await.is_empty());
    let mut user = sim.connect().await.log_in().await;
    user.send(b"PK\x08\x00\x00PQ").await;
    user.rest().await;
    timeout(LIMIT, sim.handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
}

/// Bytes as hostile peers send them: noise, or complete headers followed by noise.
fn random_bytes(random: &mut StdRng) -> Vec<u8> {
    let mut bytes = vec![0; random.random_range(0..200)];
    random.fill_bytes(&mut bytes);
    let mut at = 0;
    while random.random_bool(0.8) && at + 5 <= bytes.len() {
        let length = random.random_range(0..24u8);
        bytes[at..at + 2].copy_from_slice(b"PK");
        bytes[at + 2] %= 20;
        bytes[at + 3..at + 5].copy_from_slice(&[0, length]);
        at += 5 + usize::from(length);
    }
    bytes
}

#[tokio::test(start_paused = true)]
async fn thousands_of_random_byte_strings_do_no_harm() {
    let handle = detached(playpen(), Firmware::default());
    let mut random = StdRng::seed_from_u64(1);
    for turn in 0..200_000 {
        let mut client = connect(&handle);
        if turn % 2 == 0 {
            client = client.log_in().await;
        }
        // The robot may close while we write.
        let _ = client.stream.write_all(&random_bytes(&mut random)).await;
        let _ = client.stream.shutdown().await;
        client.rest().await;
        timeout(LIMIT, handle.wait_state(|state| state.user.is_none()))
            .await
            .unwrap();
    }
    assert!(handle.heard_count() > 200_000 && handle.heard().len() <= 16_384);
    connect(&handle).log_in().await;
}

#[tokio::test(start_paused = true)]
async fn the_same_seed_gives_the_same_bytes() {
    let run = async || {
        let (handle, mut client) = robot(exact("living_room")).await;
        client
            .send(&[VIDEO_ON, AUDIO_ON, TURN_LEFT_90].concat())
            .await;
        let mut bytes = Vec::new();
        while bytes.len() < 300_000 {
            bytes.extend(client.next().await.unwrap());
        }
        drop(handle);
        bytes
    };
    assert!(run().await == run().await);
}

#[tokio::test(start_paused = true)]
async fn clients_that_do_not_log_in_are_displaced_by_others() {
    let handle = detached(playpen(), Firmware::default());
    let mut user = connect(&handle).log_in().await;
    let mut silent: VecDeque<_> = (0..20).map(|_| connect(&handle)).collect();
    for _ in 0..13 {
        let oldest = silent.pop_front().unwrap();
        assert!(oldest.rest().await.is_empty());
    }
    assert_eq!(handle.state().time, Duration::ZERO, "nobody waits");
    user.send(FLASH_ON).await;
    timeout(LIMIT, handle.wait_state(|state| state.leds.flash))
        .await
        .unwrap();
    drop(user);
    timeout(LIMIT, handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
    connect(&handle).log_in().await;
    for client in silent {
        assert!(client.rest().await.is_empty());
    }
}
