//! The pilot's lifetime, for every user of it: a run, a session at a prompt, a tool. Launched on the
//! driving core, parted from at the first signal, and ended when what it said last has arrived.

use std::time::Duration;

use tokio::runtime;
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;
use tracing::{info, warn};

use super::AgentError;
use super::rescue;
use super::restart_loop::LaunchContext;
use crate::behaviour::{Launch, Launcher};
use crate::link::LinkError;
use crate::pilot::{self, Delivery, Dial, LinkState, Pilot, Pulse, Reactions, Settings, Status};
use crate::robot::channel::{MAX_REQUESTS, Request};
use crate::robot::{Bus, Lookout, Pictures};

/// How long the last writes and the closing of the link may take.
const LINK_END: Duration = Duration::from_millis(2500);

/// A pilot that is not launched yet.
pub struct Preflight {
    pilot: Pilot,
    settings: Settings,
    dial: Dial,
    core: runtime::Handle,
    requests: (mpsc::Sender<Request>, mpsc::Receiver<Request>),
    frames: watch::Receiver<Pictures>,
    status: watch::Receiver<Status>,
    rescue: Option<AbortOnDropHandle<()>>,
    bus: Bus,
}

impl Preflight {
    /// A pilot that goes by these settings, dials so and will run on `core`: that of a
    /// [`pilot::DrivingCore`], or in virtual time the only one there is. In real time it has a pulse.
    pub fn new(
        settings: Settings,
        dial: Dial,
        core: runtime::Handle,
        pulse: Option<Pulse>,
    ) -> Preflight {
        let (mut pilot, frames, status) = Pilot::new(&settings);
        pilot.set_pulse(pulse);
        Preflight {
            pilot,
            settings,
            dial,
            core,
            requests: mpsc::channel(MAX_REQUESTS),
            frames,
            status,
            rescue: None,
            bus: Bus::default(),
        }
    }

    /// What happens is said on this bus.
    #[must_use]
    pub fn with_bus(mut self, bus: Bus) -> Preflight {
        self.pilot.set_bus(bus.clone());
        Preflight { bus, ..self }
    }

    /// Where the pilot is asked.
    pub fn requests(&self) -> mpsc::Sender<Request> {
        self.requests.0.clone()
    }

    /// What the camera shows.
    pub fn frames(&self) -> watch::Receiver<Pictures> {
        self.frames.clone()
    }

    /// The newest status of robot and watchdog.
    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    /// How long it takes from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.pilot.reactions()
    }

    /// For so long a host that does not drive may show no life.
    pub(super) fn longest_silence(&self) -> Duration {
        self.settings.limits.host_idle_silence.get()
    }

    /// Where the pilot will run.
    pub fn core(&self) -> &runtime::Handle {
        &self.core
    }

    /// From now on the rescue behaviour runs whenever the watchdog wants it. Its hosts are started on
    /// the calling task's runtime.
    pub fn stand_by(&mut self, launcher: Launcher, launch: Launch) {
        // The rescue behaviour has an end of its own.
        let (_, stop) = watch::channel(None);
        let around = LaunchContext {
            launcher,
            core: self.core.clone(),
            requests: self.requests(),
            frames: self.frames(),
            stop,
            longest_silence: self.longest_silence(),
            lookout: Lookout::default(),
            bus: self.bus.clone(),
        };
        let standing_by = rescue::stand_by(around, launch, self.status());
        self.rescue = Some(AbortOnDropHandle::new(tokio::spawn(standing_by)));
    }

    /// Connects, and drives until the flight ends. When `stop` is cancelled nothing moves any more, at
    /// once, even if the calling thread waits for the system just then.
    pub fn launch(self, stop: &CancellationToken) -> Flight {
        let ending = pilot::Ending::default();
        let flight = self
            .pilot
            .run(self.dial, self.settings, self.requests.1, ending.clone());
        let (stopped, parting) = (stop.clone(), ending.parting.clone());
        let part = self.core.spawn(async move {
            stopped.cancelled().await;
            parting.cancel();
        });
        Flight {
            pilot: AbortOnDropHandle::new(self.core.spawn(flight)),
            over: false,
            ending,
            status: self.status,
            _part: AbortOnDropHandle::new(part),
            _rescue: self.rescue,
        }
    }
}

/// A pilot at work. Dropping it drops the pilot, whose writer says the watchdog's last words.
pub struct Flight {
    pilot: AbortOnDropHandle<Result<Delivery, LinkError>>,
    /// The pilot is no more.
    over: bool,
    ending: pilot::Ending,
    status: watch::Receiver<Status>,
    _part: AbortOnDropHandle<()>,
    /// Ends with the flight.
    _rescue: Option<AbortOnDropHandle<()>>,
}

impl Flight {
    /// Robot and watchdog as they are now.
    pub fn status(&self) -> Status {
        *self.status.borrow()
    }

    /// Waits until the robot is there. Cancel-safe.
    ///
    /// # Errors
    /// As [`Flight::lost`].
    pub async fn up(&mut self) -> Result<(), AgentError> {
        let mut status = self.status.clone();
        tokio::select! {
            biased;
            error = self.lost() => Err(error),
            _ = status.wait_for(|status| status.link == LinkState::Up) => Ok(()),
        }
    }

    /// Waits until the pilot ends without being told to: the first connection has
    /// failed, or the pilot has panicked. Cancel-safe.
    pub async fn lost(&mut self) -> AgentError {
        if self.over {
            return AgentError::Broken("the pilot");
        }
        let ended = (&mut self.pilot).await;
        self.over = true;
        match ended {
            Ok(Err(error)) => AgentError::Link(error),
            Ok(Ok(_)) | Err(_) => AgentError::Broken("the pilot"),
        }
    }

    /// Nothing moves any more; lights and sounds still work.
    pub fn part(&self) {
        self.ending.parting.cancel();
    }

    /// The battery is low and the robot is not on its station.
    pub fn is_away(&self) -> bool {
        is_away(&self.status.borrow())
    }

    /// Waits, through dropped links too, until a robot with a low battery is home; at once if none is
    /// away, or the pilot is no more. Whether one was away. Cancel-safe.
    pub fn stay(&self) -> impl Future<Output = bool> + Send + use<> {
        stay(self.status.clone())
    }

    /// First the tracks, then the link, which is closed when what was said last has arrived, or the
    /// time for it is over.
    pub async fn end(mut self) -> Delivery {
        if self.over {
            return Delivery::Offline;
        }
        self.part();
        self.ending.closing.cancel();
        match timeout(LINK_END, &mut self.pilot).await {
            Ok(Ok(Ok(delivery))) => delivery,
            Ok(Ok(Err(error))) => {
                warn!("the link's end: {error}");
                Delivery::Offline
            }
            Ok(Err(_)) => Delivery::NotAcknowledged {
                after: Duration::ZERO,
            },
            Err(_) => Delivery::NotAcknowledged { after: LINK_END },
        }
    }
}

fn is_away(status: &Status) -> bool {
    status.low && !status.docked
}

async fn stay(mut status: watch::Receiver<Status>) -> bool {
    if !is_away(&status.borrow_and_update()) {
        return false;
    }
    info!("battery low: staying until the robot is on its station (Ctrl-C leaves now)");
    let _ = status.wait_for(|status| !is_away(status)).await;
    true
}
