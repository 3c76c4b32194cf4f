//! Names of what lives in a script: numbers that count up.

use tokio::time::Instant;

/// Names a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct TaskId(pub(super) u64);

/// Names a subscription.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct SubscriptionId(pub(super) u64);

/// Names a `task.all`, `task.race` or `task.timeout` under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct GroupId(pub(super) u64);

/// Names a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ModuleId(pub(super) usize);

/// When a timer rings; equal times ring in the order in which they were set.
pub(super) type Timer = (Instant, u64);
