//! Executes commands: each in a separate task, a limited number at a time, dockings one after the
//! other.

use std::time::Duration;

use tokio::task::{AbortHandle, JoinSet};

use super::command::{BrokerCommand, CommandResult};
use crate::control::{self, Change, Run, RunRequest};
use crate::robot::{DockEnd, DockPlan};
use crate::wire::Sound;

/// Maximum number of commands in progress; further ones are refused, except stops.
const MAX_TASKS: usize = 8;
/// Maximum number of commands in progress including stops; another stop would change nothing.
const MAX_STOPS: usize = 32;
/// Timeout for an undocking.
const UNDOCKING: Duration = Duration::from_secs(15);
/// Timeout for a picture.
const PICTURE: Duration = Duration::from_secs(5);

/// A finished command.
pub(super) struct FinishedCommand {
    pub(super) answer: CommandResult,
    /// The picture taken, if any.
    pub(super) picture: Option<Vec<u8>>,
}

/// The commands in progress.
pub(super) struct CommandTasks {
    run: Run,
    tasks: JoinSet<FinishedCommand>,
    /// The task of the command that drives the robot.
    drive: Option<AbortHandle>,
}

impl CommandTasks {
    pub(super) fn new(run: Run) -> CommandTasks {
        let tasks = JoinSet::new();
        let drive = None;
        CommandTasks { run, tasks, drive }
    }

    /// Starts a command. `chosen` is the behaviour that `start` starts.
    pub(super) fn begin(
        &mut self,
        command: BrokerCommand,
        id: Option<String>,
        chosen: Option<String>,
    ) {
        let drives = matches!(command, BrokerCommand::Dock | BrokerCommand::Undock);
        if drives || command == BrokerCommand::Stop {
            // Cancel the previous docking or undocking: the pilot then ends it.
            self.cancel_driving();
        }
        if self.tasks.len() >= MAX_STOPS {
            return;
        }
        let full = self.tasks.len() >= MAX_TASKS && command != BrokerCommand::Stop;
        let run = self.run.clone();
        let task = self.tasks.spawn(async move {
            let words = command.to_string();
            let (done, picture) = if full {
                (Err("too many commands at once".to_owned()), None)
            } else {
                perform(&run, command, chosen).await
            };
            let (done, text) = match done {
                Ok(text) => (true, text),
                Err(why) => (false, Some(why)),
            };
            let command = words;
            let answer = CommandResult {
                command,
                id,
                done,
                text,
            };
            FinishedCommand { answer, picture }
        });
        if drives && !full {
            self.drive = Some(task);
        }
    }

    /// Cancels the docking or undocking in progress.
    pub(super) fn cancel_driving(&mut self) {
        if let Some(last) = self.drive.take() {
            last.abort();
        }
    }

    /// Whether no command is in progress.
    pub(super) fn is_empty(&self) -> bool {
        self.tasks.is_empty()
    }

    /// Waits for the next finished command; never returns if none is in progress. Cancel-safe.
    pub(super) async fn next(&mut self) -> FinishedCommand {
        loop {
            match self.tasks.join_next().await {
                Some(Ok(finished)) => return finished,
                // Cancelled in favour of a newer one.
                Some(Err(_)) => {}
                None => std::future::pending().await,
            }
        }
    }
}

type Done = Result<Option<String>, String>;

async fn perform(
    run: &Run,
    command: BrokerCommand,
    chosen: Option<String>,
) -> (Done, Option<Vec<u8>>) {
    let change = Change::Start;
    let request = match command {
        BrokerCommand::Stop => return (outcome_of(run.stop_behaviours().await), None),
        BrokerCommand::Start => match chosen {
            Some(name) => RunRequest::Behaviour { name, change },
            None => return (Err("there is no behaviour to start".to_owned()), None),
        },
        BrokerCommand::Run(name) => RunRequest::Behaviour { name, change },
        // The broker client handles this, since it keeps the choice.
        BrokerCommand::Choose(_) => return (Ok(None), None),
        BrokerCommand::Dock => RunRequest::Dock(DockPlan::default()),
        BrokerCommand::Undock => RunRequest::Undock(UNDOCKING),
        BrokerCommand::Locate => RunRequest::Play(Sound::Laser),
        BrokerCommand::Snapshot => RunRequest::Picture(PICTURE),
    };
    match run.perform(request).await {
        control::RunResponse::Picture(jpeg) => (Ok(None), Some(jpeg)),
        answer => (outcome_of(answer), None),
    }
}

fn outcome_of(answer: control::RunResponse) -> Done {
    match answer {
        control::RunResponse::Docked { end, .. } | control::RunResponse::Undocked(end) => {
            let words = end.name().replace('_', " ");
            match end {
                DockEnd::Done | DockEnd::AlreadyDocked | DockEnd::NotDocked => Ok(Some(words)),
                _ => Err(words),
            }
        }
        control::RunResponse::NoPicture => Err("no picture arrived in time".to_owned()),
        control::RunResponse::Offline => Err("the robot is out of reach".to_owned()),
        control::RunResponse::Refused(why) => Err(why),
        _ => Ok(None),
    }
}
