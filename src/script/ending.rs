//! How a script's life ends. There are two ways: asked to stop, it is cancelled, may clean up and
//! say farewell; killed, no line of it runs again and nothing that it did in its last slice leaves.

use std::time::Duration;

use super::failure::Ending;
use super::life::{Life, Stopping};
use super::output::{Level, Mark};
use super::state::State;
use super::task::Wait;
use crate::robot::{EndReason, Intent, MotionId};

/// How long cleaning up and `script.on_stop` may take together.
const STOP_TIME: Duration = Duration::from_millis(500);

/// What must be taken back if the slice that now begins is the last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Before {
    mark: Mark,
    motion: Option<MotionId>,
}

impl State {
    pub(super) fn is_running(&self) -> bool {
        matches!(self.life, Life::Running)
    }

    pub(super) fn has_ended(&self) -> bool {
        matches!(self.life, Life::Ended(_))
    }

    /// Before a slice.
    pub(super) fn before(&self) -> Before {
        Before {
            mark: self.output.mark(),
            motion: self.motion.current(),
        }
    }

    /// Asks the script to stop: its motion ends now, every task is cancelled, nothing new begins.
    pub(super) fn begin_stop(&mut self, reason: EndReason, message: Option<String>) {
        if !self.is_running() {
            return;
        }
        self.life = Life::Stopping(Stopping {
            ending: Ending { reason, message },
            deadline: self.now + STOP_TIME,
            spent: Duration::ZERO,
        });
        self.halt();
    }

    /// Its motion ends now, every task is cancelled and every subscription is off.
    pub(super) fn halt(&mut self) {
        if let Some(motion) = self.motion.release_any() {
            self.output.send(Intent::Release { motion });
        }
        let subscriptions: Vec<_> = self.subscriptions.keys().copied().collect();
        for id in subscriptions {
            self.unsubscribe(id);
        }
        for id in self.tasks.ids() {
            self.cancel(id);
        }
    }

    /// Counts the real time of a slice while stopping.
    pub(super) fn spend(&mut self, time: Duration) {
        if let Life::Stopping(stopping) = &mut self.life {
            stopping.spent += time;
        }
    }

    /// Whether the last half second is over.
    pub(super) fn is_out_of_time(&self) -> bool {
        match &self.life {
            Life::Stopping(stopping) => {
                self.now >= stopping.deadline || stopping.spent >= STOP_TIME
            }
            _ => false,
        }
    }

    /// The end of a script that was asked to stop.
    pub(super) fn end_stopped(&mut self) {
        if let Life::Stopping(stopping) = &self.life {
            let ending = stopping.ending.clone();
            self.give_up_docking();
            self.end(ending);
        }
    }

    /// Kills the script: what it did since `before` never happened. A script that was stopping
    /// keeps the reason for that.
    pub(super) fn kill(&mut self, reason: EndReason, message: Option<String>, before: Before) {
        let ending = match &self.life {
            Life::Running => Ending { reason, message },
            Life::Stopping(stopping) => {
                let ending = stopping.ending.clone();
                let text = message.unwrap_or_else(|| reason.sentence().to_owned());
                self.log(Level::Warn, &format!("while stopping: {text}"));
                ending
            }
            Life::Ended(_) => return,
        };
        self.output.withdraw_since(before.mark);
        let _ = self.motion.release_any();
        if let Some(motion) = before.motion {
            self.output.send(Intent::Release { motion });
        }
        self.give_up_docking();
        self.end(ending);
    }

    fn give_up_docking(&mut self) {
        let docks = |wait: &Wait| matches!(wait, Wait::Dock(_));
        if !self.tasks.waiting_for(docks).is_empty() {
            self.output.send(Intent::CancelDock);
        }
    }

    fn end(&mut self, ending: Ending) {
        self.tasks.clear();
        self.groups.clear();
        self.subscriptions.clear();
        self.exit.farewells.clear();
        self.modules.clear();
        self.sight.newest = None;
        if let Some(text) = self.sight.damage.rest() {
            self.log(Level::Warn, &text);
        }
        self.output.say_folded();
        self.life = Life::Ended(ending);
    }
}
