//! The link against peers that speak raw bytes: the bytes of `PROTOCOL.md`, not those of our
//! encoder.

mod discovery;
mod simulator;
mod writes;

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::link::{self, LinkError, Options, Session, Supervision, Target};
use spykee::wire::{Command, Engage, EngineReport, Login, Power, Report};
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::watch;

const LOGIN: &[u8] = b"PK\x0A\x00\x0C\x05admin\x05admin";
const ACCEPTED: &[u8] = b"PK\x0B\x00\x20\x01\x0ASPYKEE0001\x06Spykee\x04home\x061.0.22\x00";
const WRONG_PASSWORD: &[u8] = b"PK\x0B\x00\x02\x00\x01";
const IN_USE: &[u8] = b"PK\x0B\x00\x02\x00\x03";
const POWER_80: &[u8] = b"PK\x03\x00\x01\x50";
const DOCKED: &[u8] = b"PK\x10\x00\x01\x02";
const BASE_NOT_FOUND: &[u8] = b"PK\x10\x00\x01\x08";
const GO: Command = Command::Move {
    left: 50,
    right: 50,
};
const GO_BYTES: &[u8] = b"PK\x05\x00\x02\x32\x32";
/// POWER, empty: asks whether what was sent before is executed.
const QUESTION: &[u8] = b"PK\x03\x00\x00";
const STOP: &[u8] = b"PK\x05\x00\x02\x00\x00";

fn admin() -> Login {
    Login::new("admin", "admin")
}

fn stop() -> Vec<Command> {
    vec![Command::STOP]
}

fn nowhere() -> SocketAddr {
    SocketAddr::from(([0, 0, 0, 0], 0))
}

/// Logs in over an in-memory pipe to a robot that sends `answers` and stays connected.
async fn open_to(answers: &[u8], options: &Options) -> (Result<Session, LinkError>, DuplexStream) {
    let (ours, mut robot) = duplex(1 << 20);
    robot.write_all(answers).await.unwrap();
    let (reader, writer) = tokio::io::split(ours);
    let session = link::open(reader, writer, nowhere(), &admin(), stop(), options).await;
    (session, robot)
}

/// Like [`open_to`], for robots that accept; checks that they received the login and a stop.
async fn opened(answers: &[u8]) -> (Session, DuplexStream) {
    let (session, mut robot) = open_to(answers, &Options::default()).await;
    expect(&mut robot, &[LOGIN, STOP].concat()).await;
    (session.unwrap(), robot)
}

/// A future that never completes fails the test instead of hanging it.
async fn within_limit<T>(wanted: impl Future<Output = T>) -> T {
    let limit = Duration::from_secs(60);
    tokio::time::timeout(limit, wanted).await.expect("timeout")
}

async fn expect(robot: &mut (impl AsyncReadExt + Unpin), bytes: &[u8]) {
    let mut heard = vec![0; bytes.len()];
    within_limit(robot.read_exact(&mut heard)).await.unwrap();
    assert_eq!(heard, bytes);
}

async fn listen() -> (TcpListener, Target) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let target = listener.local_addr().unwrap().to_string().parse().unwrap();
    (listener, target)
}

/// A robot on loopback that reads the login, answers, and returns the socket.
async fn answer(listener: TcpListener, answers: &'static [u8]) -> TcpStream {
    let (mut robot, _) = listener.accept().await.unwrap();
    expect(&mut robot, LOGIN).await;
    robot.write_all(answers).await.unwrap();
    robot
}

#[tokio::test]
async fn nothing_is_sent_before_power_and_the_first_command_is_a_stop() {
    let (listener, target) = listen().await;
    let connecting =
        tokio::spawn(
            async move { link::connect(&target, &admin(), stop(), &Options::default()).await },
        );
    let mut robot = answer(listener, ACCEPTED).await;
    let mut byte = [0];
    let heard = tokio::time::timeout(Duration::from_millis(200), robot.read(&mut byte)).await;
    assert!(heard.is_err(), "bytes were sent before POWER");
    robot.write_all(POWER_80).await.unwrap();
    let mut session = connecting.await.unwrap().unwrap();
    expect(&mut robot, STOP).await;
    assert_eq!(session.accepted.uid, "SPYKEE0001");
    assert!(session.accepted.docked);
    assert_eq!(
        session.power,
        Power {
            percent: 80,
            charging: false
        }
    );
    assert_eq!(session.peer, robot.local_addr().unwrap());

    session.writer.write(&[GO]).await.unwrap();
    expect(&mut robot, GO_BYTES).await;
    link::hang_up(session.reader, session.writer).await;
    assert_eq!(robot.read(&mut byte).await.unwrap(), 0);
}

