//! Time limits of the link.

use std::time::Duration;

/// Time limits of connecting, logging in and giving up.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The longest wait for a TCP connection, name lookup included.
    pub connect_timeout: Duration,
    /// The longest wait, from the login on, for AUTH_REPLY and the first POWER.
    pub login_timeout: Duration,
    /// The pause before the first reconnect after a lost link.
    pub first_pause: Duration,
    /// Pauses grow up to this.
    pub longest_pause: Duration,
    /// A write that the robot does not acknowledge within this time means a dead link.
    pub dead_after: Duration,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            connect_timeout: Duration::from_secs(5),
            login_timeout: Duration::from_secs(10),
            first_pause: Duration::from_millis(500),
            longest_pause: Duration::from_secs(30),
            dead_after: Duration::from_secs(3),
        }
    }
}
