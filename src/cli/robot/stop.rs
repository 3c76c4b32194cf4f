//! `spykee robot stop`: the tracks rest, whatever it takes.

use std::time::Duration;

use tokio::time::{Instant, sleep};

use super::talk::farewell;
use super::{Aim, AimArgs};
use crate::cli::interrupt::interruption;
use crate::cli::{Exit, Failure, block_on};
use crate::link::LinkError;
use crate::wire::{Command, Engage};

/// Between two tries.
const PAUSE: Duration = Duration::from_millis(200);

/// Stop the robot: tracks and the search for its station
///
/// Logs in, says MOVE 0 0, ends a search for the station, says MOVE 0 0 again and ends when that is
/// written. A robot that cannot be reached is tried again until the time is over. While another
/// program is connected the robot lets nobody else in: that program must stop it.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot stop --robot 172.17.6.1")]
pub(super) struct StopArgs {
    /// Try for so long
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
          value_parser = clap::value_parser!(u64).range(1..=600))]
    timeout: u64,
    #[command(flatten)]
    pub(super) aim: AimArgs,
}

pub(super) fn stop(args: &StopArgs) -> Result<Exit, Failure> {
    let aim = args.aim.aim(rand::random())?;
    let limit = Duration::from_secs(args.timeout);
    block_on(async {
        let interrupted = interruption()?;
        tokio::select! {
            biased;
            () = interrupted => Ok(Exit::Interrupted),
            stopped = insist(&aim, limit) => Ok(stopped.map(|()| Exit::Done)?),
        }
    })?
}

async fn insist(aim: &Aim, limit: Duration) -> Result<(), LinkError> {
    let until = Instant::now() + limit;
    loop {
        match once(aim).await {
            Err(error) if !error.is_final() && Instant::now() + PAUSE < until => {
                tracing::warn!("not stopped yet: {error}; trying again");
                sleep(PAUSE).await;
            }
            ended => return ended,
        }
    }
}

/// The login's own first command is MOVE 0 0; the second stop is for what the cancelled search may
/// have left on the tracks.
async fn once(aim: &Aim) -> Result<(), LinkError> {
    let mut session = aim.connect().await?;
    let commands = [Command::Engine(Engage::CancelDock), Command::STOP];
    session.writer.write(&commands).await?;
    farewell(session).await;
    Ok(())
}
