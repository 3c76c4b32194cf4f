//! The last words: what the writer, the line and the guardian send to the robot if all else fails.

use std::os::fd::{AsFd, OwnedFd};

use super::Pilot;
use super::line::Line;
use super::pulse::Pulse;
use crate::link::Writer;
use crate::wire::Command;

impl Pilot {
    /// Stores the current last words with the writer, the line and the guardian; a released line
    /// stops dialling.
    pub(super) fn store_last_words(&mut self, line: &mut Line) {
        let last_words = self.renew_last_words();
        if line.is_logging_in()
            && let Some(guardian) = self.pulse.as_mut().and_then(Pulse::guardian)
        {
            guardian.note(&[], &bytes_of(&last_words));
        }
        line.set_last_words(last_words);
        line.set_released(self.released);
        if let Some(writer) = &self.writer {
            tell_guardian(&mut self.pulse, writer);
        }
    }

    /// Returns the current last words and stores them with the writer, if there is one.
    pub(super) fn renew_last_words(&mut self) -> Vec<Command> {
        let last_words = self.replace_while_halted(&self.watchdog.last_words().commands());
        if let Some(writer) = &mut self.writer {
            writer.set_last_words(last_words.clone());
        }
        last_words
    }

    /// Gives the guardian the socket of a link whose login the robot has accepted, and its last
    /// words; `None`: that link has ended.
    pub(super) fn guard_login(&mut self, socket: Option<OwnedFd>) {
        let last_words = bytes_of(&self.renew_last_words());
        let Some(guardian) = self.pulse.as_mut().and_then(Pulse::guardian) else {
            return;
        };
        match socket {
            Some(socket) => guardian.guard_login(socket.as_fd(), last_words),
            None => guardian.release(),
        }
    }

    /// Gives the new link and its last words to the guardian.
    pub(super) fn guard(&mut self) {
        let guardian = self.pulse.as_mut().and_then(Pulse::guardian);
        let socket = self.writer.as_ref().and_then(Writer::socket);
        if let (Some(guardian), Some(socket), Some(writer)) = (guardian, socket, &self.writer) {
            guardian.guard(socket, writer.last_words().1);
        }
    }

    /// Tells the guardian that the link is closed and its last words were sent.
    pub(super) fn release_guard(&mut self) {
        if let Some(guardian) = self.pulse.as_mut().and_then(Pulse::guardian) {
            guardian.release();
        }
    }
}

fn bytes_of(commands: &[Command]) -> Vec<u8> {
    commands.iter().flat_map(Command::to_bytes).collect()
}

/// Gives the guardian the data that this writer would send last.
pub(super) fn tell_guardian(pulse: &mut Option<Pulse>, writer: &Writer) {
    if let Some(guardian) = pulse.as_mut().and_then(Pulse::guardian) {
        let (partly_written, words) = writer.last_words();
        guardian.note(partly_written, &words);
    }
}
