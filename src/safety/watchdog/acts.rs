//! Makes the watchdog's acts: every command, answer and announcement.

use std::time::Duration;

use tokio::time::Instant;

use super::{Caller, Watchdog};
use crate::robot::{DockEnd, Event, MotionEnd, SafetyAction};
use crate::safety::{Act, Ended};
use crate::wire::{Command, Engage};

impl Watchdog {
    /// Stops the tracks in this batch of acts, whatever was sent before.
    pub(super) fn halt(&mut self, now: Instant) {
        self.tracks.note_stop(now);
        let sent = |act: &Act| matches!(act, Act::Send(_));
        let stop = Act::Send(Command::STOP);
        if self.acts.iter().rfind(|act| sent(act)) != Some(&stop) {
            self.send(Command::STOP);
        }
    }

    pub(super) fn end_motion(&mut self, end: MotionEnd) {
        let over = self.arbiter.clear(end);
        self.tell_ended(over);
    }

    pub(super) fn tell_ended(&mut self, over: Vec<Ended>) {
        let tell = |Ended { by, motion, end }| Act::Tell(by, Event::MotionEnded { motion, end });
        self.acts.extend(over.into_iter().map(tell));
    }

    pub(super) fn answer_dock(
        &mut self,
        Caller { by, call, .. }: Caller,
        end: DockEnd,
        attempts: u32,
        took: Duration,
    ) {
        self.acts.push(Act::Tell(
            by,
            Event::DockEnded {
                call,
                end,
                attempts,
                took,
            },
        ));
    }

    pub(super) fn answer_undock(&mut self, Caller { by, call, .. }: Caller, end: DockEnd) {
        self.acts
            .push(Act::Tell(by, Event::UndockEnded { call, end }));
    }

    pub(super) fn announce(&mut self, action: SafetyAction, reason: String) {
        self.acts
            .push(Act::Announce(Event::Safety { action, reason }));
    }

    pub(super) fn send(&mut self, command: Command) {
        match command {
            Command::Engine(Engage::Dock) => {
                (self.searching, self.may_search) = (true, true);
            }
            Command::Engine(_) | Command::Move { .. } => self.searching = false,
            _ => {}
        }
        self.acts.push(Act::Send(command));
    }
}
