//! Short sessions with the robot that do not move it.

use std::time::Duration;

use bytes::Bytes;
use tokio::time::{Instant, timeout_at};

use crate::cli::connection::RobotTarget;
use crate::cli::interrupt::interruption;
use crate::cli::running::refuse_if_in_use;
use crate::cli::settings::CommandSettings;
use crate::cli::startup::is_stopped;
use crate::cli::{ConnectionArgs, Exit, Failure, block_on};
use crate::config::Config;
use crate::link::{LinkError, Session, close_gracefully};
use crate::pilot::{DELIVERY, Delivery};
use crate::robot::{Battery, Streams};
use crate::safety::{Act, Fact, Watchdog};
use crate::wire::{Command, Report};

/// Timeout for the first part of a reply.
const REPLY_TIMEOUT: Duration = Duration::from_secs(3);
/// A text in several messages has no end mark: it is complete when no further message arrives for
/// this long.
const QUIET: Duration = Duration::from_millis(400);
const MAX_TEXT: usize = 1 << 20;
const MAX_MESSAGES: usize = 1000;

/// A session with the robot, which has been told to stop or to search for its station.
pub(in crate::cli) struct RobotSession {
    pub(in crate::cli) link: Session,
    pub(in crate::cli) simulated: bool,
    pub(super) streams: Streams,
    /// Whether a command was sent that must be acknowledged.
    must_confirm: bool,
}

/// Logs in, runs the job, and disconnects when the robot's side has acknowledged all commands. A
/// terminating signal ends the job in the same way.
///
/// # Errors
/// The robot cannot be reached, the job fails, or commands are not acknowledged of which one was
/// sent with [`RobotSession::send_confirmed`].
pub(super) fn with_session(
    connection: &ConnectionArgs,
    settings: &CommandSettings,
    job: impl AsyncFnOnce(&mut RobotSession) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let target = connection.resolve(settings, rand::random())?;
    block_on(async {
        let mut interrupted = std::pin::pin!(interruption()?);
        let mut session = tokio::select! {
            biased;
            () = &mut interrupted => return Ok(Exit::Interrupted),
            session = RobotSession::begin(&target) => session?,
        };
        let done = tokio::select! {
            biased;
            () = &mut interrupted => Ok(Exit::Interrupted),
            done = job(&mut session) => done,
        };
        let arrived = session.end().await;
        let exit = done?;
        arrived.map(|()| exit)
    })?
}

/// Like [`with_session`], for commands that a run cannot carry out: refused while one uses the robot.
pub(super) fn with_exclusive_session(
    connection: &ConnectionArgs,
    settings: &CommandSettings,
    job: impl AsyncFnOnce(&mut RobotSession) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    refuse_if_in_use(connection, settings)?;
    with_session(connection, settings, job)
}

/// Sends the commands and sets the last words that the watchdog's rules require after a login.
/// Every login begins with a stop, which may have ended the search for the station of a robot with
/// a low battery.
async fn send_home_if_low(session: &mut Session, config: &Config) -> Result<(), LinkError> {
    let (watchdog, acts) = watchdog_after_login(session, config);
    let commands: Vec<Command> = acts.iter().filter_map(Act::command).collect();
    session
        .writer
        .set_last_words(watchdog.last_words().commands());
    session.writer.write(&commands).await?;
    if watchdog.low().is_some() && !watchdog.docked() {
        let level = Battery::reported(session.power).level();
        tracing::warn!(
            "the battery is low ({level}): the robot was told to search for its station; \
             `spykee robot dock` waits until it is there"
        );
    }
    Ok(())
}

/// The watchdog at the beginning of this session, and what it wants done.
pub(super) fn watchdog_after_login(session: &Session, config: &Config) -> (Watchdog, Vec<Act>) {
    let now = Instant::now();
    let mut watchdog = Watchdog::new(config.watchdog.clone(), now);
    let docked = session.accepted.docked;
    let power = session.power;
    let acts = watchdog.handle(Fact::LinkUp { docked, power }, now);
    (watchdog, acts)
}

impl RobotSession {
    pub(in crate::cli) async fn begin(target: &RobotTarget) -> Result<RobotSession, LinkError> {
        let mut link = target.connect().await?;
        if !is_stopped(&target.config, target.sim.is_some()) {
            send_home_if_low(&mut link, &target.config).await?;
        }
        let simulated = target.sim.is_some();
        Ok(RobotSession::new(link, simulated, target.config.streams))
    }

    pub(in crate::cli) fn new(link: Session, simulated: bool, streams: Streams) -> RobotSession {
        RobotSession {
            link,
            simulated,
            streams,
            must_confirm: false,
        }
    }

    /// Disconnects when all commands are confirmed.
    pub(in crate::cli) async fn end(self) -> Result<(), Failure> {
        let Session { reader, writer, .. } = self.link;
        match close_gracefully(reader, writer, DELIVERY).await {
            Delivery::NotConfirmed { after } if self.must_confirm => {
                let seconds = after.as_secs_f64();
                let what =
                    format_args!("the robot has not confirmed the commands within {seconds:.1} s");
                let failure = Failure::unreachable(what);
                Err(failure.help("is the robot still in reach of its Wi-Fi? try again"))
            }
            _ => Ok(()),
        }
    }

    /// Sends a command that must be acknowledged: see [`with_session`].
    pub(super) async fn send_confirmed(&mut self, command: Command) -> Result<(), Failure> {
        self.must_confirm = true;
        self.send(&[command]).await
    }

    pub(in crate::cli) async fn send(&mut self, commands: &[Command]) -> Result<(), Failure> {
        Ok(self.link.writer.write(commands).await?)
    }

    /// Waits for a report that `pick` accepts; `None` if none arrives within `limit`.
    pub(in crate::cli) async fn receive<T>(
        &mut self,
        limit: Duration,
        mut pick: impl FnMut(Report) -> Option<T>,
    ) -> Result<Option<T>, Failure> {
        let until = Instant::now() + limit;
        loop {
            let Ok(report) = timeout_at(until, self.link.reader.next()).await else {
                return Ok(None);
            };
            if let Some(picked) = pick(report?) {
                return Ok(Some(picked));
            }
        }
    }

    pub(super) async fn messages(
        &mut self,
        ask: Command,
        what: &str,
    ) -> Result<Vec<Bytes>, Failure> {
        self.send(std::slice::from_ref(&ask)).await?;
        let pick = |report| match (&ask, report) {
            (Command::ConfigQuery, Report::Config(text))
            | (Command::LogQuery, Report::Log(text))
            | (Command::NetworksQuery, Report::Networks(text)) => Some(text),
            _ => None,
        };
        let Some(first) = self.receive(REPLY_TIMEOUT, pick).await? else {
            let seconds = REPLY_TIMEOUT.as_secs();
            let what = format_args!("the robot did not send {what} within {seconds} s");
            let failure = Failure::unreachable(what);
            return Err(failure.help("the robot may send this only to the user admin"));
        };
        let mut length = first.len();
        let mut messages = vec![first];
        while length < MAX_TEXT && messages.len() < MAX_MESSAGES {
            let Some(more) = self.receive(QUIET, pick).await? else {
                break;
            };
            length += more.len();
            messages.push(more);
        }
        Ok(messages)
    }

    pub(super) async fn text(&mut self, ask: Command, what: &str) -> Result<Bytes, Failure> {
        Ok(self.messages(ask, what).await?.concat().into())
    }
}
