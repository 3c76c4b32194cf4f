//! What a behaviour asks.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{CallId, MotionId, Percent, Setpoint};
use crate::wire::{Led, Sound, Stream};

/// What a behaviour asks. Nothing here reaches the robot unless arbiter and watchdog agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Intent {
    /// Drive. Holds until changed or released; with a duration it ends by itself. Answered by one
    /// [`Event::MotionEnded`](super::Event::MotionEnded), also when another motion of the same behaviour replaces it.
    Move {
        /// Names this setpoint; larger than that of every earlier one.
        motion: MotionId,
        /// What the tracks are to do.
        setpoint: Setpoint,
        /// How long; `None`: until changed.
        duration: Option<Duration>,
    },
    /// The task that owned a setpoint has ended. Nothing happens if it is not the current one.
    Release {
        /// The setpoint.
        motion: MotionId,
    },
    /// Stop the tracks, always.
    Stop,
    /// Switch a light.
    Led {
        /// Which.
        led: Led,
        /// On or off.
        on: bool,
    },
    /// Play a sound.
    Play(Sound),
    /// Stop the music.
    StopSound,
    /// Set the volume.
    Volume(Percent),
    /// Samples for the speaker: s16 little-endian, mono, 16 kHz.
    Say(Vec<u8>),
    /// Want a stream, or no longer. It is on while any behaviour wants it.
    Stream {
        /// Which.
        stream: Stream,
        /// Wanted.
        on: bool,
    },
    /// Go to the station. Answered by [`Event::DockEnded`](super::Event::DockEnded).
    Dock {
        /// Names this call.
        call: CallId,
        /// Times and tries.
        plan: DockPlan,
    },
    /// Leave the station. Answered by [`Event::UndockEnded`](super::Event::UndockEnded).
    Undock {
        /// Names this call.
        call: CallId,
        /// How long to wait for the robot's word that it has left.
        timeout: Duration,
    },
    /// Give up a docking under way; it ends as [`DockEnd::Cancelled`](super::DockEnd::Cancelled).
    CancelDock,
}

/// Times and tries of one docking (`API.md`, `robot.dock`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DockPlan {
    /// The longest search of one try.
    pub timeout: Duration,
    /// Tries after the first.
    pub retries: u32,
    /// How long charging may take to begin once the robot says that it is on its station.
    pub charge_timeout: Duration,
}

impl DockPlan {
    /// The defaults.
    pub const DEFAULT: DockPlan = DockPlan {
        timeout: Duration::from_secs(180),
        retries: 2,
        charge_timeout: Duration::from_secs(30),
    };
}

impl Default for DockPlan {
    fn default() -> DockPlan {
        DockPlan::DEFAULT
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn intents_from_a_broken_host_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let _ = postcard::from_bytes::<Intent>(&bytes);
        }
    }
}
