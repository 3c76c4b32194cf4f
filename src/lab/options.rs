//! How a laboratory is set up.

use tokio_util::sync::CancellationToken;

use super::recorder::Recorder;
use super::tempo::Tempo;
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
    /// What the clock on the wall shows at the beginning: 2026-01-01 09:00 in universal time unless given.
    pub date: Option<jiff::Timestamp>,
    /// Is given all that happens.
    pub events: Option<Recorder>,
    /// Holds its clock for people who watch; a run that is watched goes on when its behaviours have
    /// ended. Without it time jumps whenever everything waits.
    pub tempo: Option<Tempo>,
    /// Where its agents say what happens.
    pub bus: Bus,
}
