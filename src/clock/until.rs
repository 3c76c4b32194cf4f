//! Waiting for a deadline that may not be set.

use tokio::time::{Instant, sleep_until};

/// Sleeps until the deadline; without one, never returns. Cancel-safe, for the branches of
/// `select!`.
pub async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}
