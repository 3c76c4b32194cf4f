//! Establishes a session: connects, logs in, waits for the two answers that allow motion
//! (`PROTOCOL.md`, *Order after login*), and stops the tracks.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use socket2::SockRef;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpSocket, TcpStream};
use tokio::sync::watch;
use tokio::time::{Instant, sleep, timeout, timeout_at};

use super::writer::Confirmation;
use super::{LinkError, Reader, Target, Writer, discover};
use crate::robot_socket::{self, FormerLink};
use crate::wire::{Accepted, Command, Login, Power, Report};

/// The most reports that [`Session::early`] holds; further ones are dropped.
pub const MAX_EARLY_REPORTS: usize = 32;

/// How long the last words may take to be confirmed when a login has failed.
const DELIVERY_TIMEOUT: Duration = Duration::from_millis(500);

/// The longest wait for a TCP connection while a stop is owed: the system repeats a lost request
/// only after a second.
const HURRIED_CONNECT: Duration = Duration::from_secs(1);

/// The longest wait for the answer to a login while a stop is owed.
const HURRIED_ANSWER: Duration = Duration::from_millis(1500);
/// How long a connection from a former link's port may take; less than the system's first repetition.
const RESET_TIME: Duration = Duration::from_millis(300);

/// How long discovery may take to name the connected user while a stop is owed, and else.
const HURRIED_WHO: Duration = Duration::from_millis(200);
const WHO_TIMEOUT: Duration = Duration::from_secs(1);

/// Time limits of connecting, logging in and giving up.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The longest wait for a TCP connection, name lookup included.
    pub connect_timeout: Duration,
    /// The longest wait, from the login on, for AUTH_REPLY and the first POWER.
    pub login_timeout: Duration,
    /// The pause before the first reconnect after a lost link.
    pub first_pause: Duration,
    /// Pauses grow up to this.
    pub longest_pause: Duration,
    /// A write that the robot does not acknowledge within this time means a dead link.
    pub dead_after: Duration,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            connect_timeout: Duration::from_secs(5),
            login_timeout: Duration::from_secs(10),
            first_pause: Duration::from_millis(500),
            longest_pause: Duration::from_secs(30),
            dead_after: Duration::from_secs(3),
        }
    }
}

/// A robot that has accepted the login, has sent its battery level, and whose tracks were told to
/// stop.
#[derive(Debug)]
pub struct Session {
    pub accepted: Accepted,
    pub power: Power,
    pub peer: SocketAddr,
    /// Other reports that came before both answers were there, in order; without video and audio.
    pub early: Vec<Report>,
    pub reader: Reader,
    pub writer: Writer,
    /// How it was logged in to.
    pub login: Login,
}

/// Connects and logs in. The first command of every session is MOVE 0 0; it is written before this
/// returns. A refusal because of another user is returned with that user's name, if discovery finds
/// it within a second.
///
/// From the robot's acceptance of the login on, it is sent the newest last words of `supervision`
/// if anything fails, until the writer is given others (see [`Writer::set_last_words`]).
pub async fn connect(
    target: &Target,
    login: &Login,
    supervision: impl Into<Supervision>,
    options: &Options,
) -> Result<Session, LinkError> {
    let supervision = supervision.into();
    let mut options = options.clone();
    if supervision.hurried {
        options.connect_timeout = options.connect_timeout.min(HURRIED_CONNECT);
    }
    let options = &options;
    let former = match supervision.former {
        Some(former) if supervision.hurried => replace(former, options).await,
        _ => None,
    };
    let stream = match former {
        Some(stream) => stream,
        None => open_tcp(target, options).await?,
    };
    let io = |error| LinkError::from_io(error, options.dead_after);
    let peer = stream.peer_addr().map_err(io)?;
    let direct = duplicate(&stream).map_err(LinkError::Unguarded)?;
    // A dropped half does not shut the socket down: another process may have to go on with its
    // duplicate.
    let (reader, writer) = tokio::io::split(stream);
    let reader = Reader::new(Box::new(reader), options.dead_after);
    let mut writer = Writer::new(Box::new(writer), Some(direct), options.dead_after);
    writer.share_last_words(supervision.last_words());
    let limit = options.login_timeout;
    match log_in(reader, writer, peer, login, &supervision, limit).await {
        Err(LinkError::InUse { .. }) => {
            let limit = if supervision.hurried {
                HURRIED_WHO
            } else {
                WHO_TIMEOUT
            };
            let by = discover::connected_user(peer, limit).await;
            Err(LinkError::InUse { by })
        }
        result => result,
    }
}

/// Like [`connect`], over any transport; `peer` is only passed on.
pub async fn open(
    reader: impl AsyncRead + Unpin + Send + 'static,
    writer: impl AsyncWrite + Unpin + Send + 'static,
    peer: SocketAddr,
    login: &Login,
    supervision: impl Into<Supervision>,
    options: &Options,
) -> Result<Session, LinkError> {
    let reader = Reader::new(Box::new(reader), options.dead_after);
    let mut writer = Writer::new(Box::new(writer), None, options.dead_after);
    let supervision = supervision.into();
    writer.share_last_words(supervision.last_words());
    let limit = options.login_timeout;
    log_in(reader, writer, peer, login, &supervision, limit).await
}

