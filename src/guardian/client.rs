//! The agent's side: starts the guardian, keeps it informed, and has another one started when it is
//! gone or no longer answers. Only the start blocks.

use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};
use tracing::{error, info, warn};

use super::message::{Datagram, GuardianMessage, LastWordsData};
use super::process::GUARDIAN_ARGUMENT;

/// How often the driving core must beat while there is a link; a third of the time after which the
/// guardian acts.
pub const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(100);
/// The most consecutive beats that a living guardian leaves unanswered, even on the busiest
/// machine. Counted in beats, not seconds: an agent that was itself stopped has sent no beats
/// meanwhile.
const MAX_UNANSWERED: u32 = 20;
/// An answer is a message without data.
const MAX_ANSWER_LEN: usize = 64;

/// A running guardian. If it is dropped without [`Guardian::release`], the guardian sends the last
/// words; either way its process ends.
#[derive(Debug)]
pub struct Guardian {
    starter: Starter,
    /// `None` while no guardian runs.
    socket: Option<OwnedFd>,
    /// While there is a link: the data to send on it, and the robot's socket for a later guardian.
    link: Option<Link>,
    unanswered: u32,
    given_up: bool,
}

#[derive(Debug)]
struct Link {
    words: LastWordsData,
    robot: Option<OwnedFd>,
    login: bool,
}

impl Guardian {
    /// Starts the guardian from this executable, which must be `spykee`. Blocks until the process
    /// is started: not for the driving core.
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

    /// Guards a new link: its socket, and the last words for it.
    pub fn watch(&mut self, socket: BorrowedFd<'_>, last_words: Vec<u8>) {
        self.begin(socket, last_words, false);
    }

    /// Guards a link whose login the robot has accepted, but which obeys only after its first
    /// POWER.
    pub fn watch_login(&mut self, socket: BorrowedFd<'_>, last_words: Vec<u8>) {
        self.begin(socket, last_words, true);
    }

    fn begin(&mut self, socket: BorrowedFd<'_>, last_words: Vec<u8>, login: bool) {
        let words = LastWordsData {
            rest: Vec::new(),
            last: last_words,
        };
        let robot = socket.try_clone_to_owned().ok();
        // Older answers are about an earlier link.
        self.read_answers();
        self.link = Some(Link {
            words,
            robot,
            login,
        });
        self.send_link();
    }

    /// Sends only changes to the guardian: the rest of a partly written message, then last words.
    pub fn set_last_words(&mut self, rest: &[u8], last_words: &[u8]) {
        let Some(Link { words, .. }) = &mut self.link else {
            return;
        };
        if words.rest == rest && words.last == last_words {
            return;
        }
        words.rest = rest.to_vec();
        words.last = last_words.to_vec();
        let message = GuardianMessage::LastWords(words.clone());
        self.send_message(&message);
    }

    /// Sends a beat, and checks whether the guardian answers. Returns whether it has written to the
    /// robot since the last beat.
    pub fn heartbeat(&mut self) -> bool {
        if self.socket.is_none() {
            self.adopt_replacement();
        }
        if self.link.is_none() {
            return false;
        }
        let wrote = self.read_answers();
        if self.unanswered >= MAX_UNANSWERED {
            self.handle_guardian_lost("does not answer");
        } else {
            self.unanswered += 1;
            self.send_message(&GuardianMessage::Heartbeat);
        }
        wrote
    }

    /// Ends the guard of a link that is closed and whose last words were sent.
    pub fn release(&mut self) {
        if self.link.take().is_some() {
            self.unanswered = 0;
            self.send_message(&GuardianMessage::Release);
        }
    }

    fn adopt_replacement(&mut self) {
        match self.starter.poll() {
            Started::Yes(socket) => {
                info!("another guardian process watches the robot");
                self.socket = Some(socket);
                self.unanswered = 0;
                self.send_link();
            }
            Started::NotYet => {}
            Started::Never if !self.given_up => {
                self.given_up = true;
                error!(
                    "the guardian is lost and no other one can be started; if this \
                     program is killed now, nothing stops the robot"
                );
            }
            Started::Never => {}
        }
    }

    fn send_link(&mut self) {
        let Some(link) = &self.link else {
            return;
        };
        let words = link.words.clone();
        let message = if link.login {
            GuardianMessage::Login(words)
        } else {
            GuardianMessage::Watch(words)
        };
        let sent = send(&self.socket, &message, link.robot.as_ref().map(AsFd::as_fd));
        self.lose_if(sent);
    }

    fn send_message(&mut self, message: &GuardianMessage) {
        let sent = send(&self.socket, message, None);
        self.lose_if(sent);
    }

