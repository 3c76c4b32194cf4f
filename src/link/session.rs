//! Establishes a session: connects, logs in, waits for the two answers that allow motion
//! (`PROTOCOL.md`, *Order after login*), and stops the tracks.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::time::{Instant, timeout_at};

use super::delivery::close_gracefully;
use super::tcp_connect::{duplicate, open_tcp};
use super::{LinkError, Options, Reader, Supervision, Target, Writer, discover};
use crate::wire::{Accepted, Command, Login, Power, Report};

/// The most reports that [`Session::early`] holds; further ones are dropped.
pub const MAX_EARLY_REPORTS: usize = 32;

/// How long the last words may take to be acknowledged when a login has failed.
const DELIVERY_TIMEOUT: Duration = Duration::from_millis(500);

/// How long discovery may take to name the connected user.
const WHO_TIMEOUT: Duration = Duration::from_secs(1);

/// A robot that has accepted the login, has sent its battery level, and whose tracks were told to
/// stop.
#[derive(Debug)]
pub struct Session {
    /// The login's answer.
    pub accepted: Accepted,
    /// The first battery level.
    pub power: Power,
    /// The robot's address.
    pub peer: SocketAddr,
    /// Other reports that came before both answers were there, in order; without video and audio.
    pub early: Vec<Report>,
    /// Receives from the robot.
    pub reader: Reader,
    /// Sends to the robot.
    pub writer: Writer,
}

/// Connects and logs in. The first command of every session is MOVE 0 0; it is written before this
/// returns. A refusal because of another user is returned with that user's name, if discovery finds
/// it within a second.
///
/// From the robot's acceptance of the login on, it is sent the newest last words of `supervision`
/// if anything fails, until the writer is given others (see [`Writer::set_last_words`]).
///
/// # Errors
/// Every kind of [`LinkError`].
pub async fn connect(
    target: &Target,
    login: &Login,
    supervision: impl Into<Supervision>,
    options: &Options,
) -> Result<Session, LinkError> {
    let stream = open_tcp(target, options).await?;
    let io = |error| LinkError::from_io(error, options.dead_after);
    let peer = stream.peer_addr().map_err(io)?;
    let direct = duplicate(&stream);
    let (reader, writer) = stream.into_split();
    let reader = Reader::new(Box::new(reader), options.dead_after);
    let mut writer = Writer::new(Box::new(writer), direct, options.dead_after);
    let supervision = supervision.into();
    writer.share_last_words(supervision.last_words());
    let limit = options.login_timeout;
    match log_in(reader, writer, peer, login, &supervision, limit).await {
        Err(LinkError::InUse { .. }) => Err(LinkError::InUse {
            by: discover::connected_user(peer, WHO_TIMEOUT).await,
        }),
        result => result,
    }
}

/// Like [`connect`], over any transport; `peer` is only passed on.
///
/// # Errors
/// Every kind of [`LinkError`] but `Unreachable`.
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
        .await_all(&mut reader, &mut writer, login, supervision, limit)
        .await
    {
        Ok((accepted, power)) => Ok(Session {
            accepted,
            power,
            peer,
            early: answers.early,
            reader,
            writer,
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

/// The reports received since the login was sent.
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
        login: &Login,
        supervision: &Supervision,
        limit: Duration,
    ) -> Result<(Accepted, Power), LinkError> {
        let deadline = Instant::now() + limit;
        writer.write(&[Command::Login(login.clone())]).await?;
        loop {
            let report = timeout_at(deadline, reader.next()).await;
            let waited = self.accepted.is_none();
            self.take(report.map_err(|_| self.late(limit))??, &login.user)?;
            let Some(accepted) = &self.accepted else {
                continue;
            };
            if waited {
                writer.arm();
                supervision.announce(writer);
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
