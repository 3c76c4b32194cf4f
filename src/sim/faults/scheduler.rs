//! Tracks all faults over time: which are active, which begin now, and which changes the robot must
//! apply. Uses no clock; informs the connections through channels that never block.

use std::sync::Arc;
use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::sync::{broadcast, watch};
use tokio::time::Instant;

use super::{Direction, Fault, FaultKind};

/// Maximum number of unread beginnings of faults per connection; it misses older ones.
const MAX_UNREAD: usize = 64;

#[derive(Debug, Clone, Default)]
pub(crate) struct ActiveFaults(Arc<[Fault]>);

impl ActiveFaults {
    pub(crate) fn new(faults: impl IntoIterator<Item = Fault>) -> ActiveFaults {
        ActiveFaults(faults.into_iter().collect())
    }

    /// Returns the faults that affect bytes sent towards `end`.
    pub(crate) fn towards(&self, end: Direction) -> impl Iterator<Item = &Fault> {
        self.0.iter().filter(move |fault| fault.towards.covers(end))
    }

    /// Whether bytes sent towards `end` are dropped.
    pub(crate) fn drops_bytes(&self, end: Direction) -> bool {
        self.towards(end)
            .any(|fault| fault.kind == FaultKind::HalfOpen)
    }
}

#[derive(Debug)]
pub(crate) struct FaultFeed {
    pub(crate) active_faults: watch::Receiver<ActiveFaults>,
    /// Each fault when it begins; how momentary ones take effect.
    pub(crate) beginnings: broadcast::Receiver<Fault>,
    pub(crate) seed: u64,
    /// See [`Options::unacknowledged`](crate::Options::unacknowledged).
    pub(crate) unacknowledged: Option<Duration>,
}

struct ScheduledFault {
    fault: Fault,
    phase: TimingPhase,
    /// The fault is due and its random draw succeeded.
    on: bool,
}

pub(crate) struct FaultScheduler {
    scheduled: Vec<ScheduledFault>,
    /// What the radio does where the robot is, as a fault of the network.
    radio: Option<FaultKind>,
    active_faults: watch::Sender<ActiveFaults>,
    beginnings: broadcast::Sender<Fault>,
    rng: StdRng,
    unacknowledged: Option<Duration>,
}

impl FaultScheduler {
    /// Creates a state without faults; `seed` determines everything random.
    pub(crate) fn new(seed: u64, unacknowledged: Option<Duration>) -> FaultScheduler {
        FaultScheduler {
            unacknowledged,
            scheduled: Vec::new(),
            radio: None,
            active_faults: watch::Sender::default(),
            beginnings: broadcast::Sender::new(MAX_UNREAD),
            rng: StdRng::seed_from_u64(seed),
        }
    }

    pub(crate) fn begin(&mut self, fault: Fault, now: Instant) {
        self.scheduled.push(ScheduledFault::new(fault, now));
    }

    /// Ends all faults; returns those that were active, so that the robot can be updated.
    pub(crate) fn clear(&mut self) -> Vec<(FaultKind, Transition)> {
        let all = std::mem::take(&mut self.scheduled);
        self.publish();
        let on = all.into_iter().filter(|scheduled| scheduled.on);
        on.map(|scheduled| (scheduled.fault.kind, Transition::Ends))
            .collect()
    }

    /// Sets what the radio does where the robot is now.
    pub(crate) fn set_radio(&mut self, radio: Option<FaultKind>) {
        if self.radio != radio {
            self.radio = radio;
            self.publish();
        }
    }

    fn publish(&mut self) {
        let on = self.scheduled.iter().filter(|scheduled| scheduled.on);
        let faults = on.map(|scheduled| scheduled.fault);
        let active_faults = ActiveFaults::new(faults.chain(self.radio.map(Fault::new)));
        self.active_faults.send_replace(active_faults);
    }

    pub(crate) fn feed(&mut self) -> FaultFeed {
        FaultFeed {
            active_faults: self.active_faults.subscribe(),
            beginnings: self.beginnings.subscribe(),
            seed: self.rng.random(),
            unacknowledged: self.unacknowledged,
        }
    }

    /// Advances to `now` and returns what has begun and ended, in order. Connections have already
    /// been informed.
    pub(crate) fn poll(&mut self, now: Instant) -> Vec<(FaultKind, Transition)> {
        let mut transitions = Vec::new();
        for scheduled in &mut self.scheduled {
            while let Some(transition) = scheduled.advance(now) {
                let was_on = scheduled.on;
                scheduled.on = transition == Transition::Begins
                    && draw_occurrence(&mut self.rng, &scheduled.fault);
                if scheduled.on {
                    // Fails only if there is no connection, which is fine.
                    let _ = self.beginnings.send(scheduled.fault);
                }
                if scheduled.on != was_on {
                    transitions.push((scheduled.fault.kind, transition));
                }
            }
        }
        if !transitions.is_empty() {
            self.publish();
            self.scheduled
                .retain(|scheduled| scheduled.phase != TimingPhase::Over);
        }
        transitions
    }
}

