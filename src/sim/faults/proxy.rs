//! The proxy between a client and the robot: forwards a connection's bytes in both directions and
//! applies the active faults to them. Independent of the robot; works over any byte stream, and its
//! random choices depend only on the seed.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::corrupt::{Section, Splitter};
use super::scheduler::{ActiveFaults, FaultFeed};
use super::{Direction, Fault, FaultKind, corrupt};

/// When one end has closed, the other one gets this long to close too.
const CLOSE_TIMEOUT: Duration = Duration::from_secs(1);

/// Turns the end of a connection into a reset. Without it, dropping the connection closes it in an
/// orderly way.
pub(crate) struct Breaker(pub(crate) socket2::Socket);

impl Breaker {
    fn arm(&self) {
        // Fails only if the connection is already closed.
        let _ = self.0.set_linger(Some(Duration::ZERO));
    }
}

/// Forwards bytes between a client and the robot until both have closed, or until a fault ends the
/// connection.
pub(crate) async fn forward(
    client: impl AsyncRead + AsyncWrite,
    breaker: Option<Breaker>,
    robot: impl AsyncRead + AsyncWrite,
    feed: FaultFeed,
) {
    let (client_reader, client_writer) = tokio::io::split(client);
    let (robot_reader, robot_writer) = tokio::io::split(robot);
    let mut active_faults = feed.active_faults.clone();
    let robot_feed = FaultFeed {
        active_faults: feed.active_faults.clone(),
        beginnings: feed.beginnings.resubscribe(),
        ..feed
    };
    let client_feed = FaultFeed {
        seed: feed.seed.wrapping_add(1),
        unacknowledged: None,
        ..feed
    };
    let to_robot = ProxyDirection::new(Direction::Robot, robot_feed);
    let to_client = ProxyDirection::new(Direction::Client, client_feed);
    let mut to_robot = Box::pin(to_robot.run(client_reader, robot_writer));
    let mut to_client = Box::pin(to_client.run(robot_reader, client_writer));
    let end = tokio::select! {
        biased;
        end = &mut to_robot => end.or(timeout(CLOSE_TIMEOUT, &mut to_client)).await,
        end = &mut to_client => end.or(timeout(CLOSE_TIMEOUT, &mut to_robot)).await,
    };
    if end == End::Reset {
        breaker.iter().for_each(Breaker::arm);
    } else {
        // While the robot's side is half-open, the robot must not notice that its client is gone.
        let _ = active_faults
            .wait_for(|now| !now.drops_bytes(Direction::Robot))
            .await;
    }
}

impl End {
    /// Returns a reset immediately; otherwise waits for the end of the other direction.
    async fn or<E>(self, other: impl Future<Output = Result<End, E>>) -> End {
        match self {
            End::Reset => self,
            End::Closed => other.await.unwrap_or(End::Closed),
        }
    }
}

const READ_LEN: usize = 8 * 1024;
/// Capacity of the queue of reads, more than a delay of seconds needs; when full, the sender waits.
const MAX_WAITING: usize = 256;

/// One direction of a connection: applies the active faults to its bytes, and writes them when they
/// are due, at the rate and in the pieces that the faults require.
struct ProxyDirection {
    towards: Direction,
    active_faults: watch::Receiver<ActiveFaults>,
    beginnings: broadcast::Receiver<Fault>,
    rng: StdRng,
    splitter: Splitter,
    /// Momentary faults to be applied to the next message.
    pending: Vec<FaultKind>,
    /// Bytes were dropped; nothing is delivered any more.
    dropped: bool,
    /// How long the sender waits for an acknowledgement of dropped bytes.
    unacknowledged: Option<Duration>,
    /// When the sender gives up the connection.
    given_up: Option<Instant>,
    last_due: Instant,
}

