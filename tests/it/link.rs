//! The link against peers that speak raw bytes: what `PROTOCOL.md` says, not what our encoder says.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::link::{self, LinkError, Options, Session, Target};
use spykee::wire::{Command, EngineNews, Login, Power, Report};
use tokio::io::{AsyncReadExt, AsyncWrite, AsyncWriteExt, DuplexStream, duplex};
use tokio::net::{TcpListener, TcpStream, UdpSocket};

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
const STOP: &[u8] = b"PK\x05\x00\x02\x00\x00";

fn admin() -> Login {
    Login::new("admin", "admin")
}

fn nowhere() -> SocketAddr {
    SocketAddr::from(([0, 0, 0, 0], 0))
}

/// Logs in over an in-memory pipe to a robot that answers `answers` and stays.
async fn open_to(answers: &[u8], options: &Options) -> (Result<Session, LinkError>, DuplexStream) {
    let (ours, mut robot) = duplex(1 << 20);
    robot.write_all(answers).await.unwrap();
    let (reader, writer) = tokio::io::split(ours);
    let session = link::open(reader, writer, nowhere(), &admin(), options).await;
    (session, robot)
}

/// As [`open_to`], for robots that accept; what they heard is the login and a stop.
async fn opened(answers: &[u8]) -> (Session, DuplexStream) {
    let (session, mut robot) = open_to(answers, &Options::default()).await;
    expect(&mut robot, &[LOGIN, STOP].concat()).await;
    (session.unwrap(), robot)
}

async fn expect(robot: &mut (impl AsyncReadExt + Unpin), bytes: &[u8]) {
    let mut heard = vec![0; bytes.len()];
    robot.read_exact(&mut heard).await.unwrap();
    assert_eq!(heard, bytes);
}

async fn listen() -> (TcpListener, Target) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let target = listener.local_addr().unwrap().to_string().parse().unwrap();
    (listener, target)
}

/// A robot on loopback that hears the login, answers, and returns the socket.
async fn answer(listener: TcpListener, answers: &'static [u8]) -> TcpStream {
    let (mut robot, _) = listener.accept().await.unwrap();
    expect(&mut robot, LOGIN).await;
    robot.write_all(answers).await.unwrap();
    robot
}

#[tokio::test]
async fn nothing_is_said_before_power_and_the_first_command_is_a_stop() {
    let (listener, target) = listen().await;
    let connecting =
        tokio::spawn(async move { link::connect(&target, &admin(), &Options::default()).await });
    let mut robot = answer(listener, ACCEPTED).await;
    let mut byte = [0];
    let heard = tokio::time::timeout(Duration::from_millis(200), robot.read(&mut byte)).await;
    assert!(heard.is_err(), "spoke before POWER");
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
    session.writer.close().await;
    assert_eq!(robot.read(&mut byte).await.unwrap(), 0);
}

#[tokio::test]
async fn answers_may_come_byte_by_byte() {
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
    let session = link::open(reader, writer, nowhere(), &admin(), &options)
        .await
        .unwrap();
    assert_eq!(session.accepted.firmware, "1.0.22");
    peer.await.unwrap();
}

#[tokio::test]
async fn power_may_come_before_the_answer_to_the_login() {
    let (session, _robot) = opened(&[POWER_80, ACCEPTED].concat()).await;
    assert_eq!(session.power.percent, 80);
}

#[tokio::test]
async fn reports_between_login_and_power_are_kept_in_order_without_pictures() {
    let video = b"PK\x02\x00\x02\xFF\xD8";
    let answers = [DOCKED, ACCEPTED, video, BASE_NOT_FOUND, POWER_80, DOCKED].concat();
    let (mut session, _robot) = opened(&answers).await;
    let news = [EngineNews::Docked, EngineNews::BaseNotFound].map(Report::Engine);
    assert_eq!(session.early, news);
    let next = session.reader.next().await.unwrap();
    assert_eq!(next, Report::Engine(EngineNews::Docked));
}

