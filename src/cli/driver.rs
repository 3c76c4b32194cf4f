//! Driving by hand: the pilot and its watchdog as in a run, with this program in the place of a
//! behaviour. The same rules hold: low battery, station, dead link.

use std::time::Duration;

use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::interrupt::obey;
use super::startup::{driving_core, launcher, pulse};
use super::{Exit, Failure};
use crate::agent::{AgentError, Docked, Flight, Preflight, Seat, SeatError};
use crate::behaviour::Launch;
use crate::pilot::{Dial, Settings, Status};
use crate::robot::channel::{Request, Role};
use crate::robot::{BehaviourId, DockEnd, DockPlan, MotionEnd, Priority, Setpoint};

const ME: BehaviourId = BehaviourId(0);

/// What it takes to drive a robot by hand.
pub(super) struct Means {
    /// How to reach the robot.
    pub(super) dial: Dial,
    /// The pilot's numbers.
    pub(super) settings: Settings,
    /// The rescue behaviour, if there is to be one.
    pub(super) rescue: Option<Launch>,
}

/// A seat in front of the pilot.
pub(super) struct Driver {
    requests: mpsc::Sender<Request>,
    /// Taken as soon as the robot is there.
    seat: Option<Seat>,
    flight: Flight,
}

/// Connects, lets `job` drive, and stops the robot before it lets go of it, however the job ends. Any
/// signal that ends a program ends it; Ctrl-Z stops the robot, then the program. A robot whose battery
/// is low is not left before it is home, unless by a signal.
///
/// # Errors
/// The robot cannot be reached, or the job's own.
pub(super) async fn drive(
    means: Means,
    job: impl AsyncFnOnce(&mut Driver) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let core = driving_core()?;
    let stop = CancellationToken::new();
    let mut driver = Driver::launch(means, core.handle(), &stop)?;
    let work = async {
        driver.board().await?;
        let done = job(&mut driver).await;
        let stayed = driver.flight.stay().await;
        done.map(|exit| if stayed { Exit::Safety } else { exit })
    };
    let done = tokio::select! {
        biased;
        () = stop.cancelled() => None,
        done = work => Some(done),
    };
    let away = driver.flight.is_away();
    driver.flight.end().await;
    done.unwrap_or(Ok(if away {
        Exit::Safety
    } else {
        Exit::Interrupted
    }))
}

impl Driver {
    fn launch(
        means: Means,
        core: &tokio::runtime::Handle,
        stop: &CancellationToken,
    ) -> Result<Driver, Failure> {
        let Means {
            dial,
            settings,
            rescue,
        } = means;
        let pulse = pulse(settings.simulated);
        let mut flight = Preflight::new(settings, dial, core.clone(), Some(pulse));
        let requests = flight.requests();
        obey(core, requests.clone(), stop.clone())?;
        if let Some(rescue) = rescue {
            flight.stand_by(launcher()?, rescue);
        }
        Ok(Driver {
            requests,
            seat: None,
            flight: flight.launch(stop),
        })
    }

    async fn board(&mut self) -> Result<(), Failure> {
        self.flight.up().await.map_err(failed)?;
        let seat = Seat::join(
            self.requests.clone(),
            ME,
            "spykee",
            Priority(0),
            Role::Person,
        );
        self.seat = Some(seat.await.map_err(refused)?);
        Ok(())
    }

    /// Robot and watchdog as they are now.
    pub(super) fn status(&self) -> Status {
        self.flight.status()
    }

    /// Drives for a while; how it ended.
    ///
    /// # Errors
    /// The pilot is gone.
    pub(super) async fn run(
        &mut self,
        setpoint: Setpoint,
        duration: Duration,
    ) -> Result<MotionEnd, Failure> {
        let end = self.seat()?.run(setpoint, duration).await;
        end.map_err(refused)
    }

    /// Goes to the station.
    ///
    /// # Errors
    /// The pilot is gone.
    pub(super) async fn dock(&mut self, plan: DockPlan) -> Result<Docked, Failure> {
        self.seat()?.dock(plan).await.map_err(refused)
    }

    /// Leaves the station.
    ///
    /// # Errors
    /// The pilot is gone.
    pub(super) async fn undock(&mut self, timeout: Duration) -> Result<DockEnd, Failure> {
        self.seat()?.undock(timeout).await.map_err(refused)
    }

    /// Speaks: s16 little-endian, mono, 16 kHz.
    ///
    /// # Errors
    /// The pilot is gone.
    pub(super) async fn say(&mut self, samples: &[u8]) -> Result<(), Failure> {
        self.seat()?.say(samples).await.map_err(refused)
    }

    fn seat(&mut self) -> Result<&mut Seat, Failure> {
        self.seat.as_mut().ok_or_else(|| refused(SeatError::Closed))
    }
}

fn refused(error: SeatError) -> Failure {
    match error {
        SeatError::Closed => failed(AgentError::Broken("the pilot")),
        SeatError::Ended(_) => Failure::new(Exit::Safety, error),
    }
}

fn failed(error: AgentError) -> Failure {
    match error {
        AgentError::Link(error) => error.into(),
        error @ AgentError::Broken(_) => Failure::new(Exit::Unreachable, error),
    }
}
