//! What goes wrong, by lot: faults of the network and of the robot, a battery that collapses, and people
//! who carry the robot about, each for a while, with calm in between.

use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::sim::{Handle, Pose};

use super::super::begin_fault;

/// From one trouble to the next, at most; in seconds.
const LONGEST_CALM: f64 = 240.0;
/// After the end of a trouble things need a while to be as they were.
const AFTERMATH: Duration = Duration::from_secs(45);

/// In place of `SECONDS` comes how long.
const FAULTS: [&str; 21] = [
    "{ fault: delay, seconds: 0.2, jitter: 0.3, for: SECONDS }",
    "{ fault: delay, seconds: 0.05, jitter: 0.1, towards: client, for: SECONDS }",
    "{ fault: split, for: SECONDS }",
    "{ fault: drip, bytes: 4000, for: SECONDS }",
    "{ fault: half_open, for: SECONDS }",
    "{ fault: half_open, towards: robot, for: SECONDS }",
    "{ fault: drop }",
    "{ fault: reset }",
    "{ fault: garbage, bytes: 300 }",
    "{ fault: length_lie }",
    "{ fault: huge_frames, for: SECONDS }",
    "{ fault: truncated_frames, for: SECONDS }",
    "{ fault: flipped_frames, bytes: 40, for: SECONDS }",
    "{ fault: no_power, for: SECONDS }",
    "{ fault: power_garbage, chance: 0.3, for: SECONDS }",
    "{ fault: reboot, for: SECONDS, state: lost }",
    "{ fault: reboot, for: SECONDS, state: kept }",
    "{ fault: refuse_login, for: SECONDS }",
    "{ fault: take_over, for: SECONDS }",
    "{ fault: base_not_found, for: SECONDS }",
    "{ fault: no_charge, for: SECONDS }",
];

/// All that may go wrong.
pub struct FaultFeed {
    rng: StdRng,
    next: Duration,
    bad_until: Duration,
    carried: bool,
    pub troubles: u64,
}

impl FaultFeed {
    pub fn new(seed: u64) -> FaultFeed {
        FaultFeed {
            rng: StdRng::seed_from_u64(seed),
            next: Duration::from_secs(120),
            bad_until: Duration::ZERO,
            carried: false,
            troubles: 0,
        }
    }

    /// Lets something go wrong when its time has come, and says what.
    pub fn blow(&mut self, sim: &Handle, now: Duration) -> Option<String> {
        self.carried = false;
        if now < self.next {
            return None;
        }
        let seconds = self.rng.random_range(1.0..20.0_f64).round();
        self.troubles += 1;
        if self.rng.random_bool(0.1) {
            // An old battery that collapses, never to more than it had. Nothing else is wrong.
            let rest: f64 = self.rng.random_range(15.0..20.0);
            sim.set_battery(rest.min(sim.state().battery));
            self.next = now + Duration::from_secs(300);
            return Some("the battery collapses".to_owned());
        }
        let what = if self.rng.random_bool(0.08) {
            let x = self.rng.random_range(1.2..3.2);
            let y = self.rng.random_range(1.6..3.4);
            let heading = self.rng.random_range(-3.0..3.0);
            sim.place(Pose { x, y, heading });
            self.carried = true;
            self.bad_until = now;
            "the robot is carried away".to_owned()
        } else {
            let text = FAULTS[self.rng.random_range(0..FAULTS.len())];
            let lasts = Duration::from_secs_f64(seconds);
            begin_fault(sim, text, lasts);
            self.bad_until = now + lasts;
            text.replace("SECONDS", &seconds.to_string())
        };
        let calm = self.rng.random_range(10.0..LONGEST_CALM);
        self.next = self.bad_until + Duration::from_secs_f64(calm);
        Some(what)
    }

    /// Nothing is wrong, and has not been for a while.
    pub fn is_calm(&self, now: Duration) -> bool {
        self.troubles == 0 || now > self.bad_until + AFTERMATH
    }

    /// A fault is on at this moment.
    pub fn is_bad(&self, now: Duration) -> bool {
        now < self.bad_until
    }

    /// The robot was carried somewhere at this moment.
    pub fn has_carried(&self) -> bool {
        self.carried
    }

    /// The end of all troubles.
    pub fn clear(&self, sim: &Handle) {
        sim.clear_faults();
    }
}
