//! The task that owns the robot's socket, and with it the watchdog: no other code can move the
//! robot. Facts go into the watchdog, its acts come out and are done here, all commands of one
//! batch in one write. Knows no script, no decoder and no lock.
//!
//! However this task ends, by order, by a panic or by being dropped, the [`Writer`]'s own drop says
//! the last words that the watchdog has left with it.
//!
//! Nothing here waits for the robot to take a command: see [`Writer::send`].

mod core;
mod distress;
mod halt;
mod hearing;
mod heralding;
mod hush;
mod lights;
mod line;
mod lost;
mod pulse;
mod reaction;
mod seats;
mod serving;
mod shown;
mod silence;
mod status;
mod throttle;

use std::pin::pin;
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use crate::budget::Repeats;
pub use crate::link::Delivery;
use crate::link::{LinkError, Writer, farewell};
use crate::robot::channel::{MAX_REQUESTS, Request, Sleep};
use crate::robot::{Bus, Event, Pictures, RobotInfo, Streams};
use crate::safety::{Act, Fact, Limits, Watchdog};
use crate::vision::Damage;
use crate::wire::{Command, EngineNews};

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
use self::silence::{Silence, Verdict};
pub use self::status::{LinkState, Status};

/// Requests served in a row before the robot is heard again.
const REQUESTS_IN_A_ROW: usize = 32;

/// How often the other tasks get a turn before a deadline is judged: once to read, once to pass on.
const HEARINGS: usize = 2;

/// Of sounds that follow each other faster, such as speech, behaviours are told so often.
const SOUND_TOLD_AGAIN: Duration = Duration::from_millis(500);

/// How long the robot may take at the end to acknowledge what it was told last.
pub const DELIVERY: Duration = Duration::from_secs(2);

