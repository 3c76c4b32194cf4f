//! How a laboratory is set up.

use tokio_util::sync::CancellationToken;

use super::recorder::Recorder;
use crate::link;
use crate::robot::{Bus, Streams};
use crate::safety::Limits;
use crate::sim;

/// How a laboratory is set up.
#[derive(Default)]
pub struct Options {
    /// Of the simulator's noise and the link's pauses; behaviours bring their own.
    pub seed: u64,
    /// The simulated robot: its login, firmware, frames a second, faults. Its `seed`, `listen`,
    /// `discovery` and `unacknowledged` are not used.
    pub sim: sim::Options,
    /// The numbers of the safety rules.
    pub limits: Limits,
    /// Times of the link.
    pub link: link::Options,
    /// When the robot's streams are on.
    pub streams: Streams,
    /// Ends every run of this laboratory when cancelled, from whatever thread.
    pub stop: CancellationToken,
    /// Is given all that happens.
    pub events: Option<Recorder>,
    /// Where its agents say what happens.
    pub bus: Bus,
}
