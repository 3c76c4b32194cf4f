//! A session with a person: one behaviour that runs the lines it is given, on one robot. One that
//! dies is replaced; the link, the pilot and the watchdog stay the same all the while.

use std::pin::pin;
use std::time::Duration;

use tokio::runtime;
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;
use tracing::warn;

use super::{Flight, LINK_END, SCRIPTS_END, broken_flight};
use crate::behaviour::{Dialogue, Handle, Launch, Launcher, Order, Prepared, Said, Supervisor};
use crate::link::LinkError;
use crate::pilot::{self, Dial, LinkState, Pilot, Pulse, Settings, Status};
use crate::robot::channel::{MAX_REQUESTS, Request, Role};
use crate::robot::{BehaviourId, EndReason, Pictures, Priority};
use crate::script::Ending;

use super::AgentError;

/// Everything a session needs.
pub struct Talk {
    /// The behaviour, of which each new one is made; `interactive` in its options.
    pub launch: Launch,
    /// The pilot's numbers.
    pub settings: Settings,
    /// How to reach the robot.
    pub dial: Dial,
    /// How to start hosts.
    pub launcher: Launcher,
    /// Runs the pilot and serves the host's pipe.
    pub core: runtime::Handle,
    /// Of a session in real time.
    pub pulse: Option<Pulse>,
}

/// Why a session could not go on.
#[derive(Debug, thiserror::Error)]
pub enum TalkError {
    /// The robot, or our own fault.
    #[error(transparent)]
    Agent(#[from] AgentError),
    /// No behaviour can be started.
    #[error("{}", .0.message.as_deref().unwrap_or(.0.reason.sentence()))]
    Host(Ending),
}

impl From<LinkError> for TalkError {
    fn from(error: LinkError) -> TalkError {
        TalkError::Agent(error.into())
    }
}

/// The ways to and from the robot.
struct Session {
    launch: Launch,
    launcher: Launcher,
    core: runtime::Handle,
    flight: Flight,
    requests: mpsc::Sender<Request>,
    frames: watch::Receiver<Pictures>,
    ending: pilot::Ending,
    /// Of a host's life.
    longest_silence: Duration,
    last: u16,
}

impl Talk {
    /// Runs until `stop` is cancelled or nobody gives orders any more. All that can end it ends with
    /// a stop of the robot.
    ///
    /// # Errors
    /// See [`TalkError`].
    pub async fn run(
        self,
        mut orders: mpsc::Receiver<Order>,
        said: mpsc::Sender<Said>,
        stop: CancellationToken,
    ) -> Result<(), TalkError> {
        let (mut pilot, frames, status) = Pilot::new(&self.settings);
        pilot.set_pulse(self.pulse);
        let (requests, received) = mpsc::channel(MAX_REQUESTS);
        let ending = pilot::Ending::default();
        let longest_silence = self.settings.limits.host_idle_silence.get();
        let flight = pilot.run(self.dial, self.settings, received, ending.clone());
        let mut session = Session {
            launch: self.launch,
            launcher: self.launcher,
            flight: AbortOnDropHandle::new(self.core.spawn(flight)),
            core: self.core,
            requests,
            frames,
            ending,
            longest_silence,
            last: 0,
        };
        let outcome = session.live(&mut orders, &said, status, &stop).await;
        match &outcome {
            Err(TalkError::Agent(_)) => session.flight.abort(),
            _ => session.end().await,
        }
        outcome
    }
}

impl Session {
    async fn live(
        &mut self,
        orders: &mut mpsc::Receiver<Order>,
        said: &mpsc::Sender<Said>,
        mut status: watch::Receiver<Status>,
        stop: &CancellationToken,
    ) -> Result<(), TalkError> {
        tokio::select! {
            biased;
            () = stop.cancelled() => return Ok(()),
            ended = &mut self.flight => return Err(broken_flight(ended).into()),
            _ = status.wait_for(|status| status.link == LinkState::Up) => {}
        }
        while let Some(ending) = self.converse(orders, said, stop).await? {
            let _ = said.send(Said::Ended(ending)).await;
        }
        Ok(())
    }

    /// One behaviour from its start to its end, which is returned; `None` if the session ends.
    async fn converse(
        &mut self,
        orders: &mut mpsc::Receiver<Order>,
        said: &mpsc::Sender<Said>,
        stop: &CancellationToken,
    ) -> Result<Option<Ending>, TalkError> {
        let (order, mut hear, dialogue) = Dialogue::new();
        let supervisor = self.board().await?.with_dialogue(dialogue);
        let handle = Handle::default();
        let core = self.core.clone();
        let mut running = pin!(supervisor.run(handle.clone(), &core));
        let _ = said.send(Said::Ready).await;
        loop {
            tokio::select! {
                biased;
                () = stop.cancelled() => break,
                ended = &mut self.flight => return Err(broken_flight(ended).into()),
                next = orders.recv() => match next {
                    // One that does not take its orders is not driven on.
                    Some(next) => if order.try_send(next).is_err() { handle.stop(EndReason::Cancelled) },
                    None => break,
                },
                Some(heard) = hear.recv() => { let _ = said.send(heard).await; }
                ending = &mut running => {
                    while let Ok(heard) = hear.try_recv() {
                        let _ = said.send(heard).await;
                    }
                    return Ok(Some(ending));
                }
            }
        }
        self.ending.parting.cancel();
        handle.stop(EndReason::Shutdown);
        if timeout(SCRIPTS_END, running).await.is_err() {
            warn!("the lines' own end took too long and was left behind");
        }
        Ok(None)
    }

    async fn board(&mut self) -> Result<Supervisor, TalkError> {
        self.last = self.last.wrapping_add(1);
        let (by, launch) = (BehaviourId(self.last), self.launch.clone());
        let prepared = Prepared::start(&self.launcher, &self.core, by, Priority(0), launch).await;
        let prepared = prepared.map_err(TalkError::Host)?;
        Ok(Supervisor::board(
            prepared,
            Role::Behaviour,
            self.requests.clone(),
            self.frames.clone(),
        )
        .await
        .with_longest_silence(self.longest_silence))
    }

    /// The stop is written; now the link.
    async fn end(&mut self) {
        self.ending.parting.cancel();
        self.ending.closing.cancel();
        match timeout(LINK_END, &mut self.flight).await {
            Ok(Ok(_)) => {}
            Ok(Err(error)) => warn!("the link's end: {error}"),
            Err(_) => self.flight.abort(),
        }
    }
}