/// How often is said that the robot says what nobody knows, one of each kind.
const UNKNOWN_EVERY: Duration = Duration::from_secs(60);
/// How often the same reason for which the robot cannot be reached is said.
const FAILED_EVERY: Duration = Duration::from_secs(600);
/// How often the same news of the robot's station is said.
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
    damage: Damage,
    status: watch::Sender<Status>,
    info: Option<RobotInfo>,
    simulated: bool,
    /// Kinds of messages that nobody knows, and when each was said.
    unknown: Repeats<hearing::Kind>,
    engine_said: Repeats<EngineNews>,
    streams_due: Option<Instant>,
    /// What lights, sounds and streams were last made to follow.
    distress: Distress,
    /// The watchdog knows something that it has not acted upon yet.
    unsettled: bool,
    /// A behaviour was given up, and the robot has not heard of it yet.
    alarm_due: bool,
    /// What the behaviours were last told of the robot's motion.
    moving: bool,
    /// When they were last told that it makes a sound.
    sounding: Option<Instant>,
    /// Quiet hours.
    hush: Hush,
    /// Nobody dials until somebody wants the robot.
    released: bool,
    /// Why tries to connect have failed, and when each was said.
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
            damage: Damage::default(),
            status,
            info: None,
            simulated: settings.simulated,
            unknown: Repeats::new(UNKNOWN_EVERY),
            engine_said: Repeats::new(ENGINE_EVERY),
            streams_due: None,
            distress: Distress::default(),
            unsettled: false,
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

    /// Connects, serves and reconnects until told to close. Then says whether what the robot was told
    /// last has arrived, for which it waits up to [`DELIVERY`].
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
                news = line.next() => match self.hear(news) {
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

    /// Leaves with the writer and the line what is to be said if everything else dies.
    fn deposit(&mut self, line: &mut Line) {
        line.set_last_words(self.renew_last_words());
        line.rest(self.released);
        if let Some(writer) = &self.writer {
            tell_guardian(&mut self.pulse, writer);
        }
    }

    /// What is to be said if everything else dies; the writer, if there is one, knows it from now on.
    fn renew_last_words(&mut self) -> Vec<Command> {
        let last_words = self.held(&self.watchdog.last_words().commands());
        if let Some(writer) = &mut self.writer {
            writer.set_last_words(last_words.clone());
        }
        last_words
    }

    /// From now on the guardian holds the new link's last words.
    fn guard(&mut self) {
        let guardian = self.pulse.as_mut().and_then(Pulse::guardian);
        let socket = self.writer.as_ref().and_then(Writer::socket);
        if let (Some(guardian), Some(socket), Some(writer)) = (guardian, socket, &self.writer) {
            guardian.guard(socket, writer.last_words().1);
        }
    }

    /// The link is closed and its last words are said.
    fn release_guard(&mut self) {
        if let Some(guardian) = self.pulse.as_mut().and_then(Pulse::guardian) {
            guardian.release();
        }
    }

    /// To be called before anything else is done in a turn: beats, and if the program was asleep nothing
    /// from before is repeated.
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

    /// What has come while this task, or the whole machine, slept is heard before anybody is judged
    /// by his silence.
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
            Some(Verdict::Ask) => self.send(&[Command::PowerQuery]),
            Some(Verdict::Gone(silence)) => {
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
        self.settle()
    }

    /// Takes a fact to the watchdog and does what it wants. Like all below it fails if the link is
    /// lost.
    fn take(&mut self, fact: Fact) -> Result<(), LinkLost> {
        let acts = self.watchdog.take(fact, Instant::now());
        self.perform(acts)
    }

    /// Does what the watchdog wants: first all commands in one write, then the rest.
    fn perform(&mut self, acts: Vec<Act>) -> Result<(), LinkLost> {
        let commands = acts.iter().filter_map(Act::command);
        let commands: Vec<Command> = commands
            .filter(|command| self.hush.allows_alarm(command))
            .collect();
        let mut done = self.send(&commands);
        for act in acts {
            match act {
                Act::Send(_) => {}
                Act::Tell(by, event) => {
                    self.herald_answer(by, &event);
                    self.seats.tell(by, event);
                }
                Act::Announce(event) => {
                    if let Event::Safety { action, reason } = &event {
                        warn!(%action, "watchdog: {reason}");
                    }
                    self.herald_announcement(&event);
                    self.seats.tell_all(&event);
                }
                Act::Kill(by, reason) => self.seats.kill(by, reason),
                Act::Reconnect(reason) => done = done.and(Err(LinkLost::because(reason))),
            }
        }
        done
    }

    /// Never waits. Without a link nothing is kept for later: the robot's next login begins with a
    /// stop.
    fn send(&mut self, commands: &[Command]) -> Result<(), LinkLost> {
        let commands = &*self.held(commands);
        for command in commands {
            if self.simulated && self.writer.is_some() {
                self.lights.tell(command);
            }
            self.lights.note(command);
            self.shown.note(command);
        }
        if commands
            .iter()
            .any(|command| matches!(command, Command::Play(_)))
        {
            self.tell_sound();
        }
        if commands.is_empty() {
            return Ok(());
        }
        self.renew_last_words();
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        writer.queue(commands, Instant::now())?;
        // Before the robot hears them: the guardian may have to say them in our place.
        tell_guardian(&mut self.pulse, writer);
        writer.write_ready()?;
        self.stopwatch.wrote(commands, Instant::now());
        Ok(())
    }

    /// The link is gone: the last words are tried without waiting, and the line sees to them.
    fn lose(&mut self, lost: &LinkLost, line: &mut Line) {
        self.deposit(line);
        let Some(mut writer) = self.writer.take() else {
            return line.hang_up(None);
        };
        writer.say_last_words();
        line.hang_up(Some(writer));
        match self.released {
            true => info!("disconnected: {lost}; the robot is free for others"),
            false => warn!("disconnected: {lost}; connecting anew"),
        }
        let acts = self.watchdog.take(Fact::LinkDown, Instant::now());
        // Without a link nothing is sent, so nothing can fail.
        let _ = self.perform(acts);
        self.release_guard();
        let reason = lost.to_string();
        self.herald_loss(&reason);
        self.seats.tell_all(&Event::Disconnected { reason });
    }

    /// Tells all behaviours when the robot begins to move and when it stands: whoever compares
    /// pictures must know, whoever moves it.
    fn tell_motion(&mut self) {
        let on = self.watchdog.is_robot_moving();
        if on != self.moving {
            self.moving = on;
            self.seats.tell_all(&Event::Moving { on });
        }
    }

    /// Tells all behaviours that the robot makes a sound, so that none takes it for somebody's noise.
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

    /// The last words, streams off, and closed when that has arrived.
    async fn close(mut self, mut line: Line) -> Delivery {
        let parting = self.take(Fact::Parting);
        let off = self.seats.streams_off();
        if let Err(lost) = parting.and_then(|()| self.send(&off)) {
            warn!("at the end: {lost}");
        }
        if let Some(words) = self.damage.rest() {
            warn!("{words}");
        }
        self.deposit(&mut line);
        let delivery = match (self.writer.take(), line.into_reader()) {
            (Some(writer), Some(reader)) => {
                self.beat_during(farewell(reader, writer, DELIVERY)).await
            }
            _ => Delivery::Offline,
        };
        match delivery {
            Delivery::Acknowledged => info!("{delivery}"),
            Delivery::Offline if self.info.is_none() => debug!("never connected"),
            Delivery::NotAcknowledged { .. } | Delivery::Offline => warn!("{delivery}"),
        }
        // What has not arrived yet is the guardian's, which says it again.
        if delivery == Delivery::Acknowledged {
            self.release_guard();
        }
        delivery
    }

    /// The guardian has nothing to do yet.
    async fn beat_during<T>(&mut self, work: impl Future<Output = T>) -> T {
        let mut work = pin!(work);
        loop {
            let due = self.pulse.as_ref().map(Pulse::due);
            tokio::select! {
                biased;
                done = &mut work => return done,
                () = until(due) => {
                    if let Some(pulse) = &mut self.pulse {
                        pulse.beat(Instant::now());
                    }
                }
            }
        }
    }
}

/// Has the guardian hold what this writer would say last.
fn tell_guardian(pulse: &mut Option<Pulse>, writer: &Writer) {
    if let Some(guardian) = pulse.as_mut().and_then(Pulse::guardian) {
        let (half_out, words) = writer.last_words();
        guardian.note(half_out, &words);
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

async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}