fn draw_occurrence(rng: &mut StdRng, fault: &Fault) -> bool {
    fault.kind.alters_messages() || rng.random_bool(fault.chance.clamp(0.0, 1.0))
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transition {
    Begins,
    /// The fault ends, possibly only until its next occurrence.
    Ends,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimingPhase {
    Waiting { until: Instant },
    On { since: Instant },
    Over,
}

impl ScheduledFault {
    fn new(fault: Fault, now: Instant) -> ScheduledFault {
        let until = now + fault.timing.after;
        ScheduledFault {
            fault,
            phase: TimingPhase::Waiting { until },
            on: false,
        }
    }

    /// Returns the next change due by `now`. Call it until it returns `None`.
    fn advance(&mut self, now: Instant) -> Option<Transition> {
        match self.phase {
            TimingPhase::Waiting { until } if until <= now => {
                self.phase = TimingPhase::On { since: until };
                Some(Transition::Begins)
            }
            TimingPhase::On { since } if since + self.fault.timing.lasts? <= now => {
                self.phase = self.after(since, now);
                Some(Transition::Ends)
            }
            _ => None,
        }
    }

    /// Returns the phase after an occurrence. Skips missed beginnings, so that they do not all
    /// happen at once after a suspend.
    fn after(&self, since: Instant, now: Instant) -> TimingPhase {
        let Some(every) = self.fault.timing.every.filter(|every| !every.is_zero()) else {
            return TimingPhase::Over;
        };
        let missed = now.duration_since(since).as_nanos() / every.as_nanos();
        let periods = u32::try_from(missed).unwrap_or(u32::MAX - 1) + 1;
        TimingPhase::Waiting {
            until: since + every * periods,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::Timing;

    const SECOND: Duration = Duration::from_secs(1);

    fn fault(kind: FaultKind, lasts: u64, every: u64, chance: f64) -> Fault {
        let timing = Timing {
            after: SECOND,
            lasts: Some(SECOND * lasts as u32),
            every: Some(SECOND * every as u32),
        };
        Fault {
            timing,
            chance,
            ..Fault::new(kind)
        }
    }

    #[test]
    fn lasting_faults_become_active_and_every_beginning_is_broadcast() {
        let mut scheduler = FaultScheduler::new(1, None);
        let now = Instant::now();
        let mut feed = scheduler.feed();
        scheduler.begin(fault(FaultKind::HalfOpen, 2, 9, 1.0), now);
        scheduler.begin(fault(FaultKind::Reset, 0, 9, 1.0), now);
        assert_eq!(scheduler.poll(now), []);
        let transitions = scheduler.poll(now + SECOND);
        let expected = [
            (FaultKind::HalfOpen, Transition::Begins),
            (FaultKind::Reset, Transition::Begins),
            (FaultKind::Reset, Transition::Ends),
        ];
        assert_eq!(transitions, expected);
        assert!(feed.active_faults.borrow().drops_bytes(Direction::Robot));
        assert_eq!(
            feed.beginnings.try_recv().unwrap().kind,
            FaultKind::HalfOpen
        );
        assert_eq!(feed.beginnings.try_recv().unwrap().kind, FaultKind::Reset);
        assert_eq!(
            scheduler.poll(now + 3 * SECOND),
            [(FaultKind::HalfOpen, Transition::Ends)]
        );
        assert!(!feed.active_faults.borrow().drops_bytes(Direction::Robot));
    }

    #[test]
    fn the_same_seed_draws_the_same_occurrences() {
        let times = |seed| {
            let mut scheduler = FaultScheduler::new(seed, None);
            let now = Instant::now();
            scheduler.begin(fault(FaultKind::Drop, 0, 1, 0.5), now);
            let happens = |second: u32| !scheduler.poll(now + SECOND * second).is_empty();
            (0..64).map(happens).collect::<Vec<bool>>()
        };
        assert_eq!(times(3), times(3));
        assert_ne!(times(3), times(4));
        let count = times(3).iter().filter(|happened| **happened).count();
        assert!((10..54).contains(&count), "{count}");
    }

    #[test]
    fn cleared_faults_end_immediately_and_permanently() {
        let mut scheduler = FaultScheduler::new(1, None);
        let now = Instant::now();
        scheduler.begin(fault(FaultKind::NoCharge, 5, 9, 1.0), now);
        scheduler.poll(now + SECOND);
        assert_eq!(scheduler.clear(), [(FaultKind::NoCharge, Transition::Ends)]);
        assert_eq!(scheduler.poll(now + 60 * SECOND), []);
    }

    fn timed(timing: Timing, start: Instant) -> ScheduledFault {
        let fault = Fault {
            timing,
            ..Fault::new(FaultKind::Drop)
        };
        ScheduledFault::new(fault, start)
    }

    /// Returns the changes at each whole second, starting at 0.
    fn transitions(after: u64, lasts: Option<u64>, every: Option<u64>) -> Vec<(u64, Transition)> {
        let seconds = |count: Option<u64>| count.map(Duration::from_secs);
        let timing = Timing {
            after: Duration::from_secs(after),
            lasts: seconds(lasts),
            every: seconds(every),
        };
        let start = Instant::now();
        let mut state = timed(timing, start);
        let mut transitions = Vec::new();
        for second in 0..10 {
            while let Some(transition) = state.advance(start + SECOND * second) {
                transitions.push((u64::from(second), transition));
            }
        }
        transitions
    }

    #[test]
    fn a_fault_begins_ends_and_repeats() {
        use Transition::{Begins, Ends};
        assert_eq!(transitions(2, None, None), [(2, Begins)]);
        assert_eq!(transitions(2, Some(0), None), [(2, Begins), (2, Ends)]);
        let twice = [(1, Begins), (3, Ends), (5, Begins), (7, Ends), (9, Begins)];
        assert_eq!(transitions(1, Some(2), Some(4)), twice);
    }

    #[test]
    fn missed_beginnings_are_skipped() {
        let timing = Timing {
            after: SECOND,
            lasts: Some(Duration::ZERO),
            every: Some(SECOND),
        };
        let start = Instant::now();
        let mut state = timed(timing, start);
        let late = start + SECOND * 3600;
        assert_eq!(state.advance(late), Some(Transition::Begins));
        assert_eq!(state.advance(late), Some(Transition::Ends));
        assert_eq!(state.advance(late), None);
        assert_eq!(state.advance(late + SECOND), Some(Transition::Begins));
    }
}