impl ProxyDirection {
    fn new(towards: Direction, feed: FaultFeed) -> ProxyDirection {
        ProxyDirection {
            towards,
            active_faults: feed.active_faults,
            beginnings: feed.beginnings,
            rng: StdRng::seed_from_u64(feed.seed),
            splitter: Splitter::default(),
            pending: Vec::new(),
            dropped: false,
            unacknowledged: feed.unacknowledged,
            given_up: None,
            last_due: Instant::now(),
        }
    }

    /// Forwards bytes until one end closes, or until a fault ends the connection.
    async fn run<R: AsyncRead, W: AsyncWrite>(
        mut self,
        mut from: ReadHalf<R>,
        to: WriteHalf<W>,
    ) -> End {
        let (queue, waiting) = mpsc::channel(MAX_WAITING);
        let writer = ThrottledWriter {
            towards: self.towards,
            active_faults: self.active_faults.clone(),
            rng: StdRng::seed_from_u64(self.rng.random()),
            next_write: Instant::now(),
        };
        let mut writer = Box::pin(writer.run(to, waiting));
        tokio::select! {
            biased;
            end = &mut writer => end,
            () = self.read_input(&mut from, queue) => writer.await,
        }
    }

    /// Reads from `from` and queues writes until the input ends. Queued writes are still
    /// delivered.
    async fn read_input<R: AsyncRead + Unpin>(
        &mut self,
        from: &mut R,
        queue: mpsc::Sender<QueuedWrite>,
    ) {
        let mut buffer = vec![0; READ_LEN];
        loop {
            let due = self.given_up;
            let writes = tokio::select! {
                biased;
                received = self.beginnings.recv() => match received {
                    Ok(fault) => self.on_beginning(&fault),
                    Err(broadcast::error::RecvError::Lagged(_)) => vec![],
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                () = sleep_until(due.unwrap_or_else(Instant::now)), if due.is_some() => {
                    send(&queue, vec![QueuedWrite::Reset]).await;
                    return;
                }
                read = from.read(&mut buffer) => match read {
                    Ok(length @ 1..) => self.on_bytes(&buffer[..length]),
                    Ok(0) | Err(_) => {
                        let rest = self.splitter.rest();
                        let writes = self.writes_of(rest);
                        send(&queue, writes).await;
                        return;
                    }
                },
            };
            if !send(&queue, writes).await {
                return;
            }
        }
    }

    /// Applies a fault that begins now, if it is momentary; lasting ones are in `active_faults`.
    fn on_beginning(&mut self, fault: &Fault) -> Vec<QueuedWrite> {
        if !fault.towards.covers(self.towards) {
            return vec![];
        }
        match fault.kind {
            FaultKind::Garbage { bytes } => {
                let bytes = corrupt::garbage(bytes, &mut self.rng);
                self.writes_of([Section::Raw(bytes)])
            }
            FaultKind::Reset if self.towards == Direction::Robot => vec![],
            FaultKind::Reset | FaultKind::LengthLie { .. } => {
                self.pending.push(fault.kind);
                vec![]
            }
            _ => vec![],
        }
    }

    fn on_bytes(&mut self, bytes: &[u8]) -> Vec<QueuedWrite> {
        let sections = self.splitter.feed(bytes);
        self.writes_of(sections)
    }

    /// Combines the data of one read into one write, unless a reset cuts it off.
    fn writes_of(&mut self, sections: impl IntoIterator<Item = Section>) -> Vec<QueuedWrite> {
        let active_faults = self.active_faults.borrow_and_update().clone();
        self.dropped |= active_faults.drops_bytes(self.towards);
        if self.dropped {
            let limit = self.unacknowledged.map(|limit| Instant::now() + limit);
            self.given_up = self.given_up.or(limit);
            return vec![];
        }
        let due = self.due(&active_faults);
        let mut bytes = BytesMut::new();
        for section in sections {
            let packet = match section {
                Section::Raw(raw) => {
                    bytes.extend_from_slice(&raw);
                    continue;
                }
                Section::Message(packet) => packet,
            };
            let faults = active_faults.towards(self.towards);
            let Some(packet) = corrupt::corrupt(packet, faults, &mut self.rng) else {
                continue;
            };
            let start = bytes.len();
            packet.emit(&mut bytes);
            if self.apply_pending(&mut bytes, start) {
                let bytes = bytes.freeze();
                return vec![QueuedWrite::Bytes { due, bytes }, QueuedWrite::Reset];
            }
        }
        let bytes = bytes.freeze();
        if bytes.is_empty() {
            vec![]
        } else {
            vec![QueuedWrite::Bytes { due, bytes }]
        }
    }

    /// Applies the pending momentary faults to the message that starts at `start`; returns true if
    /// one of them cuts the message off.
    fn apply_pending(&mut self, bytes: &mut BytesMut, start: usize) -> bool {
        for kind in std::mem::take(&mut self.pending) {
            match kind {
                FaultKind::LengthLie { claim } => {
                    corrupt::falsify_length(&mut bytes[start..], claim, &mut self.rng)
                }
                _ => {
                    bytes.truncate(start + (bytes.len() - start) / 2);
                    return true;
                }
            }
        }
        false
    }

    /// Returns when bytes read now are delivered: never before earlier ones.
    fn due(&mut self, active_faults: &ActiveFaults) -> Instant {
        let mut due = Instant::now();
        for fault in active_faults.towards(self.towards) {
            if let FaultKind::Delay { by, jitter } = fault.kind {
                due += by + jitter.mul_f64(self.rng.random_range(0.0..=1.0));
            }
        }
        self.last_due = self.last_due.max(due);
        self.last_due
    }
}

async fn send(queue: &mpsc::Sender<QueuedWrite>, writes: Vec<QueuedWrite>) -> bool {
    for queued in writes {
        if queue.send(queued).await.is_err() {
            return false;
        }
    }
    true
}

/// Pause between two pieces of a split message; without it the network would join them again.
const PIECE_PAUSE: Duration = Duration::from_millis(1);
/// Maximum length of a piece in bytes, unless `PIECE_SHARE` allows more.
const PIECE: usize = 12;
/// Maximum length of a piece as a fraction of the bytes left: one part in this many.
const PIECE_SHARE: usize = 16;
/// Number of pieces per second when the data rate is limited.
const PIECES_PER_SECOND: u32 = 50;

/// Maximum lateness of a timer. A limited stream catches up on it, to keep its average rate.
const LATE: Duration = Duration::from_millis(2);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// One end has closed or disappeared.
    Closed,
    /// A fault requires a reset of the whole connection.
    Reset,
}

