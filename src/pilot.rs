//! The task that owns the robot's socket, and with it the watchdog: no other code can move the
//! robot. Facts go into the watchdog, its acts come out and are done here, all commands of one
//! batch in one write. Knows no script, no decoder and no lock.
//!
//! However this task ends, by order, by a panic or by being dropped, the [`Writer`]'s own drop
//! sends the last words that the watchdog has left with it.
//!
//! Nothing here waits for the robot to take a command: see [`Writer::queue`].

mod acting;
mod core;
mod distress;
mod halt;
mod hearing;
mod heralding;
mod hush;
mod last_words;
mod lights;
mod line;
mod lost;
mod parting;
mod pulse;
mod reaction;
mod seats;
mod serving;
mod shown;
mod silence;
mod status;
mod throttle;

use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::warn;

use crate::budget::Repeats;
use crate::clock::until;
pub use crate::link::Delivery;
use crate::link::{LinkError, Writer};
use crate::robot::channel::{MAX_REQUESTS, Request, Sleep};
use crate::robot::{Bus, Event, Pictures, RobotInfo, Streams};
use crate::safety::{Fact, Limits, Watchdog};
use crate::wire::{Command, EngineReport};

pub use self::core::DrivingCore;
use self::distress::Distress;
use self::halt::Halt;
use self::hush::Hush;
use self::lights::Lights;
pub use self::line::Dial;
use self::line::Line;
use self::lost::{HearError, LinkLost};
pub use self::pulse::Pulse;
use self::reaction::Stopwatch;
pub use self::reaction::{Reactions, Tally};
use self::seats::Seats;
pub use self::shown::Shown;
use self::silence::{Silence, SilenceAction};
pub use self::status::{LinkState, Status};

/// Requests served in a row before the robot is heard again.
const REQUESTS_IN_A_ROW: usize = 32;

/// How often the other tasks get a turn before a timeout is evaluated: once to read, once to pass
/// on.
const HEARINGS: usize = 2;

/// Of sounds that follow each other faster, such as speech, behaviours are told so often.
const SOUND_TOLD_AGAIN: Duration = Duration::from_millis(500);

/// How long the robot may take at the end to acknowledge what it was told last.
pub const DELIVERY: Duration = Duration::from_secs(2);

/// How often an unknown message of the robot is logged, for each kind.
const UNKNOWN_EVERY: Duration = Duration::from_secs(60);
/// How often the same reason for which the robot cannot be reached is logged.
const FAILED_EVERY: Duration = Duration::from_secs(600);
/// How often the same report of the robot's station is logged.
const ENGINE_EVERY: Duration = Duration::from_secs(1);

/// How the run is told to come to its end.
#[derive(Debug, Clone, Default)]
pub struct Ending {
    /// Nothing may move any more; lights and sounds still work.
    pub parting: CancellationToken,
    /// Close the link and return.
    pub closing: CancellationToken,
}

/// What the pilot needs to know besides the line.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The numbers of the safety rules.
    pub limits: Limits,
    /// The line leads to the embedded simulator.
    pub simulated: bool,
    /// Seeds the jitter of the pauses between tries to connect.
    pub seed: u64,
    /// Times of the link.
    pub link: crate::link::Options,
    /// When the robot's streams are on.
    pub streams: Streams,
}

/// The task's state. [`Pilot::run`] is its life.
#[derive(Debug)]
pub struct Pilot {
    watchdog: Watchdog,
    writer: Option<Writer>,
    seats: Seats,
    lights: Lights,
    /// As a person beside the robot sees it.
    shown: Shown,
    /// A person's STOP.
    halt: Halt,
    silence: Silence,
    pictures: watch::Sender<Pictures>,
    status: watch::Sender<Status>,
    info: Option<RobotInfo>,
    simulated: bool,
    /// Unknown kinds of messages, and when each was logged.
    unknown: Repeats<hearing::UnknownKind>,
    engine_said: Repeats<EngineReport>,
    streams_due: Option<Instant>,
    /// What lights, sounds and streams were last made to follow.
    distress: Distress,
    /// The watchdog knows something that it has not acted upon yet.
    has_deferred: bool,
    /// A behaviour was given up, and the robot has not heard of it yet.
    alarm_due: bool,
    /// What the behaviours were last told of the robot's motion.
    moving: bool,
    /// When they were last told that it makes a sound.
    sounding: Option<Instant>,
    /// Quiet hours.
    hush: Hush,
    /// The link is down on purpose until a behaviour wants the robot.
    released: bool,
    /// Why attempts to connect have failed, and when each was logged.
    failed: Repeats<String>,
    /// In real time only.
    pulse: Option<Pulse>,
    /// Where it says what has happened.
    bus: Bus,
    /// From frames to what behaviours make of them.
    stopwatch: Stopwatch,
}

