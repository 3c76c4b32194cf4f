//! Faults of the connection between a client and the robot, and of the robot itself, with their
//! times. The submodules read them from YAML and apply them to bytes, `server` to the robot.

mod corrupt;
mod list;
pub(crate) mod proxy;
pub(crate) mod scheduler;

use std::time::Duration;

use serde::Deserialize;
use wire::Refusal;

/// Which direction of a connection a fault affects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// From the robot to the client.
    Client,
    /// From the client to the robot.
    Robot,
    /// Both directions.
    Both,
}

impl Direction {
    /// Whether the fault affects the direction towards `end`.
    pub(crate) fn covers(self, end: Direction) -> bool {
        self == Direction::Both || self == end
    }
}

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultKind {
    /// Bytes are delayed by `by` plus a random time up to `jitter`, and stay in order.
    Delay {
        /// Minimum delay.
        by: Duration,
        /// Maximum additional delay, drawn for each chunk.
        jitter: Duration,
    },
    /// Messages arrive in pieces, split at random places.
    Split,
    /// Bytes arrive slowly, a few at a time.
    Drip {
        /// Bytes per second.
        rate: u32,
    },
    /// Bytes are dropped silently. A connection that has lost bytes stays dead permanently, and the
    /// robot does not notice its end until the fault is over.
    HalfOpen,
    /// All connections are closed in an orderly way.
    Drop,
    /// The connection is reset in the middle of the next message.
    Reset,
    /// Random bytes are inserted between two messages.
    Garbage {
        /// Number of bytes, 1 to 65,535.
        bytes: usize,
    },
    /// The next header claims a wrong length.
    LengthLie {
        /// The claimed length; random if `None`.
        claim: Option<u16>,
    },
    /// Frames are padded to 65,535 bytes with a JPEG comment.
    HugeFrames,
    /// Frames are truncated at a random place.
    TruncatedFrames,
    /// Random bytes of each frame are changed.
    FlippedFrames {
        /// How many of each frame.
        bytes: usize,
    },
    /// No POWER arrives.
    NoPower,
    /// POWER reports a wrong level; its sign (charging) stays.
    PowerJumps {
        /// The reported level, 0 to 100; random if `None`.
        percent: Option<u8>,
    },
    /// POWER contains a random byte.
    PowerGarbage,
    /// The robot is unreachable for a while, and clients must log in again.
    Reboot {
        /// Tracks, lights, sounds and streams are off afterwards. If false, only the Wi-Fi was off
        /// and the robot continued what it was doing.
        forgets: bool,
    },
    /// Every login is refused, for this reason.
    RefuseLogin(Refusal),
    /// The robot's program takes this long for each command, and executes one after another.
    SlowProgram {
        /// Time for each command.
        period: Duration,
    },
    /// Another user takes over the robot for a while.
    TakeOver,
    /// The station's beacon is off, so that a search fails.
    BaseNotFound,
    /// The station does not charge.
    NoCharge,
    /// The robot slides off the contacts after each docking.
    DockLost {
        /// Time from docking to sliding off.
        after: Duration,
    },
}

/// A fault and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// The affected direction, for kinds that have one.
    pub towards: Direction,
    /// When, and for how long.
    pub timing: Timing,
    /// Probability, 0..=1: per message for faults that alter messages, otherwise per occurrence.
    pub chance: f64,
}

impl Fault {
    /// Creates a fault that starts immediately, lasts for the default time of its kind and affects
    /// both directions.
    pub fn new(kind: FaultKind) -> Fault {
        Fault {
            kind,
            towards: Direction::Both,
            timing: Timing {
                lasts: kind.default_duration(),
                ..Timing::default()
            },
            chance: 1.0,
        }
    }
}

impl FaultKind {
    /// Returns the default duration; zero means momentary, `None` unlimited.
    fn default_duration(&self) -> Option<Duration> {
        match self {
            FaultKind::Drop
            | FaultKind::Reset
            | FaultKind::Garbage { .. }
            | FaultKind::LengthLie { .. } => Some(Duration::ZERO),
            FaultKind::Reboot { .. } | FaultKind::TakeOver => Some(Duration::from_secs(5)),
            _ => None,
        }
    }

    /// Whether the chance applies to each message instead of each occurrence.
    pub(crate) fn alters_messages(&self) -> bool {
        matches!(
            self,
            FaultKind::HugeFrames
                | FaultKind::TruncatedFrames
                | FaultKind::FlippedFrames { .. }
                | FaultKind::NoPower
                | FaultKind::PowerJumps { .. }
                | FaultKind::PowerGarbage
        )
    }
}

/// The timing of one fault, relative to the time at which it is added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Timing {
    /// Time until the fault begins.
    pub after: Duration,
    /// Duration of each occurrence; zero means momentary, `None` unlimited.
    pub lasts: Option<Duration>,
    /// Period from one beginning to the next, longer than `lasts`; `None` if the fault occurs only
    /// once.
    pub every: Option<Duration>,
}