enum QueuedWrite {
    /// Bytes to be written when they are due.
    Bytes { due: Instant, bytes: Bytes },
    /// The connection is reset; nothing follows.
    Reset,
}

struct ThrottledWriter {
    towards: Direction,
    active_faults: watch::Receiver<ActiveFaults>,
    rng: StdRng,
    /// When the next piece of a rate-limited stream may be written.
    next_write: Instant,
}

impl ThrottledWriter {
    /// Runs until the queue is closed, the receiver has disappeared, or a reset is queued.
    async fn run(
        mut self,
        mut to: impl AsyncWrite + Unpin,
        mut waiting: mpsc::Receiver<QueuedWrite>,
    ) -> End {
        while let Some(queued) = waiting.recv().await {
            let QueuedWrite::Bytes { due, bytes } = queued else {
                return End::Reset;
            };
            sleep_until(due).await;
            if self.write(&mut to, bytes).await.is_err() {
                return End::Closed;
            }
        }
        let dropped = self.active_faults.borrow().drops_bytes(self.towards);
        if !dropped {
            let _ = to.shutdown().await;
        }
        End::Closed
    }

    async fn write<W: AsyncWrite + Unpin>(
        &mut self,
        to: &mut W,
        mut bytes: Bytes,
    ) -> std::io::Result<()> {
        while !bytes.is_empty() {
            let (length, pause, drip) = self.piece(bytes.len());
            to.write_all(&bytes.split_to(length)).await?;
            to.flush().await?;
            if !pause.is_zero() {
                sleep(pause).await;
            }
            if !drip.is_zero() {
                let now = Instant::now();
                self.next_write = self.next_write.max(now.checked_sub(LATE).unwrap_or(now)) + drip;
                sleep_until(self.next_write).await;
            }
        }
        Ok(())
    }