#[tokio::test]
async fn a_number_beyond_a_hundred_is_no_level_and_the_login_succeeds() {
    for byte in [110i8, 127, -110, -128] {
        let power = [0x50, 0x4B, 3, 0, 1, byte.cast_unsigned()];
        let (session, _robot) = open_to(&[ACCEPTED, &power].concat(), &Options::default()).await;
        let power = session.unwrap().power;
        assert_eq!((power.level(), power.charging), (None, byte < 0));
    }
}

#[tokio::test]
async fn answers_may_arrive_byte_by_byte() {
    let (ours, mut robot) = duplex(1);
    let (reader, writer) = tokio::io::split(ours);
    let peer = tokio::spawn(async move {
        expect(&mut robot, LOGIN).await;
        for byte in [ACCEPTED, POWER_80].concat() {
            robot.write_all(&[byte]).await.unwrap();
            tokio::task::yield_now().await;
        }
        expect(&mut robot, STOP).await;
        robot
    });
    let options = Options::default();
    let session = link::open(reader, writer, nowhere(), &admin(), stop(), &options)
        .await
        .unwrap();
    assert_eq!(session.accepted.firmware, "1.0.22");
    peer.await.unwrap();
}

#[tokio::test]
async fn power_may_arrive_before_the_answer_to_the_login() {
    let (session, _robot) = opened(&[POWER_80, ACCEPTED].concat()).await;
    assert_eq!(session.power.percent, 80);
}

#[tokio::test]
async fn reports_between_login_and_power_are_kept_in_order_except_frames() {
    let video = b"PK\x02\x00\x02\xFF\xD8";
    let answers = [DOCKED, ACCEPTED, video, BASE_NOT_FOUND, POWER_80, DOCKED].concat();
    let (mut session, _robot) = opened(&answers).await;
    let news = [EngineReport::Docked, EngineReport::BaseNotFound].map(Report::Engine);
    assert_eq!(session.early, news);
    let next = session.reader.next().await.unwrap();
    assert_eq!(next, Report::Engine(EngineReport::Docked));
}

#[tokio::test]
async fn reports_kept_during_the_login_are_bounded() {
    let answers = [&DOCKED.repeat(5000)[..], ACCEPTED, POWER_80].concat();
    let (session, _robot) = opened(&answers).await;
    assert_eq!(session.early.len(), link::MAX_EARLY_REPORTS);
}

#[tokio::test]
async fn a_wrong_password_is_reported_as_final_and_never_shown() {
    let (listener, target) = listen().await;
    let robot = tokio::spawn(async move {
        let (mut robot, _) = listener.accept().await.unwrap();
        robot.write_all(WRONG_PASSWORD).await.unwrap();
        let mut heard = Vec::new();
        robot.read_to_end(&mut heard).await.unwrap();
        heard
    });
    let login = Login::new("anna", "hunter2");
    let error = link::connect(&target, &login, stop(), &Options::default())
        .await
        .unwrap_err();
    assert!(matches!(&error, LinkError::WrongPassword { user } if user == "anna"));
    assert!(error.is_final());
    let shown = format!("{error} {error:?} {}", error.help());
    assert!(!shown.contains("hunter2"), "{shown}");
    assert_eq!(robot.await.unwrap(), b"PK\x0A\x00\x0D\x04anna\x07hunter2");
}

#[tokio::test]
async fn discovery_names_the_user_of_a_robot_in_use() {
    let (listener, target) = listen().await;
    let discovery = UdpSocket::bind(listener.local_addr().unwrap())
        .await
        .unwrap();
    tokio::spawn(answer(listener, IN_USE));
    let who = tokio::spawn(async move {
        let mut datagram = [0; 64];
        let (length, from) = discovery.recv_from(&mut datagram).await.unwrap();
        assert_eq!(&datagram[..length], b"DSCV\x01");
        discovery.send_to(b"DSCV\x01", from).await.unwrap();
        let reply = b"DSCV\x02\x23uid=SPYKEE0001,connected-user=berta";
        discovery.send_to(reply, from).await.unwrap();
    });
    let error = link::connect(&target, &admin(), stop(), &Options::default())
        .await
        .unwrap_err();
    who.await.unwrap();
    assert!(!error.is_final());
    assert!(
        matches!(&error, LinkError::InUse { by: Some(user) } if user == "berta"),
        "{error}"
    );
    assert!(error.to_string().contains("`berta`"), "{error}");
}

