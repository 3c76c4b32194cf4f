//! The task that owns the robot's socket, and with it the watchdog: no other code can move the
//! robot. Facts go into the watchdog; the acts that come out are executed here, with all commands
//! of one batch in one write. Knows no script, no decoder and no lock.
//!
//! However this task ends, as told, by a panic or by being dropped, dropping the [`Writer`] sends
//! the last words that the watchdog has left with it.
//!
//! Nothing here blocks until the robot takes a command: see [`Writer::queue`].

mod acting;
mod core;
mod halt;
mod last_words;
mod lights;
mod line;
mod link_end;
mod link_events;
mod lost;
mod minutes_left;
mod publishing;
mod pulse;
mod quiet_hours;
mod reaction;
mod restrictions;
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
use self::halt::Halt;
use self::lights::Lights;
pub use self::line::Dial;
use self::line::Line;
use self::lost::{LinkEventError, LinkLost};
use self::minutes_left::MinutesLeft;
pub use self::pulse::Pulse;
use self::quiet_hours::QuietHours;
use self::reaction::Stopwatch;
pub use self::reaction::{Reactions, Tally};
use self::restrictions::Restrictions;
use self::seats::Seats;
pub use self::shown::Shown;
use self::silence::{Silence, SilenceAction};
pub use self::status::{LinkState, Status};

/// The most requests served in a row before the robot's messages are read again.
const REQUESTS_IN_A_ROW: usize = 32;

/// How often the other tasks get a turn before timeouts are evaluated: once to read, once to pass
/// on.
const YIELDS_BEFORE_TIMEOUTS: usize = 2;

/// Behaviours are told of a sequence of sounds, such as speech, once per this interval.
const SOUND_EVENT_INTERVAL: Duration = Duration::from_millis(500);

/// How long the robot may take at the end to acknowledge what was sent last.
pub const DELIVERY: Duration = Duration::from_secs(2);

/// How often an unknown message of the robot is logged, per kind.
const UNKNOWN_EVERY: Duration = Duration::from_secs(60);
/// How often the same reason for a failed attempt to connect is logged.
const FAILED_EVERY: Duration = Duration::from_secs(600);
/// How often the same ENGINE report is logged.
const ENGINE_EVERY: Duration = Duration::from_secs(1);

/// The tokens that end the run.
#[derive(Debug, Clone, Default)]
pub struct Ending {
    /// No motion is allowed any more, except the search of a robot with a low battery; lights and
    /// sounds still work.
    pub stop_motion: CancellationToken,
    /// Close the link and return.
    pub close_link: CancellationToken,
}

/// The pilot's settings, besides the line.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The numbers of the safety rules.
    pub limits: Limits,
    /// Whether the line leads to the embedded simulator.
    pub simulated: bool,
    /// Seeds the jitter of the pauses between attempts to connect.
    pub seed: u64,
    /// The timeouts of the link.
    pub link: crate::link::Options,
    /// Which streams of the robot are on, and when.
    pub streams: Streams,
}

/// The task's state; [`Pilot::run`] is its main loop.
#[derive(Debug)]
pub struct Pilot {
    watchdog: Watchdog,
    writer: Option<Writer>,
    seats: Seats,
    lights: Lights,
    /// The state of tracks, lights and sounds as a person beside the robot sees it.
    shown: Shown,
    /// A person's STOP.
    halt: Halt,
    silence: Silence,
    minutes_left: MinutesLeft,
    pictures: watch::Sender<Pictures>,
    status: watch::Sender<Status>,
    info: Option<RobotInfo>,
    simulated: bool,
    /// Unknown kinds of messages, and when each was last logged.
    unknown: Repeats<link_events::UnknownKind>,
    engine_log: Repeats<EngineReport>,
    streams_due: Option<Instant>,
    /// The state that lights, sounds and streams were last adapted to.
    restrictions: Restrictions,
    /// The watchdog has taken in a fact whose acts are deferred.
    has_deferred: bool,
    /// A behaviour was given up, and the robot has not sounded the alarm for it yet.
    alarm_due: bool,
    /// The state of motion that the behaviours were last told.
    moving: bool,
    /// When the behaviours were last told of a sound.
    sounding: Option<Instant>,
    /// Quiet hours.
    quiet_hours: QuietHours,
    /// The link is closed on purpose until a behaviour needs the robot.
    released: bool,
    /// Why attempts to connect have failed, and when each reason was last logged.
    failed: Repeats<String>,
    /// Present in real time only.
    pulse: Option<Pulse>,
    /// Publishes what has happened.
    bus: Bus,
    /// Measures the time from a frame to the motion that behaviours derive from it.
    stopwatch: Stopwatch,
}

