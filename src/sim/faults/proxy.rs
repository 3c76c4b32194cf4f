//! The proxy between a client and the robot: forwards a connection's bytes in both directions and
//! applies the active faults to them. Independent of the robot; works over any byte stream, and its
//! random choices depend only on the seed.

use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::timeout;

use super::Direction;
use super::proxy_direction::{End, ProxyDirection};
use super::scheduler::FaultFeed;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::faults::scheduler::FaultScheduler;
    use crate::sim::faults::{Fault, FaultKind, Timing};
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