#[tokio::test]
async fn a_robot_in_use_may_not_name_its_user() {
    let (listener, target) = listen().await;
    tokio::spawn(answer(listener, IN_USE));
    let error = link::connect(&target, &admin(), stop(), &Options::default())
        .await
        .unwrap_err();
    assert!(matches!(error, LinkError::InUse { by: None }), "{error}");
}

#[tokio::test]
async fn an_unknown_refusal_keeps_its_number() {
    let (session, _robot) = open_to(b"PK\x0B\x00\x02\x00\x09", &Options::default()).await;
    assert!(matches!(session.unwrap_err(), LinkError::Refused(9)));
}

#[tokio::test(start_paused = true)]
async fn a_login_without_an_answer_times_out() {
    let (session, mut robot) = open_to(POWER_80, &Options::default()).await;
    let error = session.unwrap_err();
    assert!(matches!(error, LinkError::TimedOut { .. }), "{error}");
    let mut heard = Vec::new();
    within_limit(robot.read_to_end(&mut heard)).await.unwrap();
    assert_eq!(heard, LOGIN, "nothing may move before the login is through");
}

#[tokio::test(start_paused = true)]
async fn a_login_without_power_times_out_with_the_last_words() {
    let (session, mut robot) = open_to(ACCEPTED, &Options::default()).await;
    let error = session.unwrap_err();
    assert!(matches!(error, LinkError::NoPower { .. }), "{error}");
    let mut heard = Vec::new();
    within_limit(robot.read_to_end(&mut heard)).await.unwrap();
    assert_eq!(
        heard,
        [LOGIN, STOP, QUESTION, QUESTION].concat(),
        "nothing may move before POWER"
    );
}

#[tokio::test(start_paused = true)]
async fn a_login_that_is_given_up_sends_the_newest_last_words() {
    for dropped in [false, true] {
        let words = watch::Sender::new(vec![Command::STOP, Command::Engine(Engage::Dock)]);
        let (ours, mut robot) = duplex(1 << 20);
        robot.write_all(ACCEPTED).await.unwrap();
        let (reader, writer) = tokio::io::split(ours);
        let login = admin();
        let options = Options::default();
        let supervision = Supervision::new(words.subscribe());
        let mut logging_in = Box::pin(link::open(
            reader,
            writer,
            nowhere(),
            &login,
            supervision,
            &options,
        ));
        let second = Duration::from_secs(1);
        let waits = tokio::time::timeout(second, &mut logging_in).await;
        assert!(waits.is_err(), "POWER was not sent");
        words.send_replace(stop());
        if dropped {
            drop(logging_in);
        } else {
            assert!(logging_in.await.is_err());
        }
        let mut heard = Vec::new();
        within_limit(robot.read_to_end(&mut heard)).await.unwrap();
        let told = [LOGIN, STOP].concat();
        let asked = [QUESTION, QUESTION].concat();
        let expected = if dropped {
            told
        } else {
            [told, asked].concat()
        };
        assert_eq!(heard, expected, "dropped: {dropped}");
    }
}