impl Pilot {
    /// How long it takes from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.stopwatch.reactions.clone()
    }

    /// Without a link. Also returns what the camera shows and the newest status.
    pub fn new(settings: &Settings) -> (Pilot, watch::Receiver<Pictures>, watch::Receiver<Status>) {
        let (pictures, shown) = watch::channel(Pictures::default());
        let (status, newest_status) = watch::channel(Status::default());
        let pilot = Pilot {
            watchdog: Watchdog::new(settings.limits.clone(), Instant::now()),
            writer: None,
            seats: Seats::new(settings.streams),
            lights: Lights::default(),
            shown: Shown::default(),
            halt: Halt::default(),
            silence: Silence::new(Instant::now()),
            pictures,
            status,
            info: None,
            simulated: settings.simulated,
            unknown: Repeats::new(UNKNOWN_EVERY),
            engine_said: Repeats::new(ENGINE_EVERY),
            streams_due: None,
            distress: Distress::default(),
            has_deferred: false,
            alarm_due: false,
            moving: false,
            sounding: None,
            hush: Hush::default(),
            released: false,
            failed: Repeats::new(FAILED_EVERY),
            pulse: None,
            bus: Bus::default(),
            stopwatch: Stopwatch::default(),
        };
        (pilot, shown, newest_status)
    }

    /// In real time: beats for a guardian, and notices when the program was asleep.
    pub fn set_pulse(&mut self, pulse: Option<Pulse>) {
        self.pulse = pulse;
    }

    /// Says on this bus what happens.
    pub fn set_bus(&mut self, bus: Bus) {
        self.bus = bus;
    }

    /// Connects, serves and reconnects until told to close. Then says whether what the robot was
    /// told last has arrived, for which it waits up to [`DELIVERY`].
    ///
    /// # Errors
    /// [`LinkError`] if the very first connection fails: then a person is there to read it. Later
    /// failures are tried again for ever.
    pub async fn run(
        mut self,
        dial: Dial,
        settings: Settings,
        mut requests: mpsc::Receiver<Request>,
        ending: Ending,
    ) -> Result<Delivery, LinkError> {
        let mut line = Line::new(dial, &settings.link, settings.seed, self.renew_last_words());
        let mut parted = false;
        loop {
            self.deposit(&mut line);
            let deadline = self.next_deadline();
            let turn = tokio::select! {
                biased;
                () = ending.closing.cancelled() => break,
                () = ending.parting.cancelled(), if !parted => {
                    parted = true;
                    self.take(Fact::Parting)
                }
                () = until(deadline) => self.tick(&mut requests).await,
                error = progress(self.writer.as_mut()) => Err(error.into()),
                event = line.next() => match self.hear(event) {
                    Ok(()) => Ok(()),
                    Err(HearError::Lost(lost)) => Err(lost),
                    Err(HearError::First(error)) => return Err(error),
                },
                Some(request) = requests.recv() => self.serve(request),
            };
            let served = turn.and(self.serve_waiting(&mut requests));
            if let Err(lost) = served.and_then(|()| self.follow_distress()) {
                self.lose(&lost, &mut line);
            }
            self.tell_motion();
            self.publish();
        }
        self.serve_last(&mut requests);
        Ok(self.close(line).await)
    }

    fn next_deadline(&self) -> Option<Instant> {
        let silence = self.writer.as_ref().map(|_| self.silence.next_deadline());
        let beat = self.pulse.as_ref().map(Pulse::due);
        let deadlines = [
            self.watchdog.next_deadline(),
            self.streams_due,
            silence,
            beat,
        ];
        deadlines.into_iter().flatten().min()
    }

    /// To be called before anything else is done in a turn: beats, and if the program was asleep
    /// nothing from before is repeated.
    fn wake(&mut self) -> Result<(), LinkLost> {
        let pulse = self.pulse.as_mut();
        match pulse.and_then(|pulse| pulse.beat(Instant::now())) {
            Some(slept) => {
                warn!(
                    "asleep for {:.1} s: the robot is stopped first",
                    slept.as_secs_f64()
                );
                self.take(Fact::Suspended)
            }
            None => Ok(()),
        }
    }

    /// Stops the robot, then this program; when it goes on, the robot again.
    fn sleep(&mut self, Sleep(sleep): Sleep) -> Result<(), LinkLost> {
        let stopped = self.take(Fact::Suspended);
        sleep();
        stopped.and_then(|()| self.take(Fact::Suspended))
    }

    /// What the behaviours asked for with their last words has come before the order to close.
    fn serve_last(&mut self, requests: &mut mpsc::Receiver<Request>) {
        let rounds = MAX_REQUESTS / REQUESTS_IN_A_ROW;
        for _ in 0..rounds {
            if requests.is_empty() || self.serve_waiting(requests).is_err() {
                return;
            }
        }
    }

    /// Drains what has come while this task, or the whole machine, slept before it evaluates
    /// timeouts.
    async fn tick(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkLost> {
        let woken = self.wake();
        for _ in 0..HEARINGS {
            tokio::task::yield_now().await;
        }
        let served = self.serve_waiting(requests);
        let acts = self.watchdog.tick(Instant::now());
        woken.and(served).and(self.perform(acts))?;
        self.catch_up_streams()?;
        self.check_silence()
    }

    /// Is the robot still there, though nothing is heard of it?
    fn check_silence(&mut self) -> Result<(), LinkLost> {
        if self.writer.is_none() {
            return Ok(());
        }
        match self.silence.poll(Instant::now()) {
            Some(SilenceAction::Ask) => self.send(&[Command::PowerQuery]),
            Some(SilenceAction::Gone(silence)) => {
                let silence = silence.as_secs();
                let reason = format!("nothing was heard of the robot for {silence} s");
                Err(LinkLost::because(reason))
            }
            None => Ok(()),
        }
    }

    /// Requests get their turn even if the robot never stops talking.
    fn serve_waiting(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkLost> {
        for _ in 0..REQUESTS_IN_A_ROW {
            let Ok(request) = requests.try_recv() else {
                break;
            };
            self.serve(request)?;
        }
        self.flush_deferred()
    }

    /// Tells all behaviours when the robot begins to move and when it stands: those that compare
    /// pictures must know, whatever moves it.
    fn tell_motion(&mut self) {
        let on = self.watchdog.is_robot_moving();
        if on != self.moving {
            self.moving = on;
            self.seats.tell_all(&Event::Moving { on });
        }
    }

    /// Tells all behaviours that the robot makes a sound, so that none takes it for a noise of
    /// others.
    fn tell_sound(&mut self) {
        let now = Instant::now();
        let lately = |at: Instant| now.saturating_duration_since(at) < SOUND_TOLD_AGAIN;
        if !self.sounding.is_some_and(lately) {
            self.sounding = Some(now);
            self.seats.tell_all(&Event::Sounding);
        }
    }

    fn publish(&mut self) {
        self.herald_dock();
        let link = match (&self.writer, &self.info) {
            (Some(_), _) => LinkState::Up,
            (None, _) if self.released => LinkState::Released,
            (None, Some(_)) => LinkState::Lost,
            (None, None) => LinkState::Connecting,
        };
        let newest = Status {
            link,
            safety: self.watchdog.state(),
            battery: self.watchdog.battery(),
            low: self.watchdog.low().is_some(),
            rescue: self.watchdog.wants_rescue(),
            docked: self.watchdog.docked(),
            place: self.watchdog.place(),
            shed: self.watchdog.shed(),
            halted: self.halt.is_on(),
            shown: self.shown,
            frames: self.status.borrow().frames,
        };
        self.herald_status(&newest);
        self.status.send_if_modified(|status| status.update(newest));
    }
}

/// Writes what waits; returns only if that fails.
async fn progress(writer: Option<&mut Writer>) -> LinkError {
    match writer {
        Some(writer) => match writer.progress().await {
            Ok(never) => match never {},
            Err(error) => error,
        },
        None => std::future::pending().await,
    }
}
