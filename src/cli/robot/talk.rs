//! A short conversation with the robot that moves nothing.

use std::time::Duration;

use bytes::Bytes;
use tokio::time::{Instant, timeout_at};

use super::{Aim, AimArgs};
use crate::cli::interrupt::interruption;
use crate::cli::remote::RemoteArgs;
use crate::cli::running::{run_on, taken};
use crate::cli::{Exit, Failure, block_on};
use crate::config::Config;
use crate::link::{LinkError, Session, farewell};
use crate::pilot::{DELIVERY, Delivery};
use crate::robot::Streams;
use crate::safety::{Act, Fact, Watchdog};
use crate::wire::{Command, Report};

/// The longest wait for the first part of an answer.
const ANSWER: Duration = Duration::from_secs(3);
/// A text that comes in several messages has no end mark: it is over when no more comes for so long.
const QUIET: Duration = Duration::from_millis(400);
/// Nothing that the robot has to tell is longer.
const MAX_TEXT: usize = 1 << 20;
/// Messages of a text, at most.
const MAX_MESSAGES: usize = 1000;

/// A robot that listens; its tracks have been told to rest, or to take it home.
pub(super) struct Talk {
    pub(super) session: Session,
    pub(super) simulated: bool,
    pub(super) streams: Streams,
    /// Something was said that must arrive.
    said: bool,
}

/// Logs in, talks, and hangs up when the robot's side has acknowledged all that was said. Any signal
/// that ends a program ends it so, too.
///
/// # Errors
/// The robot cannot be reached, the job's own, or what was said has not arrived.
pub(super) fn talk(
    args: &AimArgs,
    job: impl AsyncFnOnce(&mut Talk) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let aim = args.aim(rand::random())?;
    block_on(async {
        let mut interrupted = std::pin::pin!(interruption()?);
        let mut talk = tokio::select! {
            biased;
            () = &mut interrupted => return Ok(Exit::Interrupted),
            talk = Talk::begin(&aim) => talk?,
        };
        let done = tokio::select! {
            biased;
            () = &mut interrupted => Ok(Exit::Interrupted),
            done = job(&mut talk) => done,
        };
        let arrived = talk.end().await;
        let exit = done?;
        arrived.map(|()| exit)
    })?
}

/// As [`talk`], for what a run that has the robot cannot be asked for.
///
/// # Errors
/// As of [`talk`], or a run has the robot.
pub(super) fn talk_alone(
    args: &AimArgs,
    job: impl AsyncFnOnce(&mut Talk) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    match run_on(&args.settings, &args.connection, &RemoteArgs::default())? {
        Some(run) => Err(taken(&run)),
        None => talk(args, job),
    }
}

/// Every login begins with a stop, which may have ended the search of a robot with a low battery: the
/// watchdog's rules say what it is told then, and what its last words are.
///
/// # Errors
/// The link is gone.
pub(in crate::cli) async fn send_home_if_low(
    session: &mut Session,
    config: &Config,
) -> Result<(), LinkError> {
    let now = Instant::now();
    let mut watchdog = Watchdog::new(config.watchdog.clone(), now);
    let (docked, power) = (session.accepted.docked, session.power);
    let acts = watchdog.take(Fact::LinkUp { docked, power }, now);
    let commands: Vec<Command> = acts.iter().filter_map(Act::command).collect();
    session
        .writer
        .set_last_words(watchdog.last_words().commands());
    session.writer.write(&commands).await?;
    if watchdog.low().is_some() && !watchdog.docked() {
        let percent = power.percent;
        tracing::warn!(
            "the battery is low ({percent} %): the robot was told to search its station; \
             `spykee robot dock` stays until it is there"
        );
    }
    Ok(())
}

impl Talk {
    async fn begin(aim: &Aim) -> Result<Talk, LinkError> {
        let mut session = aim.connect().await?;
        send_home_if_low(&mut session, &aim.config).await?;
        Ok(Talk {
            session,
            simulated: aim.sim.is_some(),
            streams: aim.config.streams,
            said: false,
        })
    }

    /// Hangs up when all has arrived.
    async fn end(self) -> Result<(), Failure> {
        let Session { reader, writer, .. } = self.session;
        match farewell(reader, writer, DELIVERY).await {
            Delivery::NotAcknowledged { after } if self.said => {
                let seconds = after.as_secs_f64();
                let what = format_args!(
                    "the robot's side has not acknowledged the commands within {seconds:.1} s"
                );
                let failure = Failure::new(Exit::Unreachable, what);
                Err(failure.help("is the robot still in reach of its Wi-Fi? try again"))
            }
            _ => Ok(()),
        }
    }

    /// Says something that must arrive: see [`talk`].
    ///
    /// # Errors
    /// The link is gone.
    pub(super) async fn tell(&mut self, command: Command) -> Result<(), Failure> {
        self.said = true;
        self.say(&[command]).await
    }

    /// Says something, in one write.
    ///
    /// # Errors
    /// The link is gone.
    pub(super) async fn say(&mut self, commands: &[Command]) -> Result<(), Failure> {
        Ok(self.session.writer.write(commands).await?)
    }

    /// Waits for a report; `None` when none came within `limit`.
    ///
    /// # Errors
    /// The link is gone.
    pub(super) async fn hear<T>(
        &mut self,
        limit: Duration,
        mut pick: impl FnMut(Report) -> Option<T>,
    ) -> Result<Option<T>, Failure> {
        let until = Instant::now() + limit;
        loop {
            let Ok(report) = timeout_at(until, self.session.reader.next()).await else {
                return Ok(None);
            };
            if let Some(picked) = pick(report?) {
                return Ok(Some(picked));
            }
        }
    }

    /// Asks for a text: its messages in their order.
    ///
    /// # Errors
    /// The link is gone, or no answer came.
    pub(super) async fn messages(
        &mut self,
        ask: Command,
        what: &str,
        pick: impl Fn(Report) -> Option<Bytes>,
    ) -> Result<Vec<Bytes>, Failure> {
        self.say(&[ask]).await?;
        let Some(first) = self.hear(ANSWER, &pick).await? else {
            let seconds = ANSWER.as_secs();
            let what = format_args!("the robot did not tell {what} within {seconds} s");
            let failure = Failure::new(Exit::Unreachable, what);
            return Err(failure.help("robots may show it only to the user admin"));
        };
        let (mut length, mut messages) = (first.len(), vec![first]);
        while length < MAX_TEXT && messages.len() < MAX_MESSAGES {
            let Some(more) = self.hear(QUIET, &pick).await? else {
                break;
            };
            length += more.len();
            messages.push(more);
        }
        Ok(messages)
    }

    /// Asks for a text, and puts its messages together as they came.
    ///
    /// # Errors
    /// The link is gone, or no answer came.
    pub(super) async fn text(
        &mut self,
        ask: Command,
        what: &str,
        pick: impl Fn(Report) -> Option<Bytes>,
    ) -> Result<Bytes, Failure> {
        Ok(self.messages(ask, what, pick).await?.concat().into())
    }
}
