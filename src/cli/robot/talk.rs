//! A short conversation with the robot that moves nothing.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::time::{Instant, timeout, timeout_at};

use super::AimArgs;
use crate::cli::interrupt::interruption;
use crate::cli::{Exit, Failure, block_on};
use crate::link::Session;
use crate::robot::Streams;
use crate::wire::{Command, Report};

/// The longest wait for the first part of an answer.
const ANSWER: Duration = Duration::from_secs(3);
/// A text that comes in several messages has no end mark: it is over when no more comes for so long.
const QUIET: Duration = Duration::from_millis(400);
/// Nothing that the robot has to tell is longer.
const MAX_TEXT: usize = 1 << 20;
/// The longest wait for the robot to hang up, when all is written.
const FAREWELL: Duration = Duration::from_secs(1);

/// A robot that listens; its tracks have been told to rest.
pub(super) struct Talk {
    pub(super) session: Session,
    pub(super) simulated: bool,
    pub(super) streams: Streams,
}

/// Logs in, talks, and hangs up. Ctrl-C ends it.
///
/// # Errors
/// The robot cannot be reached, or the job's own.
pub(super) fn talk(
    args: &AimArgs,
    job: impl AsyncFnOnce(&mut Talk) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let aim = args.aim(rand::random())?;
    block_on(async {
        let interrupted = interruption()?;
        let conversation = async {
            let mut talk = Talk {
                session: aim.connect().await?,
                simulated: aim.sim.is_some(),
                streams: aim.config.streams,
            };
            let exit = job(&mut talk).await?;
            farewell(talk.session).await;
            Ok(exit)
        };
        tokio::select! {
            biased;
            () = interrupted => Ok(Exit::Interrupted),
            exit = conversation => exit,
        }
    })?
}

/// Writes what is left, closes our half, and listens until the robot has hung up too: a socket
/// closed with unread news in it would be reset, and the robot might lose our last words.
pub(in crate::cli) async fn farewell(session: Session) {
    let Session {
        mut reader, writer, ..
    } = session;
    writer.close().await;
    let silence = async { while reader.next().await.is_ok() {} };
    // A robot that does not hang up has heard us all the same.
    let _ = timeout(FAREWELL, silence).await;
}

impl Talk {
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

    /// Asks for a text, and puts its messages together.
    ///
    /// # Errors
    /// The link is gone, or no answer came.
    pub(super) async fn text(
        &mut self,
        ask: Command,
        what: &str,
        pick: impl Fn(Report) -> Option<Bytes>,
    ) -> Result<Bytes, Failure> {
        self.say(&[ask]).await?;
        let Some(first) = self.hear(ANSWER, &pick).await? else {
            let seconds = ANSWER.as_secs();
            let what = format_args!("the robot did not tell {what} within {seconds} s");
            let failure = Failure::new(Exit::Unreachable, what);
            return Err(failure.help("robots may tell it to the user admin only"));
        };
        let mut text = BytesMut::from(&first[..]);
        while text.len() < MAX_TEXT {
            match self.hear(QUIET, &pick).await? {
                Some(more) => text.extend_from_slice(&more),
                None => break,
            }
        }
        Ok(text.freeze())
    }
}
