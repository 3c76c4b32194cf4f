//! What is sent when the link is established or lost, the machine resumes or the run ends, and what
//! would be sent if the agent died.

use tokio::time::Instant;

use super::Watchdog;
use crate::robot::{DockEnd, MotionEnd};
use crate::safety::LastWords;
use crate::wire::{Command, Engage, Power};

impl Watchdog {
    /// The commands to send if the agent dies now; valid once the last batch of acts is executed.
    ///
    /// - [`LastWords::Nothing`] on the station, unless the robot backs out of it, and while the
    ///   robot searches for it because its battery is low.
    /// - [`LastWords::StopAndDock`] in all other cases of a low battery: waiting for the next
    ///   search, driven by the watchdog or a borrower, or backing out of the station.
    /// - [`LastWords::Stop`] otherwise: with a good battery the robot stays where it is until
    ///   somebody controls it again, also if a behaviour asked for a search.
    ///
    /// Without a link, these commands are sent if a login is given up half way: a stop, and
    /// BASE_FIND if the battery was low and the robot not known to be on its station, or else
    /// BASE_FIND_CANCEL.
    pub fn last_words(&self) -> LastWords {
        let low = self.guard.low().is_some();
        let stays = self.docked() && !self.dock_tracker.is_leaving();
        if self.online && (stays || (low && self.searching)) {
            LastWords::Nothing
        } else if low && !stays {
            LastWords::StopAndDock
        } else {
            LastWords::Stop
        }
    }

    pub(super) fn link_up(&mut self, docked: bool, power: Power, now: Instant) {
        if self.online {
            self.link_down(now);
        }
        (self.online, self.streaming) = (true, false);
        let low = self.guard.low().is_some();
        self.dock_tracker.login(docked, low, now);
        self.tracks.note_stop(now);
        self.cancel_earlier_search(now);
        self.note_received(now);
        self.search_at_once(now);
        self.power(power, now);
    }

    pub(super) fn note_received(&mut self, now: Instant) {
        self.silent_motion_since = self.tracks.moving_since().map(|_| now);
    }

    pub(super) fn link_down(&mut self, now: Instant) {
        (self.online, self.searching) = (false, false);
        self.tracks.note_stop(now);
        self.end_motion(MotionEnd::Disconnected);
        if let Some(leaving) = self.leaving.take() {
            self.answer_undock(leaving.caller, DockEnd::Disconnected);
        }
        if let Some(homing) = &mut self.homing {
            homing.docking.cancel(DockEnd::Disconnected, now);
            self.answer_homing(now);
        }
        self.answer_waiting(DockEnd::Disconnected, now);
        self.interrupt_recovery(now);
    }

    /// Handles the end of a suspension. Nothing old is repeated: all requests end as if the link
    /// had been lost, the tracks stop, and a robot with a low battery searches at once.
    pub(super) fn wake(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        self.link_down(now);
        self.online = true;
        self.cancel_earlier_search(now);
        self.halt(now);
        self.dock_tracker.doubt_leaving();
        self.search_at_once(now);
    }

    /// Stops all motion. If the watchdog sends the robot home, BASE_FIND is sent again, since the
    /// stop may have ended the search.
    pub(super) fn end_run(&mut self, now: Instant) {
        self.run_ending = true;
        self.end_motion(MotionEnd::Cancelled);
        self.cancel_docks(None, now);
        if !self.online {
            return;
        }
        self.halt(now);
        if self.homing.is_none() {
            self.search_at_once(now);
        }
        if self.homing.as_ref().is_some_and(|homing| homing.forced) && !self.docked() {
            self.send(Command::Engine(Engage::Dock));
        }
    }
}
