//! How a script ends. There are two ways. A script that is asked to stop has its tasks cancelled;
//! they may clean up, and its `script.on_stop` functions run. A script that is killed runs no
//! further line, and the output of its last slice is discarded, except log lines, parameters and
//! saved pictures.

use std::time::Duration;

use super::failure::ScriptExit;
use super::life::{Life, Stopping};
use super::output::{Level, QueuePosition};
use super::state::State;
use super::task::Wait;
use crate::robot::{EndReason, Intent, MotionId};

/// Time limit for clean-up and `script.on_stop` together.
const STOP_TIME: Duration = Duration::from_millis(500);

/// The state before a slice, to undo the slice if the script is killed in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SliceStart {
    output: QueuePosition,
    motion: Option<MotionId>,
}

impl State {
    pub(super) fn is_running(&self) -> bool {
        matches!(self.life, Life::Running)
    }

    pub(super) fn has_ended(&self) -> bool {
        matches!(self.life, Life::Ended(_))
    }

    /// Records the state before a slice.
    pub(super) fn slice_start(&self) -> SliceStart {
        SliceStart {
            output: self.output.position(),
            motion: self.motion.current(),
        }
    }

    /// Asks the script to stop: its motion ends now, every task is cancelled, and nothing new can
    /// be started.
    pub(super) fn begin_stop(&mut self, reason: EndReason, message: Option<String>) {
        if !self.is_running() {
            return;
        }
        self.life = Life::Stopping(Stopping {
            exit: ScriptExit { reason, message },
            deadline: self.now + STOP_TIME,
            spent: Duration::ZERO,
        });
        self.cancel_all();
    }

    /// Ends the motion now, cancels every task and removes every subscription.
    pub(super) fn cancel_all(&mut self) {
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

    /// Counts the real time of a slice while the script is stopping.
    pub(super) fn count_stopping_time(&mut self, time: Duration) {
        if let Life::Stopping(stopping) = &mut self.life {
            stopping.spent += time;
        }
    }

    /// Whether the time limit for stopping has passed.
    pub(super) fn is_out_of_time(&self) -> bool {
        match &self.life {
            Life::Stopping(stopping) => {
                self.now >= stopping.deadline || stopping.spent >= STOP_TIME
            }
            _ => false,
        }
    }

    /// Ends a script that was asked to stop.
    pub(super) fn end_stopped(&mut self) {
        if let Life::Stopping(stopping) = &self.life {
            let exit = stopping.exit.clone();
            self.cancel_docking();
            self.end(exit);
        }
    }

    /// Kills the script and undoes what it did since `before`. A script that was already stopping
    /// keeps its original reason.
    pub(super) fn kill(&mut self, reason: EndReason, message: Option<String>, before: SliceStart) {
        let exit = match &self.life {
            Life::Running => ScriptExit { reason, message },
            Life::Stopping(stopping) => {
                let exit = stopping.exit.clone();
                let text = message.unwrap_or_else(|| reason.sentence().to_owned());
                self.log(Level::Warn, &format!("while stopping: {text}"));
                exit
            }
            Life::Ended(_) => return,
        };
        self.output.withdraw_since(before.output);
        let _ = self.motion.release_any();
        if let Some(motion) = before.motion {
            self.output.send(Intent::Release { motion });
        }
        self.cancel_docking();
        self.end(exit);
    }

    fn cancel_docking(&mut self) {
        let docks = |wait: &Wait| matches!(wait, Wait::Dock(_));
        if !self.tasks.waiting_for(docks).is_empty() {
            self.output.send(Intent::CancelDock);
        }
    }

    fn end(&mut self, exit: ScriptExit) {
        self.tasks.clear();
        self.groups.clear();
        self.subscriptions.clear();
        self.exit.stop_handlers.clear();
        self.modules.clear();
        self.frames.newest = None;
        if let Some(text) = self.frames.damage.rest() {
            self.log(Level::Warn, &text);
        }
        self.output.report_dropped();
        self.life = Life::Ended(exit);
    }
}
