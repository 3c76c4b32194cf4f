//! Everything that a script's natives and its scheduler share.

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::time::Duration;

use tokio::time::Instant;

use super::album::Album;
use super::blockage::{Blockage, Going};
use super::complaints::{Complaints, Telling};
use super::declaration::Declaration;
use super::events::{EventName, Loan, Payload, Subscriptions};
use super::group::Group;
use super::held::HeldFrame;
use super::life::{Exit, Life};
use super::modules::Modules;
use super::motion::{Motion, Owner};
use super::odometry::{Driver, Odometry, drive_of};
use super::options::Options;
use super::output::{Level, LogLine, Outbox};
use super::params::ParamValue;
use super::queue::Tasks;
use super::shares::Shares;
use super::sight::Sight;
use super::sighting::{Seen, Sighting};
use super::sound::Loudness;
use super::stage::Stage;
use super::store::Store;
use super::streams::{Demand, WantedStreams};
use super::task::{Answer, GroupId, Kind, SubscriptionId, Wait};
use super::way_back::way_back;
use crate::robot::{Battery, Event, Frame, Intent, MotionEnd, MotionId, RobotInfo};
use crate::vision::{FrameError, Skyline, validate_markers};
use crate::wire::Stream;

/// After so long without a loud sound the next one is another noise.
const QUIET: Duration = Duration::from_secs(1);
/// The motors may be heard for so long after the robot has moved.
const MOTOR: Duration = Duration::from_secs(1);
/// A sound may be heard for so long after it has begun.
const SOUND: Duration = Duration::from_secs(5);

/// A turn from one frame to the next that is looked for in the pictures, radians.
const LEAST_TURN: f64 = 0.02;
/// Pictures are late, and so is the end of a turn in them.
const ROLLING_OUT: Duration = Duration::from_millis(500);
/// A turn is looked for so far from what is expected, at least; radians.
const LEAST_REACH: f64 = 0.15;

/// What the script knows of the robot, from the events it was told.
#[derive(Debug, Default)]
pub(super) struct Known {
    pub(super) info: Option<RobotInfo>,
    pub(super) connected: bool,
    pub(super) docked: bool,
    pub(super) battery: Option<(Battery, Instant)>,
    /// Something moves the robot, be it this script or not.
    moving: bool,
}

impl Known {
    fn note(&mut self, event: &Event, now: Instant) {
        match event {
            Event::Connected { info, docked } => {
                self.info = Some(info.clone());
                self.connected = true;
                self.docked = *docked;
            }
            Event::Disconnected { .. } => self.connected = false,
            Event::Battery(battery) | Event::BatteryLow(battery) | Event::BatteryOk(battery) => {
                self.battery = Some((*battery, now));
                self.docked |= battery.charging;
            }
            Event::Charging { on } => self.docked |= on,
            Event::Docked => self.docked = true,
            Event::Undocked => self.docked = false,
            Event::Moving { on } => self.moving = *on,
            _ => {}
        }
    }
}

/// Whether an event says that the robot has moved by itself.
fn shows_motion(event: &Event) -> bool {
    matches!(
        event,
        Event::Moving { .. }
            | Event::Connected { .. }
            | Event::Docked
            | Event::Undocked
            | Event::BaseNotFound
    )
}

/// What a script has used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Usage {
    /// Time spent running, by the wall clock.
    pub cpu: Duration,
    /// The longest time without waiting.
    pub worst_callback: Duration,
    /// The VM's memory, in bytes.
    pub memory_bytes: u64,
}

/// What the script has declared with `params.declare`.
#[derive(Default)]
pub(super) struct Declared {
    /// The names, once it was called.
    pub(super) names: Option<Vec<String>>,
    /// All of them with their values.
    pub(super) all: BTreeMap<String, (Declaration, ParamValue)>,
    /// What is wrong with the values that were given to it.
    pub(super) refused: Option<String>,
}

/// Everything that natives and scheduler share.
pub(super) struct State {
    pub(super) options: Options,
    pub(super) complaints: Complaints,
    /// Typed lines so far.
    pub(super) inputs: u64,
    pub(super) start: Instant,
    pub(super) now: Instant,
    pub(super) tasks: Tasks,
    pub(super) groups: BTreeMap<GroupId, Group>,
    pub(super) subscriptions: Subscriptions,
    pub(super) known: Known,
    pub(super) motion: Motion,
    pub(super) odometry: Odometry,
    blockage: Blockage,
    pub(super) streams: WantedStreams,
    pub(super) sight: Sight,
    pub(super) album: Album,
    pub(super) store: Store,
    pub(super) shares: Shares,
    pub(super) modules: Modules,
    /// Whom a script asks that drives no robot.
    pub(super) stage: Option<Rc<dyn Stage>>,
    pub(super) params: Declared,
    pub(super) outbox: Outbox,
    pub(super) life: Life,
    pub(super) exit: Exit,
    /// No coroutine of the running task stands where it cannot yield.
    pub(super) can_wait: bool,
    pub(super) usage: Usage,
    pub(super) last_call: u64,
    /// When the robot last moved, whoever moved it.
    moved: Option<Instant>,
    /// When it was last loud.
    loud: Option<Instant>,
    /// When the robot was last told to make a sound.
    sounded: Option<Instant>,
    /// Events that the script listens to and that the config keeps from coming; said once each.
    pub(super) missed: BTreeSet<EventName>,
}

