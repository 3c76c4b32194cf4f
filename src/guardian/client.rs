//! The agent's side: starts the guardian, keeps it informed, and has another one started when it is
//! gone or no longer answers. Only the start blocks.

use std::io;
use std::net::TcpStream;
use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::Interest;
use tokio::net::UnixStream;
use tokio::time::Instant;
use tracing::{error, info, warn};

use super::message::{Datagram, GuardianMessage, LastWordsData, Route};
use super::starter::{GuardianFiles, Starter};

/// How often the driving core must beat; a third of the time after which the guardian acts.
pub const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(100);
/// So many consecutive beats without an answer, and the guardian counts as not answering: nothing may
/// drive without it for more than 2 s, and a busy machine may starve it for a while. Counted in beats,
/// not seconds: an agent that was itself stopped has sent none.
const MAX_UNANSWERED: u32 = 15;
/// So many, and it is replaced. Until then a guardian that is only slow, on a busy machine, may
/// answer again.
const GIVEN_UP: u32 = 40;
/// The gap between two beats after which unanswered ones do not count.
const STALL: Duration = Duration::from_millis(500);
/// An answer is a message without data.
const MAX_ANSWER_LEN: usize = 64;

/// What the guardian has done in the place of an agent that hung.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum GuardianAct {
    /// It has written the last words to the robot.
    Wrote,
    /// A person has told it to stop the robot.
    Stopped,
}

/// The guardian of a run. If it is dropped without [`Guardian::release`], or while a stop is owed,
/// the guardian process acts in its place before it ends.
#[derive(Debug)]
pub struct Guardian {
    starter: Starter,
    files: GuardianFiles,
    /// `None` while no guardian runs.
    socket: Option<GuardianSocket>,
    /// Kept for a later guardian, like all that follows.
    link: Option<Arc<TcpStream>>,
    /// The link obeys only after its first POWER.
    login: bool,
    words: LastWordsData,
    route: Option<Route>,
    owed: bool,
    unanswered: u32,
    last_beat: Option<Instant>,
}

impl Guardian {
    /// Starts the guardian from this executable, which must be `spykee`. Blocks until the process
    /// is started: not for the driving core. If no process can be started now, that is tried again
    /// for as long as this lives, and nothing may drive meanwhile.
    pub fn start(executable: &Path, files: GuardianFiles) -> io::Result<Guardian> {
        let (starter, first) = Starter::start(executable, files.clone())?;
        if let Err(error) = &first {
            error!("cannot start the guardian process, trying again: {error}");
        }
        Ok(Guardian {
            starter,
            files,
            socket: first.ok().map(GuardianSocket::new),
            link: None,
            login: false,
            words: LastWordsData::default(),
            route: None,
            owed: false,
            unanswered: 0,
            last_beat: None,
        })
    }

    /// Whether a guardian process runs and answers. Nothing may drive otherwise.
    pub fn is_answering(&self) -> bool {
        self.socket.is_some() && self.unanswered <= MAX_UNANSWERED
    }

    /// Sets how to dial the robot and log in again.
    pub fn set_route(&mut self, route: Route) {
        if self.route.as_ref() != Some(&route) {
            self.route = Some(route.clone());
            self.send(&GuardianMessage::Route(route));
        }
    }

    /// Sets whether a stop is owed: `true` before the first byte of a command that may move the
    /// robot, `false` when a stop was executed. While it is, a guardian whose agent is gone dials
    /// the robot until a stop is executed.
    pub fn set_debt(&mut self, owed: bool) {
        if self.owed != owed {
            self.owed = owed;
            self.send(&GuardianMessage::Debt(owed));
        }
    }

    /// Guards a new link: its socket, and the last words for it. `login`: the robot has accepted a
    /// login, but obeys only after its first POWER.
    pub fn watch(&mut self, robot: Arc<TcpStream>, last: Vec<u8>, login: bool) {
        // Older answers are about an earlier link.
        self.read_answers();
        self.words = LastWordsData {
            rest: Vec::new(),
            last,
        };
        self.link = Some(robot);
        self.login = login;
        self.send_link();
    }

    /// Sets the rest of a partly written message, and the last words; without a link, too. Sends
    /// only changes to the guardian.
    pub fn set_last_words(&mut self, rest: &[u8], last_words: &[u8]) {
        if self.words.rest == rest && self.words.last == last_words {
            return;
        }
        self.words.rest = rest.to_vec();
        self.words.last = last_words.to_vec();
        self.send(&GuardianMessage::LastWords(self.words.clone()));
    }

    /// Sends a beat, and checks whether the guardian answers. Returns what it has done in this
    /// program's place since that was last asked.
    pub fn heartbeat(&mut self, now: Instant) -> Option<GuardianAct> {
        let acted = self.check();
        // After a stall of this process, the guardian may not have had its turn either.
        let stalled = |before: Instant| now - before > STALL;
        if self.last_beat.replace(now).is_some_and(stalled) {
            self.unanswered = 0;
        }
        if self.unanswered >= GIVEN_UP {
            self.lose("does not answer");
        } else {
            self.unanswered += 1;
            self.send(&GuardianMessage::Heartbeat);
            if self.unanswered == MAX_UNANSWERED + 1 {
                warn!("the guardian process does not answer: nothing may drive until it does");
            }
        }
        acted
    }

