//! The middleware between a client and the robot: carries a connection's bytes both ways and
//! spoils them as the faults of the moment say. Knows no robot; works over anything that reads and
//! writes bytes, and over its seed alone.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, sleep, sleep_until, timeout};

use super::connection::Transport;
use super::faults::{Fault, Towards, Trouble};
use super::mangle::{self, Splitter, Stretch};
use super::troubles::{Conditions, Weather};

const READ_LEN: usize = 8 * 1024;
/// Reads that may wait on their way; then the sender waits. More than a delay of seconds needs.
const MAX_WAITING: usize = 256;
/// When one end has closed, the other gets this long to do so too.
const FAREWELL: Duration = Duration::from_secs(1);
/// Between two pieces of a message that is cut: else the network puts them together again.
const PIECE_PAUSE: Duration = Duration::from_millis(1);
/// A message is cut into pieces of up to so many bytes, or of up to this part of it.
const PIECE: usize = 12;
const PIECE_SHARE: usize = 16;
/// A trickle comes in so many sips a second.
const SIPS: u32 = 50;

/// Makes the end of a connection a reset; its drop alone is an orderly end.
pub(super) struct Breaker(pub(super) socket2::Socket);

impl Breaker {
    fn arm(&self) {
        // A connection that cannot be reset any more has gone already.
        let _ = self.0.set_linger(Some(Duration::ZERO));
    }
}

/// Carries bytes between a client and the robot until both have closed, or until a fault ends it.
pub(super) async fn carry(
    client: impl Transport,
    breaker: Option<Breaker>,
    robot: impl Transport,
    weather: Weather,
) {
    let (client_reader, client_writer) = tokio::io::split(client);
    let (robot_reader, robot_writer) = tokio::io::split(robot);
    let Weather { mut conditions, strikes, seed } = weather;
    let lane = |towards, strikes, seed| Lane::new(towards, conditions.clone(), strikes, seed);
    let to_robot = lane(Towards::Robot, strikes.resubscribe(), seed);
    let to_client = lane(Towards::Client, strikes, seed.wrapping_add(1));
    let mut to_robot = Box::pin(to_robot.run(client_reader, robot_writer));
    let mut to_client = Box::pin(to_client.run(robot_reader, client_writer));
    let end = tokio::select! {
        end = &mut to_robot => end.or(timeout(FAREWELL, &mut to_client)).await,
        end = &mut to_client => end.or(timeout(FAREWELL, &mut to_robot)).await,
    };
    if end == End::Reset {
        breaker.iter().for_each(Breaker::arm);
    } else {
        // While its side is half-open nobody tells the robot that its client has gone.
        let _ = conditions.wait_for(|now| !now.swallow(Towards::Robot)).await;
    }
}

/// How one direction has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    /// One end has closed, or has gone.
    Closed,
    /// A fault wants the whole connection reset.
    Reset,
}

impl End {
    /// A reset waits for nothing; else the other direction may still end in its own way.
    async fn or<E>(self, other: impl Future<Output = Result<End, E>>) -> End {
        match self {
            End::Reset => self,
            End::Closed => other.await.unwrap_or(End::Closed),
        }
    }
}

/// What is on its way.
enum Parcel {
    Bytes { due: Instant, bytes: Bytes },
    Reset,
}

/// One direction of a connection.
struct Lane {
    towards: Towards,
    conditions: watch::Receiver<Conditions>,
    strikes: broadcast::Receiver<Fault>,
    rng: StdRng,
    splitter: Splitter,
    /// Strikes that wait for a message.
    aimed: Vec<Trouble>,
    /// Bytes were swallowed: nothing arrives any more.
    swallowed: bool,
    last_due: Instant,
}

impl Lane {
    fn new(
        towards: Towards,
        conditions: watch::Receiver<Conditions>,
        strikes: broadcast::Receiver<Fault>,
        seed: u64,
    ) -> Lane {
        Lane {
            towards,
            conditions,
            strikes,
            rng: StdRng::seed_from_u64(seed),
            splitter: Splitter::default(),
            aimed: Vec::new(),
            swallowed: false,
            last_due: Instant::now(),
        }
    }

    async fn run<R: AsyncRead, W: AsyncWrite>(
        mut self,
        mut from: ReadHalf<R>,
        to: WriteHalf<W>,
    ) -> End {
        let (queue, waiting) = mpsc::channel(MAX_WAITING);
        let outlet = Outlet {
            towards: self.towards,
            conditions: self.conditions.clone(),
            rng: StdRng::seed_from_u64(self.rng.random()),
        };
        let mut outlet = Box::pin(outlet.run(to, waiting));
        tokio::select! {
            end = &mut outlet => end,
            () = self.take_in(&mut from, queue) => outlet.await,
        }
    }

