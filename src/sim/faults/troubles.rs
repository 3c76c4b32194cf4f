//! Tracks all faults over time: which are active, which momentary ones occur now, and which changes
//! the robot must apply. Uses no clock; informs the connections through channels that never block.

use std::time::Duration;

use std::sync::Arc;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::sync::{broadcast, watch};
use tokio::time::Instant;

use super::fault::{Fault, Towards, Trouble};
use super::timing::{Beat, Turn};

/// Maximum number of unread momentary faults per connection; it misses older ones.
const MAX_STRIKES: usize = 64;

/// The active faults.
#[derive(Debug, Clone, Default)]
pub(crate) struct Conditions(Arc<[Fault]>);

impl Conditions {
    /// Creates conditions from faults.
    pub(crate) fn of(faults: impl IntoIterator<Item = Fault>) -> Conditions {
        Conditions(faults.into_iter().collect())
    }

    /// Returns the faults that affect bytes sent towards `end`.
    pub(crate) fn towards(&self, end: Towards) -> impl Iterator<Item = &Fault> {
        self.0.iter().filter(move |fault| fault.towards.covers(end))
    }

    /// Whether bytes sent towards `end` are dropped.
    pub(crate) fn swallow(&self, end: Towards) -> bool {
        self.towards(end)
            .any(|fault| fault.trouble == Trouble::HalfOpen)
    }
}

/// The channels through which a connection receives faults.
#[derive(Debug)]
pub(crate) struct FaultFeed {
    pub(crate) conditions: watch::Receiver<Conditions>,
    pub(crate) strikes: broadcast::Receiver<Fault>,
    /// Seed of the connection's random numbers.
    pub(crate) seed: u64,
    /// See [`Options::unacknowledged`](crate::sim::Options::unacknowledged).
    pub(crate) unacknowledged: Option<Duration>,
}

struct Running {
    fault: Fault,
    beat: Beat,
    /// The fault is due and its random draw succeeded.
    on: bool,
}

/// The state of all faults.
pub(crate) struct Troubles {
    running: Vec<Running>,
    conditions: watch::Sender<Conditions>,
    strikes: broadcast::Sender<Fault>,
    rng: StdRng,
    unacknowledged: Option<Duration>,
}

impl Troubles {
    /// Creates a state without faults; `seed` determines everything random.
    pub(crate) fn new(seed: u64, unacknowledged: Option<Duration>) -> Troubles {
        Troubles {
            unacknowledged,
            running: Vec::new(),
            conditions: watch::Sender::default(),
            strikes: broadcast::Sender::new(MAX_STRIKES),
            rng: StdRng::seed_from_u64(seed),
        }
    }

    /// Adds a fault whose times count from `now`.
    pub(crate) fn begin(&mut self, fault: Fault, now: Instant) {
        let (beat, on) = (Beat::new(fault.timing, now), false);
        self.running.push(Running { fault, beat, on });
    }

    /// Ends all faults; returns those that were active, so that the robot can be updated.
    pub(crate) fn clear(&mut self) -> Vec<(Trouble, Turn)> {
        let all = std::mem::take(&mut self.running);
        self.conditions.send_replace(Conditions::default());
        let on = all.into_iter().filter(|running| running.on);
        on.map(|running| (running.fault.trouble, Turn::Ends))
            .collect()
    }

    /// Returns the feed for a new connection.
    pub(crate) fn feed(&mut self) -> FaultFeed {
        FaultFeed {
            conditions: self.conditions.subscribe(),
            strikes: self.strikes.subscribe(),
            seed: self.rng.random(),
            unacknowledged: self.unacknowledged,
        }
    }

    /// Advances to `now` and returns what has begun and ended, in order. Connections have already
    /// been informed.
    pub(crate) fn poll(&mut self, now: Instant) -> Vec<(Trouble, Turn)> {
        let mut turns = Vec::new();
        for running in &mut self.running {
            while let Some(turn) = running.beat.poll(now) {
                let was_on = running.on;
                running.on = turn == Turn::Begins && lucky(&mut self.rng, &running.fault);
                if running.on {
                    // Fails only if there is no connection, which is fine.
                    let _ = self.strikes.send(running.fault);
                }
                if running.on != was_on {
                    turns.push((running.fault.trouble, turn));
                }
            }
        }
        if !turns.is_empty() {
            let on = self.running.iter().filter(|running| running.on);
            let conditions = Conditions::of(on.map(|running| running.fault));
            self.conditions.send_replace(conditions);
            self.running.retain(|running| !running.beat.is_over());
        }
        turns
    }
}

fn lucky(rng: &mut StdRng, fault: &Fault) -> bool {
    fault.trouble.spoils_messages() || rng.random_bool(fault.chance.clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::super::timing::Timing;
    use super::*;
    use std::time::Duration;

    const SECOND: Duration = Duration::from_secs(1);

    fn fault(trouble: Trouble, lasts: u64, every: u64, chance: f64) -> Fault {
        let timing = Timing {
            after: SECOND,
            lasts: Some(SECOND * lasts as u32),
            every: Some(SECOND * every as u32),
        };
        Fault {
            timing,
            chance,
            ..Fault::new(trouble)
        }
    }

    #[test]
    fn lasting_faults_become_conditions_and_momentary_ones_are_broadcast() {
        let (mut troubles, now) = (Troubles::new(1, None), Instant::now());
        let mut feed = troubles.feed();
        troubles.begin(fault(Trouble::HalfOpen, 2, 9, 1.0), now);
        troubles.begin(fault(Trouble::Reset, 0, 9, 1.0), now);
        assert_eq!(troubles.poll(now), []);
        let turns = troubles.poll(now + SECOND);
        let expected = [
            (Trouble::HalfOpen, Turn::Begins),
            (Trouble::Reset, Turn::Begins),
            (Trouble::Reset, Turn::Ends),
        ];
        assert_eq!(turns, expected);
        assert!(feed.conditions.borrow().swallow(Towards::Robot));
        assert_eq!(feed.strikes.try_recv().unwrap().trouble, Trouble::HalfOpen);
        assert_eq!(feed.strikes.try_recv().unwrap().trouble, Trouble::Reset);
        assert_eq!(
            troubles.poll(now + 3 * SECOND),
            [(Trouble::HalfOpen, Turn::Ends)]
        );
        assert!(!feed.conditions.borrow().swallow(Towards::Robot));
    }

    #[test]
    fn the_same_seed_draws_the_same_occurrences() {
        let times = |seed| {
            let (mut troubles, now) = (Troubles::new(seed, None), Instant::now());
            troubles.begin(fault(Trouble::Drop, 0, 1, 0.5), now);
            let happens = |second: u32| !troubles.poll(now + SECOND * second).is_empty();
            (0..64).map(happens).collect::<Vec<bool>>()
        };
        assert_eq!(times(3), times(3));
        assert_ne!(times(3), times(4));
        let count = times(3).iter().filter(|happened| **happened).count();
        assert!((10..54).contains(&count), "{count}");
    }

    #[test]
    fn cleared_faults_end_immediately_and_permanently() {
        let (mut troubles, now) = (Troubles::new(1, None), Instant::now());
        troubles.begin(fault(Trouble::NoCharge, 5, 9, 1.0), now);
        troubles.poll(now + SECOND);
        assert_eq!(troubles.clear(), [(Trouble::NoCharge, Turn::Ends)]);
        assert_eq!(troubles.poll(now + 60 * SECOND), []);
    }
}
