//! Manual driving: the pilot and its watchdog as in a run, with this program in place of a
//! behaviour. The same safety rules apply: low battery, station, dead link.

use tokio::sync::{mpsc, watch};
use tokio_util::sync::CancellationToken;

use super::connection::RobotTarget;
use super::interrupt::handle_signals;
use super::{Exit, Failure, block_on};
use crate::agent::{
    AgentError, PilotClient, PilotClientError, PilotPlan, PilotSetup, RunningPilot,
};
use crate::pilot::Status;
use crate::robot::channel::{Request, Role};
use crate::robot::{BehaviourId, Pictures, Priority};

const DRIVER_ID: BehaviourId = BehaviourId(0);

/// Drives the robot through a client of the pilot.
pub(super) struct Driver {
    requests: mpsc::Sender<Request>,
    frames: watch::Receiver<Pictures>,
    /// Set once the robot is connected.
    client: Option<PilotClient>,
    pilot: RunningPilot,
}

/// Lets `job` drive this robot: see [`drive`].
pub(super) fn drive_target(
    target: &RobotTarget,
    seed: u64,
    job: impl AsyncFnOnce(&mut Driver) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let (_core, plan) = target.driver_plan(seed)?;
    block_on(drive(plan, job))?
}

/// Connects, lets `job` drive, and stops the robot before it disconnects, however the job ends. Any
/// terminating signal ends the job, except in virtual time; Ctrl-Z stops the robot, then suspends
/// the program. If the battery is low, stays connected until the robot is on its station, unless a
/// signal arrives.
pub(super) async fn drive(
    plan: PilotPlan,
    job: impl AsyncFnOnce(&mut Driver) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let stop = CancellationToken::new();
    let mut driver = Driver::launch(plan, &stop)?;
    let work = async {
        driver.connect().await?;
        let done = job(&mut driver).await;
        let stayed = driver.pilot.wait_until_settled().await;
        done.map(|exit| if stayed { Exit::Safety } else { exit })
    };
    let done = unless_stopped(&stop, work).await;
    let away = driver.pilot.is_away();
    if driver.pilot.end().await.is_owed() {
        return Ok(Exit::Unreachable);
    }
    done.unwrap_or(Ok(if away {
        Exit::Safety
    } else {
        Exit::Interrupted
    }))
}

/// The result of the work; `None` once `stop` is cancelled: work that ends after that, such as a
/// motion, ends because of it.
async fn unless_stopped<T>(stop: &CancellationToken, work: impl Future<Output = T>) -> Option<T> {
    let done = stop.run_until_cancelled(work).await;
    if stop.is_cancelled() { None } else { done }
}

impl Driver {
    fn launch(plan: PilotPlan, stop: &CancellationToken) -> Result<Driver, Failure> {
        let signals_on = plan.heartbeat.as_ref().map(|_| plan.core.clone());
        let setup = PilotSetup::new(plan);
        let requests = setup.requests();
        if let Some(core) = signals_on {
            handle_signals(&core, requests.clone(), stop.clone(), &[], None)?;
        }
        Ok(Driver {
            requests,
            frames: setup.frames(),
            client: None,
            pilot: setup.launch(stop),
        })
    }

    async fn connect(&mut self) -> Result<(), Failure> {
        self.connected().await?;
        let client = PilotClient::join(
            self.requests.clone(),
            DRIVER_ID,
            "spykee",
            Priority(0),
            Role::Person,
        );
        self.client = match client.await {
            Ok(client) => Some(client),
            Err(error) => return Err(self.refused(error).await),
        };
        Ok(())
    }

    pub(super) fn status(&self) -> Status {
        self.pilot.status()
    }

    /// The camera's pictures, while the robot sends them.
    pub(super) fn frames(&self) -> watch::Receiver<Pictures> {
        self.frames.clone()
    }

    pub(super) async fn connected(&mut self) -> Result<(), Failure> {
        self.pilot.connected().await.map_err(failed)
    }

    /// Has the pilot carry out a request, and returns its answer.
    pub(super) async fn ask<T>(
        &mut self,
        request: impl AsyncFnOnce(&mut PilotClient) -> Result<T, PilotClientError>,
    ) -> Result<T, Failure> {
        let broken = || failed(AgentError::Broken("the pilot"));
        match request(self.client.as_mut().ok_or_else(broken)?).await {
            Ok(answer) => Ok(answer),
            Err(error) => Err(self.refused(error).await),
        }
    }

    /// The failure to report. If the pilot has ended, reports the pilot's own reason.
    async fn refused(&mut self, error: PilotClientError) -> Failure {
        match error {
            PilotClientError::Closed => failed(self.pilot.failure().await),
            PilotClientError::Ended(_) => Failure::new(Exit::Safety, error),
        }
    }
}

fn failed(error: AgentError) -> Failure {
    match error {
        AgentError::Link(error) => error.into(),
        error @ AgentError::Broken(_) => Failure::unreachable(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn work_that_ends_because_of_a_stop_has_no_result() {
        let stop = CancellationToken::new();
        assert_eq!(unless_stopped(&stop, async { 1 }).await, Some(1));
        let cut_short = unless_stopped(&stop, async {
            stop.cancel();
            2
        });
        assert_eq!(cut_short.await, None);
    }
}
