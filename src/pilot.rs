//! The task that owns the robot's socket, and with it the watchdog: no other code can move the
//! robot. Facts go into the watchdog; the acts that come out are executed here, with all commands
//! of one batch in one write. Knows no script, no decoder and no lock.
//!
//! However this task ends, as told, by a panic or by being dropped, dropping the [`Writer`] sends
//! the last words that the watchdog has left with it.
//!
//! Nothing here blocks until the robot takes a command: see [`Writer::queue`].

mod connection;
mod core;
mod debt;
mod outputs;
mod reaction;
mod requests;
mod silence;
mod status;
mod throttle;

use std::time::Duration;

use bytes::Bytes;
use tokio::sync::{mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use crate::clock::{or_never, until};
pub use crate::link::Delivery;
use crate::link::{Confirmation, Executes, LinkError, Reader, Session, Writer, hang_up};
use crate::rate_limit::Repeats;
use crate::robot::channel::{MAX_REQUESTS, Quiet, Request, Suspend};
use crate::robot::{
    AgentEvent, Battery, BehaviourId, Bus, DockEnd, Event, Frame, Pictures, RobotInfo,
    StopConfirmation, Streams,
};
use crate::safety::{Act, Fact, LastWords, Limits, Watchdog};
use crate::wire::{Accepted, Command, EngineReport, Report};

pub use self::connection::Connector;
use self::connection::{Connection, ConnectionEvent};
use self::core::Interruption;
pub use self::core::{DrivingCore, Heartbeat};
use self::debt::{Debt, DebtAction};
use self::outputs::Restrictions;
use self::reaction::Stopwatch;
pub use self::reaction::{Reactions, Tally};
use self::requests::Sessions;
use self::silence::{Silence, SilenceAction};
use self::status::MinutesLeft;
pub use self::status::{ActuatorState, LinkState, Status};

/// The most requests served in a row before the robot's messages are read again.
const REQUESTS_IN_A_ROW: usize = 32;

/// How often the other tasks get a turn before timeouts are evaluated: once to read, once to pass
/// on.
const YIELDS_BEFORE_TIMEOUTS: usize = 2;

/// Behaviours are told of a sequence of sounds, such as speech, once per this interval.
const SOUND_EVENT_INTERVAL: Duration = Duration::from_millis(500);

/// How long the robot may take at the end to acknowledge what was sent last.
pub const DELIVERY: Duration = Duration::from_secs(2);
/// The shortest time for that, when most of it was spent on reaching the robot.
const SHORTEST_DELIVERY: Duration = Duration::from_millis(300);

/// A robot that answers questions, moves, and leaves one unanswered for this long is stopped.
const STALL: Duration = Duration::from_secs(3);

/// For how long after a lost link the attempts to connect follow each other without growing pauses,
/// if the robot may be driving.
pub const HURRY_LIMIT: Duration = Duration::from_secs(600);

/// How often an unknown message of the robot is logged, per kind.
const UNKNOWN_EVERY: Duration = Duration::from_secs(60);
/// How often the same reason for a failed attempt to connect is logged.
const FAILED_EVERY: Duration = Duration::from_secs(600);
/// How often the same ENGINE report is logged.
const ENGINE_EVERY: Duration = Duration::from_secs(1);

#[derive(Debug)]
struct Ending {
    /// When it is over at the latest.
    until: Instant,
    /// When the robot was asked whether it has executed the last stop.
    asked: Option<Instant>,
}

/// The tokens that end the run.
#[derive(Debug, Clone, Default)]
pub struct Shutdown {
    /// No motion is allowed any more, except the search of a robot with a low battery; lights and
    /// sounds still work.
    pub stop_motion: CancellationToken,
    pub close_link: CancellationToken,
}

#[derive(Debug, Clone)]
pub struct Settings {
    /// The numbers of the safety rules.
    pub limits: Limits,
    /// Whether the connection leads to the embedded simulator.
    pub simulated: bool,
    /// Seeds the jitter of the pauses between attempts to connect.
    pub seed: u64,
    pub link: crate::link::Options,
    /// Whether the first connection is repeated, like each later one, until the robot accepts the
    /// login; only a refused password ends that.
    pub waits: bool,
    /// Which streams of the robot are on, and when.
    pub streams: Streams,
}

/// The task's state; [`Pilot::run`] is its main loop.
#[derive(Debug)]
pub struct Pilot {
    watchdog: Watchdog,
    /// Both halves of the open link.
    reader: Option<Reader>,
    writer: Option<Writer>,
    sessions: Sessions,
    actuators: ActuatorState,
    emergency_stop: bool,
    emergency_stop_sent: Option<Instant>,
    silence: Silence,
    debt: Debt,
    /// A robot that answers questions executes nothing at present.
    executes_nothing: bool,
    lost_at: Option<Instant>,
    minutes_left: MinutesLeft,
    pictures: watch::Sender<Pictures>,
    status: watch::Sender<Status>,
    info: Option<RobotInfo>,
    simulated: bool,
    /// Unknown kinds of messages and of ENGINE, and when each was last logged.
    unknown_messages: Repeats<u8>,
    unknown_engine: Repeats<u8>,
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
    /// When the robot last told its battery level.
    level_told: Option<Instant>,
    quiet: Quiet,
    /// The link is closed on purpose until a behaviour needs the robot.
    released: bool,
    ending: Option<Ending>,
    /// Why attempts to connect have failed, and when each reason was last logged.
    failed: Repeats<String>,
    /// How many attempts have failed before the first connection.
    attempts: u32,
    /// Present in real time only.
    heartbeat: Option<Heartbeat>,
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
        let (pictures, frames) = watch::channel(Pictures::default());
        let (status, newest_status) = watch::channel(Status::default());
        let pilot = Pilot {
            watchdog: Watchdog::new(settings.limits.clone(), Instant::now()),
            reader: None,
            writer: None,
            sessions: Sessions::new(settings.streams),
            actuators: ActuatorState::default(),
            emergency_stop: false,
            emergency_stop_sent: None,
            silence: Silence::new(Instant::now()),
            debt: Debt::default(),
            executes_nothing: false,
            lost_at: None,
            minutes_left: MinutesLeft::default(),
            pictures,
            status,
            info: None,
            simulated: settings.simulated,
            unknown_messages: Repeats::new(UNKNOWN_EVERY),
            unknown_engine: Repeats::new(UNKNOWN_EVERY),
            engine_log: Repeats::new(ENGINE_EVERY),
            streams_due: None,
            restrictions: Restrictions::default(),
            has_deferred: false,
            alarm_due: false,
            moving: false,
            sounding: None,
            level_told: None,
            quiet: Quiet::Off,
            released: false,
            ending: None,
            failed: Repeats::new(FAILED_EVERY),
            attempts: 0,
            heartbeat: None,
            bus: Bus::default(),
            stopwatch: Stopwatch::default(),
        };
        (pilot, frames, newest_status)
    }

    /// Sets the heartbeat, which runs in real time only: it beats for a guardian and detects a
    /// suspension.
    pub fn set_heartbeat(&mut self, heartbeat: Option<Heartbeat>) {
        self.heartbeat = heartbeat;
    }

    pub fn set_bus(&mut self, bus: Bus) {
        self.bus = bus;
    }

    /// Connects, serves and reconnects until told to close. Then goes on for up to [`DELIVERY`]: for
    /// a link if a stop is owed, and for the answer of the robot's program. Returns how far the last
    /// stop has come.
    ///
    /// # Errors
    /// [`LinkError`] if the very first connection fails, so that a person can read it at the start,
    /// unless the settings say to wait. Later failures are retried forever.
    pub async fn run(
        mut self,
        connector: Connector,
        settings: Settings,
        mut requests: mpsc::Receiver<Request>,
        shutdown: Shutdown,
    ) -> Result<Delivery, LinkError> {
        let mut connection = Connection::new(
            connector,
            &settings.link,
            settings.seed,
            self.renew_last_words(),
        );
        let mut motion_stopped = false;
        while !self.is_over(&connection) {
            self.store_last_words(&mut connection);
            let deadline = self.next_deadline();
            let end = self.ending.as_ref().map(|ending| ending.until);
            let guardian_changed = self.heartbeat.as_mut().map(Heartbeat::guardian_changed);
            let progress = self.writer.as_mut().map(Writer::progress);
            let receiving = self.reader.as_mut().map(Reader::receive);
            let turn = tokio::select! {
                biased;
                () = until(end) => break,
                () = shutdown.close_link.cancelled(), if self.ending.is_none() => {
                    self.begin_ending(&mut requests)
                }
                () = shutdown.stop_motion.cancelled(), if !motion_stopped => {
                    motion_stopped = true;
                    self.handle(Fact::RunEnding)
                }
                () = or_never(guardian_changed) => self.check_guardian(),
                () = until(deadline) => self.poll(&mut requests).await,
                // The next turn tells the guardian what is left of a partly written message.
                written = or_never(progress) => written,
                event = connection.next() => match event {
                    ConnectionEvent::Failed(error) if self.ends_run(&error, settings.waits) => {
                        self.release_guardian();
                        return Err(error);
                    }
                    event => self.handle_event(event),
                },
                received = or_never(receiving) => self.handle_received(received),
                Some(request) = requests.recv() => self.serve(request),
            };
            let served = turn.and(self.serve_waiting(&mut requests));
            self.end_turn(served, &mut connection);
        }
        Ok(self.close(connection).await)
    }

    /// Whether a failed attempt to connect ends the run: only one before the first connection does,
    /// when a person can read why.
    fn ends_run(&self, error: &LinkError, waits: bool) -> bool {
        self.info.is_none() && self.ending.is_none() && (error.is_final() || !waits)
    }

    fn end_turn(&mut self, served: Result<(), LinkError>, connection: &mut Connection) {
        let served = served.and_then(|()| self.apply_restrictions());
        let served = served.and_then(|()| self.send_last());
        if let Err(lost) = served.and_then(|()| self.check_execution()) {
            self.handle_link_lost(&lost, connection);
        }
        self.note_setpoint_queued();
        self.tell_motion();
        self.publish();
    }

    /// The time of a timed setpoint begins when the robot begins to execute it.
    fn note_setpoint_queued(&mut self) {
        let now = Instant::now();
        let writer = self.writer.as_ref();
        let queued = writer.is_some_and(|writer| writer.is_new_setpoint_waiting(now));
        if let Some(Act::Tell(by, event)) = self.watchdog.note_setpoint_queued(queued, now) {
            self.sessions.tell(by, event);
        }
    }

    fn next_deadline(&mut self) -> Option<Instant> {
        let writer = self.writer.as_ref();
        let silence = writer.map(|_| self.silence.next_deadline());
        let move_begins = writer.and_then(|writer| writer.move_begins(Instant::now()));
        let beat = self.heartbeat.as_ref().map(Heartbeat::due);
        let deadlines = [
            self.watchdog.next_deadline(),
            self.streams_due,
            silence,
            move_begins,
            self.execution_deadline(),
            beat,
        ];
        deadlines.into_iter().flatten().min()
    }

    /// Must be called first in a turn: beats, and detects an interruption, after which the robot is
    /// stopped first.
    fn heartbeat(&mut self) -> Result<(), LinkError> {
        let heartbeat = self.heartbeat.as_mut();
        let interruption = heartbeat.and_then(|heartbeat| heartbeat.beat(Instant::now()));
        self.note_guardian(interruption)
    }

    fn check_guardian(&mut self) -> Result<(), LinkError> {
        let heartbeat = self.heartbeat.as_mut();
        let interruption = heartbeat.and_then(Heartbeat::check_guardian);
        self.note_guardian(interruption)
    }

    fn note_guardian(&mut self, interruption: Option<Interruption>) -> Result<(), LinkError> {
        let guarded = self.heartbeat.as_ref().is_none_or(Heartbeat::is_guarded);
        if guarded != self.watchdog.is_guarded() {
            self.handle(Fact::Guarded(guarded))?;
        }
        match interruption {
            Some(Interruption { what, fact }) => {
                warn!("{what}: the robot is stopped first");
                self.handle(fact)
            }
            None => Ok(()),
        }
    }

    /// Stops the robot, suspends this program, and stops the robot again when the program resumes.
    fn suspend(&mut self, Suspend(suspend): Suspend) -> Result<(), LinkError> {
        let stopped = self.handle(Fact::Suspended);
        suspend();
        stopped.and_then(|()| self.handle(Fact::Suspended))
    }

    /// Begins the end of the run; serves the requests that the behaviours have sent before.
    fn begin_ending(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkError> {
        self.ending = Some(Ending {
            until: Instant::now() + DELIVERY,
            asked: None,
        });
        let rounds = MAX_REQUESTS / REQUESTS_IN_A_ROW;
        for _ in 0..rounds {
            if requests.is_empty() {
                break;
            }
            self.serve_waiting(requests)?;
        }
        Ok(())
    }

    /// Drains what has arrived while this task, or the whole machine, slept before it evaluates
    /// timeouts.
    async fn poll(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkError> {
        let woken = self.heartbeat();
        for _ in 0..YIELDS_BEFORE_TIMEOUTS {
            tokio::task::yield_now().await;
        }
        let served = self.serve_waiting(requests);
        let acts = self.watchdog.poll(Instant::now());
        woken.and(served).and(self.perform(acts))?;
        self.catch_up_streams()?;
        self.check_silence()
    }

    /// When to look again whether the robot has executed what it was sent.
    fn execution_deadline(&mut self) -> Option<Instant> {
        let now = Instant::now();
        let writer = self.writer.as_mut()?;
        let debt = self.debt.next_deadline(now);
        let stalled = writer.overdue_since().map(|since| since + STALL);
        let stalled = if self.executes_nothing { None } else { stalled };
        debt.into_iter().chain(stalled).min()
    }

    /// Asks whether the last stop is executed, and pays the debt when it is. Stops a robot that
    /// moves but no longer executes what it is sent.
    fn check_execution(&mut self) -> Result<(), LinkError> {
        let now = Instant::now();
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        let executes = writer.executes(now);
        let overdue = writer.overdue_since();
        let confirmation = if self.debt.is_asked() {
            writer.confirmation(now)
        } else {
            Confirmation::NotYet
        };
        let moving = self.watchdog.is_robot_moving();
        match self.debt.poll(moving, confirmation, now) {
            Some(DebtAction::Ask) => writer.ask(now)?,
            Some(DebtAction::Stop) => self.send(&[Command::STOP])?,
            Some(DebtAction::Paid(how)) => {
                debug!("the stop: {how:?}");
                self.tell_guardian_of_debt();
            }
            None => {}
        }
        if let Executes::Every(period) = executes {
            self.silence.note_answers();
            self.watchdog.apply(Fact::Pace(period), now);
        }
        let stalled = overdue.is_some_and(|since| now >= since + STALL);
        let before = std::mem::replace(&mut self.executes_nothing, stalled);
        if stalled && !before && self.watchdog.moving() {
            warn!(
                "the robot has executed nothing for {} s: it is stopped",
                STALL.as_secs()
            );
            return self.handle(Fact::Suspended);
        }
        Ok(())
    }

    /// Asks a silent robot for a sign of life, and ends the link if it stays silent.
    fn check_silence(&mut self) -> Result<(), LinkError> {
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        match self.silence.poll(Instant::now()) {
            Some(SilenceAction::Ask) => writer.ask(Instant::now()),
            Some(SilenceAction::Gone(silence)) => Err(LinkError::ClosedHere(format!(
                "nothing received from the robot for {} s",
                silence.as_secs()
            ))),
            None => Ok(()),
        }
    }

    /// Serves waiting requests, so that they get their turn even if the robot sends without pause.
    fn serve_waiting(&mut self, requests: &mut mpsc::Receiver<Request>) -> Result<(), LinkError> {
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
            self.sessions.tell_all(&Event::Moving { on });
        }
    }

    /// Tells all behaviours that the robot makes a sound, so that none mistakes it for another
    /// noise.
    fn tell_sound(&mut self) {
        let now = Instant::now();
        let lately = |at: Instant| now.saturating_duration_since(at) < SOUND_EVENT_INTERVAL;
        if !self.sounding.is_some_and(lately) {
            self.sounding = Some(now);
            self.sessions.tell_all(&Event::Sounding);
        }
    }

    fn publish(&mut self) {
        self.publish_docking();
        if self.debt.is_owed() && self.watchdog.is_docked_and_still() {
            self.debt.forgive();
            self.tell_guardian_of_debt();
        }
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
            level_told: self.level_told,
            low: self.watchdog.low().is_some(),
            rescue: self.watchdog.wants_rescue(),
            docked: self.watchdog.docked(),
            dock_state: self.watchdog.dock_state(),
            shed: self.watchdog.shed(),
            emergency_stop: self.emergency_stop,
            stop: self.stop_confirmation(),
            owes_stop: self.owes_stop(),
            delays: self.writer.as_mut().and_then(Writer::delays),
            actuators: self.actuators,
            frames: self.status.borrow().frames,
            attempts: self.attempts,
        };
        self.publish_status(&newest);
        self.status.send_if_modified(|status| status.update(newest));
    }

    /// Whether the robot may be moving, and not on its own way home with a low battery.
    fn owes_stop(&self) -> bool {
        self.debt.is_owed() && self.watchdog.last_words() != LastWords::Nothing
    }

    /// Whether the next attempt to connect must not wait.
    pub(super) fn is_hurried(&self) -> bool {
        let urgent = self.debt.is_owed()
            || self.emergency_stop
            || self.watchdog.low().is_some() && !self.watchdog.docked();
        let recent = |lost: Instant| lost.elapsed() < HURRY_LIMIT;
        urgent && self.lost_at.is_some_and(recent)
    }

    fn stop_confirmation(&self) -> StopConfirmation {
        self.debt
            .confirmation(self.writer.is_some(), Instant::now())
    }

    // What comes over the connection.

    fn handle_event(&mut self, event: ConnectionEvent) -> Result<(), LinkError> {
        self.heartbeat()?;
        match event {
            ConnectionEvent::Up(session) => self.connected(*session),
            ConnectionEvent::Accepted(login) => {
                self.watch_login(login);
                Ok(())
            }
            ConnectionEvent::Failed(error) => {
                // If the robot had accepted the login, the last words were sent.
                self.release_guardian();
                self.attempts += u32::from(self.info.is_none());
                self.log_failed_attempt(&error.to_string());
                Ok(())
            }
        }
    }

    fn connected(&mut self, session: Session) -> Result<(), LinkError> {
        let Accepted {
            uid,
            name,
            firmware,
            docked,
            ..
        } = session.accepted;
        let power = session.power;
        let address = session.peer.to_string();
        info!(%uid, %address, %firmware, docked, battery = Battery::reported(power).level(), "connected");
        let info = RobotInfo {
            uid,
            name,
            firmware,
            address,
            simulated: self.simulated,
        };
        self.reader = Some(session.reader);
        self.writer = Some(session.writer);
        self.set_route(session.peer, session.login);
        self.watch_link();
        self.actuators.forget_lights();
        self.silence.begin(Instant::now());
        self.level_told = Some(Instant::now());
        self.executes_nothing = false;
        let robot = info.clone();
        self.bus.publish(AgentEvent::LinkUp { robot, docked });
        self.info = Some(info);
        self.failed = Repeats::new(FAILED_EVERY);
        let mut lost = self
            .handle(Fact::LinkUp { docked, power })
            .and(self.repeat_emergency_stop());
        self.note_level();
        self.publish_battery();
        for event in self.welcome() {
            self.sessions.tell_all(&event);
        }
        for report in session.early {
            lost = lost.and(self.report(report));
        }
        lost?;
        self.ask()?;
        self.apply_streams(true)?;
        self.sound_alarm()
    }

    /// Asks whether everything is executed, after a login and at the end. The answers also measure
    /// how fast the robot executes.
    fn ask(&mut self) -> Result<(), LinkError> {
        let now = Instant::now();
        let Some(writer) = &mut self.writer else {
            return Ok(());
        };
        if !self.watchdog.is_robot_moving() && self.debt.is_owed() {
            self.debt.ask_at_once(now);
            return self.check_execution();
        }
        writer.ask(now)
    }

    /// The events that tell a behaviour the state of a connected robot.
    fn welcome(&self) -> Vec<Event> {
        let (Some(info), Some(battery)) = (&self.info, self.battery()) else {
            return vec![];
        };
        if self.writer.is_none() {
            return vec![];
        }
        let connected = Event::Connected {
            info: info.clone(),
            docked: self.watchdog.docked(),
        };
        vec![Event::Battery(battery), connected]
    }

    /// Handles what the reader has returned: a report, progress of a long one, or a lost link.
    fn handle_received(
        &mut self,
        received: Result<Option<Report>, LinkError>,
    ) -> Result<(), LinkError> {
        self.heartbeat()?;
        match received? {
            Some(report) => self.report(report),
            None => {
                self.silence.note_received(Instant::now());
                Ok(())
            }
        }
    }

    fn report(&mut self, report: Report) -> Result<(), LinkError> {
        self.silence.note_received(Instant::now());
        let lost = self.handle(Fact::BytesReceived);
        if let Some(writer) = &mut self.writer {
            writer.answer(&report, Instant::now());
        }
        match report {
            Report::Power(power) => {
                self.level_told = Some(Instant::now());
                return lost.and(self.take_battery_fact(Fact::Power(power)));
            }
            Report::Engine(report) => return lost.and(self.engine(report)),
            Report::Video(jpeg) => self.frame(jpeg),
            Report::Audio(samples) => self.sessions.tell_listeners(&Event::Audio(samples)),
            Report::SoundFinished => self.sessions.tell_all(&Event::SoundFinished),
            Report::Unknown(packet) => self.log_unknown_message(packet.kind),
            Report::Accepted(_) | Report::Refused(_) => debug!("unexpected login reply"),
            Report::Config(_) | Report::Networks(_) | Report::Log(_) => {}
        }
        lost
    }

    // Events go to behaviours before the answers that they cause: an answer to a waiting call must
    // not overtake the event that ended the call. Sending an event never blocks, so nothing is
    // delayed.

    /// Takes in a fact that may change what is believed of the battery, and publishes such a
    /// change.
    fn take_battery_fact(&mut self, fact: Fact) -> Result<(), LinkError> {
        let before = self.watchdog.battery();
        let read_voltage = self.watchdog.reads_voltage();
        let acts = self.watchdog.handle(fact, Instant::now());
        if self.watchdog.reads_voltage() && !read_voltage {
            warn!(
                "the robot's battery level sags while the tracks run: from now on it is taken for a voltage \
                 and converted; if that is wrong, set `watchdog: {{ power: percent }}` in the config"
            );
        }
        self.note_level();
        if let (Some(before), Some(battery)) = (before, self.battery()) {
            if battery.is_news_after(&before) {
                self.sessions.tell_all(&Event::Battery(battery));
                self.publish_battery();
            }
            if battery.charging != before.charging {
                let on = battery.charging;
                self.sessions.tell_all(&Event::Charging { on });
            }
        }
        self.perform(acts)
    }

    fn note_level(&mut self) {
        if let Some(battery) = self.watchdog.battery() {
            self.minutes_left.level(battery, Instant::now());
        }
    }

    fn engine(&mut self, report: EngineReport) -> Result<(), LinkError> {
        let event = match report {
            EngineReport::Docked => Event::Docked,
            EngineReport::Undocked => Event::Undocked,
            EngineReport::Charged => Event::Charged,
            EngineReport::BaseNotFound => Event::BaseNotFound,
            EngineReport::Unknown(code) => Event::Engine { code },
        };
        self.log_engine_report(report);
        self.sessions.tell_all(&event);
        self.take_battery_fact(Fact::Engine(report))
    }

    /// Puts a frame into the slot of the newest one without decoding it: its readers validate it.
    fn frame(&mut self, jpeg: Bytes) {
        let at = Instant::now();
        let mut seq = 0;
        self.status.send_if_modified(|status| {
            seq = status.count_frame();
            false
        });
        self.stopwatch.frame(at);
        let frame = Frame { seq, at, jpeg };
        self.pictures
            .send_modify(|pictures| pictures.before = pictures.newest.replace(frame));
        self.sessions.notify_frame();
    }

    /// Logs each reason at long intervals: a robot may be out of reach for weeks.
    fn log_failed_attempt(&mut self, error: &str) {
        match self.failed.record(error.to_owned(), Instant::now()) {
            Some(0) if self.info.is_none() => {
                info!("{error}; trying until it answers, Ctrl-C ends");
            }
            Some(0) => warn!("still not connected: {error}"),
            Some(repeated) => warn!(repeated, "still not connected: {error}"),
            None => debug!("still not connected: {error}"),
        }
    }

    /// Limits the log: a broken or faked robot may repeat a report a thousand times a second.
    fn log_engine_report(&mut self, report: EngineReport) {
        let now = Instant::now();
        let said = match report {
            EngineReport::Unknown(code) => self.unknown_engine.record(code, now),
            known => self.engine_log.record(known, now),
        };
        match said {
            Some(0) => info!("the robot says: {}", describe(report)),
            Some(repeated) => info!(repeated, "the robot says: {}", describe(report)),
            None => {}
        }
    }

    fn log_unknown_message(&mut self, kind: u8) {
        if let Some(repeated) = self.unknown_messages.record(kind, Instant::now()) {
            info!(
                kind,
                repeated, "a message of unknown type or length; logged once per type and minute"
            );
        }
    }

    // The end of a link, and of the run.

    /// Handles a lost link: the last words are tried without blocking. If a stop is owed, the next
    /// login delivers it; a robot that still believes in this link would refuse that, so the guardian
    /// does not keep it open.
    fn handle_link_lost(&mut self, lost: &LinkError, connection: &mut Connection) {
        self.store_last_words(connection);
        connection.reconnect();
        let (Some(reader), Some(mut writer)) = (self.reader.take(), self.writer.take()) else {
            return;
        };
        writer.send_last_words();
        tokio::spawn(hang_up(reader, writer));
        self.release_guardian();
        if self.released {
            info!("disconnected: {lost}; the robot is free for others")
        } else {
            warn!("disconnected: {lost}; reconnecting")
        }
        self.minutes_left.forget();
        self.debt.link_lost();
        self.lost_at = Some(Instant::now());
        if let Some(ending) = &mut self.ending {
            ending.asked = None;
        }
        let acts = self.watchdog.handle(Fact::LinkDown, Instant::now());
        // Without a link nothing is sent, so this cannot fail.
        let _ = self.perform(acts);
        let reason = lost.to_string();
        self.bus.publish(AgentEvent::LinkDown {
            reason: reason.clone(),
        });
        self.sessions.tell_all(&Event::Disconnected { reason });
    }

    /// At the end, once a link is there: ends the run's motion (see [`Fact::RunEnding`]), switches
    /// the streams off, and asks whether that is executed.
    fn send_last(&mut self) -> Result<(), LinkError> {
        let now = Instant::now();
        let Some(ending) = &mut self.ending else {
            return Ok(());
        };
        if self.writer.is_none() || ending.asked.is_some() {
            return Ok(());
        }
        ending.asked = Some(now);
        ending.until = ending.until.max(now + SHORTEST_DELIVERY);
        self.handle(Fact::RunEnding)?;
        let off = self.sessions.streams_off();
        self.send(&off)?;
        if let Some(writer) = &mut self.writer {
            writer.drop_audio();
        }
        self.ask()
    }

    /// Whether the run is ending and waits for nothing more: on a link, for the last stop to be
    /// confirmed; without one, for one on which a stop that is owed can be sent, or for a login that
    /// the robot has accepted, since before its first POWER it obeys no stop.
    fn is_over(&mut self, connection: &Connection) -> bool {
        match (&self.ending, &mut self.writer) {
            (None, _) => false,
            (Some(ending), Some(writer)) => {
                let confirmation = writer.confirmation(Instant::now());
                ending.asked.is_some() && confirmation >= Confirmation::Acknowledged
            }
            (Some(_), None) => !self.owes_stop() && !connection.is_logging_in(),
        }
    }

    /// How far the last stop has come.
    fn last_delivery(&mut self) -> Delivery {
        let now = Instant::now();
        let is_owed = self.owes_stop();
        let Some(writer) = &mut self.writer else {
            return if is_owed {
                Delivery::OutOfReach
            } else {
                Delivery::Offline
            };
        };
        let asked = self.ending.as_ref().and_then(|ending| ending.asked);
        match writer.confirmation(now) {
            Confirmation::Executed => Delivery::Executed,
            Confirmation::Acknowledged | Confirmation::Received => Delivery::Acknowledged,
            Confirmation::NotYet if is_owed => Delivery::NotConfirmed {
                after: now - asked.unwrap_or(now),
            },
            Confirmation::NotYet => Delivery::NotDriving,
        }
    }

    /// Closes the link, or leaves it to the guardian if the last stop is not confirmed.
    async fn close(mut self, mut connection: Connection) -> Delivery {
        self.store_last_words(&mut connection);
        let delivery = self.last_delivery();
        let guardian = self.heartbeat.as_mut().and_then(Heartbeat::guardian);
        let is_guarded = guardian.is_some_and(|guardian| guardian.is_answering());
        match delivery {
            Delivery::Executed | Delivery::Acknowledged => info!("{delivery}"),
            Delivery::Offline if self.info.is_none() => debug!("never connected"),
            Delivery::NotDriving | Delivery::Offline => warn!("{delivery}"),
            Delivery::NotConfirmed { .. } | Delivery::OutOfReach if is_guarded => warn!(
                "{delivery}; the guardian process keeps trying to stop it for {} minutes",
                HURRY_LIMIT.as_secs() / 60
            ),
            Delivery::NotConfirmed { .. } | Delivery::OutOfReach => warn!("{delivery}"),
        }
        if is_guarded && connection.is_logging_in() {
            connection.abandon_login();
        } else if !delivery.is_owed() {
            self.debt.forgive();
            self.tell_guardian_of_debt();
            self.release_guardian();
            if let (Some(reader), Some(writer)) = (self.reader.take(), self.writer.take()) {
                hang_up(reader, writer).await;
            }
        }
        delivery
    }

    // What is published on the bus. Nothing here waits for a listener.

    /// The battery with the estimate of the minutes left.
    fn battery(&self) -> Option<Battery> {
        Some(Battery {
            minutes_left: self.minutes_left.estimate(),
            ..self.watchdog.battery()?
        })
    }

    fn publish_battery(&self) {
        if let Some(battery) = self.battery() {
            self.bus.publish(AgentEvent::Battery(battery));
        }
    }

    /// Publishes an undocking that was tried; a refused one is not published, since a script may
    /// request thousands of them.
    fn publish_undocking(&self, by: BehaviourId, event: &Event) {
        let Event::UndockEnded { end, .. } = event else {
            return;
        };
        if let (DockEnd::Done | DockEnd::Timeout, Some(by)) = (*end, self.sessions.name(by)) {
            let by = by.to_owned();
            let end = *end;
            self.bus.publish(AgentEvent::Undock { by, end });
        }
    }

    fn publish_docking(&mut self) {
        let Some(report) = self.watchdog.take_dock_report() else {
            return;
        };
        let by = report.by.and_then(|by| self.sessions.name(by));
        self.bus.publish(AgentEvent::Dock {
            by: by.map(str::to_owned),
            end: report.outcome.end,
            attempts: report.outcome.attempts,
            seconds: report.outcome.took.as_secs_f64(),
        });
    }

    /// Publishes the watchdog's state if it differs from that in the last status.
    fn publish_status(&self, newest: &Status) {
        let before = *self.status.borrow();
        let essence = |status: &Status| (status.safety, status.low, status.docked);
        if essence(&before) != essence(newest) {
            let (state, low, docked) = essence(newest);
            self.bus
                .publish(AgentEvent::Watchdog { state, low, docked });
        }
    }
}

fn describe(report: EngineReport) -> String {
    match report {
        EngineReport::Docked => "on the station".to_owned(),
        EngineReport::Undocked => "off the station".to_owned(),
        EngineReport::Charged => "the battery is full".to_owned(),
        EngineReport::BaseNotFound => "station not found".to_owned(),
        EngineReport::Unknown(code) => format!("ENGINE {code}, an unknown value"),
    }
}