#[tokio::test]
async fn early_reports_are_bounded() {
    let answers = [&DOCKED.repeat(5000)[..], ACCEPTED, POWER_80].concat();
    let (session, _robot) = opened(&answers).await;
    assert_eq!(session.early.len(), link::MAX_EARLY_REPORTS);
}

#[tokio::test]
async fn a_wrong_password_is_named_final_and_never_shown() {
    let (listener, target) = listen().await;
    let robot = tokio::spawn(async move {
        let (mut robot, _) = listener.accept().await.unwrap();
        robot.write_all(WRONG_PASSWORD).await.unwrap();
        let mut heard = Vec::new();
        robot.read_to_end(&mut heard).await.unwrap();
        heard
    });
    let login = Login::new("anna", "hunter2");
    let error = link::connect(&target, &login, &Options::default())
        .await
        .unwrap_err();
    assert!(matches!(&error, LinkError::WrongPassword { user } if user == "anna"));
    assert!(error.is_final());
    let shown = format!("{error} {error:?} {}", error.help());
    assert!(!shown.contains("hunter2"), "{shown}");
    assert_eq!(robot.await.unwrap(), b"PK\x0A\x00\x0D\x04anna\x07hunter2");
}

#[tokio::test]
async fn a_robot_in_use_is_asked_by_whom() {
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
    let error = link::connect(&target, &admin(), &Options::default())
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
async fn a_robot_in_use_that_does_not_tell_by_whom_is_still_in_use() {
    let (listener, target) = listen().await;
    tokio::spawn(answer(listener, IN_USE));
    let error = link::connect(&target, &admin(), &Options::default())
        .await
        .unwrap_err();
    assert!(matches!(error, LinkError::InUse { by: None }), "{error}");
}

#[tokio::test]
async fn an_unlisted_refusal_keeps_its_number() {
    let (session, _robot) = open_to(b"PK\x0B\x00\x02\x00\x09", &Options::default()).await;
    assert!(matches!(session.unwrap_err(), LinkError::Refused(9)));
}

#[tokio::test(start_paused = true)]
async fn a_robot_that_never_answers_the_login_is_given_up() {
    let (session, mut robot) = open_to(POWER_80, &Options::default()).await;
    let error = session.unwrap_err();
    assert!(matches!(error, LinkError::TimedOut { .. }), "{error}");
    let mut heard = Vec::new();
    robot.read_to_end(&mut heard).await.unwrap();
    assert_eq!(heard, LOGIN, "nothing may move before the login is through");
}

#[tokio::test(start_paused = true)]
async fn a_login_without_power_is_given_up() {
    let (session, mut robot) = open_to(ACCEPTED, &Options::default()).await;
    let error = session.unwrap_err();
    assert!(matches!(error, LinkError::NoPower { .. }), "{error}");
    let mut heard = Vec::new();
    robot.read_to_end(&mut heard).await.unwrap();
    assert_eq!(heard, LOGIN, "nothing may move before POWER");
}

#[tokio::test(start_paused = true)]
async fn chatter_does_not_prolong_the_wait_for_the_login() {
    let (ours, mut robot) = duplex(1 << 16);
    let (reader, writer) = tokio::io::split(ours);
    tokio::spawn(async move {
        while robot.write_all(DOCKED).await.is_ok() {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    });
    let options = Options::default();
    let error = link::open(reader, writer, nowhere(), &admin(), &options)
        .await
        .unwrap_err();
    assert!(matches!(error, LinkError::TimedOut { .. }), "{error}");
}

#[tokio::test]
async fn what_is_no_spykee_ends_the_login_at_once() {
    let (session, _robot) = open_to(b"HTTP/1.1 400 Bad Request\r\n", &Options::default()).await;
    assert!(matches!(session.unwrap_err(), LinkError::Framing(_)));
}

#[tokio::test]
async fn garbage_instead_of_a_header_ends_the_session_for_good() {
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
async fn a_robot_that_goes_within_a_message_has_closed() {
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
async fn a_robot_that_resets_the_connection_has_closed() {
    let (listener, target) = listen().await;
    let robot = tokio::spawn(answer(listener, b""));
    let connecting =
        tokio::spawn(async move { link::connect(&target, &admin(), &Options::default()).await });
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
async fn nobody_listening_is_named_with_the_address() {
    let (listener, target) = listen().await;
    drop(listener);
    let error = link::connect(&target, &admin(), &Options::default())
        .await
        .unwrap_err();
    assert!(matches!(error, LinkError::Unreachable { .. }));
    assert!(error.to_string().contains(&target.to_string()), "{error}");
}

#[tokio::test(start_paused = true)]
async fn a_dropped_wait_for_a_report_loses_nothing() {
    let (mut session, mut robot) = opened(&[ACCEPTED, POWER_80].concat()).await;
    for piece in DOCKED.chunks(1) {
        let wait = tokio::time::timeout(Duration::from_millis(1), session.reader.next()).await;
        assert!(wait.is_err());
        robot.write_all(piece).await.unwrap();
    }
    let report = session.reader.next().await.unwrap();
    assert_eq!(report, Report::Engine(EngineNews::Docked));
}

#[tokio::test(start_paused = true)]
async fn a_flood_of_reports_leaves_timers_their_turn() {
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

/// A transport that takes `room` bytes, in pieces, and then nothing more for ever.
struct Narrow {
    taken: std::sync::Arc<std::sync::Mutex<Vec<Vec<u8>>>>,
    room: std::sync::Arc<std::sync::atomic::AtomicUsize>,
}

impl AsyncWrite for Narrow {
    fn poll_write(
        self: Pin<&mut Self>,
        _: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        use std::sync::atomic::Ordering::SeqCst;
        let count = bytes.len().min(self.room.load(SeqCst));
        if count == 0 {
            return Poll::Pending;
        }
        self.room.fetch_sub(count, SeqCst);
        self.taken.lock().unwrap().push(bytes[..count].to_vec());
        Poll::Ready(Ok(count))
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }
}

/// A session whose writes are seen one by one, over a transport with room for `room` more bytes.
struct Watched {
    session: Session,
    taken: std::sync::Arc<std::sync::Mutex<Vec<Vec<u8>>>>,
    room: std::sync::Arc<std::sync::atomic::AtomicUsize>,
}

impl Watched {
    async fn with_room(room: usize) -> Watched {
        let taken = std::sync::Arc::default();
        let free = LOGIN.len() + STOP.len() + room;
        let room = std::sync::Arc::new(std::sync::atomic::AtomicUsize::new(free));
        let narrow = Narrow {
            taken: std::sync::Arc::clone(&taken),
            room: room.clone(),
        };
        let answers = io::Cursor::new([ACCEPTED, POWER_80].concat());
        let options = Options::default();
        let session = link::open(answers, narrow, nowhere(), &admin(), &options)
            .await
            .unwrap();
        taken.lock().unwrap().clear();
        Watched {
            session,
            taken,
            room,
        }
    }

    fn make_room(&self) {
        self.room
            .store(1 << 20, std::sync::atomic::Ordering::SeqCst);
    }

    fn writes(&self) -> Vec<Vec<u8>> {
        self.taken.lock().unwrap().clone()
    }
}

#[tokio::test]
async fn several_commands_leave_in_one_write() {
    let mut watched = Watched::with_room(1000).await;
    watched
        .session
        .writer
        .write(&[Command::STOP, GO])
        .await
        .unwrap();
    assert_eq!(watched.writes(), [[STOP, GO_BYTES].concat()]);
}

#[tokio::test(start_paused = true)]
async fn a_write_that_blocks_for_ever_ends_as_a_dead_link() {
    let mut watched = Watched::with_room(3).await;
    let began = tokio::time::Instant::now();
    let error = watched.session.writer.write(&[GO]).await.unwrap_err();
    assert!(matches!(error, LinkError::Dead { .. }), "{error}");
    assert!(began.elapsed() <= Options::default().dead_after * 2);
    let began = tokio::time::Instant::now();
    watched.session.writer.close().await;
    assert!(began.elapsed() <= Options::default().dead_after * 2);
}

#[tokio::test(start_paused = true)]
async fn writes_to_a_dead_link_do_not_pile_up() {
    let mut watched = Watched::with_room(0).await;
    let samples = Command::Audio(vec![0; 60_000].into());
    for _ in 0..50 {
        let write = watched.session.writer.write(std::slice::from_ref(&samples));
        let _ = tokio::time::timeout(Duration::from_millis(1), write).await;
    }
    watched.make_room();
    let _ = watched.session.writer.write(&[]).await;
    let written: usize = watched.writes().iter().map(Vec::len).sum();
    assert!(written < 8 * 65_540, "{written}");
}

#[tokio::test(start_paused = true)]
async fn a_stop_after_a_cut_write_finishes_the_message_and_forgets_the_motion_behind_it() {
    for cut in 0..=14 {
        let mut watched = Watched::with_room(cut).await;
        let write = watched.session.writer.write(&[GO, GO, GO]);
        assert!(
            tokio::time::timeout(Duration::from_millis(1), write)
                .await
                .is_err()
        );
        watched.make_room();
        watched.session.writer.stop_now();
        let expected = [&GO_BYTES.repeat(cut.div_ceil(7))[..], STOP].concat();
        assert_eq!(watched.writes().concat(), expected, "cut at {cut}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_write_after_a_cut_write_continues_where_it_was_cut() {
    let mut watched = Watched::with_room(9).await;
    let write = watched.session.writer.write(&[GO, GO]);
    assert!(
        tokio::time::timeout(Duration::from_millis(1), write)
            .await
            .is_err()
    );
    watched.make_room();
    watched
        .session
        .writer
        .write(&[Command::STOP])
        .await
        .unwrap();
    assert_eq!(
        watched.writes().concat(),
        [GO_BYTES, GO_BYTES, STOP].concat()
    );
}

#[tokio::test]
async fn a_dropped_writer_stops_the_tracks_and_a_closed_one_says_nothing() {
    let mut watched = Watched::with_room(1000).await;
    watched.session.writer.write(&[GO]).await.unwrap();
    let taken = watched.taken.clone();
    drop(watched);
    assert_eq!(taken.lock().unwrap().concat(), [GO_BYTES, STOP].concat());

    let watched = Watched::with_room(1000).await;
    let taken = watched.taken.clone();
    watched.session.writer.close().await;
    assert!(taken.lock().unwrap().is_empty());
}

#[test]
fn a_writer_dropped_after_its_runtime_has_ended_still_stops_the_tracks() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let (session, robot) = runtime.block_on(async {
        let (listener, target) = listen().await;
        let robot = tokio::spawn(answer(
            listener,
            b"PK\x0B\x00\x06\x01\x00\x00\x00\x00\x01PK\x03\x00\x01\x50",
        ));
        let session = link::connect(&target, &admin(), &Options::default())
            .await
            .unwrap();
        (session, robot.await.unwrap().into_std().unwrap())
    });
    drop(runtime);
    let panicked = std::thread::spawn(move || {
        let _session = session;
        panic!("a panic somewhere (this test wants it)");
    });
    assert!(panicked.join().is_err());
    robot.set_nonblocking(false).unwrap();
    let mut heard = Vec::new();
    io::Read::read_to_end(&mut &robot, &mut heard).unwrap();
    assert_eq!(heard, [STOP, STOP].concat());
}

/// Bytes that begin like a robot's and go astray, or are astray from the start.
fn astray(rng: &mut StdRng) -> Vec<u8> {
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
async fn a_hundred_thousand_strings_of_garbage_neither_panic_nor_hang() {
    let mut rng = StdRng::seed_from_u64(0x5bee);
    let (mut sessions, mut reports, mut framing) = (0, 0, 0);
    for _ in 0..100_000 {
        let robot = io::Cursor::new(astray(&mut rng));
        let options = Options::default();
        let opened = link::open(robot, tokio::io::sink(), nowhere(), &admin(), &options).await;
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

mod discovery {
    use super::*;
    use spykee::link::discover;

    /// Answers every datagram with each of `replies`, for ever.
    async fn answering(replies: &'static [&'static [u8]]) -> SocketAddr {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let addr = socket.local_addr().unwrap();
        tokio::spawn(async move {
            let mut datagram = [0; 64];
            loop {
                let (_, from) = socket.recv_from(&mut datagram).await.unwrap();
                for reply in replies {
                    socket.send_to(reply, from).await.unwrap();
                }
            }
        });
        addr
    }

    #[tokio::test]
    async fn robots_are_listed_once_and_garbage_is_overlooked() {
        let free = answering(&[
            b"DSCV\x01",
            b"",
            b"HELLO",
            b"DSCV\x02\x0Euid=SPYKEE0001",
            b"DSCV\x02\x0Euid=SPYKEE0001",
        ]);
        let busy = answering(&[b"DSCV\x02\x23uid=SPYKEE0002,connected-user=berta"]);
        let (free, busy) = (free.await, busy.await);
        let nobody = SocketAddr::from(([127, 0, 0, 1], 9));
        // Long enough for three questions.
        let found = discover::ask(&[nobody, free, busy], Duration::from_secs(1))
            .await
            .unwrap();
        let mut uids: Vec<_> = found.iter().map(|robot| robot.uid.as_str()).collect();
        uids.sort_unstable();
        assert_eq!(uids, ["SPYKEE0001", "SPYKEE0002"]);
        let robot = found.iter().find(|robot| robot.addr == busy).unwrap();
        assert_eq!(robot.connected_user.as_deref(), Some("berta"));
    }

    #[tokio::test]
    async fn a_lost_question_is_repeated() {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let addr = socket.local_addr().unwrap();
        tokio::spawn(async move {
            let mut datagram = [0; 64];
            socket.recv_from(&mut datagram).await.unwrap();
            let (_, from) = socket.recv_from(&mut datagram).await.unwrap();
            socket
                .send_to(b"DSCV\x02\x0Euid=SPYKEE0001", from)
                .await
                .unwrap();
        });
        let found = discover::ask(&[addr], Duration::from_secs(2))
            .await
            .unwrap();
        assert_eq!(found.len(), 1);
    }

    #[tokio::test]
    async fn nobody_is_an_empty_list_after_the_time() {
        let found = discover::ask(&[], Duration::from_millis(50)).await.unwrap();
        assert_eq!(found, []);
    }

    #[tokio::test]
    async fn ipv6_robots_are_asked_too() {
        let Ok(socket) = UdpSocket::bind("[::1]:0").await else {
            return;
        };
        let addr = socket.local_addr().unwrap();
        tokio::spawn(async move {
            let mut datagram = [0; 64];
            let (_, from) = socket.recv_from(&mut datagram).await.unwrap();
            socket
                .send_to(b"DSCV\x02\x0Euid=SPYKEE0001", from)
                .await
                .unwrap();
        });
        let found = discover::ask(&[addr], Duration::from_millis(300))
            .await
            .unwrap();
        assert_eq!(found.len(), 1);
    }

    #[test]
    fn the_robots_own_network_and_a_simulator_here_are_always_asked() {
        let targets: Vec<String> = discover::broadcast_targets()
            .iter()
            .map(ToString::to_string)
            .collect();
        for target in [
            "172.17.6.255:9000",
            "255.255.255.255:9000",
            "127.0.0.1:9000",
        ] {
            assert!(targets.iter().any(|each| each == target), "{targets:?}");
        }
    }
}

/// The same promises against the simulator, over loopback TCP.
mod simulator {
    use super::*;
    use spykee::sim::{Firmware, Handle, Server, World};
    use tokio::task::JoinHandle;

    struct Sim {
        handle: Handle,
        target: Target,
        task: JoinHandle<io::Result<()>>,
    }

    impl Drop for Sim {
        fn drop(&mut self) {
            self.task.abort();
        }
    }

    async fn sim(firmware: Firmware) -> Sim {
        let options = spykee::sim::Options {
            firmware,
            ..Default::default()
        };
        let server = Server::bind(World::default_world(), options).await.unwrap();
        Sim {
            handle: server.handle(),
            target: server.local_addr().to_string().parse().unwrap(),
            task: tokio::spawn(server.run()),
        }
    }

    impl Sim {
        async fn connect(&self, login: &Login) -> Result<Session, LinkError> {
            let options = Options {
                login_timeout: Duration::from_secs(2),
                dead_after: Duration::from_millis(500),
                ..Options::default()
            };
            link::connect(&self.target, login, &options).await
        }

        /// What the robot heard from one connection, the first being 0.
        fn heard(&self, client: u64) -> Vec<Command> {
            let heard = self.handle.heard().into_iter();
            heard
                .filter(|heard| heard.client == client)
                .map(|heard| heard.command)
                .collect()
        }
    }

    #[tokio::test]
    async fn every_session_begins_with_a_stop_also_after_a_lost_link() {
        let sim = sim(Firmware::default()).await;
        let login = admin();
        let mut first = sim.connect(&login).await.unwrap();
        assert_eq!(first.accepted.uid, "SPYKEE0001");
        first.writer.write(&[GO]).await.unwrap();
        sim.handle.wait_heard(0, |command| *command == GO).await;
        sim.handle.cut();
        while first.reader.next().await.is_ok() {}
        drop(first);
        let lost = sim.handle.heard_count();
        let _second = sim.connect(&login).await.unwrap();
        sim.handle
            .wait_heard(lost, |command| *command == Command::STOP)
            .await;
        assert_eq!(
            sim.heard(0)[..3],
            [Command::Login(login.clone()), Command::STOP, GO]
        );
        assert_eq!(sim.heard(1), [Command::Login(login), Command::STOP]);
    }

    #[tokio::test]
    async fn a_wrong_password_is_final() {
        let sim = sim(Firmware::default()).await;
        let error = sim
            .connect(&Login::new("admin", "nimda"))
            .await
            .unwrap_err();
        assert!(error.is_final(), "{error}");
    }

    #[tokio::test]
    async fn the_second_user_hears_who_the_first_is_and_comes_in_once_that_one_has_gone() {
        let sim = sim(Firmware::default()).await;
        let first = sim.connect(&admin()).await.unwrap();
        let error = sim.connect(&admin()).await.unwrap_err();
        assert!(
            matches!(&error, LinkError::InUse { by: Some(user) } if user == "admin"),
            "{error}"
        );
        first.writer.close().await;
        drop(first.reader);
        sim.handle.wait_state(|state| state.user.is_none()).await;
        sim.connect(&admin()).await.unwrap();
    }

    #[tokio::test]
    async fn a_robot_whose_power_never_comes_is_not_driven() {
        let firmware = Firmware {
            power_after_login: Duration::from_secs(3600),
            power_period: Duration::from_secs(3600),
            ..Firmware::default()
        };
        let sim = sim(firmware).await;
        let error = sim.connect(&admin()).await.unwrap_err();
        assert!(matches!(error, LinkError::NoPower { .. }), "{error}");
        assert_eq!(sim.heard(0), [Command::Login(admin())]);
    }

    #[tokio::test]
    async fn a_dropped_session_stops_a_robot_that_would_drive_on() {
        let sim = sim(Firmware::default()).await;
        let mut session = sim.connect(&admin()).await.unwrap();
        session.writer.write(&[GO]).await.unwrap();
        let go = sim.handle.wait_heard(0, |command| *command == GO).await;
        drop(session);
        sim.handle
            .wait_heard(go, |command| *command == Command::STOP)
            .await;
    }

    #[tokio::test]
    async fn a_robot_that_reads_no_more_is_a_dead_link_in_time() {
        let sim = sim(Firmware::default()).await;
        let mut session = sim.connect(&admin()).await.unwrap();
        sim.handle.mute(true);
        let samples = [Command::Audio(vec![0; 60_000].into())];
        let writing = async {
            loop {
                if let Err(error) = session.writer.write(&samples).await {
                    return error;
                }
            }
        };
        let error = tokio::time::timeout(Duration::from_secs(60), writing)
            .await
            .unwrap();
        assert!(matches!(error, LinkError::Dead { .. }), "{error}");
    }
}
