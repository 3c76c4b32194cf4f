//! The timing of faults: once or periodic, momentary or lasting. Pure functions: the time is an
//! argument.

use std::time::Duration;

use tokio::time::Instant;

/// The timing of one fault, relative to the time at which it is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Timing {
    /// Time until the fault begins.
    pub after: Duration,
    /// Duration of each occurrence; zero means momentary, `None` unlimited.
    pub lasts: Option<Duration>,
    /// Period from one beginning to the next, longer than `lasts`; `None` if the fault occurs only
    /// once.
    pub every: Option<Duration>,
}

/// A state change of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Transition {
    /// The fault begins.
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

/// The timing state of one fault.
#[derive(Debug, Clone)]
pub(crate) struct TimingState {
    timing: Timing,
    phase: TimingPhase,
}

impl TimingState {
    /// Creates the state; times count from `now`.
    pub(crate) fn new(timing: Timing, now: Instant) -> TimingState {
        let until = now + timing.after;
        TimingState {
            timing,
            phase: TimingPhase::Waiting { until },
        }
    }

    /// Returns the next change due by `now`. Call it until it returns `None`.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Transition> {
        match self.phase {
            TimingPhase::Waiting { until } if until <= now => {
                self.phase = TimingPhase::On { since: until };
                Some(Transition::Begins)
            }
            TimingPhase::On { since } if since + self.timing.lasts? <= now => {
                self.phase = self.after(since, now);
                Some(Transition::Ends)
            }
            _ => None,
        }
    }

    /// Whether the fault will not occur again.
    pub(crate) fn is_over(&self) -> bool {
        self.phase == TimingPhase::Over
    }

    /// Returns the phase after an occurrence. Skips missed beginnings, so that they do not all
    /// happen at once after a suspend.
    fn after(&self, since: Instant, now: Instant) -> TimingPhase {
        let Some(every) = self.timing.every.filter(|every| !every.is_zero()) else {
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

    const SECOND: Duration = Duration::from_secs(1);

    /// Returns the changes at each whole second, starting at 0.
    fn transitions(after: u64, lasts: Option<u64>, every: Option<u64>) -> Vec<(u64, Transition)> {
        let seconds = |count: Option<u64>| count.map(Duration::from_secs);
        let timing = Timing {
            after: Duration::from_secs(after),
            lasts: seconds(lasts),
            every: seconds(every),
        };
        let start = Instant::now();
        let mut state = TimingState::new(timing, start);
        let mut transitions = Vec::new();
        for second in 0..10 {
            while let Some(transition) = state.poll(start + SECOND * second) {
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
        let mut state = TimingState::new(timing, start);
        let late = start + SECOND * 3600;
        assert_eq!(state.poll(late), Some(Transition::Begins));
        assert_eq!(state.poll(late), Some(Transition::Ends));
        assert_eq!(state.poll(late), None);
        assert_eq!(state.poll(late + SECOND), Some(Transition::Begins));
    }
}
