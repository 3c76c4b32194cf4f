//! The requests of behaviours.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::{CallId, MotionId, Percent, Setpoint};
use crate::wire::{Led, Sound, Stream};

/// A request of a behaviour. None reaches the robot unless arbiter and watchdog agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Intent {
    /// Drive. Holds until changed or released; with a duration it ends automatically. Answered by
    /// one [`Event::MotionEnded`](super::Event::MotionEnded), also when another motion of the same
    /// behaviour replaces it.
    Move {
        /// The setpoint's number; larger than that of every earlier one.
        motion: MotionId,
        /// The power of the tracks.
        setpoint: Setpoint,
        /// The duration; `None`: until changed.
        duration: Option<Duration>,
    },
    /// The task that owned a setpoint has ended. Has no effect if the setpoint is not the current
    /// one.
    Release {
        /// The setpoint.
        motion: MotionId,
    },
    /// End the motions and dockings of this behaviour and of all with equal or lower priority. Of
    /// the watchdog's own way home it ends only a grant to this behaviour.
    Stop,
    /// Switch a light.
    Led {
        /// The light.
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
    /// Request a stream, or no longer. It is on while any behaviour requests it.
    Stream {
        /// The stream.
        stream: Stream,
        /// Whether it is wanted.
        on: bool,
    },
    /// Go to the station. Answered by [`Event::DockEnded`](super::Event::DockEnded).
    Dock {
        /// The number of this call.
        call: CallId,
        /// Timeouts and retries.
        plan: DockPlan,
    },
    /// Leave the station. Answered by [`Event::UndockEnded`](super::Event::UndockEnded).
    Undock {
        /// The number of this call.
        call: CallId,
        /// How long to wait for the robot's confirmation that it has left.
        timeout: Duration,
    },
    /// Cancel a docking under way; it ends as [`DockEnd::Cancelled`](super::DockEnd::Cancelled).
    CancelDock,
}

/// Timeouts and retries of one docking.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DockPlan {
    /// The longest search of one attempt.
    pub timeout: Duration,
    /// Attempts after the first.
    pub retries: u32,
    /// How long charging may take to begin once the robot reports that it is on its station.
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