    /// Ends when nothing more will come; what is on its way still arrives.
    async fn take_in(&mut self, from: &mut (impl AsyncRead + Unpin), queue: mpsc::Sender<Parcel>) {
        let mut buffer = vec![0; READ_LEN];
        loop {
            let parcels = tokio::select! {
                biased;
                strike = self.strikes.recv() => match strike {
                    Ok(fault) => self.struck(&fault),
                    Err(broadcast::error::RecvError::Lagged(_)) => vec![],
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                read = from.read(&mut buffer) => match read {
                    Ok(length @ 1..) => self.passed(&buffer[..length]),
                    Ok(0) | Err(_) => {
                        let rest = self.splitter.rest();
                        let parcels = self.load(rest);
                        send(&queue, parcels).await;
                        return;
                    }
                },
            };
            if !send(&queue, parcels).await {
                return;
            }
        }
    }

    fn struck(&mut self, fault: &Fault) -> Vec<Parcel> {
        if !fault.towards.covers(self.towards) {
            return vec![];
        }
        match fault.trouble {
            Trouble::Garbage { bytes } => {
                let bytes = mangle::garbage(bytes, &mut self.rng);
                self.load([Stretch::Raw(bytes)])
            }
            Trouble::Reset if self.towards == Towards::Robot => vec![],
            Trouble::Reset | Trouble::LengthLie { .. } => {
                self.aimed.push(fault.trouble);
                vec![]
            }
            _ => vec![],
        }
    }

    fn passed(&mut self, bytes: &[u8]) -> Vec<Parcel> {
        let stretches = self.splitter.feed(bytes);
        self.load(stretches)
    }

    /// What came in one read goes on in one parcel, unless a reset cuts it.
    fn load(&mut self, stretches: impl IntoIterator<Item = Stretch>) -> Vec<Parcel> {
        let conditions = self.conditions.borrow_and_update().clone();
        self.swallowed |= conditions.swallow(self.towards);
        if self.swallowed {
            return vec![];
        }
        let due = self.due(&conditions);
        let mut bytes = BytesMut::new();
        for stretch in stretches {
            let packet = match stretch {
                Stretch::Raw(raw) => {
                    bytes.extend_from_slice(&raw);
                    continue;
                }
                Stretch::Message(packet) => packet,
            };
            let faults = conditions.towards(self.towards);
            let Some(packet) = mangle::spoil(packet, faults, &mut self.rng) else {
                continue;
            };
            let start = bytes.len();
            packet.emit(&mut bytes);
            if self.strike(&mut bytes, start) {
                let bytes = bytes.freeze();
                return vec![Parcel::Bytes { due, bytes }, Parcel::Reset];
            }
        }
        let bytes = bytes.freeze();
        if bytes.is_empty() { vec![] } else { vec![Parcel::Bytes { due, bytes }] }
    }

    /// Lets the strikes that wait hit the message at the end of `bytes`; true if that cuts it off.
    fn strike(&mut self, bytes: &mut BytesMut, start: usize) -> bool {
        for trouble in std::mem::take(&mut self.aimed) {
            match trouble {
                Trouble::LengthLie { claim } => mangle::lie(&mut bytes[start..], claim, &mut self.rng),
                _ => {
                    bytes.truncate(start + (bytes.len() - start) / 2);
                    return true;
                }
            }
        }
        false
    }

    /// When what comes now is to arrive: never before what came earlier.
    fn due(&mut self, conditions: &Conditions) -> Instant {
        let mut due = Instant::now();
        for fault in conditions.towards(self.towards) {
            if let Trouble::Delay { by, jitter } = fault.trouble {
                due += by + jitter.mul_f64(self.rng.random_range(0.0..=1.0));
            }
        }
        self.last_due = self.last_due.max(due);
        self.last_due
    }
}

/// False if nobody takes them any more.
async fn send(queue: &mpsc::Sender<Parcel>, parcels: Vec<Parcel>) -> bool {
    for parcel in parcels {
        if queue.send(parcel).await.is_err() {
            return false;
        }
    }
    true
}

/// The far end of a direction: writes what is due, as fast as the faults let it.
struct Outlet {
    towards: Towards,
    conditions: watch::Receiver<Conditions>,
    rng: StdRng,
}

impl Outlet {
    async fn run(
        mut self,
        mut to: impl AsyncWrite + Unpin,
        mut waiting: mpsc::Receiver<Parcel>,
    ) -> End {
        while let Some(parcel) = waiting.recv().await {
            let Parcel::Bytes { due, bytes } = parcel else {
                return End::Reset;
            };
            sleep_until(due).await;
            if self.write(&mut to, bytes).await.is_err() {
                return End::Closed;
            }
        }
        let swallowed = self.conditions.borrow().swallow(self.towards);
        if !swallowed {
            let _ = to.shutdown().await;
        }
        End::Closed
    }

    async fn write(
        &mut self,
        to: &mut (impl AsyncWrite + Unpin),
        mut bytes: Bytes,
    ) -> std::io::Result<()> {
        while !bytes.is_empty() {
            let (length, pause) = self.piece(bytes.len());
            to.write_all(&bytes.split_to(length)).await?;
            to.flush().await?;
            if !pause.is_zero() {
                sleep(pause).await;
            }
        }
        Ok(())
    }

    /// How much of what is left goes out now, and the pause after it.
    fn piece(&mut self, left: usize) -> (usize, Duration) {
        let (mut length, mut pause) = (left, Duration::ZERO);
        let conditions = self.conditions.borrow_and_update().clone();
        for fault in conditions.towards(self.towards) {
            match fault.trouble {
                Trouble::Split => {
                    let most = PIECE.max(left / PIECE_SHARE).min(length);
                    length = self.rng.random_range(1..=most);
                    pause = pause.max(PIECE_PAUSE);
                }
                Trouble::Drip { rate } => {
                    length = length.min((rate / SIPS).max(1) as usize);
                    pause = pause.max(Duration::from_secs_f64(length as f64 / f64::from(rate.max(1))));
                }
                _ => {}
            }
        }
        (length, pause)
    }
}
