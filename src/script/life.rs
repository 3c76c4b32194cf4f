//! Where in its life a script is.

use std::collections::VecDeque;
use std::time::Duration;

use mlua::prelude::LuaFunction;

use tokio::time::Instant;

use super::failure::Ending;
use crate::robot::EndReason;

/// Where in its life a script is.
#[derive(Debug)]
pub(super) enum Life {
    Running,
    Stopping(Stopping),
    Ended(Ending),
}

/// The last half second.
#[derive(Debug)]
pub(super) struct Stopping {
    pub(super) ending: Ending,
    pub(super) deadline: Instant,
    /// Real time that its slices took: the deadline's own time may stand still.
    pub(super) spent: Duration,
}

/// What the script has asked for its end.
#[derive(Default)]
pub(super) struct Exit {
    /// Functions of `script.on_stop`.
    pub(super) farewells: VecDeque<LuaFunction>,
    /// The running task has called `script.stop`.
    pub(super) asked: Option<Option<String>>,
    /// A native has panicked: nothing of the script can be trusted any more.
    pub(super) broken: bool,
}

/// Whether a script that ends for this reason runs no further line.
pub(super) fn is_kill(reason: EndReason) -> bool {
    matches!(
        reason,
        EndReason::Cpu | EndReason::Memory | EndReason::Safety
    )
}