impl Pilot {
    /// The times from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.stopwatch.reactions.clone()
    }

    /// Begins without a link. Also returns the channels of the camera's frames and of the newest
    /// status.
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
            minutes_left: MinutesLeft::default(),
            pictures,
            status,
            info: None,
            simulated: settings.simulated,
            unknown: Repeats::new(UNKNOWN_EVERY),
            engine_log: Repeats::new(ENGINE_EVERY),
            streams_due: None,
            restrictions: Restrictions::default(),
            has_deferred: false,
            alarm_due: false,
            moving: false,
            sounding: None,
            quiet_hours: QuietHours::default(),
            released: false,
            failed: Repeats::new(FAILED_EVERY),
            pulse: None,
            bus: Bus::default(),
            stopwatch: Stopwatch::default(),
        };
        (pilot, shown, newest_status)
    }

    /// Sets the heartbeat, which runs in real time only: it beats for a guardian and detects a
    /// suspension.
    pub fn set_pulse(&mut self, pulse: Option<Pulse>) {
        self.pulse = pulse;
    }

    /// Sets the bus on which the pilot publishes.
    pub fn set_bus(&mut self, bus: Bus) {
        self.bus = bus;
    }

    /// Connects, serves and reconnects until told to close. Then waits up to [`DELIVERY`] for a
    /// login in progress or the last words of a lost link, and as long again for the robot's
    /// acknowledgement; returns whether that has come for what was sent last.
    ///
    /// # Errors
    /// [`LinkError`] if the very first connection fails, so that a person can read it at the start.
    /// Later failures are retried forever.
    pub async fn run(
        mut self,
        dial: Dial,
        settings: Settings,
        mut requests: mpsc::Receiver<Request>,
        ending: Ending,
    ) -> Result<Delivery, LinkError> {
        let mut line = Line::new(dial, &settings.link, settings.seed, self.renew_last_words());
        let mut motion_stopped = false;
        loop {
            self.store_last_words(&mut line);
            let deadline = self.next_deadline();
            let turn = tokio::select! {
                biased;
                () = ending.close_link.cancelled() => break,
                () = ending.stop_motion.cancelled(), if !motion_stopped => {
                    motion_stopped = true;
                    self.take(Fact::RunEnding)
                }
                () = until(deadline) => self.tick(&mut requests).await,
                // The next turn tells the guardian what is left of a partly written message.
                written = progress(self.writer.as_mut()) => written.map_err(LinkLost::from),
                event = line.next() => match self.handle_event(event) {
                    Ok(()) => Ok(()),
                    Err(LinkEventError::Lost(lost)) => Err(lost),
                    Err(LinkEventError::First(error)) => return Err(error),
                },
                Some(request) = requests.recv() => self.serve(request),
            };
            let served = turn.and(self.serve_waiting(&mut requests));
            if let Err(lost) = served.and_then(|()| self.apply_restrictions()) {
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

    /// Must be called first in a turn: beats, and detects an interruption, after which nothing from
    /// before is repeated.
    fn wake(&mut self) -> Result<(), LinkLost> {
        let pulse = self.pulse.as_mut();
        match pulse.and_then(|pulse| pulse.beat(Instant::now())) {
            Some(interruption) => {
                warn!("{interruption}: the robot is stopped first");
                self.take(Fact::Suspended)
            }
            None => Ok(()),
        }
    }

    /// Stops the robot, suspends this program, and stops the robot again when the program resumes.
    fn sleep(&mut self, Sleep(sleep): Sleep) -> Result<(), LinkLost> {
        let stopped = self.take(Fact::Suspended);
        sleep();
        stopped.and_then(|()| self.take(Fact::Suspended))
    }

    /// Serves the requests that the behaviours sent before `close_link` was cancelled.
    fn serve_last(&mut self, requests: &mut mpsc::Receiver<Request>) {
        let rounds = MAX_REQUESTS / REQUESTS_IN_A_ROW;
        for _ in 0..rounds {
            if requests.is_empty() || self.serve_waiting(requests).is_err() {
                return;
            }
        }
    }

    /// Drains what has arrived while this task, or the whole machine, slept before it evaluates
    /// timeouts.
    async fn tick(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkLost> {
        let woken = self.wake();
        for _ in 0..YIELDS_BEFORE_TIMEOUTS {
            tokio::task::yield_now().await;
        }
        let served = self.serve_waiting(requests);
        let acts = self.watchdog.tick(Instant::now());
        woken.and(served).and(self.perform(acts))?;
        self.catch_up_streams()?;
        self.check_silence()
    }

    /// Asks a silent robot for a sign of life, and ends the link if it stays silent.
    fn check_silence(&mut self) -> Result<(), LinkLost> {
        if self.writer.is_none() {
            return Ok(());
        }
        match self.silence.poll(Instant::now()) {
            Some(SilenceAction::Ask) => self.send(&[Command::PowerQuery]),
            Some(SilenceAction::Gone(silence)) => {
                let silence = silence.as_secs();
                let reason = format!("nothing received from the robot for {silence} s");
                Err(LinkLost::because(reason))
            }
            None => Ok(()),
        }
    }

    /// Serves waiting requests, so that they get their turn even if the robot sends without pause.
    fn serve_waiting(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkLost> {
        for _ in 0..REQUESTS_IN_A_ROW {
            let Ok(request) = requests.try_recv() else {
                break;
            };
            self.serve(request)?;
        }
        self.flush_deferred()
    }

    /// Tells all behaviours when the robot begins and stops moving: those that compare pictures
    /// must know, whatever moves it.
    fn tell_motion(&mut self) {
        let on = self.watchdog.is_robot_moving();
        if on != self.moving {
            self.moving = on;
            self.seats.tell_all(&Event::Moving { on });
        }
    }

    /// Tells all behaviours that the robot makes a sound, so that none mistakes it for another
    /// noise.
    fn tell_sound(&mut self) {
        let now = Instant::now();
        let lately = |at: Instant| now.saturating_duration_since(at) < SOUND_EVENT_INTERVAL;
        if !self.sounding.is_some_and(lately) {
            self.sounding = Some(now);
            self.seats.tell_all(&Event::Sounding);
        }
    }

    fn publish(&mut self) {
        self.publish_docking();
        let link = match (&self.writer, &self.info) {
            (Some(_), _) => LinkState::Up,
            (None, _) if self.released => LinkState::Released,
            (None, Some(_)) => LinkState::Lost,
            (None, None) => LinkState::Connecting,
        };
        let newest = Status {
            link,
            safety: self.watchdog.state(),
            battery: self.battery(),
            low: self.watchdog.low().is_some(),
            rescue: self.watchdog.wants_rescue(),
            docked: self.watchdog.docked(),
            place: self.watchdog.place(),
            shed: self.watchdog.shed(),
            halted: self.halt.is_on(),
            shown: self.shown,
            frames: self.status.borrow().frames,
        };
        self.publish_status(&newest);
        self.status.send_if_modified(|status| status.update(newest));
    }
}

/// Writes what is queued; see [`Writer::progress`].
async fn progress(writer: Option<&mut Writer>) -> Result<(), LinkError> {
    match writer {
        Some(writer) => writer.progress().await,
        None => std::future::pending().await,
    }
}
