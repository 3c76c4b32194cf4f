//! What a person wants to know at a glance.

use super::shown::Shown;
use crate::robot::Battery;
use crate::safety::{DockState, WatchdogState};

/// Whether the robot is there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LinkState {
    /// The first try is under way.
    #[default]
    Connecting,
    /// Logged in.
    Up,
    /// Was up; connecting anew.
    Lost,
    /// Released, so that another program can log in.
    Released,
}

impl LinkState {
    /// One word for it, as pages and brokers are told.
    pub fn name(self) -> &'static str {
        match self {
            LinkState::Connecting => "connecting",
            LinkState::Up => "up",
            LinkState::Lost => "lost",
            LinkState::Released => "released",
        }
    }

    /// In words for people, unless the link is up: then the watchdog's state says more.
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
    /// The battery, as far as it is believed.
    pub battery: Option<Battery>,
    /// The battery counts as low and the watchdog has the robot.
    pub low: bool,
    /// A rescue behaviour should be there.
    pub rescue: bool,
    /// On the station, as far as is known; without a link as far as was known.
    pub docked: bool,
    /// Where the robot is, as far as is known.
    pub place: DockState,
    /// The battery is nearly empty: scripts have neither lights nor sounds nor streams.
    pub shed: bool,
    /// Frames that have come so far, damaged ones included. Counting alone does not wake those who wait for a change.
    pub frames: u64,
    /// A person has stopped the robot, and the stop still holds.
    pub halted: bool,
    /// What the robot was told last.
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
    /// Takes the newest state over; says whether anything is new.
    pub(super) fn update(&mut self, newest: Status) -> bool {
        std::mem::replace(self, newest) != newest
    }

    /// Counts a frame, which is no news, and gives its number.
    pub(super) fn count_frame(&mut self) -> u64 {
        self.frames += 1;
        self.frames
    }
}
