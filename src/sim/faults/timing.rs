//! When a fault has its time: once or again and again, for a moment or for a while. Pure: the time
//! is an argument.

use std::time::Duration;

use tokio::time::Instant;

/// The times of one fault, counted from the moment at which it is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Timing {
    /// Until it begins.
    pub after: Duration,
    /// From each beginning to its end; zero: a moment, `None`: for ever.
    pub lasts: Option<Duration>,
    /// From one beginning to the next; `None`: it comes once. Longer than `lasts`.
    pub every: Option<Duration>,
}

/// What has just happened to a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Turn {
    /// Its time has come.
    Begins,
    /// Its time is over, perhaps only until it comes again.
    Ends,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum TimingPhase {
    Waiting { until: Instant },
    On { since: Instant },
    Over,
}

/// One fault's way through its times.
#[derive(Debug, Clone)]
pub(crate) struct Beat {
    timing: Timing,
    phase: TimingPhase,
}

impl Beat {
    /// The times count from `now`.
    pub(crate) fn new(timing: Timing, now: Instant) -> Beat {
        let until = now + timing.after;
        Beat {
            timing,
            phase: TimingPhase::Waiting { until },
        }
    }

    /// The next turn that has come by `now`; to be asked until there is none.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Turn> {
        match self.phase {
            TimingPhase::Waiting { until } if until <= now => {
                self.phase = TimingPhase::On { since: until };
                Some(Turn::Begins)
            }
            TimingPhase::On { since } if since + self.timing.lasts? <= now => {
                self.phase = self.after(since, now);
                Some(Turn::Ends)
            }
            _ => None,
        }
    }

    /// It will not come any more.
    pub(crate) fn is_over(&self) -> bool {
        self.phase == TimingPhase::Over
    }

    /// Skips missed beginnings: after a suspend they do not all happen at once.
    fn after(&self, since: Instant, now: Instant) -> TimingPhase {
        let Some(every) = self.timing.every.filter(|every| !every.is_zero()) else {
            return TimingPhase::Over;
        };
        let missed = now.duration_since(since).as_nanos() / every.as_nanos();
        let beats = u32::try_from(missed).unwrap_or(u32::MAX - 1) + 1;
        TimingPhase::Waiting {
            until: since + every * beats,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    /// The turns at each whole second from 0 on.
    fn turns(after: u64, lasts: Option<u64>, every: Option<u64>) -> Vec<(u64, Turn)> {
        let seconds = |count: Option<u64>| count.map(Duration::from_secs);
        let timing = Timing {
            after: Duration::from_secs(after),
            lasts: seconds(lasts),
            every: seconds(every),
        };
        let start = Instant::now();
        let mut beat = Beat::new(timing, start);
        let mut turns = Vec::new();
        for second in 0..10 {
            while let Some(turn) = beat.poll(start + SECOND * second) {
                turns.push((u64::from(second), turn));
            }
        }
        turns
    }

    #[test]
    fn a_fault_begins_lasts_and_comes_again() {
        use Turn::{Begins, Ends};
        assert_eq!(turns(2, None, None), [(2, Begins)]);
        assert_eq!(turns(2, Some(0), None), [(2, Begins), (2, Ends)]);
        let twice = [(1, Begins), (3, Ends), (5, Begins), (7, Ends), (9, Begins)];
        assert_eq!(turns(1, Some(2), Some(4)), twice);
    }

    #[test]
    fn beginnings_that_were_missed_are_skipped() {
        let timing = Timing {
            after: SECOND,
            lasts: Some(Duration::ZERO),
            every: Some(SECOND),
        };
        let start = Instant::now();
        let mut beat = Beat::new(timing, start);
        let late = start + SECOND * 3600;
        assert_eq!(beat.poll(late), Some(Turn::Begins));
        assert_eq!(beat.poll(late), Some(Turn::Ends));
        assert_eq!(beat.poll(late), None);
        assert_eq!(beat.poll(late + SECOND), Some(Turn::Begins));
    }
}
