//! Controls the virtual clock of a simulation that people watch: paused, stepped, or a multiple of
//! real time. While the clock is ahead of real time, one task of the simulation stays ready: it
//! blocks the thread for a moment and then yields to all others, so that a user's STOP is processed
//! even while the clock is paused.

use std::sync::Arc;
use std::time::Duration;

use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::Serialize;
use tokio::task::yield_now;
use tokio::time::{Instant, sleep};
use tokio_util::sync::CancellationToken;

/// Maximum time for which the thread sleeps at once, which is also the maximum delay of external
/// requests.
const MAX_BLOCK: Duration = Duration::from_millis(4);
const STEP: Duration = Duration::from_millis(100);
/// Interval, in real time if possible, at which the virtual clock is compared with the real one.
const CHECK_INTERVAL: Duration = Duration::from_millis(4);
/// A virtual clock that is late by more than this cannot keep up; it does not catch up afterwards.
const MAX_LAG: Duration = Duration::from_millis(50);

/// Speed of the simulation: simulated seconds per second.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
#[schemars(inline)]
pub struct TimeScale(f64);

impl TimeScale {
    pub const REAL: TimeScale = TimeScale(1.0);
    /// The minimum factor: slow motion.
    pub const MIN: f64 = 0.1;
    /// The maximum factor.
    pub const MAX: f64 = 100.0;

    /// Creates a factor; `None` if it is not in 0.1..=100.
    pub fn new(factor: f64) -> Option<TimeScale> {
        if !(TimeScale::MIN..=TimeScale::MAX).contains(&factor) {
            return None;
        }
        Some(TimeScale(factor))
    }

    /// Returns the factor as a number.
    pub fn get(self) -> f64 {
        self.0
    }
}

/// The state of a simulation's own clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "Clock")]
pub struct ClockMode {
    /// Whether it is paused, except for single steps.
    pub paused: bool,
    /// Simulated seconds per second unless paused, 0.1..=100.
    pub factor: TimeScale,
}

/// Controls the clock from any thread. Clones control the same clock.
#[derive(Debug, Clone)]
pub struct SimClock(Arc<Mutex<ClockState>>);

/// The clock's state; all times count from the start of the simulation.
#[derive(Debug)]
struct ClockState {
    mode: ClockMode,
    /// Whether it stands, whatever the mode says.
    held: bool,
    /// Simulated and real time at which the two clocks were last aligned; `None`: at the next
    /// comparison.
    aligned: Option<(Duration, Duration)>,
    /// A paused clock runs up to this simulated time.
    allowed: Duration,
    /// The last known simulated time.
    now: Duration,
}

impl ClockState {
    /// Returns how long the clock must wait now; `None` if it may continue.
    fn wait(&mut self, simulated: Duration, real: Duration) -> Option<Duration> {
        self.now = simulated;
        if self.held || self.mode.paused {
            self.aligned = None;
            let stands = self.held || simulated >= self.allowed;
            return stands.then_some(MAX_BLOCK);
        }
        let (from, since) = *self.aligned.get_or_insert((simulated, real));
        let passed = simulated.saturating_sub(from);
        let due = since + passed.div_f64(self.mode.factor.get());
        if real.saturating_sub(due) > MAX_LAG {
            self.aligned = Some((simulated, real));
        }
        due.checked_sub(real).filter(|wait| !wait.is_zero())
    }

    fn check_interval(&self) -> Duration {
        if self.mode.paused {
            STEP / 10
        } else {
            CHECK_INTERVAL.mul_f64(self.mode.factor.get())
        }
    }

    fn realign(&mut self) {
        self.aligned = None;
        self.allowed = self.now;
    }
}

impl Default for SimClock {
    fn default() -> SimClock {
        let mode = ClockMode {
            paused: false,
            factor: TimeScale::REAL,
        };
        SimClock(Arc::new(Mutex::new(ClockState {
            mode,
            held: false,
            aligned: None,
            allowed: Duration::ZERO,
            now: Duration::ZERO,
        })))
    }
}

impl SimClock {
    pub fn mode(&self) -> ClockMode {
        self.0.lock().mode
    }

    /// Pauses or resumes the clock.
    pub fn pause(&self, paused: bool) {
        let mut state = self.0.lock();
        state.mode.paused = paused;
        state.realign();
    }

    /// Holds the clock, or lets it go on in its mode: for those who may do more than the ones who
    /// pause and resume it.
    pub fn hold(&self, held: bool) {
        let mut state = self.0.lock();
        state.held = held;
        state.realign();
    }

    /// Sets the speed; a paused clock stays paused.
    pub fn set_time_scale(&self, factor: TimeScale) {
        let mut state = self.0.lock();
        state.mode.factor = factor;
        state.realign();
    }

    /// Runs the clock for 0.1 s of simulated time, then pauses it.
    pub fn step(&self) {
        let mut state = self.0.lock();
        state.mode.paused = true;
        state.realign();
        state.allowed = state.now + STEP;
    }

    /// Returns the simulated time since the start, as of the last comparison.
    pub fn now(&self) -> Duration {
        self.0.lock().now
    }

    /// Controls the simulation's clock until `stop` is cancelled. After that there is no viewer,
    /// and the rest of the run proceeds as fast as possible.
    pub(super) async fn run(self, began: Instant, stop: CancellationToken) {
        let wall = std::time::Instant::now();
        while !stop.is_cancelled() {
            let (wait, check_interval) = {
                let mut state = self.0.lock();
                (
                    state.wait(began.elapsed(), wall.elapsed()),
                    state.check_interval(),
                )
            };
            match wait {
                None => sleep(check_interval).await,
                Some(wait) => {
                    // Blocks the thread deliberately: while this task is ready, the clock does not
                    // jump.
                    std::thread::sleep(wait.min(MAX_BLOCK));
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

    #[test]
    fn a_factor_of_ten_waits_a_tenth_and_a_late_clock_does_not_catch_up() {
        let sim_clock = SimClock::default();
        sim_clock.set_time_scale(TimeScale::new(10.0).unwrap());
        assert_eq!(sim_clock.0.lock().wait(ms(0), ms(1000)), None);
        assert_eq!(sim_clock.0.lock().wait(ms(100), ms(1000)), Some(ms(10)));
        assert_eq!(sim_clock.0.lock().wait(ms(100), ms(1010)), None);
        // One second late.
        assert_eq!(sim_clock.0.lock().wait(ms(200), ms(2020)), None);
        assert_eq!(sim_clock.0.lock().wait(ms(300), ms(2020)), Some(ms(10)));
    }

    #[test]
    fn a_paused_clock_stops_and_a_step_is_a_tenth_of_a_second() {
        let sim_clock = SimClock::default();
        sim_clock.pause(true);
        assert!(sim_clock.0.lock().wait(ms(0), ms(0)).is_some());
        assert!(sim_clock.0.lock().wait(ms(0), ms(60_000)).is_some());
        sim_clock.step();
        assert_eq!(sim_clock.0.lock().wait(ms(90), ms(60_000)), None);
        assert!(sim_clock.0.lock().wait(ms(100), ms(60_000)).is_some());
        sim_clock.pause(false);
        assert_eq!(sim_clock.0.lock().wait(ms(100), ms(90_000)), None);
        assert_eq!(sim_clock.0.lock().wait(ms(110), ms(90_000)), Some(ms(10)));
    }

    #[test]
    fn numbers_out_of_range_are_not_factors() {
        for wrong in [0.0, -1.0, 0.099, 100.1, f64::NAN, f64::INFINITY] {
            assert_eq!(TimeScale::new(wrong), None, "{wrong}");
        }
    }
}
