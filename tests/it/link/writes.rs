//! The bytes and segments that are written, and the state after a write that is partial or blocks.

use super::*;
use std::pin::Pin;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use tokio::io::AsyncWrite;

/// A transport that accepts `room` bytes, in pieces, and then blocks forever.
struct Narrow {
    taken: Arc<Mutex<Vec<Vec<u8>>>>,
    room: Arc<AtomicUsize>,
}

impl AsyncWrite for Narrow {
    fn poll_write(
        self: Pin<&mut Self>,
        _: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
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

const DOCK: Command = Command::Engine(Engage::Dock);
const UNDOCK: Command = Command::Engine(Engage::Undock);

/// A session that records its writes, over a transport with room for `room` more bytes.
struct Watched {
    session: Session,
    taken: Arc<Mutex<Vec<Vec<u8>>>>,
    room: Arc<AtomicUsize>,
}

impl Watched {
    async fn with_room(room: usize) -> Watched {
        let taken = Arc::default();
        let free = LOGIN.len() + STOP.len() + room;
        let room = Arc::new(AtomicUsize::new(free));
        let narrow = Narrow {
            taken: Arc::clone(&taken),
            room: room.clone(),
        };
        let answers = io::Cursor::new([ACCEPTED, POWER_80].concat());
        let options = Options::default();
        let session = link::open(answers, narrow, nowhere(), &admin(), stop(), &options)
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
        self.room.store(1 << 20, SeqCst);
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
        .write(&[Command::STOP, DOCK])
        .await
        .unwrap();
    assert_eq!(watched.writes(), [[STOP, &DOCK.to_bytes()].concat()]);
}

#[tokio::test(start_paused = true)]
async fn a_write_that_blocks_forever_ends_as_a_dead_link() {
    let mut watched = Watched::with_room(3).await;
    let began = tokio::time::Instant::now();
    let error = watched.session.writer.write(&[GO]).await.unwrap_err();
    assert!(matches!(error, LinkError::Dead { .. }), "{error}");
    assert!(began.elapsed() <= Options::default().dead_after * 2);
    let began = tokio::time::Instant::now();
    link::hang_up(watched.session.reader, watched.session.writer).await;
    assert!(began.elapsed() <= Options::default().dead_after * 2);
}

#[tokio::test(start_paused = true)]
async fn writes_to_a_dead_link_do_not_accumulate() {
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
async fn a_stop_after_a_partial_write_completes_the_message_and_discards_queued_commands() {
    for cut in 0..=12 {
        let mut watched = Watched::with_room(cut).await;
        let write = watched.session.writer.write(&[UNDOCK, UNDOCK, UNDOCK]);
        assert!(
            tokio::time::timeout(Duration::from_millis(1), write)
                .await
                .is_err()
        );
        watched.make_room();
        watched.session.writer.send_last_words();
        let expected = [&UNDOCK.to_bytes().repeat(cut.div_ceil(6))[..], STOP].concat();
        assert_eq!(watched.writes().concat(), expected, "cut at {cut}");
    }
}

#[tokio::test(start_paused = true)]
async fn a_write_after_a_partial_write_continues_where_it_ended() {
    let mut watched = Watched::with_room(9).await;
    let write = watched.session.writer.write(&[UNDOCK, UNDOCK]);
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
        [&UNDOCK.to_bytes(), &UNDOCK.to_bytes(), STOP].concat()
    );
}

/// Those who would have to complete the message must hear of it.
#[tokio::test(start_paused = true)]
async fn progress_returns_when_the_rest_of_a_cut_message_has_changed() {
    let (ours, mut robot) = duplex(8);
    let login = admin();
    let options = Options::default();
    let answers = io::Cursor::new([ACCEPTED, POWER_80].concat());
    let wanted = [LOGIN, STOP].concat();
    let (session, ()) = tokio::join!(
        link::open(answers, ours, nowhere(), &login, stop(), &options),
        expect(&mut robot, &wanted),
    );
    let mut writer = session.unwrap().writer;
    let now = tokio::time::Instant::now();
    writer.send(&[UNDOCK, UNDOCK], now).unwrap();
    let mut bytes = [0; 6];
    for (read, rest) in [(0, 4), (2, 2), (1, 1), (6, 0)] {
        let (written, _) = tokio::join!(writer.progress(), robot.read_exact(&mut bytes[..read]));
        written.unwrap();
        assert_eq!(writer.last_words().0, &UNDOCK.to_bytes()[6 - rest..]);
    }
    robot.read_exact(&mut bytes[..3]).await.unwrap();
    writer.send(&[UNDOCK], now).unwrap();
    let whole = tokio::time::timeout(Duration::from_millis(1), writer.progress()).await;
    assert!(whole.is_err(), "no message is cut");
}

#[tokio::test]
async fn a_dropped_writer_stops_the_tracks_and_a_closed_one_sends_nothing() {
    let mut watched = Watched::with_room(1000).await;
    watched.session.writer.write(&[GO]).await.unwrap();
    let taken = watched.taken.clone();
    drop(watched);
    assert_eq!(taken.lock().unwrap().concat(), [GO_BYTES, STOP].concat());

    let watched = Watched::with_room(1000).await;
    let taken = watched.taken.clone();
    link::hang_up(watched.session.reader, watched.session.writer).await;
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
        let session = link::connect(&target, &admin(), stop(), &Options::default())
            .await
            .unwrap();
        (session, robot.await.unwrap().into_std().unwrap())
    });
    drop(runtime);
    let panicked = std::thread::spawn(move || {
        let _session = session;
        panic!("an expected panic of this test");
    });
    assert!(panicked.join().is_err());
    robot.set_nonblocking(false).unwrap();
    let mut heard = Vec::new();
    io::Read::read_to_end(&mut &robot, &mut heard).unwrap();
    assert_eq!(heard, [STOP, STOP].concat());
}
