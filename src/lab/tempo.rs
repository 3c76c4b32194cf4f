//! The clock of a laboratory that people watch: paused, stepped, or so many times as fast as the one
//! on the wall. There is one clock for all of it, so agent, scripts, watchdog and simulator keep their
//! times among each other, whatever the factor; only people and what they hold have another.
//!
//! Without it the clock jumps whenever everything waits. With it a task of the laboratory is never
//! quite waiting while the clock is ahead: it sleeps its thread for a moment, in real time, and lets
//! everybody else have a turn, so that a person's STOP is heard also while the clock stands.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::task::yield_now;
use tokio::time::{Instant, sleep};
use tokio_util::sync::CancellationToken;

/// The longest that the thread sleeps at a time; whatever comes from outside waits so long.
const NAP: Duration = Duration::from_millis(4);
/// What one step is.
const STEP: Duration = Duration::from_millis(100);
/// How often the clock is held against the one on the wall, in real time if that is possible.
const BEAT: Duration = Duration::from_millis(4);
/// A clock that is later than this cannot keep up; it does not hurry afterwards.
const LATE: Duration = Duration::from_millis(50);

/// So many simulated seconds a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor(f64);

impl Factor {
    /// As on the wall.
    pub const REAL: Factor = Factor(1.0);
    /// The fastest.
    pub const MOST: f64 = 100.0;

    /// 1..=100; nothing else is one.
    pub fn new(factor: f64) -> Option<Factor> {
        (1.0..=Factor::MOST)
            .contains(&factor)
            .then_some(Factor(factor))
    }

    /// As a number.
    pub fn get(self) -> f64 {
        self.0
    }
}

/// What the clock does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Going {
    /// It stands, but for steps.
    pub paused: bool,
    /// How fast it goes unless it stands.
    pub factor: Factor,
}

/// A hold on the clock, for any thread: see the module. Clones hold the same one.
#[derive(Debug, Clone)]
pub struct Tempo(Arc<Mutex<Course>>);

/// Both clocks count from the beginning of the laboratory.
#[derive(Debug)]
struct Course {
    going: Going,
    /// Simulated and real time when they began to go beside each other; none yet: with the next beat.
    mark: Option<(Duration, Duration)>,
    /// Up to this simulated time goes a clock that is paused.
    allowed: Duration,
    /// The newest simulated time.
    now: Duration,
}

impl Course {
    /// How long the clock has to wait now; `None`: it may go on.
    fn wait(&mut self, simulated: Duration, real: Duration) -> Option<Duration> {
        self.now = simulated;
        if self.going.paused {
            self.mark = None;
            return (simulated >= self.allowed).then_some(NAP);
        }
        let (from, since) = *self.mark.get_or_insert((simulated, real));
        let passed = simulated.saturating_sub(from);
        let due = since + passed.div_f64(self.going.factor.get());
        if real.saturating_sub(due) > LATE {
            self.mark = Some((simulated, real));
        }
        due.checked_sub(real).filter(|wait| !wait.is_zero())
    }

    /// How long it goes before it is held against the other again.
    fn beat(&self) -> Duration {
        if self.going.paused {
            STEP / 10
        } else {
            BEAT.mul_f64(self.going.factor.get())
        }
    }

    fn change(&mut self, going: Going) {
        self.going = going;
        self.mark = None;
        self.allowed = self.now;
    }
}

impl Default for Tempo {
    /// As the clock on the wall.
    fn default() -> Tempo {
        let going = Going {
            paused: false,
            factor: Factor::REAL,
        };
        Tempo(Arc::new(Mutex::new(Course {
            going,
            mark: None,
            allowed: Duration::ZERO,
            now: Duration::ZERO,
        })))
    }
}

impl Tempo {
    /// For as long as it takes to look something up.
    fn course(&self) -> MutexGuard<'_, Course> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What the clock does.
    pub fn going(&self) -> Going {
        self.course().going
    }

    /// From now on it stands, or goes on.
    pub fn pause(&self, paused: bool) {
        let mut course = self.course();
        let going = Going {
            paused,
            ..course.going
        };
        course.change(going);
    }

    /// From now on it goes so fast, unless it stands.
    pub fn hurry(&self, factor: Factor) {
        let mut course = self.course();
        let going = Going {
            factor,
            ..course.going
        };
        course.change(going);
    }

    /// It goes on for 0.1 s, and stands then.
    pub fn step(&self) {
        let mut course = self.course();
        let going = Going {
            paused: true,
            ..course.going
        };
        course.change(going);
        course.allowed = course.now + STEP;
    }

    /// Simulated time since the beginning, as of the last beat.
    pub fn now(&self) -> Duration {
        self.course().now
    }

    /// Holds the laboratory's clock until `stop` is cancelled: then there is no viewer any more, and the rest
    /// takes no time.
    pub(super) async fn keep(self, began: Instant, stop: CancellationToken) {
        let wall = std::time::Instant::now();
        while !stop.is_cancelled() {
            let (wait, beat) = {
                let mut course = self.course();
                (course.wait(began.elapsed(), wall.elapsed()), course.beat())
            };
            match wait {
                None => sleep(beat).await,
                Some(wait) => {
                    // On purpose: as long as this task is ready, the clock does not jump.
                    std::thread::sleep(wait.min(NAP));
                    yield_now().await;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ms(number: u64) -> Duration {
        Duration::from_millis(number)
    }

    fn course(tempo: &Tempo) -> MutexGuard<'_, Course> {
        tempo.course()
    }

    #[test]
    fn ten_times_as_fast_waits_a_tenth_and_who_is_late_does_not_hurry_afterwards() {
        let tempo = Tempo::default();
        tempo.hurry(Factor::new(10.0).unwrap());
        assert_eq!(course(&tempo).wait(ms(0), ms(1000)), None);
        assert_eq!(course(&tempo).wait(ms(100), ms(1000)), Some(ms(10)));
        assert_eq!(course(&tempo).wait(ms(100), ms(1010)), None);
        // A second late.
        assert_eq!(course(&tempo).wait(ms(200), ms(2020)), None);
        assert_eq!(course(&tempo).wait(ms(300), ms(2020)), Some(ms(10)));
    }

    #[test]
    fn a_paused_clock_stands_and_a_step_is_a_tenth_of_a_second() {
        let tempo = Tempo::default();
        tempo.pause(true);
        assert!(course(&tempo).wait(ms(0), ms(0)).is_some());
        assert!(course(&tempo).wait(ms(0), ms(60_000)).is_some());
        tempo.step();
        assert_eq!(course(&tempo).wait(ms(90), ms(60_000)), None);
        assert!(course(&tempo).wait(ms(100), ms(60_000)).is_some());
        tempo.pause(false);
        assert_eq!(course(&tempo).wait(ms(100), ms(90_000)), None);
        assert_eq!(course(&tempo).wait(ms(110), ms(90_000)), Some(ms(10)));
    }

    #[test]
    fn no_other_number_is_a_factor() {
        for wrong in [0.0, -1.0, 0.99, 100.1, f64::NAN, f64::INFINITY] {
            assert_eq!(Factor::new(wrong), None, "{wrong}");
        }
    }
}
