//! The middleware between a client and the robot: carries a connection's bytes both ways and
//! spoils them as the faults of the moment say. Knows no robot; works over anything that reads and
//! writes bytes, and over its seed alone.

use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::timeout;

use super::fault::Towards;
use super::lane::Lane;
use super::outlet::End;
use super::troubles::FaultFeed;

/// When one end has closed, the other gets this long to do so too.
const FAREWELL: Duration = Duration::from_secs(1);

/// Makes the end of a connection a reset; its drop alone is an orderly end.
pub(crate) struct Breaker(pub(crate) socket2::Socket);

impl Breaker {
    fn arm(&self) {
        // Fails only if the connection has gone already.
        let _ = self.0.set_linger(Some(Duration::ZERO));
    }
}

/// Carries bytes between a client and the robot until both have closed, or until a fault ends it.
pub(crate) async fn carry(
    client: impl AsyncRead + AsyncWrite,
    breaker: Option<Breaker>,
    robot: impl AsyncRead + AsyncWrite,
    feed: FaultFeed,
) {
    let (client_reader, client_writer) = tokio::io::split(client);
    let (robot_reader, robot_writer) = tokio::io::split(robot);
    let FaultFeed {
        mut conditions,
        strikes,
        seed,
        unacknowledged,
    } = feed;
    let lane = |towards, strikes, seed| Lane::new(towards, conditions.clone(), strikes, seed);
    let mut to_robot = lane(Towards::Robot, strikes.resubscribe(), seed);
    to_robot.unacknowledged = unacknowledged;
    let to_client = lane(Towards::Client, strikes, seed.wrapping_add(1));
    let mut to_robot = Box::pin(to_robot.run(client_reader, robot_writer));
    let mut to_client = Box::pin(to_client.run(robot_reader, client_writer));
    let end = tokio::select! {
        biased;
        end = &mut to_robot => end.or(timeout(FAREWELL, &mut to_client)).await,
        end = &mut to_client => end.or(timeout(FAREWELL, &mut to_robot)).await,
    };
    if end == End::Reset {
        breaker.iter().for_each(Breaker::arm);
    } else {
        // While the robot's side is half-open, the robot does not notice that its client has gone.
        let _ = conditions
            .wait_for(|now| !now.swallow(Towards::Robot))
            .await;
    }
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

#[cfg(test)]
mod tests {
    use super::super::fault::{Fault, Trouble};
    use super::super::timing::Timing;
    use super::super::troubles::Troubles;
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream};
    use tokio::task::JoinHandle;
    use tokio::time::{Instant, sleep};

    const SECOND: Duration = Duration::from_secs(1);
    const POWER_80: &[u8] = &[0x50, 0x4B, 3, 0, 1, 0x50];

    /// A connection that is carried, and its ends.
    struct Line {
        troubles: Troubles,
        client: DuplexStream,
        robot: DuplexStream,
        carried: JoinHandle<()>,
    }

    fn line(seed: u64) -> Line {
        let mut troubles = Troubles::new(seed, Some(4 * SECOND));
        let (client, near) = tokio::io::duplex(64 * 1024);
        let (far, robot) = tokio::io::duplex(64 * 1024);
        let carried = tokio::spawn(carry(near, None, far, troubles.feed()));
        Line {
            troubles,
            client,
            robot,
            carried,
        }
    }

    impl Line {
        fn begin(&mut self, trouble: Trouble, towards: Towards, lasts: Option<Duration>) {
            let mut fault = Fault {
                towards,
                ..Fault::new(trouble)
            };
            fault.timing = Timing {
                lasts: lasts.or(fault.timing.lasts),
                ..fault.timing
            };
            self.troubles.begin(fault, Instant::now());
            self.troubles.poll(Instant::now());
        }
    }

    async fn rest(end: &mut DuplexStream) -> Vec<u8> {
        let mut bytes = Vec::new();
        end.read_to_end(&mut bytes).await.unwrap();
        bytes
    }

    #[tokio::test(start_paused = true)]
    async fn without_faults_bytes_and_the_end_pass_unchanged_even_if_they_are_no_messages() {
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
        line.carried.await.unwrap();
    }

    #[tokio::test(start_paused = true)]
    async fn delayed_bytes_arrive_later_and_in_order() {
        let mut line = line(1);
        let (by, jitter) = (SECOND, SECOND);
        line.begin(Trouble::Delay { by, jitter }, Towards::Client, None);
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
    async fn what_is_cut_or_trickles_arrives_whole() {
        for trouble in [Trouble::Split, Trouble::Drip { rate: 100 }] {
            let mut line = line(3);
            line.begin(trouble, Towards::Both, None);
            let (start, sent) = (Instant::now(), POWER_80.repeat(100));
            line.robot.write_all(&sent).await.unwrap();
            drop(line.robot);
            assert_eq!(rest(&mut line.client).await, sent);
            let seconds = start.elapsed().as_secs();
            assert_eq!(seconds, if trouble == Trouble::Split { 0 } else { 6 });
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_connection_that_lost_bytes_stays_dead_and_its_end_is_noticed_late() {
        let mut line = line(1);
        line.begin(Trouble::HalfOpen, Towards::Both, Some(5 * SECOND));
        line.client.write_all(POWER_80).await.unwrap();
        sleep(3 * SECOND).await;
        drop(line.client);
        let mut byte = [0];
        let read = timeout(SECOND, line.robot.read(&mut byte)).await;
        assert!(read.is_err(), "the robot noticed {read:?}");
        sleep(SECOND).await;
        line.troubles.poll(Instant::now());
        assert_eq!(rest(&mut line.robot).await, b"");
    }

    #[tokio::test(start_paused = true)]
    async fn a_client_whose_bytes_are_swallowed_loses_its_connection_in_the_end() {
        let mut line = line(1);
        line.begin(Trouble::HalfOpen, Towards::Robot, None);
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
        line.begin(Trouble::Reset, Towards::Both, None);
        line.robot.write_all(&POWER_80.repeat(2)).await.unwrap();
        assert_eq!(rest(&mut line.client).await, POWER_80[..3]);
        line.carried.await.unwrap();
        assert!(line.robot.write_all(POWER_80).await.is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn the_same_seed_spoils_the_same_bytes() {
        let spoilt = async |seed| {
            let mut line = line(seed);
            line.begin(Trouble::Garbage { bytes: 50 }, Towards::Client, None);
            line.begin(Trouble::LengthLie { claim: None }, Towards::Client, None);
            // The strikes hit what is there: let them in before the end.
            sleep(SECOND).await;
            line.robot.write_all(POWER_80).await.unwrap();
            drop(line.robot);
            rest(&mut line.client).await
        };
        let first = spoilt(4).await;
        assert_eq!(first.len(), 56);
        assert!(!first.ends_with(POWER_80), "the length is a lie");
        assert_eq!(first, spoilt(4).await);
        assert_ne!(first, spoilt(5).await);
    }
}