    /// Returns how many of the `left` bytes to write now, the pause after them, and the time they
    /// take at the limited rate.
    fn piece(&mut self, left: usize) -> (usize, Duration, Duration) {
        let mut length = left;
        let mut pause = Duration::ZERO;
        let mut slowest = None::<u32>;
        let active_faults = self.active_faults.borrow_and_update().clone();
        for fault in active_faults.towards(self.towards) {
            match fault.kind {
                FaultKind::Split => {
                    let most = PIECE.max(left / PIECE_SHARE).min(length);
                    length = self.rng.random_range(1..=most);
                    pause = pause.max(PIECE_PAUSE);
                }
                FaultKind::Drip { rate } => {
                    length = length.min((rate / PIECES_PER_SECOND).max(1) as usize);
                    slowest = Some(slowest.map_or(rate, |slowest| slowest.min(rate)));
                }
                _ => {}
            }
        }
        let drip = slowest.map_or(Duration::ZERO, |rate| {
            Duration::from_secs_f64(length as f64 / f64::from(rate.max(1)))
        });
        (length, pause, drip)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::scheduler::FaultScheduler;
    use crate::faults::{Fault, FaultKind, Timing};
    use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
    use tokio::task::JoinHandle;
    use tokio::time::{Instant, sleep};

    const SECOND: Duration = Duration::from_secs(1);
    const POWER_80: &[u8] = &[0x50, 0x4B, 3, 0, 1, 0x50];

    /// A proxied connection and its ends.
    struct Line {
        scheduler: FaultScheduler,
        client: DuplexStream,
        robot: DuplexStream,
        forwarding: JoinHandle<()>,
    }

    fn line(seed: u64) -> Line {
        let mut scheduler = FaultScheduler::new(seed, Some(4 * SECOND));
        let (client, near) = tokio::io::duplex(64 * 1024);
        let (far, robot) = tokio::io::duplex(64 * 1024);
        let forwarding = tokio::spawn(forward(near, None, far, scheduler.feed()));
        Line {
            scheduler,
            client,
            robot,
            forwarding,
        }
    }

    impl Line {
        fn begin(&mut self, kind: FaultKind, towards: Direction, lasts: Option<Duration>) {
            let mut fault = Fault {
                towards,
                ..Fault::new(kind)
            };
            fault.timing = Timing {
                lasts: lasts.or(fault.timing.lasts),
                ..fault.timing
            };
            self.scheduler.begin(fault, Instant::now());
            self.scheduler.poll(Instant::now());
        }
    }

    async fn rest(end: &mut DuplexStream) -> Vec<u8> {
        let mut bytes = Vec::new();
        end.read_to_end(&mut bytes).await.unwrap();
        bytes
    }

    #[tokio::test(start_paused = true)]
    async fn without_faults_any_bytes_and_the_end_pass_unchanged() {
        let mut line = line(1);
        line.client.write_all(b"GET / HTTP/1.0").await.unwrap();
        line.client.shutdown().await.unwrap();
        assert_eq!(rest(&mut line.robot).await, b"GET / HTTP/1.0");
        line.robot
            .write_all(&[POWER_80, &POWER_80[..3]].concat())
            .await
            .unwrap();
        drop(line.robot);
        assert_eq!(
            rest(&mut line.client).await,
            [POWER_80, &POWER_80[..3]].concat()
        );
        line.forwarding.await.unwrap();
    }

    #[tokio::test(start_paused = true)]
    async fn delayed_bytes_arrive_later_and_in_order() {
        let mut line = line(1);
        let by = SECOND;
        let jitter = SECOND;
        line.begin(FaultKind::Delay { by, jitter }, Direction::Client, None);
        let start = Instant::now();
        for level in 0..20 {
            line.robot
                .write_all(&[0x50, 0x4B, 3, 0, 1, level])
                .await
                .unwrap();
            sleep(Duration::from_millis(50)).await;
        }
        let mut levels = Vec::new();
        for _ in 0..20 {
            let mut message = [0; 6];
            line.client.read_exact(&mut message).await.unwrap();
            levels.push(message[5]);
            assert!(levels.len() > 1 || start.elapsed() >= SECOND);
        }
        assert_eq!(levels, (0..20).collect::<Vec<u8>>());
        assert!(start.elapsed() < 4 * SECOND, "{:?}", start.elapsed());
    }

    #[tokio::test(start_paused = true)]
    async fn split_or_rate_limited_bytes_arrive_complete() {
        for kind in [FaultKind::Split, FaultKind::Drip { rate: 100 }] {
            let mut line = line(3);
            line.begin(kind, Direction::Both, None);
            let start = Instant::now();
            let sent = POWER_80.repeat(100);
            line.robot.write_all(&sent).await.unwrap();
            drop(line.robot);
            assert_eq!(rest(&mut line.client).await, sent);
            let seconds = start.elapsed().as_secs();
            assert_eq!(seconds, if kind == FaultKind::Split { 0 } else { 6 });
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_half_open_connection_stays_dead_and_its_end_is_noticed_late() {
        let mut line = line(1);
        line.begin(FaultKind::HalfOpen, Direction::Both, Some(5 * SECOND));
        line.client.write_all(POWER_80).await.unwrap();
        sleep(3 * SECOND).await;
        drop(line.client);
        let mut byte = [0];
        let read = timeout(SECOND, line.robot.read(&mut byte)).await;
        assert!(read.is_err(), "the robot noticed {read:?}");
        sleep(SECOND).await;
        line.scheduler.poll(Instant::now());
        assert_eq!(rest(&mut line.robot).await, b"");
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_whose_bytes_are_dropped_loses_its_connection_after_the_timeout() {
        let mut line = line(1);
        line.begin(FaultKind::HalfOpen, Direction::Robot, None);
        let start = Instant::now();
        line.client.write_all(POWER_80).await.unwrap();
        sleep(SECOND).await;
        line.client.write_all(POWER_80).await.unwrap();
        assert_eq!(rest(&mut line.client).await, b"");
        assert_eq!(start.elapsed().as_secs(), 4);
    }

    #[tokio::test(start_paused = true)]
    async fn a_reset_leaves_half_a_message() {
        let mut line = line(1);
        line.begin(FaultKind::Reset, Direction::Both, None);
        line.robot.write_all(&POWER_80.repeat(2)).await.unwrap();
        assert_eq!(rest(&mut line.client).await, POWER_80[..3]);
        line.forwarding.await.unwrap();
        assert!(line.robot.write_all(POWER_80).await.is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn the_same_seed_corrupts_the_same_bytes() {
        let corrupted = async |seed| {
            let mut line = line(seed);
            line.begin(FaultKind::Garbage { bytes: 50 }, Direction::Client, None);
            line.begin(
                FaultKind::LengthLie { claim: None },
                Direction::Client,
                None,
            );
            // Gives this direction time to receive the momentary faults before the connection ends.
            sleep(SECOND).await;
            line.robot.write_all(POWER_80).await.unwrap();
            drop(line.robot);
            rest(&mut line.client).await
        };
        let first = corrupted(4).await;
        assert_eq!(first.len(), 56);
        assert!(!first.ends_with(POWER_80), "the length is unchanged");
        assert_eq!(first, corrupted(4).await);
        assert_ne!(first, corrupted(5).await);
    }
}