    /// Returns whether one of the answers is that the guardian has written.
    fn read_answers(&mut self) -> bool {
        let mut buffer = [0; MAX_ANSWER_LEN];
        let mut wrote = false;
        while let Some(socket) = &self.socket {
            match GuardianMessage::receive(socket, &mut buffer) {
                Ok(Datagram::Message(answer, _)) => {
                    self.unanswered = 0;
                    wrote |= answer == GuardianMessage::Wrote;
                }
                Ok(Datagram::Nothing) => break,
                Ok(Datagram::End) => self.handle_guardian_lost("is gone"),
                Err(error) => self.handle_guardian_lost(&error.to_string()),
            }
        }
        wrote
    }

    fn lose_if(&mut self, sent: io::Result<()>) {
        match sent {
            Ok(()) => {}
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                self.handle_guardian_lost("does not answer")
            }
            Err(_) => self.handle_guardian_lost("is gone"),
        }
    }

    fn handle_guardian_lost(&mut self, what: &str) {
        if let Some(socket) = self.socket.take() {
            warn!("the guardian process {what}: starting another one");
            self.starter.replace(socket);
        }
    }
}

fn send(
    to: &Option<OwnedFd>,
    message: &GuardianMessage,
    robot: Option<BorrowedFd<'_>>,
) -> io::Result<()> {
    to.as_ref().map_or(Ok(()), |to| message.send(to, robot))
}

/// The most consecutive attempts to start another guardian.
const MAX_TRIES: u32 = 8;
/// The pause before the first attempt; each further pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// The count of attempts restarts after a guardian that has lived this long.
const GOOD_LIFE: Duration = Duration::from_secs(60);

/// Starts guardian processes on a thread, because that takes time that the driving core does not
/// have. When it is dropped the thread ends; the guardian lives on until its
/// agent is gone.
#[derive(Debug)]
pub(super) struct Starter {
    lost: SyncSender<OwnedFd>,
    started: Receiver<OwnedFd>,
}

#[derive(Debug)]
pub(super) enum Started {
    Yes(OwnedFd),
    NotYet,
    /// None will be started.
    Never,
}

impl Starter {
    /// Blocks until the first guardian's process is started.
    pub(super) fn start(executable: &Path) -> io::Result<(Starter, OwnedFd)> {
        let first = Process::start(executable)?;
        let (lost, losses) = sync_channel(1);
        let (start, started) = sync_channel(1);
        let executable = executable.to_owned();
        let (process, socket) = first;
        thread::Builder::new()
            .name("guardian".into())
            .spawn(move || replace(&executable, process, &losses, &start))?;
        Ok((Starter { lost, started }, socket))
    }

    /// Requests another guardian in place of one that is gone, or is killed because it does not
    /// answer. Never blocks. Only one request is pending at a time.
    pub(super) fn replace(&self, socket: OwnedFd) {
        let _ = self.lost.try_send(socket);
    }

    /// Whether the requested guardian runs. Never blocks.
    pub(super) fn poll(&self) -> Started {
        match self.started.try_recv() {
            Ok(socket) => Started::Yes(socket),
            Err(TryRecvError::Empty) => Started::NotYet,
            Err(TryRecvError::Disconnected) => Started::Never,
        }
    }
}

fn replace(
    executable: &Path,
    mut process: Process,
    losses: &Receiver<OwnedFd>,
    started: &SyncSender<OwnedFd>,
) {
    let mut tries = 0;
    while let Ok(socket) = losses.recv() {
        if process.began.elapsed() >= GOOD_LIFE {
            tries = 0;
        }
        process.kill();
        // Only after its death: at the end of its socket it would write to the robot.
        drop(socket);
        let (next, socket) = loop {
            if tries == MAX_TRIES {
                return;
            }
            thread::sleep(FIRST_PAUSE * 2_u32.pow(tries));
            tries += 1;
            if let Ok(next) = Process::start(executable) {
                break next;
            }
        };
        process = next;
        if started.send(socket).is_err() {
            return;
        }
    }
}

#[derive(Debug)]
struct Process {
    child: Child,
    began: Instant,
}

impl Process {
    fn start(executable: &Path) -> io::Result<(Process, OwnedFd)> {
        let flags = SocketFlags::CLOEXEC;
        let (ours, theirs) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        let child = Command::new(executable)
            .arg(GUARDIAN_ARGUMENT)
            .env_clear()
            .current_dir("/")
            .stdin(Stdio::from(theirs))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        let began = Instant::now();
        Ok((Process { child, began }, ours))
    }

    fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
