//! Driving by hand: the pilot and its watchdog as in a run, with this program in the place of a
//! behaviour. The same rules hold: low battery, station, dead link.

use std::time::Duration;

use tokio::sync::mpsc;
use tokio::time::{MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::interrupt::obey;
use super::run::{driving_core, pulse};
use super::{Exit, Failure};
use crate::agent::{AgentError, Flight, Preflight};
use crate::behaviour::{Launch, Launcher};
use crate::pilot::{Dial, Settings, Status};
use crate::robot::channel::{Inbox, Request, Role, Told, events};
use crate::robot::{
    BehaviourId, CallId, DockEnd, DockPlan, Event, Intent, MotionEnd, MotionId, Priority, Setpoint,
};

const ME: BehaviourId = BehaviourId(0);
/// How often a driver that moves shows that it lives; the watchdog's patience is 0.25 s.
const BEAT: Duration = Duration::from_millis(50);

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
    inbox: Inbox,
    flight: Flight,
    last: u64,
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
            let launcher = Launcher::this_executable().map_err(|error| {
                Failure::usage(format_args!("cannot find this program's own file: {error}"))
            })?;
            flight.stand_by(launcher, rescue);
        }
        // Replaced by the one that the pilot knows as soon as it is connected.
        let (_, inbox) = events();
        Ok(Driver {
            requests,
            inbox,
            flight: flight.launch(stop),
            last: 0,
        })
    }

    async fn board(&mut self) -> Result<(), Failure> {
        self.flight.up().await.map_err(failed)?;
        let (outbox, inbox) = events();
        self.inbox = inbox;
        let (by, priority) = (ME, Priority(0));
        self.ask(Request::Join {
            by,
            name: "spykee".into(),
            priority,
            role: Role::Behaviour,
            outbox,
        })
        .await
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
        let motion = MotionId(self.next());
        let duration = Some(duration);
        self.intend(Intent::Move {
            motion,
            setpoint,
            duration,
        })
        .await?;
        self.wait(|event| match event {
            Event::MotionEnded { motion: of, end } if *of == motion => Some(*end),
            _ => None,
        })
        .await
    }

    /// Goes to the station: how it ended, tries made, time taken.
    ///
    /// # Errors
    /// The pilot is gone.
    pub(super) async fn dock(
        &mut self,
        plan: DockPlan,
    ) -> Result<(DockEnd, u32, Duration), Failure> {
        let call = CallId(self.next());
        self.intend(Intent::Dock { call, plan }).await?;
        self.wait(|event| match event {
            Event::DockEnded {
                call: of,
                end,
                attempts,
                took,
            } if *of == call => Some((*end, *attempts, *took)),
            _ => None,
        })
        .await
    }

    /// Leaves the station.
    ///
    /// # Errors
    /// The pilot is gone.
    pub(super) async fn undock(&mut self, timeout: Duration) -> Result<DockEnd, Failure> {
        let call = CallId(self.next());
        self.intend(Intent::Undock { call, timeout }).await?;
        self.wait(|event| match event {
            Event::UndockEnded { call: of, end } if *of == call => Some(*end),
            _ => None,
        })
        .await
    }

    fn next(&mut self) -> u64 {
        self.last += 1;
        self.last
    }

    async fn intend(&mut self, intent: Intent) -> Result<(), Failure> {
        self.ask(Request::Intent(ME, intent)).await
    }

    async fn ask(&mut self, request: Request) -> Result<(), Failure> {
        match self.requests.send(request).await {
            Ok(()) => Ok(()),
            Err(_) => Err(failed(self.flight.lost().await)),
        }
    }

    /// Waits for an answer, and shows life meanwhile.
    async fn wait<T>(&mut self, answer: impl Fn(&Event) -> Option<T>) -> Result<T, Failure> {
        let mut beat = interval(BEAT);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let told = tokio::select! {
                told = self.inbox.next() => told,
                _ = beat.tick() => {
                    self.ask(Request::Alive(ME)).await?;
                    continue;
                }
            };
            match told {
                Told::Event(event) => {
                    if let Some(answer) = answer(&event) {
                        return Ok(answer);
                    }
                }
                Told::Kill(reason) => {
                    return Err(Failure::new(Exit::Safety, reason.sentence()));
                }
                Told::Closed => return Err(failed(self.flight.lost().await)),
            }
        }
    }
}

fn failed(error: AgentError) -> Failure {
    match error {
        AgentError::Link(error) => error.into(),
        error @ AgentError::Broken(_) => Failure::new(Exit::Unreachable, error),
    }
}