impl State {
    /// For people who look on.
    pub(super) fn show_params(&mut self) {
        let all = self.params.all.iter();
        let knobs = all.map(|(name, (declaration, value))| declaration.knob(name, value.clone()));
        self.outbox.params(knobs.collect());
    }

    pub(super) fn new(options: Options, now: Instant) -> State {
        let album = Album::new(options.data_dir.clone(), &options.limits);
        let shares = Shares::new(&options.limits);
        let modules = Modules::new(&options.chunk);
        let sight = Sight::new(&options);
        let odometry = Odometry::new(now, options.calibration);
        State {
            options,
            complaints: Complaints::default(),
            inputs: 0,
            start: now,
            now,
            tasks: Tasks::default(),
            groups: BTreeMap::new(),
            subscriptions: BTreeMap::new(),
            known: Known::default(),
            motion: Motion::default(),
            odometry,
            blockage: Blockage::default(),
            streams: WantedStreams::default(),
            sight,
            album,
            store: Store::default(),
            shares,
            modules,
            stage: None,
            params: Declared::default(),
            outbox: Outbox::new(now),
            life: Life::Running,
            exit: Exit::default(),
            can_wait: true,
            usage: Usage::default(),
            last_call: 0,
            moved: None,
            loud: None,
            sounded: None,
            missed: BTreeSet::new(),
        }
    }

    /// The time never runs backwards.
    pub(super) fn tick(&mut self, now: Instant) {
        self.now = self.now.max(now);
        self.odometry.advance(self.now, self.driver());
        if self.motion.is_on() || self.known.moving {
            self.moved = Some(self.now);
        }
        self.note_used_streams();
        self.outbox.unfold(self.now);
    }