#[tokio::test(start_paused = true)]
async fn other_messages_do_not_prolong_the_login_timeout() {
    let (ours, mut robot) = duplex(1 << 16);
    let (reader, writer) = tokio::io::split(ours);
    tokio::spawn(async move {
        while robot.write_all(DOCKED).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    let options = Options::default();
    let error = link::open(reader, writer, nowhere(), &admin(), stop(), &options)
        .await
        .unwrap_err();
    assert!(matches!(error, LinkError::TimedOut { .. }), "{error}");
}

#[tokio::test]
async fn a_peer_that_is_not_a_spykee_ends_the_login_at_once() {
    let (session, _robot) = open_to(b"HTTP/1.1 400 Bad Request\r\n", &Options::default()).await;
    assert!(matches!(session.unwrap_err(), LinkError::Framing(_)));
}

#[tokio::test]
async fn garbage_instead_of_a_header_ends_the_session_permanently() {
    let answers = [ACCEPTED, POWER_80, DOCKED, b"PX\x10\x00\x01\x02"].concat();
    let (mut session, mut robot) = opened(&answers).await;
    session.reader.next().await.unwrap();
    assert!(matches!(
        session.reader.next().await,
        Err(LinkError::Framing(_))
    ));
    robot.write_all(DOCKED).await.unwrap();
    assert!(matches!(
        session.reader.next().await,
        Err(LinkError::Framing(_))
    ));
}

#[tokio::test]
async fn an_end_of_stream_within_a_message_counts_as_closed() {
    let answers = [ACCEPTED, POWER_80, &DOCKED[..4]].concat();
    let (mut session, robot) = opened(&answers).await;
    drop(robot);
    assert!(matches!(
        session.reader.next().await,
        Err(LinkError::Closed)
    ));
    assert!(matches!(
        session.writer.write(&[GO]).await,
        Err(LinkError::Closed)
    ));
}

#[tokio::test]
async fn a_connection_reset_counts_as_closed() {
    let (listener, target) = listen().await;
    let robot = tokio::spawn(answer(listener, b""));
    let connecting =
        tokio::spawn(
            async move { link::connect(&target, &admin(), stop(), &Options::default()).await },
        );
    let robot = robot.await.unwrap();
    socket2::SockRef::from(&robot)
        .set_linger(Some(Duration::ZERO))
        .unwrap();
    drop(robot);
    assert!(matches!(
        connecting.await.unwrap().unwrap_err(),
        LinkError::Closed
    ));
}

#[tokio::test]
async fn a_refused_connection_is_reported_with_the_address() {
    let (listener, target) = listen().await;
    drop(listener);
    let error = link::connect(&target, &admin(), stop(), &Options::default())
        .await
        .unwrap_err();
    assert!(matches!(error, LinkError::Unreachable { .. }));
    assert!(error.to_string().contains(&target.to_string()), "{error}");
}

#[tokio::test(start_paused = true)]
async fn a_cancelled_wait_for_a_report_loses_nothing() {
    let (mut session, mut robot) = opened(&[ACCEPTED, POWER_80].concat()).await;
    for piece in DOCKED.chunks(1) {
        let wait = tokio::time::timeout(Duration::from_millis(1), session.reader.next()).await;
        assert!(wait.is_err());
        robot.write_all(piece).await.unwrap();
    }
    let report = session.reader.next().await.unwrap();
    assert_eq!(report, Report::Engine(EngineReport::Docked));
}

#[tokio::test(start_paused = true)]
async fn a_flood_of_reports_does_not_starve_timers() {
    let answers = [ACCEPTED, POWER_80].concat();
    let (mut session, mut robot) = opened(&answers).await;
    let flood = tokio::spawn(async move {
        let chunk = b"PK\x08\x00\x00".repeat(10_000);
        while robot.write_all(&chunk).await.is_ok() {}
    });
    let heard = std::cell::Cell::new(0);
    let hearing = async {
        while session.reader.next().await.is_ok() {
            heard.set(heard.get() + 1);
        }
    };
    tokio::pin!(hearing);
    let mut turns = 0;
    while turns < 100 {
        tokio::select! {
            biased;
            () = &mut hearing => unreachable!("the flood has no end"),
            () = tokio::task::yield_now() => turns += 1,
        }
        let at_a_stretch = heard.replace(0);
        assert!(
            at_a_stretch < 1000,
            "{at_a_stretch} reports without a pause"
        );
    }
    flood.abort();
}

/// Bytes that begin like a robot's and then become invalid, or are invalid from the start.
fn invalid_bytes(rng: &mut StdRng) -> Vec<u8> {
    let length = rng.random_range(0..60);
    let mut bytes: Vec<u8> = match rng.random_range(0..4) {
        0 => Vec::new(),
        1 => [ACCEPTED, POWER_80].concat(),
        2 => [ACCEPTED, POWER_80, DOCKED, b"PK"].concat(),
        _ => [IN_USE, ACCEPTED, POWER_80].concat(),
    };
    bytes.extend((0..length).map(|_| rng.random::<u8>()));
    for _ in 0..rng.random_range(0..3) {
        if !bytes.is_empty() {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random();
        }
    }
    bytes
}

#[tokio::test(start_paused = true)]
async fn two_hundred_thousand_strings_of_garbage_neither_panic_nor_hang() {
    let mut rng = StdRng::seed_from_u64(0x5bee);
    let mut sessions = 0;
    let mut reports = 0;
    let mut framing = 0;
    for _ in 0..200_000 {
        let robot = io::Cursor::new(invalid_bytes(&mut rng));
        let options = Options::default();
        let opened = link::open(
            robot,
            tokio::io::sink(),
            nowhere(),
            &admin(),
            stop(),
            &options,
        )
        .await;
        let Ok(mut session) = opened else { continue };
        sessions += 1;
        loop {
            match session.reader.next().await {
                Ok(_) => reports += 1,
                Err(LinkError::Closed) => break,
                Err(LinkError::Framing(_)) => {
                    framing += 1;
                    break;
                }
                Err(other) => panic!("{other}"),
            }
        }
    }
    assert!(sessions > 10_000 && reports > 1_000 && framing > 1_000);
}
