//! The options of a simulation.

use tokio_util::sync::CancellationToken;

use super::recorder::Recorder;
use super::sim_clock::SimClock;
use crate::link;
use crate::robot::{Bus, Streams};
use crate::safety::Limits;
use crate::sim;

/// Options of a simulation.
#[derive(Default)]
pub struct Options {
    /// Seed of the simulator's noise and of the link's pauses; behaviours have their own seeds.
    pub seed: u64,
    /// The simulated robot: its login, firmware, frames per second and faults. Its `seed`,
    /// `listen`, `discovery` and `unacknowledged` are not used.
    pub sim: sim::Options,
    /// The parameters of the safety rules.
    pub limits: Limits,
    /// Timing of the link.
    pub link: link::Options,
    /// When the robot's streams are on.
    pub streams: Streams,
    /// Ends every run of this simulation when cancelled, from any thread.
    pub stop: CancellationToken,
    /// Wall-clock time at the start; 2026-01-01 09:00 UTC if `None`.
    pub date: Option<jiff::Timestamp>,
    /// Receives all events.
    pub events: Option<Recorder>,
    /// Slows the virtual clock down for viewers. A run with a sim_clock continues after its
    /// behaviours have ended. Without it, virtual time jumps ahead whenever all tasks wait.
    pub sim_clock: Option<SimClock>,
    /// The bus to which its agents publish.
    pub bus: Bus,
}
