//! Driving by hand: the pilot and its watchdog as in a run, with this program in the place of a
//! behaviour. The same rules hold: low battery, station, dead link.

use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::{MissedTickBehavior, interval, timeout};

use super::interrupt::interruption;
use super::run::{driving_core, pulse};
use super::{Exit, Failure};
use crate::link::LinkError;
use crate::pilot::{Delivery, Dial, DrivingCore, Ending, LinkState, Pilot, Settings, Status};
use crate::robot::channel::{Inbox, MAX_REQUESTS, Request, Told, events};
use crate::robot::{
    BehaviourId, CallId, DockEnd, DockPlan, Event, Intent, MotionEnd, MotionId, Priority, Setpoint,
};

const ME: BehaviourId = BehaviourId(0);
/// How often a driver that moves shows that it lives; the watchdog's patience is 0.25 s.
const BEAT: Duration = Duration::from_millis(50);
/// How long the last writes and the closing of the link may take.
const LINK_END: Duration = Duration::from_millis(2500);

/// A seat in front of the pilot.
pub(super) struct Driver {
    requests: mpsc::Sender<Request>,
    inbox: Inbox,
    status: watch::Receiver<Status>,
    flight: JoinHandle<Result<Delivery, LinkError>>,
    ending: Ending,
    last: u64,
    /// Dropped last: what runs on it ends first.
    _core: DrivingCore,
}

/// Connects, lets `job` drive, and stops the robot before it lets go of it, however the job ends;
/// Ctrl-C ends it too.
///
/// # Errors
/// The robot cannot be reached, or the job's own.
pub(super) async fn drive(
    dial: Dial,
    settings: Settings,
    job: impl AsyncFnOnce(&mut Driver) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let interrupted = interruption()?;
    let mut driver = Driver::launch(dial, settings)?;
    let work = async {
        driver.board().await?;
        job(&mut driver).await
    };
    let result = tokio::select! {
        biased;
        () = interrupted => Ok(Exit::Interrupted),
        result = work => result,
    };
    driver.end().await;
    result
}

impl Driver {
    fn launch(dial: Dial, settings: Settings) -> Result<Driver, Failure> {
        let core = driving_core()?;
        let (mut pilot, _frames, status) = Pilot::new(&settings);
        pilot.set_pulse(Some(pulse(settings.simulated)));
        let (requests, received) = mpsc::channel(MAX_REQUESTS);
        let ending = Ending::default();
        let flight = core
            .handle()
            .spawn(pilot.run(dial, settings, received, ending.clone()));
        // Replaced by the one that the pilot knows as soon as it is connected.
        let (_, inbox) = events();
        Ok(Driver {
            requests,
            inbox,
            status,
            flight,
            ending,
            last: 0,
            _core: core,
        })
    }

    async fn board(&mut self) -> Result<(), Failure> {
        tokio::select! {
            biased;
            ended = &mut self.flight => return Err(failed(ended)),
            _ = self.status.wait_for(|status| status.link == LinkState::Up) => {}
        }
        let (outbox, inbox) = events();
        self.inbox = inbox;
        let (by, priority) = (ME, Priority(0));
        self.ask(Request::Join {
            by,
            name: "spykee".into(),
            priority,
            outbox,
        })
        .await
    }

    /// Robot and watchdog as they are now.
    pub(super) fn status(&self) -> Status {
        *self.status.borrow()
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
            Err(_) => Err(failed((&mut self.flight).await)),
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
                Told::Closed => return Err(failed((&mut self.flight).await)),
            }
        }
    }

    /// A stop is written, then the link is closed.
    async fn end(mut self) {
        self.ending.parting.cancel();
        self.ending.closing.cancel();
        if !self.flight.is_finished() && timeout(LINK_END, &mut self.flight).await.is_err() {
            self.flight.abort();
        }
    }
}

fn failed(ended: Result<Result<Delivery, LinkError>, tokio::task::JoinError>) -> Failure {
    match ended {
        Ok(Err(error)) => error.into(),
        Ok(Ok(_)) | Err(_) => Failure::new(
            Exit::Unreachable,
            "internal error: the pilot broke down; the robot was told to stop",
        ),
    }
}
