//! The last words: what the writer, the line and the guardian say to the robot if everything else dies.

use super::Pilot;
use super::line::Line;
use super::pulse::Pulse;
use crate::link::Writer;
use crate::wire::Command;

impl Pilot {
    /// Leaves with the writer and the line what is to be said if everything else dies.
    pub(super) fn deposit(&mut self, line: &mut Line) {
        line.set_last_words(self.renew_last_words());
        line.rest(self.released);
        if let Some(writer) = &self.writer {
            tell_guardian(&mut self.pulse, writer);
        }
    }

    /// What is to be said if everything else dies; the writer, if there is one, knows it from now on.
    pub(super) fn renew_last_words(&mut self) -> Vec<Command> {
        let last_words = self.held(&self.watchdog.last_words().commands());
        if let Some(writer) = &mut self.writer {
            writer.set_last_words(last_words.clone());
        }
        last_words
    }

    /// From now on the guardian holds the new link's last words.
    pub(super) fn guard(&mut self) {
        let guardian = self.pulse.as_mut().and_then(Pulse::guardian);
        let socket = self.writer.as_ref().and_then(Writer::socket);
        if let (Some(guardian), Some(socket), Some(writer)) = (guardian, socket, &self.writer) {
            guardian.guard(socket, writer.last_words().1);
        }
    }

    /// The link is closed and its last words are said.
    pub(super) fn release_guard(&mut self) {
        if let Some(guardian) = self.pulse.as_mut().and_then(Pulse::guardian) {
            guardian.release();
        }
    }
}

/// Has the guardian hold what this writer would say last.
pub(super) fn tell_guardian(pulse: &mut Option<Pulse>, writer: &Writer) {
    if let Some(guardian) = pulse.as_mut().and_then(Pulse::guardian) {
        let (half_out, words) = writer.last_words();
        guardian.note(half_out, &words);
    }
}
