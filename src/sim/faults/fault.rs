//! What can go wrong between a client and the robot, and with the robot itself: troubles and their
//! times. Only describes them: `lane` and `outlet` act on the bytes, `server::site` on the robot.
//! How they are written in YAML is in `list` and `entry`.

use std::time::Duration;

use serde::Deserialize;

use crate::wire::Refusal;

use super::timing::Timing;

/// Which direction of a connection a fault affects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Towards {
    /// From the robot to the client.
    Client,
    /// From the client to the robot.
    Robot,
    /// Both ways.
    Both,
}

impl Towards {
    /// Whether the direction towards `end` is affected.
    pub(crate) fn covers(self, end: Towards) -> bool {
        self == Towards::Both || self == end
    }
}

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Trouble {
    /// Bytes come later by `by` and up to `jitter` more, in order.
    Delay {
        /// At least.
        by: Duration,
        /// Drawn anew for each piece.
        jitter: Duration,
    },
    /// Messages arrive in pieces, cut anywhere.
    Split,
    /// Bytes trickle.
    Drip {
        /// So many a second.
        rate: u32,
    },
    /// Bytes are dropped silently. A connection that lost bytes stays dead for good, and
    /// the robot does not notice its end before the fault is over.
    HalfOpen,
    /// All connections end in an orderly way.
    Drop,
    /// The connection is reset in the middle of the next message.
    Reset,
    /// So many random bytes between two messages.
    Garbage {
        /// 1 to 65,535.
        bytes: usize,
    },
    /// The next header claims a wrong length.
    LengthLie {
        /// The length; random if left out.
        claim: Option<u16>,
    },
    /// Pictures of 65,535 bytes, padded with a comment.
    HugeFrames,
    /// Pictures are cut off somewhere.
    TruncatedFrames,
    /// So many bytes of each picture are wrong.
    FlippedFrames {
        /// At least 1.
        bytes: usize,
    },
    /// POWER does not arrive.
    NoPower,
    /// POWER names a wrong level; its sign stays.
    PowerJumps {
        /// 0 to 100; random if left out.
        percent: Option<u8>,
    },
    /// POWER is any byte.
    PowerGarbage,
    /// The robot is gone for a while and must be logged in to anew.
    Reboot {
        /// Tracks, lights, sounds and streams are off afterwards. Else only its Wi-Fi was
        /// gone, and it continued what it was doing.
        forgets: bool,
    },
    /// Every login is refused.
    RefuseLogin(Refusal),
    /// Another user takes the robot for a while.
    TakeOver,
    /// The station cannot be found.
    BaseNotFound,
    /// The station has no current.
    NoCharge,
    /// The robot slides off the contacts again and again.
    DockLost {
        /// So long after each docking.
        after: Duration,
    },
}

/// A trouble and its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// What goes wrong.
    pub trouble: Trouble,
    /// Which way, where that means anything.
    pub towards: Towards,
    /// When.
    pub timing: Timing,
    /// How probable it is, 0..=1: for spoilt messages of each one, else of each time that it is
    /// due.
    pub chance: f64,
}

impl Fault {
    /// At once, and for as long as this trouble usually takes; both ways.
    pub fn new(trouble: Trouble) -> Fault {
        let timing = Timing {
            lasts: trouble.usual_length(),
            ..Timing::default()
        };
        let towards = Towards::Both;
        Fault {
            trouble,
            towards,
            timing,
            chance: 1.0,
        }
    }
}

impl Trouble {
    /// How long it lasts by default; zero: for a moment.
    fn usual_length(&self) -> Option<Duration> {
        match self {
            Trouble::Drop
            | Trouble::Reset
            | Trouble::Garbage { .. }
            | Trouble::LengthLie { .. } => Some(Duration::ZERO),
            Trouble::Reboot { .. } | Trouble::TakeOver => Some(Duration::from_secs(5)),
            _ => None,
        }
    }

    /// Whether its chance is drawn for each message instead of each time.
    pub(crate) fn spoils_messages(&self) -> bool {
        matches!(
            self,
            Trouble::HugeFrames
                | Trouble::TruncatedFrames
                | Trouble::FlippedFrames { .. }
                | Trouble::NoPower
                | Trouble::PowerJumps { .. }
                | Trouble::PowerGarbage
        )
    }
}
