//! How the simulated robot's firmware behaves where the real one's behaviour is not known
//! (`PROTOCOL.md`, *Not known*).

use std::time::Duration;

/// The unknowns as settings; the defaults are the worst case for a client that drives the robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Firmware {
    /// The tracks stop when the user disconnects. Default: they keep running.
    pub stops_on_disconnect: bool,
    /// The tracks stop when no MOVE has arrived for this long. Default: they keep running.
    pub stops_without_repeat: Option<Duration>,
    /// POWER comes on every change, and at least this often. Default 5 s.
    pub power_period: Duration,
    /// From AUTH_REPLY to the first POWER. Default: at once.
    pub power_after_login: Duration,
    /// BASE_NOT_FOUND comes after this time without the station's beacon. Default 20 s.
    pub search_limit: Duration,
    /// How long the uploaded music lasts. Default 20 s.
    pub music: Duration,
    /// The version that AUTH_REPLY names.
    pub version: String,
}

impl Default for Firmware {
    fn default() -> Firmware {
        Firmware {
            stops_on_disconnect: false,
            stops_without_repeat: None,
            power_period: Duration::from_secs(5),
            power_after_login: Duration::ZERO,
            search_limit: Duration::from_secs(20),
            music: Duration::from_secs(20),
            version: "1.0.22".into(),
        }
    }
}
