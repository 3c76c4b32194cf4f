//! The agent's side: starts the guardian and keeps it informed. Nothing here waits.

use std::io;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};
use tracing::error;

use super::note::{Note, Words};
use super::process::GUARDIAN_ARGUMENT;

/// How often the driving core must beat while there is a link; a third of the guardian's patience.
pub const BEAT: Duration = Duration::from_millis(100);

/// A running guardian. When it is dropped without [`Guardian::release`] the guardian says the last
/// words; either way it ends.
#[derive(Debug)]
pub struct Guardian {
    socket: OwnedFd,
    /// What it was told last, while it guards a link.
    told: Option<Words>,
    lost: bool,
}

impl Guardian {
    /// Starts the guardian's process from this executable, which must be `spykee`. Waits for the new
    /// process: not to be called on the driving core.
    ///
    /// # Errors
    /// Whatever the system says; then there is no guardian.
    pub fn start(executable: &Path) -> io::Result<Guardian> {
        let flags = SocketFlags::CLOEXEC;
        let (ours, theirs) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        // Not waited for: it outlives the agent, or ends when the agent lets go of the socket.
        Command::new(executable)
            .arg(GUARDIAN_ARGUMENT)
            .env_clear()
            .current_dir("/")
            .stdin(Stdio::from(theirs))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        Ok(Guardian {
            socket: ours,
            told: None,
            lost: false,
        })
    }

    /// Guards a new link: its socket, and what to say on it.
    pub fn guard(&mut self, socket: BorrowedFd<'_>, last_words: Vec<u8>) {
        let words = Words {
            rest: Vec::new(),
            last: last_words,
        };
        self.told = Some(words.clone());
        self.tell(&Note::Guard(words), Some(socket));
    }

    /// Tells what is to be said from now on: the rest of a message that is half out, then the last
    /// words. Sends only changes.
    pub fn note(&mut self, rest: &[u8], last_words: &[u8]) {
        let Some(told) = &mut self.told else {
            return;
        };
        if told.rest == rest && told.last == last_words {
            return;
        }
        let words = Words {
            rest: rest.to_vec(),
            last: last_words.to_vec(),
        };
        told.clone_from(&words);
        self.tell(&Note::Words(words), None);
    }

    /// The driving core is alive.
    pub fn beat(&mut self) {
        if self.told.is_some() {
            self.tell(&Note::Beat, None);
        }
    }

    /// The link is closed, and what was to be said on it has been said.
    pub fn release(&mut self) {
        if self.told.take().is_some() {
            self.tell(&Note::Release, None);
        }
    }

    fn tell(&mut self, note: &Note, socket: Option<BorrowedFd<'_>>) {
        if self.lost {
            return;
        }
        if let Err(error) = note.send(&self.socket, socket) {
            self.lost = true;
            error!(
                "the guardian process is gone ({error}): if this program is killed now, nobody \
                 stops the robot; start the run again"
            );
        }
    }
}
