//! `spykee robot let-go`: releases a person's STOP.

use super::SharedAimArgs;
use crate::cli::running::{REPLY_TIMEOUT, ask, unexpected_reply};
use crate::cli::{Exit, Failure, print};
use crate::control::{Answer, RunRequest, StopLatch};

/// Release STOP, so that the robot may move again
///
/// STOP at the page, or through the API, holds until a person releases it, also in later programs of
/// the same data folder. If a run or service uses the robot, this releases it there, as the button
/// on the page does; otherwise it releases what an earlier one has left behind in the data folder.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot let-go")]
pub(super) struct LetGoArgs {
    #[command(flatten)]
    pub(super) aim: SharedAimArgs,
}

pub(super) fn let_go(args: &LetGoArgs) -> Result<Exit, Failure> {
    if args.aim.connection.sim.is_some() {
        return Err(Failure::usage(
            "--sim starts a new simulated robot, which nobody has stopped",
        ));
    }
    if let Some(run) = args.aim.find_run()? {
        return match ask(&run, &RunRequest::LetGo, REPLY_TIMEOUT)? {
            None => Ok(Exit::Interrupted),
            Some(Answer::Done) => {
                print("released: the robot may move again\n")?;
                Ok(Exit::Done)
            }
            Some(_) => Err(unexpected_reply()),
        };
    }
    let data = args.aim.settings.config()?.data_folder();
    match StopLatch::remove(data) {
        Ok(true) => print("released: the next program may move the robot again\n")?,
        Ok(false) => print("nothing to release: no STOP holds in this data folder\n")?,
        Err(error) => {
            let doing = format_args!("release STOP in {}", data.display());
            return Err(Failure::io(doing, error));
        }
    }
    Ok(Exit::Done)
}
