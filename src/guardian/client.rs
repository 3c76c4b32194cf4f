//! The agent's side: starts the guardian, keeps it informed, and has another one started when it is
//! gone or answers no more. But for the start nothing here waits.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::time::Duration;

use tracing::{error, info, warn};

use super::note::{Note, Received, Words};
use super::starter::{Started, Starter};

/// How often the driving core must beat while there is a link; a third of the time after which the guardian acts.
pub const BEAT: Duration = Duration::from_millis(100);
/// Beats in a row that a living guardian leaves without an answer on the busiest machine. Beats and
/// not seconds: an agent that was stopped itself has not beaten meanwhile.
const MOST_UNANSWERED: u32 = 20;
/// An answer is a beat.
const MAX_ANSWER_LEN: usize = 64;

/// A running guardian. When it is dropped without [`Guardian::release`] the guardian says the last
/// words; either way it ends.
#[derive(Debug)]
pub struct Guardian {
    starter: Starter,
    /// `None` while there is no guardian.
    socket: Option<OwnedFd>,
    /// While there is a link: what to say on it, and the robot's socket for a guardian that comes later.
    link: Option<Link>,
    unanswered: u32,
    given_up: bool,
}

#[derive(Debug)]
struct Link {
    words: Words,
    robot: Option<OwnedFd>,
}

impl Guardian {
    /// Starts the guardian's process from this executable, which must be `spykee`. Waits for the new
    /// process: not to be called on the driving core.
    ///
    /// # Errors
    /// Whatever the system says; then there is no guardian.
    pub fn start(executable: &Path) -> io::Result<Guardian> {
        let (starter, socket) = Starter::start(executable)?;
        Ok(Guardian {
            starter,
            socket: Some(socket),
            link: None,
            unanswered: 0,
            given_up: false,
        })
    }

    /// Guards a new link: its socket, and what to say on it.
    pub fn guard(&mut self, socket: BorrowedFd<'_>, last_words: Vec<u8>) {
        let words = Words {
            rest: Vec::new(),
            last: last_words,
        };
        let robot = socket.try_clone_to_owned().ok();
        self.link = Some(Link { words, robot });
        self.tell_of_link();
    }

    /// Tells what is to be said from now on: the rest of a message that is half out, then the last
    /// words. Sends only changes.
    pub fn note(&mut self, rest: &[u8], last_words: &[u8]) {
        let Some(Link { words, .. }) = &mut self.link else {
            return;
        };
        if words.rest == rest && words.last == last_words {
            return;
        }
        words.rest = rest.to_vec();
        words.last = last_words.to_vec();
        let note = Note::Words(words.clone());
        self.tell(&note);
    }

    /// The driving core is alive; and is the guardian?
    pub fn beat(&mut self) {
        if self.socket.is_none() {
            self.take_another();
        }
        if self.link.is_none() {
            return;
        }
        self.hear_answers();
        if self.unanswered >= MOST_UNANSWERED {
            return self.lose("does not answer");
        }
        self.unanswered += 1;
        self.tell(&Note::Beat);
    }

    /// The link is closed, and what was to be said on it has been said.
    pub fn release(&mut self) {
        if self.link.take().is_some() {
            self.unanswered = 0;
            self.tell(&Note::Release);
        }
    }

    fn take_another(&mut self) {
        match self.starter.poll() {
            Started::Yes(socket) => {
                info!("another guardian process watches over the robot");
                self.socket = Some(socket);
                self.unanswered = 0;
                self.tell_of_link();
            }
            Started::NotYet => {}
            Started::Never if !self.given_up => {
                self.given_up = true;
                error!(
                    "this run has no guardian any more: no other one can be started; if this \
                     program is killed now, nothing stops the robot"
                );
            }
            Started::Never => {}
        }
    }

    fn tell_of_link(&mut self) {
        let Some(Link { words, robot }) = &self.link else {
            return;
        };
        let note = Note::Guard(words.clone());
        let sent = send(&self.socket, &note, robot.as_ref().map(AsFd::as_fd));
        self.lose_if(sent);
    }

    fn tell(&mut self, note: &Note) {
        let sent = send(&self.socket, note, None);
        self.lose_if(sent);
    }

    fn hear_answers(&mut self) {
        let mut buffer = [0; MAX_ANSWER_LEN];
        while let Some(socket) = &self.socket {
            match Note::receive(socket, &mut buffer) {
                Ok(Received::Note(..)) => self.unanswered = 0,
                Ok(Received::Nothing) => return,
                Ok(Received::End) => return self.lose("is gone"),
                Err(error) => return self.lose(&error.to_string()),
            }
        }
    }

    fn lose_if(&mut self, sent: io::Result<()>) {
        match sent {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => self.lose("does not answer"),
            Err(_) => self.lose("is gone"),
        }
    }

    fn lose(&mut self, what: &str) {
        if let Some(socket) = self.socket.take() {
            warn!("the guardian process {what}: starting another one");
            self.starter.replace(socket);
        }
    }
}

/// Where there is no guardian nothing is sent.
fn send(to: &Option<OwnedFd>, note: &Note, robot: Option<BorrowedFd<'_>>) -> io::Result<()> {
    to.as_ref().map_or(Ok(()), |to| note.send(to, robot))
}
