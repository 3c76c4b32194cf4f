//! Identifiers of the objects in a script: numbers that count up.

use tokio::time::Instant;

/// Identifies a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct TaskId(pub(super) u64);

/// Identifies a subscription.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct SubscriptionId(pub(super) u64);

/// Identifies a `task.all`, `task.race` or `task.timeout` in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct GroupId(pub(super) u64);

/// Identifies a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ModuleId(pub(super) usize);

/// When a timer fires, and its number; timers with equal times fire in the order in which they were
/// set.
pub(super) type Timer = (Instant, u64);