    /// Whether the robot has moved within the last `time`, whoever moved it.
    pub(super) fn has_moved_within(&self, time: Duration) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < time;
        self.motion.is_on() || self.known.moving || self.moved.is_some_and(lately)
    }

    /// Takes note of an event and hands it on.
    pub(super) fn deliver(&mut self, event: Event) {
        self.known.note(&event, self.now);
        if shows_motion(&event) {
            self.moved = Some(self.now);
        }
        if event == Event::Sounding {
            self.sounded = Some(self.now);
        }
        match event {
            Event::MotionEnded { motion, end } => {
                self.motion.ended(motion);
                self.answer(Wait::Motion(motion), || Answer::Motion(end));
            }
            Event::DockEnded {
                call,
                end,
                attempts,
                took,
            } => self.answer(Wait::Dock(call), || Answer::Dock {
                end,
                attempts,
                took,
            }),
            Event::UndockEnded { call, end } => {
                self.answer(Wait::Undock(call), || Answer::Undock(end));
            }
            Event::Audio(ref samples) => {
                self.hear(samples);
                self.publish(EventName::Audio, Payload::Event(Rc::new(event)));
            }
            Event::Loan {
                seconds,
                power,
                low_for,
                way,
            } => {
                let calibration = self.options.calibration;
                let loan = Loan {
                    seconds,
                    power,
                    low_for,
                    way_back: way.map(|way| way_back(&way, calibration)),
                };
                self.publish(EventName::Loan, Payload::Loan(Rc::new(loan)));
            }
            event => {
                if let Some(name) = EventName::of(&event) {
                    self.publish(name, Payload::Event(Rc::new(event)));
                }
            }
        }
    }

    /// The newest frame takes the place of those that nobody has looked at. One that its markers
    /// already give away as no picture is counted and goes no further.
    pub(super) fn deliver_frame(&mut self, frame: Frame) {
        let size = match validate_markers(&frame.jpeg) {
            Ok(size) => size,
            Err(error) => return self.note_damage(frame.seq, &error),
        };
        let held = Rc::new(HeldFrame::new(frame, size, &self.sight.held_bytes));
        self.sight.newest = Some(Rc::clone(&held));
        self.look_where_it_goes(&held);
        self.publish(EventName::Frame, Payload::Frame(held));
    }

    /// What drives the robot, as far as the script knows.
    fn driver(&self) -> Driver {
        match self.motion.setpoint() {
            Some(setpoint) if !setpoint.is_stop() => {
                Driver::Script(drive_of(setpoint, self.options.calibration))
            }
            _ if self.known.moving => Driver::Other,
            _ => Driver::Nobody,
        }
    }

    /// While the script drives for a time, its pictures tell whether the robot turns, and whether it moves.
    fn look_where_it_goes(&mut self, held: &HeldFrame) {
        let at = held.frame().at;
        self.odometry.mark(at);
        let calibration = self.options.calibration;
        let going = self.motion.timed().map(|(motion, setpoint, since)| Going {
            motion,
            since,
            drive: drive_of(setpoint, calibration),
            odometer: self.odometry.odometer(),
        });
        let turn = self.odometry.last_turn().filter(|turn| {
            let turns = turn.abs() > LEAST_TURN;
            self.sight.turned = if turns { Some(at) } else { self.sight.turned };
            let lately = |turned: Instant| at.saturating_duration_since(turned) < ROLLING_OUT;
            self.sight.turned.is_some_and(lately)
        });
        if going.is_none() && turn.is_none() {
            return self.sight.skyline = None;
        }
        let camera = self.options.camera;
        let Ok(image) = self.sight.eyes.look(held.frame().seq, &held.frame().jpeg) else {
            return;
        };
        let skyline = Skyline::of(image, camera);
        let held_since = going.and_then(|going| self.blockage.look(image, at, camera, going));
        if let (Some(turn), Some(before)) = (turn, &self.sight.skyline) {
            let reach = (turn.abs() * 0.6).max(LEAST_REACH);
            if let Some(seen) = skyline.turned_since(before, turn, reach) {
                self.odometry.correct_turn(seen);
            }
        }
        self.sight.skyline = Some(skyline);
        if let (Some(since), Some(going)) = (held_since, going) {
            self.end_blocked(going.motion, since);
        }
    }

    /// A motion leads nowhere: the tracks rest, and whoever waits for its end is told why.
    fn end_blocked(&mut self, motion: MotionId, since: Instant) {
        self.odometry.rewind(since);
        self.motion.ended(motion);
        self.outbox.send(Intent::Release { motion });
        self.answer(Wait::Motion(motion), || Answer::Motion(MotionEnd::Blocked));
    }

    /// Takes note of what the script was told about a frame.
    pub(super) fn saw(&mut self, held: &HeldFrame, found: impl IntoIterator<Item = Seen>) {
        if let Some(witness) = &mut self.sight.witness {
            witness.note(held.frame(), self.now, found);
        }
    }

    /// See [`Script::take_sighting`](super::Script::take_sighting).
    pub(super) fn take_sighting(&mut self) -> Option<Sighting> {
        let newest = self.sight.newest.as_ref().map(|held| held.frame().seq);
        let busy = !self.has_ended() && self.tasks.is_ready();
        let witness = self.sight.witness.as_mut()?;
        witness.take_if(|sighting| !busy || newest != Some(sighting.frame.seq))
    }

    fn hear(&mut self, samples: &[u8]) {
        if self.is_heard(EventName::Noise) {
            let dbfs = Loudness::of(samples).dbfs();
            if dbfs > self.options.limits.noise_dbfs && self.becomes_loud() {
                let own = self.may_hear_itself();
                self.publish(EventName::Noise, Payload::Noise { dbfs, own });
            }
        }
    }

    /// It is loud now; whether it was quiet before. A bell is one noise, however long it rings, and so are
    /// the motors that a script starts because of it.
    fn becomes_loud(&mut self) -> bool {
        let before = self.loud.replace(self.now);
        before.is_none_or(|at| self.now.saturating_duration_since(at) >= QUIET)
    }

    /// Whether what is heard may be the robot's own motors or loudspeaker.
    fn may_hear_itself(&self) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < SOUND;
        self.has_moved_within(MOTOR) || self.sounded.is_some_and(lately)
    }

    /// Whether anyone listens to this event or waits for it.
    pub(super) fn is_heard(&self, name: EventName) -> bool {
        let listens = self.subscriptions.values().any(|one| one.event == name);
        listens
            || !self
                .tasks
                .waiting_for(|wait| *wait == Wait::Event(name))
                .is_empty()
    }

    /// Wakes those who wait for exactly this.
    pub(super) fn answer(&mut self, awaited: Wait, answer: impl Fn() -> Answer) {
        for id in self.tasks.waiting_for(|wait| *wait == awaited) {
            self.tasks.wake(id, answer(), self.now);
        }
    }

    fn publish(&mut self, name: EventName, payload: Payload) {
        self.answer(Wait::Event(name), || Answer::Event(payload.clone()));
        let listeners: Vec<SubscriptionId> = self
            .subscriptions
            .iter()
            .filter(|(_, one)| one.event == name)
            .map(|(id, _)| *id)
            .collect();
        for id in listeners {
            let dropped = self
                .subscriptions
                .get_mut(&id)
                .and_then(|one| one.push(payload.clone()));
            if let Some(count) = dropped {
                let name = name.name();
                self.log(
                    Level::Warn,
                    &format!("'{name}' events come faster than they are handled: {count} dropped"),
                );
            }
            self.schedule(id);
        }
    }

    /// Writes a line of the runtime's own into the script's log.
    pub(super) fn log(&mut self, level: Level, text: &str) {
        self.outbox.log(LogLine::new(level, text), self.now);
    }

    /// Counts a frame that is no picture; the log says so once in a while.
    pub(super) fn note_damage(&mut self, seq: u64, error: &FrameError) {
        if let Some(text) = self.sight.damage.note(seq, &error.to_string(), self.now) {
            self.log(Level::Warn, &text);
        }
    }

    /// Logs a failure, the first time and then ever more rarely for the same place.
    pub(super) fn complain(&mut self, text: &str) {
        let text = match self.complaints.count(text) {
            Telling::Explained => self.explained(text),
            Telling::Plain => text.to_owned(),
            Telling::Counted(count) => format!("{text} ({count} times)"),
            Telling::Silent => return,
        };
        self.log(Level::Error, &text);
    }

    /// A failure in words for people, with the line where it happened.
    pub(super) fn explained(&self, text: &str) -> String {
        let main = (self.options.chunk.as_str(), self.complaints.source.as_str());
        let mut files = std::iter::once(main).chain(self.modules.sources());
        let explain = self.complaints.explain;
        let explained = explain
            .and_then(|explain| files.find_map(|(chunk, source)| explain(text, chunk, source)));
        explained.unwrap_or_else(|| text.to_owned())
    }

    /// To whom the setpoints of the running task belong.
    pub(super) fn owner(&mut self) -> Option<Owner> {
        let task = self.tasks.running()?;
        Some(match task.kind {
            Kind::Handler(id) => Owner::Subscription(id),
            Kind::Line => Owner::Lines,
            _ => Owner::Task(task.handle.id),
        })
    }

    /// An owner is gone, and its setpoint with it.
    pub(super) fn release(&mut self, owner: Owner) {
        if let Some(motion) = self.motion.release(owner) {
            self.outbox.send(Intent::Release { motion });
        }
    }

    /// Switches a stream on unless it is, or must stay off: then it says so.
    pub(super) fn want(&mut self, stream: Stream, by: Demand) -> Result<(), String> {
        if let Some(why) = self.options.streams.refusal(stream) {
            return Err(why);
        }
        if self.streams.want(stream, by, self.now) {
            self.outbox.send(Intent::Stream { stream, on: true });
        }
        Ok(())
    }

    /// Whether anything listens to a stream or waits for it.
    fn is_used(&self, stream: Stream) -> bool {
        let mut events = EventName::ALL.iter().copied();
        events.any(|event| event.stream() == Some(stream) && self.is_heard(event))
    }

    /// Before anything happens: what listens to a stream now still uses it.
    fn note_used_streams(&mut self) {
        for stream in self.streams.lent() {
            if self.is_used(stream) {
                self.streams.note_use(stream, self.now);
            }
        }
    }

    /// Switches off the streams that nothing has used for a while.
    pub(super) fn drop_unused_streams(&mut self) {
        for stream in self.streams.lent() {
            if !self.is_used(stream) && self.streams.drop_if_unused(stream, self.now) {
                self.outbox.send(Intent::Stream { stream, on: false });
            }
        }
    }

    /// When the next stream is switched off because nothing uses it.
    fn next_stream_end(&self) -> Option<Instant> {
        let unused = |stream: &Stream| !self.is_used(*stream);
        let lent = self.streams.lent().into_iter().filter(unused);
        lent.filter_map(|stream| self.streams.end_of(stream)).min()
    }

    /// A number for a docking or undocking.
    pub(super) fn next_call(&mut self) -> crate::robot::CallId {
        self.last_call += 1;
        crate::robot::CallId(self.last_call)
    }

    /// When something is due.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        let ending = match &self.life {
            Life::Stopping(stopping) => Some(stopping.deadline),
            Life::Running => None,
            Life::Ended(_) => return None,
        };
        let timers = [self.tasks.next_timer(), self.outbox.unfolds_at(), ending];
        timers
            .into_iter()
            .chain([self.next_stream_end()])
            .flatten()
            .min()
    }
}
