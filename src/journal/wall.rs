//! From the agent's clock to that on the wall.

use jiff::{SignedDuration, Timestamp};
use tokio::time::Instant;

/// The time of day of a moment that is not long ago. A clock that was put right in between counts as it
/// is now.
pub fn wall(at: Instant) -> Timestamp {
    let ago = SignedDuration::try_from(at.elapsed()).unwrap_or_default();
    let now = Timestamp::now();
    now.checked_sub(ago).unwrap_or(now)
}