async fn log_in(
    mut reader: Reader,
    mut writer: Writer,
    peer: SocketAddr,
    login: &Login,
    supervision: &Supervision,
    limit: Duration,
) -> Result<Session, LinkError> {
    let mut answers = Answers::default();
    match answers
        .await_all(&mut reader, &mut writer, peer, login, supervision, limit)
        .await
    {
        Ok((accepted, power)) => Ok(Session {
            accepted,
            power,
            peer,
            early: answers.early,
            reader,
            writer,
            login: login.clone(),
        }),
        Err(error) => {
            // The robot has accepted the login, so it may be driving.
            if answers.accepted.is_some() {
                writer.send_last_words();
                close_gracefully(reader, writer, DELIVERY_TIMEOUT).await;
                supervision.withdraw();
            }
            Err(error)
        }
    }
}

#[derive(Default)]
struct Answers {
    accepted: Option<Accepted>,
    power: Option<Power>,
    early: Vec<Report>,
}

impl Answers {
    /// Sends the login and waits for the answers, then stops the tracks.
    async fn await_all(
        &mut self,
        reader: &mut Reader,
        writer: &mut Writer,
        peer: SocketAddr,
        login: &Login,
        supervision: &Supervision,
        limit: Duration,
    ) -> Result<(Accepted, Power), LinkError> {
        let deadline = Instant::now() + limit;
        writer.write(&[Command::Login(login.clone())]).await?;
        loop {
            let waited = self.accepted.is_none();
            let until = if waited && supervision.hurried {
                deadline.min(deadline - limit + HURRIED_ANSWER)
            } else {
                deadline
            };
            let report = timeout_at(until, reader.next()).await;
            self.take(report.map_err(|_| self.late(limit))??, &login.user)?;
            let Some(accepted) = &self.accepted else {
                continue;
            };
            if waited {
                writer.arm();
                supervision.announce(writer, peer, login);
            }
            if let Some(power) = self.power {
                writer.write(&[Command::STOP]).await?;
                return Ok((accepted.clone(), power));
            }
        }
    }

    fn take(&mut self, report: Report, user: &str) -> Result<(), LinkError> {
        match report {
            Report::Accepted(accepted) => self.accepted = Some(accepted),
            Report::Refused(refusal) => return Err(LinkError::from_refusal(refusal, user)),
            Report::Power(power) => self.power = Some(power),
            Report::Video(_) | Report::Audio(_) => {}
            other if self.early.len() < MAX_EARLY_REPORTS => self.early.push(other),
            _ => {}
        }
        Ok(())
    }

    /// The error that a missing answer means.
    fn late(&self, after: Duration) -> LinkError {
        if self.accepted.is_some() {
            return LinkError::NoPower { after };
        }
        LinkError::TimedOut {
            what: "the answer to the login",
            after,
        }
    }
}

/// A login that the robot has accepted; it obeys only after its first POWER.
#[derive(Debug, Clone)]
pub struct AcceptedLogin {
    pub socket: Arc<std::net::TcpStream>,
    pub peer: SocketAddr,
    /// How it was logged in to.
    pub login: Login,
}

/// A caller's hold on a login in progress. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Supervision {
    last_words: watch::Receiver<Vec<Command>>,
    /// Gives up a connection sooner, because a stop is owed: the robot may be in reach again.
    pub hurried: bool,
    /// Resets this link at the robot first if a stop is owed.
    pub former: Option<FormerLink>,
    accepted: watch::Sender<Option<AcceptedLogin>>,
}

impl Supervision {
    /// With these last words: the newest ones count, also while a login is in progress.
    pub fn new(last_words: watch::Receiver<Vec<Command>>) -> Supervision {
        Supervision {
            last_words,
            hurried: false,
            former: None,
            accepted: watch::Sender::new(None),
        }
    }

    /// The login from the robot's acceptance on, for a process that sends the last words if this one
    /// cannot; `None` again when the login has failed.
    pub fn accepted(&self) -> watch::Receiver<Option<AcceptedLogin>> {
        self.accepted.subscribe()
    }

    pub(super) fn last_words(&self) -> watch::Receiver<Vec<Command>> {
        self.last_words.clone()
    }

    /// The robot has accepted the login of this link.
    pub(super) fn announce(&self, writer: &Writer, peer: SocketAddr, login: &Login) {
        if let Some(socket) = writer.socket() {
            let login = login.clone();
            self.accepted.send_replace(Some(AcceptedLogin {
                socket,
                peer,
                login,
            }));
        }
    }

    /// The link has ended, and its last words were sent.
    pub(super) fn withdraw(&self) {
        self.accepted
            .send_if_modified(|login| login.take().is_some());
    }
}

/// Last words that do not change during the login.
impl From<Vec<Command>> for Supervision {
    fn from(last_words: Vec<Command>) -> Supervision {
        Supervision::new(watch::Sender::new(last_words).subscribe())
    }
}