    /// Takes in what has come from the guardian. Returns what it has done in this program's place.
    pub fn check(&mut self) -> Option<GuardianAct> {
        if self.socket.is_none()
            && let Some(socket) = self.starter.poll()
        {
            self.adopt(socket);
        }
        self.read_answers()
    }

    /// Waits for something to [check](Guardian::check). Cancel-safe.
    pub async fn changed(&mut self) {
        match &mut self.socket {
            Some(socket) => socket.readable().await,
            None => {
                let socket = self.starter.started().await;
                self.adopt(socket);
            }
        }
    }

    /// Ends the guard of a link that is closed. A debt stays.
    pub fn release(&mut self) {
        self.words.rest.clear();
        if self.link.take().is_some() {
            self.send(&GuardianMessage::Release);
        }
    }

    /// Another guardian runs: it is told everything.
    fn adopt(&mut self, socket: OwnedFd) {
        info!("another guardian process watches the robot");
        self.socket = Some(GuardianSocket::new(socket));
        self.unanswered = 0;
        self.send_all();
    }

    fn send_all(&mut self) {
        if let Some(route) = &self.route {
            self.send(&GuardianMessage::Route(route.clone()));
        }
        self.send(&GuardianMessage::Debt(self.owed));
        self.send_link();
    }

    fn send_link(&mut self) {
        let words = self.words.clone();
        let message = match &self.link {
            None => GuardianMessage::LastWords(words),
            Some(_) if self.login => GuardianMessage::Login(words),
            Some(_) => GuardianMessage::Watch(words),
        };
        if let Some(socket) = &self.socket {
            let robot = self.link.as_ref().map(|robot| robot.as_fd());
            let sent = message.send(&socket.fd, robot);
            self.lose_if(sent);
        }
    }

    fn send(&mut self, message: &GuardianMessage) {
        if let Some(socket) = &self.socket {
            let sent = message.send(&socket.fd, None);
            self.lose_if(sent);
        }
    }

    fn read_answers(&mut self) -> Option<GuardianAct> {
        let mut buffer = [0; MAX_ANSWER_LEN];
        let mut acted = None;
        while let Some(socket) = &self.socket {
            match GuardianMessage::receive(&socket.fd, &mut buffer) {
                Ok(Datagram::Message(answer, _)) => {
                    self.unanswered = 0;
                    acted = acted.max(match answer {
                        GuardianMessage::Wrote => Some(GuardianAct::Wrote),
                        GuardianMessage::Stopped => Some(GuardianAct::Stopped),
                        _ => None,
                    });
                }
                Ok(Datagram::Nothing) => break,
                Ok(Datagram::End) => self.lose("is gone"),
                Err(error) => self.lose(&error.to_string()),
            }
        }
        if acted.is_some() {
            // A person may have given it other last words meanwhile, or it has paid the debt.
            self.send(&GuardianMessage::LastWords(self.words.clone()));
            self.send(&GuardianMessage::Debt(self.owed));
        }
        acted
    }

    fn lose_if(&mut self, sent: io::Result<()>) {
        match sent {
            Ok(()) => {}
            // It does not read; unanswered beats are counted.
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => self.lose("does not answer"),
            Err(_) => self.lose("is gone"),
        }
    }

    fn lose(&mut self, what: &str) {
        if let Some(socket) = self.socket.take() {
            warn!("the guardian process {what}: nothing may drive until another one has started");
            self.unanswered = 0;
            self.starter.replace(socket.fd);
        }
    }
}

impl Drop for Guardian {
    fn drop(&mut self) {
        // Removed here, too, so that the run's folder can be removed without waiting for the
        // process.
        if let Some(path) = &self.files.stop_socket
            && self.link.is_none()
            && !self.owed
        {
            let _ = std::fs::remove_file(path);
        }
    }
}

#[derive(Debug)]
struct GuardianSocket {
    fd: OwnedFd,
    /// A duplicate, registered with the runtime when it is first waited for.
    ready: Option<UnixStream>,
}

impl GuardianSocket {
    fn new(fd: OwnedFd) -> GuardianSocket {
        GuardianSocket { fd, ready: None }
    }

    /// Waits until it is readable. Cancel-safe.
    async fn readable(&mut self) {
        if self.ready.is_none() {
            self.ready = self.register().ok();
        }
        // Without it the beats notice everything, a little later.
        let Some(ready) = &self.ready else {
            return std::future::pending().await;
        };
        if ready.readable().await.is_err() {
            return std::future::pending().await;
        }
        // All messages are read next, so that nothing is missed.
        let again = || Err::<(), _>(io::ErrorKind::WouldBlock.into());
        let _ = ready.try_io(Interest::READABLE, again);
    }

    fn register(&self) -> io::Result<UnixStream> {
        let duplicate = std::os::unix::net::UnixStream::from(self.fd.try_clone()?);
        duplicate.set_nonblocking(true)?;
        UnixStream::from_std(duplicate)
    }
}
