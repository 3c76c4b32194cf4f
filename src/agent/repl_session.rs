//! An interactive session with a person: one behaviour runs the lines it is given, on one robot. A
//! behaviour that ends is replaced; the link, the pilot and the watchdog are kept.

use std::pin::pin;

use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tracing::warn;

use super::{AgentError, PilotSetup, RunningPilot, SCRIPTS_END};
use crate::behaviour::{
    Handle, HostContext, Launch, Prepared, PromptCommand, PromptMessage, ReplChannel, Supervisor,
};
use crate::robot::channel::{Request, Role};
use crate::robot::{BehaviourId, EndReason, Intent, Priority};
use crate::script::ScriptExit;

#[derive(Debug, thiserror::Error)]
pub enum ReplError {
    /// An error of the robot's link, or an internal error.
    #[error(transparent)]
    Agent(#[from] AgentError),
    /// No behaviour can be started.
    #[error("{}", .0.text())]
    Host(ScriptExit),
}

/// Runs a session until `stop` is cancelled, or until the command sender is dropped and a robot with
/// a low battery is home. In either case the robot is stopped. Each behaviour is made from `launch`,
/// which has `interactive` in its options. Returns whether the watchdog controlled the robot at the
/// end.
pub async fn run_repl(
    launch: Launch,
    setup: PilotSetup,
    mut commands: mpsc::Receiver<PromptCommand>,
    sink: mpsc::Sender<PromptMessage>,
    stop: CancellationToken,
) -> Result<bool, ReplError> {
    let mut session = ReplSession {
        launch,
        context: setup.host_context(),
        pilot: setup.launch(&stop),
        last: 0,
    };
    let stayed = session.live(&mut commands, &sink, &stop).await;
    let safety = session.pilot.is_away();
    session.pilot.end().await;
    stayed.map(|stayed| stayed || safety)
}

struct ReplSession {
    launch: Launch,
    context: HostContext,
    pilot: RunningPilot,
    last: u16,
}

impl ReplSession {
    /// Returns whether the session had to wait for a robot with a low battery.
    async fn live(
        &mut self,
        commands: &mut mpsc::Receiver<PromptCommand>,
        sink: &mpsc::Sender<PromptMessage>,
        stop: &CancellationToken,
    ) -> Result<bool, ReplError> {
        tokio::select! {
            biased;
            () = stop.cancelled() => return Ok(false),
            up = self.pilot.connected() => up?,
        }
        while let Some(exit) = self.run_behaviour(commands, sink, stop).await? {
            let _ = sink.send(PromptMessage::Ended(exit)).await;
        }
        tokio::select! {
            biased;
            () = stop.cancelled() => Ok(false),
            stayed = self.pilot.wait_until_settled() => Ok(stayed),
        }
    }

    /// Runs one behaviour and returns its ending; `None` if the session ends.
    async fn run_behaviour(
        &mut self,
        commands: &mut mpsc::Receiver<PromptCommand>,
        sink: &mpsc::Sender<PromptMessage>,
        stop: &CancellationToken,
    ) -> Result<Option<ScriptExit>, ReplError> {
        let (lines, mut messages, repl_channel) = ReplChannel::new();
        let supervisor = self.start_behaviour(repl_channel).await?;
        let handle = Handle::default();
        let mut running = pin!(supervisor.run(handle.clone()));
        let _ = sink.send(PromptMessage::Ready).await;
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => break,
                error = self.pilot.failure() => return Err(error.into()),
                next = commands.recv() => match next {
                    // A behaviour that does not read its lines is ended.
                    Some(next) => if lines.try_send(next).is_err() { handle.stop(EndReason::Cancelled) },
                    None => break,
                },
                Some(message) = messages.recv() => { let _ = sink.send(message).await; }
                exit = &mut running => {
                    while let Ok(message) = messages.try_recv() {
                        let _ = sink.send(message).await;
                    }
                    return Ok(Some(exit));
                }
            }
        }
        // Stop without the end of the run: if the battery is low, the robot is brought home first.
        let rest = Request::Intent(BehaviourId(self.last), Intent::Stop);
        let _ = self.context.requests.try_send(rest);
        handle.stop(EndReason::Shutdown);
        if timeout(SCRIPTS_END, running).await.is_err() {
            warn!("a typed script's on_stop took too long and was abandoned");
        }
        Ok(None)
    }

    async fn start_behaviour(&mut self, prompt: ReplChannel) -> Result<Supervisor, ReplError> {
        self.last = self.last.wrapping_add(1);
        let by = BehaviourId(self.last);
        let launch = self.launch.clone();
        let context = self.context.clone();
        let prepared = Prepared::start(&context, by, Priority(0), launch).await;
        let prepared = prepared.map_err(ReplError::Host)?;
        Ok(Supervisor::register(prepared, Role::Behaviour, context, Some(prompt)).await)
    }
}