/// Resets a former link at the robot, or connects if the robot has forgotten it. `None` if there is
/// no connection within [`RESET_TIME`], or the port is in use here.
async fn replace(former: FormerLink, options: &Options) -> Option<TcpStream> {
    let socket = former.open(options.dead_after).ok()?;
    let connecting = TcpSocket::from_std_stream(socket.into()).connect(former.peer);
    timeout(RESET_TIME, connecting).await.ok()?.ok()
}

/// Connects, and sets the socket's options before a byte is sent.
pub(super) async fn open_tcp(target: &Target, options: &Options) -> Result<TcpStream, LinkError> {
    let connecting = TcpStream::connect((target.host.as_str(), target.port));
    let connected = timeout(options.connect_timeout, connecting).await;
    let unreachable = |source| LinkError::Unreachable {
        target: target.clone(),
        source,
    };
    let stream = connected
        .map_err(|_| LinkError::TimedOut {
            what: "a connection",
            after: options.connect_timeout,
        })?
        .map_err(unreachable)?;
    robot_socket::set_options(&stream, options.dead_after).map_err(unreachable)?;
    Ok(stream)
}

/// Duplicates the socket, for writes outside a runtime and for the guardian process.
fn duplicate(stream: &TcpStream) -> io::Result<Arc<std::net::TcpStream>> {
    let duplicate = SockRef::from(stream).try_clone()?;
    Ok(Arc::new(duplicate.into()))
}

/// How long the robot may take to close its half, once it has acknowledged everything.
const LINGER: Duration = Duration::from_millis(300);

/// How far the last commands of a connection have come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// The robot's program has executed them: it has answered a question that followed them.
    Executed,
    /// The robot's system has acknowledged them; its program answers no question.
    Acknowledged,
    /// Neither: the robot may be driving.
    NotConfirmed {
        /// How long the wait was.
        after: Duration,
    },
    /// The robot was not driving, and has not confirmed that it still stands.
    NotDriving,
    /// There was no connection, and the robot was not driving.
    Offline,
    /// There was no connection, and the robot may be driving.
    OutOfReach,
}

impl Delivery {
    /// Whether the robot may still be driving.
    pub fn is_owed(self) -> bool {
        matches!(self, Delivery::NotConfirmed { .. } | Delivery::OutOfReach)
    }
}

impl fmt::Display for Delivery {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Delivery::Executed => f.write_str("the robot has executed the stop"),
            Delivery::Acknowledged => f.write_str(
                "the robot's side has acknowledged the stop; its program does not say whether it has executed it",
            ),
            Delivery::NotConfirmed { after } => write!(
                f,
                "the robot has not confirmed the stop within {:.1} s: it may be driving",
                after.as_secs_f64()
            ),
            Delivery::NotDriving => {
                f.write_str("the robot was not driving; it has not confirmed the last stop")
            }
            Delivery::Offline => {
                f.write_str("the robot was out of reach at the end: no stop was sent")
            }
            Delivery::OutOfReach => {
                f.write_str("the robot is out of reach, and may be driving: no stop could be sent")
            }
        }
    }
}

/// How often to check whether the robot's system has acknowledged everything.
const RECHECK: Duration = Duration::from_millis(10);

/// Ends a connection: asks the robot's program whether it has executed what was sent, and waits up to
/// `limit` for the answer. Queued speech is dropped. Send the last words before. If they are not
/// confirmed, the writer's drop sends them again.
pub async fn close_gracefully(mut reader: Reader, mut writer: Writer, limit: Duration) -> Delivery {
    writer.drop_audio();
    let delivery = confirm(&mut reader, &mut writer, limit).await;
    if !delivery.is_owed() {
        hang_up(reader, writer).await;
    }
    delivery
}

async fn confirm(reader: &mut Reader, writer: &mut Writer, limit: Duration) -> Delivery {
    let began = Instant::now();
    let not_confirmed = Delivery::NotConfirmed { after: limit };
    if writer.ask(began).is_err() {
        return not_confirmed;
    }
    let mut reads = true;
    loop {
        let now = Instant::now();
        match writer.confirmation(now) {
            Confirmation::Executed => return Delivery::Executed,
            Confirmation::Acknowledged => return Delivery::Acknowledged,
            Confirmation::Received if now >= began + limit => return Delivery::Acknowledged,
            _ if now >= began + limit => return not_confirmed,
            _ => {}
        }
        tokio::select! {
            biased;
            report = reader.next(), if reads => match report {
                Ok(report) => writer.answer(&report, now),
                // A robot that has only closed its half may still acknowledge ours.
                Err(LinkError::Closed) => reads = false,
                Err(_) => return not_confirmed,
            },
            written = writer.progress() => if written.is_err() {
                return not_confirmed;
            },
            () = sleep(RECHECK) => {}
        }
    }
}

/// Closes a connection: the write half first, then, when the robot has closed its half or has had
/// enough time for that, the read half, because closing a socket with unread data resets the
/// connection and discards what is not acknowledged.
pub async fn hang_up(mut reader: Reader, mut writer: Writer) {
    let hanging_up = async {
        writer.shut_down().await;
        reader.discard().await
    };
    let _ = timeout(LINGER, hanging_up).await;
}
