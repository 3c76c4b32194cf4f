//! A summary of the state for people.

use super::shown::Shown;
use crate::robot::Battery;
use crate::safety::{DockState, WatchdogState};

/// The state of the link.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LinkState {
    /// The first attempt is under way.
    #[default]
    Connecting,
    /// Logged in.
    Up,
    /// Was up; reconnecting.
    Lost,
    /// Released, so that another program can log in.
    Released,
}

impl LinkState {
    /// The name that pages and brokers receive.
    pub fn name(self) -> &'static str {
        match self {
            LinkState::Connecting => "connecting",
            LinkState::Up => "up",
            LinkState::Lost => "lost",
            LinkState::Released => "released",
        }
    }

    /// A description for people, unless the link is up: then the watchdog's state says more.
    pub fn absence(self) -> Option<&'static str> {
        match self {
            LinkState::Connecting => Some("connecting"),
            LinkState::Up => None,
            LinkState::Lost => Some("link lost, reconnecting"),
            LinkState::Released => Some("disconnected, free for others"),
        }
    }
}

/// The newest state of robot and watchdog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Status {
    /// The link.
    pub link: LinkState,
    /// The watchdog.
    pub safety: WatchdogState,
    /// The battery, as far as its reports are believed.
    pub battery: Option<Battery>,
    /// The battery counts as low, and the watchdog controls the robot.
    pub low: bool,
    /// A rescue behaviour should be running.
    pub rescue: bool,
    /// On the station, as far as known; without a link, the last known state.
    pub docked: bool,
    /// Where the robot is, as far as known.
    pub place: DockState,
    /// The battery is nearly empty: scripts have neither lights nor sounds nor streams.
    pub shed: bool,
    /// Frames received so far, damaged ones included. A change of this count alone does not wake
    /// receivers.
    pub frames: u64,
    /// A person has stopped the robot and not released it yet.
    pub halted: bool,
    /// Last tracks, lights and sound commanded.
    pub shown: Shown,
}

impl Default for Status {
    fn default() -> Status {
        let safety = WatchdogState::Offline;
        Status {
            link: LinkState::default(),
            safety,
            battery: None,
            low: false,
            rescue: false,
            docked: false,
            place: DockState::Unknown,
            shed: false,
            frames: 0,
            halted: false,
            shown: Shown::default(),
        }
    }
}

impl Status {
    /// Takes over the newest state; returns whether anything has changed.
    pub(super) fn update(&mut self, newest: Status) -> bool {
        std::mem::replace(self, newest) != newest
    }

    /// Counts a frame, which does not count as a change, and returns its number.
    pub(super) fn count_frame(&mut self) -> u64 {
        self.frames += 1;
        self.frames
    }
}
