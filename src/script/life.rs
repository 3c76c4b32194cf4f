//! The phases of a script's life.

use std::collections::VecDeque;
use std::time::Duration;

use mlua::prelude::LuaFunction;

use tokio::time::Instant;

use super::failure::ScriptExit;
use crate::robot::EndReason;

/// The phase of a script's life.
#[derive(Debug)]
pub(super) enum Life {
    Running,
    Stopping(Stopping),
    Ended(ScriptExit),
}

/// The last half second, in which a stopping script may clean up.
#[derive(Debug)]
pub(super) struct Stopping {
    pub(super) exit: ScriptExit,
    pub(super) deadline: Instant,
    /// Real time that its slices took; needed since the clock of the deadline may be virtual and
    /// stand still.
    pub(super) spent: Duration,
}

/// How the script is to end.
#[derive(Default)]
pub(super) struct Exit {
    /// Functions given to `script.on_stop`.
    pub(super) stop_handlers: VecDeque<LuaFunction>,
    /// Set when the running task has called `script.stop`; holds its message.
    pub(super) stop_requested: Option<Option<String>>,
    /// A native function has panicked: the state of the script can no longer be trusted.
    pub(super) broken: bool,
}

/// Whether a script that ends for this reason must not run another line.
pub(super) fn is_kill(reason: EndReason) -> bool {
    matches!(
        reason,
        EndReason::Cpu | EndReason::Memory | EndReason::Safety
    )
}
