//! The state that a script's native functions and its scheduler share, and the scheduler's rules.
//! The order is the same in every run: ready tasks are queued, timers fire by time and then in the
//! order in which they were set, and tasks that wait for the same event wake in the order of their
//! creation.
//!
//! A script that is asked to stop has its tasks cancelled; they may clean up, and its
//! `script.on_stop` functions run. One that is killed runs no further line, and the output of its
//! last slice is discarded, except log lines, parameters and saved pictures.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{LuaFunction, LuaMultiValue};
use tokio::time::Instant;

use super::eval;
use super::failure::{FailureLog, Life, ScriptExit};
use super::frame_state::{AnnotatedFrame, FrameState, LabelledBlob, MotionCheck};
use super::modules::Modules;
use super::motion::{Motion, Owner};
use super::options::{Options, ScenarioApi};
use super::output::{DailyLimits, Evaluated, FromHost, Level, LogLine};
use super::picture_store::PictureStore;
use super::store::Store;
use super::streams::{Demand, Loudness, WantedStreams};
use super::task::{
    Cancel, Due, Group, GroupId, Payload, Status, SubscriptionId, TaskId, TaskKind, TaskPhase,
    Tasks, Timer, Wait, Wakeup,
};
use crate::api::EventName;
use crate::odometry::{Blockage, Driver, Odometry, TimedMotion};
use crate::rate_limit::is_round;
use crate::robot::{
    Battery, DeclaredParam, DockEnd, EndReason, Event, Frame, HostReport, Intent, MotionEnd,
    MotionId, RobotInfo,
};
use crate::vision::{Blob, BlobOptions, Colour, FrameError, Image, Line, Roi, validate_markers};
use crate::wire::Stream;

/// Least turn between two frames, in radians, that is searched for in the pictures.
const LEAST_TURN: f64 = 0.02;
/// How long after the tracks have stopped the pictures may still show a turn, because tracks and
/// pictures are late.
const COASTING_TIME: Duration = Duration::from_millis(500);

/// After this long without a loud sound the next one is a new noise.
const QUIET: Duration = Duration::from_secs(1);
/// How long a call that was refused takes, so that a loop of them leaves time for others.
const REFUSAL_PAUSE: Duration = Duration::from_millis(100);
/// The motors may be heard for this long after the robot has moved.
const MOTOR: Duration = Duration::from_secs(1);
/// A sound of the robot may be heard for this long after it has begun.
const SOUND: Duration = Duration::from_secs(5);
/// The error that the wait of a cancelled task raises.
pub(super) const CANCELLED: &str = "cancelled";
/// This many failures of a subscription's function in a row end the script.
const MAX_FAILURES: u32 = 5;
/// Time limit for clean-up and `script.on_stop` together.
const STOP_TIME: Duration = Duration::from_millis(500);

pub(super) const MAX_SUBSCRIPTIONS: usize = 64;
/// The most events that wait for a handler.
const MAX_QUEUE: usize = 64;
const MAX_INTENTS: usize = 256;
/// Largest number of bytes of `Intent::Say` in the queue.
const MAX_SPEECH: usize = 256 * 1024;
/// Largest number of log lines in one [`WINDOW`]; further ones are dropped and counted.
const MAX_LINES: u32 = 100;
/// The period of [`MAX_LINES`].
const WINDOW: Duration = Duration::from_secs(1);

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Usage {
    /// Time spent running, by the wall clock.
    pub cpu: Duration,
    /// The longest time without waiting.
    pub worst_callback: Duration,
    pub memory_bytes: u64,
}

pub(super) struct State {
    pub(super) options: Options,
    pub(super) failure_log: FailureLog,
    /// Number of lines typed so far.
    pub(super) inputs: u64,
    pub(super) start: Instant,
    pub(super) now: Instant,
    pub(super) tasks: Tasks,
    /// The first failure of a task that nothing has joined: the script then ends with it.
    pub(super) failed_task: Option<(TaskId, String)>,
    pub(super) groups: BTreeMap<GroupId, Group>,
    pub(super) subscriptions: BTreeMap<SubscriptionId, Subscription>,
    pub(super) robot: RobotState,
    pub(super) motion: Motion,
    pub(super) odometry: Odometry,
    pub(super) blockage: Blockage,
    pub(super) streams: WantedStreams,
    pub(super) frames: FrameState,
    pub(super) picture_store: PictureStore,
    pub(super) store: Store,
    pub(super) daily_limits: DailyLimits,
    pub(super) modules: Modules,
    pub(super) scenario_api: Option<Rc<dyn ScenarioApi>>,
    /// The parameters by name; `None` before `params.declare` was called.
    pub(super) declared_params: Option<BTreeMap<String, DeclaredParam>>,
    /// The error message if the given values of parameters were refused.
    pub(super) refused_params: Option<String>,
    pub(super) output: OutputQueue,
    pub(super) life: Life,
    pub(super) stop_handlers: VecDeque<LuaFunction>,
    /// Set when the running task has called `script.stop`; holds its message.
    pub(super) stop_requested: Option<Option<String>>,
    /// A native function has panicked: the state of the script can no longer be trusted.
    pub(super) broken: bool,
    /// Whether the running task can yield; `false` inside a coroutine or callback that cannot.
    pub(super) can_wait: bool,
    pub(super) usage: Usage,
    pub(super) last_call: u64,
    /// Why the robot does not move, as last logged.
    last_refusal: Option<&'static str>,
    last_moved: Option<Instant>,
    last_loud: Option<Instant>,
    last_sounded: Option<Instant>,
    /// Events that the script listens to although the config prevents them; each is logged once.
    pub(super) unavailable_events: BTreeSet<EventName>,
}

impl State {
    pub(super) fn show_params(&mut self) {
        let declared = self.declared_params.iter().flat_map(BTreeMap::values);
        self.output.params(declared.cloned().collect());
    }

    pub(super) fn new(options: Options, now: Instant) -> State {
        let picture_store = PictureStore::new(options.data_dir.clone(), &options.limits)
            .with_left(options.bytes_left);
        let daily_limits = DailyLimits::new(&options.limits);
        let modules = Modules::new(&options.chunk);
        let frames = FrameState::new(&options);
        let calibration = options.calibration;
        let odometry = Odometry::new(now, calibration.full_speed, calibration.track_width);
        State {
            options,
            failure_log: FailureLog::default(),
            inputs: 0,
            start: now,
            now,
            tasks: Tasks::default(),
            failed_task: None,
            groups: BTreeMap::new(),
            subscriptions: BTreeMap::new(),
            robot: RobotState::default(),
            motion: Motion::default(),
            odometry,
            blockage: Blockage::default(),
            streams: WantedStreams::default(),
            frames,
            picture_store,
            store: Store::default(),
            daily_limits,
            modules,
            scenario_api: None,
            declared_params: None,
            refused_params: None,
            output: OutputQueue::new(now),
            life: Life::Running,
            stop_handlers: VecDeque::new(),
            stop_requested: None,
            broken: false,
            can_wait: true,
            usage: Usage::default(),
            last_call: 0,
            last_refusal: None,
            last_moved: None,
            last_loud: None,
            last_sounded: None,
            unavailable_events: BTreeSet::new(),
        }
    }

    /// Advances the time, which never runs backwards.
    pub(super) fn tick(&mut self, now: Instant) {
        self.now = self.now.max(now);
        self.odometry.advance(self.now, self.driver());
        if self.motion.is_on() || self.robot.moving {
            self.last_moved = Some(self.now);
        }
        self.note_used_streams();
        self.output.roll_window(self.now);
    }

    /// Whether the robot has moved within the last `time`, whatever the cause.
    pub(super) fn has_moved_within(&self, time: Duration) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < time;
        self.motion.is_on() || self.robot.moving || self.last_moved.is_some_and(lately)
    }

    /// Whether a task can run, or a frame must be examined for the robot's own motion.
    pub(super) fn is_ready(&self) -> bool {
        !self.has_ended() && (self.tasks.is_ready() || self.frames.motion_check.is_some())
    }

    /// The source of the robot's motion, as far as the script knows.
    fn driver(&self) -> Driver {
        match self.motion.begun() {
            _ if self.motion.waits() => Driver::None,
            Some(setpoint) if !setpoint.is_stop() => {
                Driver::Script(self.options.calibration.drive(setpoint))
            }
            _ if self.robot.moving => Driver::Other,
            _ => Driver::None,
        }
    }

    /// Plans to examine a frame for the robot's own motion: for turns, and during a timed motion
    /// for a blockage. This happens after the script's own handlers, so that they are not delayed.
    fn plan_motion_check(&mut self, frame: &Rc<Frame>) {
        let at = frame.at;
        self.odometry.mark(at);
        let calibration = self.options.calibration;
        let timed = self
            .motion
            .timed()
            .map(|(motion, setpoint, since)| TimedMotion {
                motion,
                since,
                drive: calibration.drive(setpoint),
                odometer: self.odometry.odometer(),
            });
        if self.odometry.last_turn() > LEAST_TURN {
            self.frames.turned = Some(at);
        }
        let lately = |turned: Instant| at.saturating_duration_since(turned) < COASTING_TIME;
        let turns = self.frames.turned.is_some_and(lately);
        if timed.is_none() && !turns {
            return self.odometry.look(at, None);
        }
        let frame = Rc::clone(frame);
        self.frames.motion_check = Some(MotionCheck {
            frame,
            timed,
            turns,
        });
    }

    pub(super) fn examine_frame_for_motion(&mut self) {
        let Some(MotionCheck {
            frame,
            timed,
            turns,
        }) = self.frames.motion_check.take()
        else {
            return;
        };
        let camera = self.options.camera;
        let Ok(image) = self.frames.analyser.decode(frame.seq, &frame.jpeg) else {
            return;
        };
        let skyline = if turns {
            Some(self.frames.skyline_reader.read(image))
        } else {
            None
        };
        let held_since = timed.and_then(|timed| self.blockage.look(image, frame.at, camera, timed));
        self.odometry.look(frame.at, skyline);
        if let (Some(since), Some(timed)) = (held_since, timed)
            && self
                .motion
                .timed()
                .is_some_and(|(motion, ..)| motion == timed.motion)
        {
            self.end_blocked(timed.motion, since);
        }
    }

    /// Ends a blocked motion: the tracks stop, and the waiting call returns the reason.
    fn end_blocked(&mut self, motion: MotionId, since: Instant) {
        self.odometry.rewind(since);
        self.motion.ended(motion);
        self.output.send(Intent::Release { motion });
        self.answer(Wait::Motion(motion), || Wakeup::Motion(MotionEnd::Blocked));
    }

    pub(super) fn record_detections(
        &mut self,
        frame: &Frame,
        found: impl IntoIterator<Item = LabelledBlob>,
    ) {
        if let Some(recorder) = &mut self.frames.recorder {
            recorder.record(frame, self.now, found);
        }
    }

    pub(super) fn take_annotated_frame(&mut self) -> Option<AnnotatedFrame> {
        let newest = self.frames.newest.as_ref().map(|frame| frame.seq);
        let busy = !self.has_ended() && self.tasks.is_ready();
        let recorder = self.frames.recorder.as_mut()?;
        recorder.take_if(|annotated| !busy || newest != Some(annotated.frame.seq))
    }

    pub(super) fn log(&mut self, level: Level, text: &str) {
        self.output.log(LogLine::new(level, text), self.now);
    }

    /// Logs a failure: the first time, and then ever more rarely for the same place.
    pub(super) fn log_failure(&mut self, text: &str) {
        let text = match self.failure_log.count(text) {
            Some(1) => self.explained(text),
            Some(count) if is_round(count) => format!("{text} ({count} times)"),
            Some(_) => return,
            None => text.to_owned(),
        };
        self.log(Level::Error, &text);
    }

    /// Explains a failure in plain words, with the line where it happened.
    pub(super) fn explained(&self, text: &str) -> String {
        let main = (
            self.options.chunk.as_str(),
            self.failure_log.source.as_str(),
        );
        let mut files = std::iter::once(main).chain(self.modules.sources());
        let explain = self.failure_log.explain;
        let explained = explain
            .and_then(|explain| files.find_map(|(chunk, source)| explain(text, chunk, source)));
        explained.unwrap_or_else(|| text.to_owned())
    }

    /// The owner of setpoints that the running task sets.
    pub(super) fn owner(&mut self) -> Option<Owner> {
        let task = self.tasks.running()?;
        Some(match task.kind {
            TaskKind::Handler(id) => Owner::Subscription(id),
            TaskKind::Line => Owner::Lines,
            _ => Owner::Task(task.handle.id),
        })
    }

    pub(super) fn release(&mut self, owner: Owner) {
        if let Some(motion) = self.motion.release(owner) {
            self.output.send(Intent::Release { motion });
        }
    }

    pub(super) fn next_call(&mut self) -> crate::robot::CallId {
        self.last_call += 1;
        crate::robot::CallId(self.last_call)
    }

    pub(super) fn next_deadline(&self) -> Option<Instant> {
        let exit = match &self.life {
            Life::Stopping { deadline, .. } => Some(*deadline),
            Life::Running => None,
            Life::Ended(_) => return None,
        };
        let timers = [
            self.tasks.next_timer(),
            self.output.window_end(),
            exit,
            self.next_stream_end(),
        ];
        timers.into_iter().flatten().min()
    }

    pub(super) fn deliver(&mut self, event: Event) {
        self.robot.record(&event, self.now);
        if shows_motion(&event) {
            self.last_moved = Some(self.now);
        }
        match event {
            Event::Sounding => self.last_sounded = Some(self.now),
            Event::Undocked | Event::BatteryOk(_) | Event::Connected { .. } => {
                self.last_refusal = None;
            }
            _ => {}
        }
        match event {
            Event::MotionWaiting { motion, on } => {
                self.motion.set_waiting(motion, on, self.now);
            }
            Event::MotionEnded { motion, end } => self.motion_ended(motion, end),
            Event::DockEnded { call, outcome } => {
                let refused = outcome.attempts == 0;
                self.answer_later(Wait::Dock(call), refusal_pause(refused), || {
                    Wakeup::Dock(outcome)
                });
            }
            Event::UndockEnded { call, end } => {
                let refused = end != DockEnd::Done;
                self.answer_later(Wait::Undock(call), refusal_pause(refused), || {
                    Wakeup::Undock(end)
                });
            }
            Event::Audio(ref samples) => {
                self.detect_noise(samples);
                self.publish(EventName::Audio, Payload::Event(Rc::new(event)));
            }
            event => {
                if let Some(name) = EventName::from_event(&event) {
                    self.publish(name, Payload::Event(Rc::new(event)));
                }
            }
        }
    }

    /// Delivers a frame; it replaces those that no handler has taken. A frame whose markers show
    /// that it is not a valid picture is only counted: `false`.
    pub(super) fn deliver_frame(&mut self, frame: Frame) -> bool {
        // For a script that is always busy: examine the last frame before its buffers are reused.
        self.examine_frame_for_motion();
        let size = match validate_markers(&frame.jpeg) {
            Ok(size) => size,
            Err(error) => {
                self.note_damage(frame.seq, &error);
                return false;
            }
        };
        let frame = self.frames.hold(frame, size);
        self.plan_motion_check(&frame);
        self.publish(EventName::Frame, Payload::Frame(frame));
        true
    }

    /// Counts a frame that is not a valid picture; this is logged now and then.
    pub(super) fn note_damage(&mut self, seq: u64, error: &FrameError) {
        if let Some(text) = self.frames.damage.record(seq, &error.to_string(), self.now) {
            self.log(Level::Warn, &text);
        }
    }

    /// Publishes a `noise` event if this audio begins a loud sound and something listens for it.
    fn detect_noise(&mut self, samples: &[u8]) {
        if self.has_listener(EventName::Noise) {
            let dbfs = Loudness::from_samples(samples).dbfs();
            if dbfs > self.options.limits.noise_dbfs && self.becomes_loud() {
                let own = self.may_be_own_sound();
                self.publish(EventName::Noise, Payload::Noise { dbfs, own });
            }
        }
    }

    /// Records a loud sound; returns whether it was quiet before. So a bell is one noise, however
    /// long it rings, together with the motors that a script starts because of it.
    fn becomes_loud(&mut self) -> bool {
        let before = self.last_loud.replace(self.now);
        before.is_none_or(|at| self.now.saturating_duration_since(at) >= QUIET)
    }

    /// Whether a sound may come from the robot's own motors or speaker.
    fn may_be_own_sound(&self) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < SOUND;
        self.has_moved_within(MOTOR) || self.last_sounded.is_some_and(lately)
    }

    pub(super) fn has_listener(&self, name: EventName) -> bool {
        let listens = self.subscriptions.values().any(|one| one.event == name);
        listens
            || !self
                .tasks
                .waiting_for(|wait| *wait == Wait::Event(name))
                .is_empty()
    }

    /// Answers the tasks that wait for this motion: when the tracks stand, or, if it was refused or
    /// taken away, a moment later.
    fn motion_ended(&mut self, motion: MotionId, end: MotionEnd) {
        let is_current = self.motion.current() == Some(motion);
        let runs_on = self.motion.ended(motion);
        let pause = match end {
            MotionEnd::Done => runs_on,
            MotionEnd::Blocked => Duration::ZERO,
            _ => REFUSAL_PAUSE,
        };
        self.warn_of_refusal(motion, end, is_current);
        self.answer_later(Wait::Motion(motion), pause, || Wakeup::Motion(end));
    }

    /// Says why the robot does not move, once until there is another reason or this one is gone.
    fn warn_of_refusal(&mut self, motion: MotionId, end: MotionEnd, is_current: bool) {
        let is_awaited = |wait: &Wait| *wait == Wait::Motion(motion);
        let why = match end {
            MotionEnd::Docked => "the robot is on its station: robot.undock() first",
            MotionEnd::Safety => {
                "the watchdog lets nothing drive: a person's STOP holds, the battery is low, or the \
                 guardian process that could stop the robot is missing"
            }
            MotionEnd::Disconnected => "the robot is not connected: nothing can drive it",
            MotionEnd::Preempted if is_current => {
                "another behaviour or a person drives the robot, or it is docking"
            }
            MotionEnd::Preempted if !self.tasks.waiting_for(is_awaited).is_empty() => {
                "another part of this script drives too: each motion ends the one before it"
            }
            _ => return,
        };
        if self.is_running() && self.last_refusal.replace(why) != Some(why) {
            self.log(Level::Warn, why);
        }
    }

    /// Wakes the tasks that wait for exactly this.
    pub(super) fn answer(&mut self, awaited: Wait, answer: impl Fn() -> Wakeup) {
        self.answer_later(awaited, Duration::ZERO, answer);
    }

    fn answer_later(&mut self, awaited: Wait, pause: Duration, answer: impl Fn() -> Wakeup) {
        for id in self.tasks.waiting_for(|wait| *wait == awaited) {
            if pause.is_zero() {
                self.tasks.wake(id, answer(), self.now);
            } else {
                self.tasks.wake_at(id, answer(), self.now + pause);
            }
        }
    }

    fn publish(&mut self, name: EventName, payload: Payload) {
        self.answer(Wait::Event(name), || Wakeup::Event(payload.clone()));
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

    pub(super) fn need_stream(&mut self, stream: Stream, by: Demand) -> Result<(), String> {
        self.options.streams.allow(stream)?;
        if self.streams.switch_on(stream, by, self.now) {
            self.output.send(Intent::Stream { stream, on: true });
        }
        Ok(())
    }

    /// Whether a handler listens to a stream or a task waits for it.
    fn is_used(&self, stream: Stream) -> bool {
        let mut events = EventName::ALL.iter().copied();
        events.any(|event| event.stream() == Some(stream) && self.has_listener(event))
    }

    /// Records the use of each stream that is listened to. Called when time advances, before
    /// anything else happens.
    fn note_used_streams(&mut self) {
        for stream in self.streams.temporary() {
            if self.is_used(stream) {
                self.streams.note_use(stream, self.now);
            }
        }
    }

    /// Switches off the streams that nothing has used for a while.
    pub(super) fn drop_unused_streams(&mut self) {
        for stream in self.streams.temporary() {
            if !self.is_used(stream) && self.streams.drop_if_unused(stream, self.now) {
                self.output.send(Intent::Stream { stream, on: false });
            }
        }
    }

    /// When the next stream is switched off because nothing uses it.
    fn next_stream_end(&self) -> Option<Instant> {
        let unused = |stream: &Stream| !self.is_used(*stream);
        let temporary = self.streams.temporary().into_iter().filter(unused);
        temporary
            .filter_map(|stream| self.streams.end_of(stream))
            .min()
    }

    pub(super) fn fire_due_timers(&mut self) {
        while let Some(due) = self.tasks.next_due(self.now) {
            match due {
                Due::Wait(id) => self.time_out(id),
                Due::Run(id) => self.tasks.enqueue_due(id),
                Due::Handle(id) => {
                    if let Some(subscription) = self.subscriptions.get_mut(&id) {
                        subscription.busy = Busy::No;
                    }
                    self.schedule(id);
                }
            }
        }
    }

    fn time_out(&mut self, id: TaskId) {
        let Some(TaskPhase::Waiting(wait)) = self.tasks.get(id).map(|task| &task.phase) else {
            return;
        };
        let answer = match *wait {
            Wait::Time { since } => Wakeup::Slept(self.now.saturating_duration_since(since)),
            Wait::Beat { missed } => Wakeup::Beat(missed),
            Wait::Event(_) => Wakeup::NoEvent,
            Wait::Group(group) => {
                self.end_group(group);
                Wakeup::Refused("timeout")
            }
            Wait::Module(_) => Wakeup::Again,
            Wait::Join(_) | Wait::Motion(_) | Wait::Dock(_) | Wait::Undock(_) => {
                Wakeup::Refused("timeout")
            }
        };
        self.tasks.wake(id, answer, self.now);
    }

    /// Cancels a task: its motion ends now, its wait fails, and what it waits for is cancelled too.
    /// A task that has not started never starts.
    pub(super) fn cancel(&mut self, id: TaskId) {
        self.release(Owner::Task(id));
        let Some(task) = self.tasks.get_mut(id) else {
            return;
        };
        if task.cancel != Cancel::No {
            return;
        }
        task.cancel = Cancel::Raised;
        match &mut task.phase {
            TaskPhase::Running => task.cancel = Cancel::Requested,
            TaskPhase::Ready(_) if !task.started => self.finish(id, Outcome::Cancelled),
            TaskPhase::Ready(_) if task.timer.is_some() => {
                self.tasks.wake(id, Wakeup::Cancelled, self.now);
            }
            TaskPhase::Ready(answer) => *answer = Wakeup::Cancelled,
            TaskPhase::Waiting(wait) => {
                let wait = *wait;
                self.cancel_wait(wait);
                self.tasks.wake(id, Wakeup::Cancelled, self.now);
            }
        }
    }

    fn cancel_wait(&mut self, wait: Wait) {
        match wait {
            Wait::Motion(motion) if self.motion.current() == Some(motion) => {
                self.motion.ended(motion);
                self.output.send(Intent::Release { motion });
            }
            Wait::Dock(_) => self.output.send(Intent::CancelDock),
            Wait::Group(group) => self.end_group(group),
            _ => {}
        }
    }

    /// Handles the end of a task: ends its motion and wakes the tasks that wait for it.
    pub(super) fn finish(&mut self, id: TaskId, outcome: Outcome) {
        let Some(task) = self.tasks.remove(id) else {
            return;
        };
        let status = outcome.status();
        task.handle.status.set(status);
        self.release(Owner::Task(id));
        let waiters = self.tasks.waiting_for(|wait| *wait == Wait::Join(id));
        let is_joined = !waiters.is_empty();
        for waiter in waiters {
            let answer = Wakeup::Joined(status, outcome.text());
            self.tasks.wake(waiter, answer, self.now);
        }
        match (task.kind, outcome) {
            (TaskKind::Child(group, index), outcome) => self.child_ended(group, index, outcome),
            (TaskKind::Handler(subscription), outcome) => {
                self.handler_ended(subscription, &outcome)
            }
            (TaskKind::Main, Outcome::Failed(text)) => {
                let text = self.explained(&text);
                self.begin_stop(EndReason::Error, Some(text));
            }
            (TaskKind::Line, outcome) => {
                let answer = self.evaluated(outcome);
                self.output.push(FromHost::Evaluated(answer));
            }
            (TaskKind::Spawned | TaskKind::StopHandler, Outcome::Failed(text)) => {
                if !is_joined && self.failed_task.is_none() {
                    self.failed_task = Some((id, self.explained(&text)));
                }
                self.log_failure(&text);
            }
            _ => {}
        }
    }

    fn handler_ended(&mut self, id: SubscriptionId, outcome: &Outcome) {
        if let Outcome::Failed(text) = outcome {
            self.log_failure(text);
        }
        let Some(subscription) = self.subscriptions.get_mut(&id) else {
            // The subscription was removed meanwhile, or was for one event only.
            return self.release(Owner::Subscription(id));
        };
        subscription.busy = Busy::No;
        match outcome {
            Outcome::Failed(text) => {
                subscription.failures += 1;
                if subscription.failures >= MAX_FAILURES {
                    let name = subscription.event.name();
                    let text = self.explained(text);
                    let text = format!(
                        "{text}\n(the '{name}' handler failed {MAX_FAILURES} times in a row)"
                    );
                    return self.begin_stop(EndReason::Error, Some(text));
                }
            }
            Outcome::Done(_) | Outcome::Cancelled => subscription.failures = 0,
        }
        self.schedule(id);
    }

    /// Queues a subscription's next run if an event is waiting, or sets a timer if it is too early
    /// for the run.
    pub(super) fn schedule(&mut self, id: SubscriptionId) {
        let Some(subscription) = self.subscriptions.get_mut(&id) else {
            return;
        };
        if subscription.busy != Busy::No || !subscription.has_waiting() {
            return;
        }
        subscription.busy = match subscription.delayed_until(self.now) {
            Some(at) => Busy::Timed(self.tasks.call_handler_at(id, at)),
            None => {
                self.tasks.call_handler(id);
                Busy::Queued
            }
        };
    }

    /// Ends a subscription. A run in progress continues, and so does its motion.
    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) {
        let Some(subscription) = self.subscriptions.remove(&id) else {
            return;
        };
        match subscription.busy {
            Busy::Running(_) => {}
            Busy::Timed(timer) => {
                self.tasks.cancel_timer(timer);
                self.release(Owner::Subscription(id));
            }
            Busy::No | Busy::Queued => self.release(Owner::Subscription(id)),
        }
    }

    /// Logs the error of a cancelled task, unless it is the cancellation's own error.
    pub(super) fn log_clean_up_failure(&mut self, text: &str) {
        if !text.ends_with(CANCELLED) {
            self.log(Level::Warn, &format!("while cleaning up: {text}"));
        }
    }

    /// Whether nothing is left that could run: no tasks and no subscriptions.
    pub(super) fn is_finished(&self) -> bool {
        self.is_running()
            && !self.options.interactive
            && self.tasks.is_empty()
            && self.subscriptions.is_empty()
    }

    fn child_ended(&mut self, id: GroupId, index: usize, outcome: Outcome) {
        let Some(group) = self.groups.get_mut(&id) else {
            return;
        };
        let parent = group.parent;
        let answer = match outcome {
            Outcome::Done(values) => group.child_done(index, values).map(Wakeup::Values),
            Outcome::Failed(text) => Some(Wakeup::Failed(text)),
            Outcome::Cancelled => Some(Wakeup::Cancelled),
        };
        if let Some(answer) = answer {
            self.end_group(id);
            self.tasks.wake(parent, answer, self.now);
        }
    }

    /// Ends a group: children that have not ended are cancelled, and run their clean-up before
    /// their parent continues.
    fn end_group(&mut self, id: GroupId) {
        if let Some(group) = self.groups.remove(&id) {
            for child in group.children {
                self.cancel(child);
            }
        }
    }

    pub(super) fn is_running(&self) -> bool {
        matches!(self.life, Life::Running)
    }

    pub(super) fn has_ended(&self) -> bool {
        matches!(self.life, Life::Ended(_))
    }

    pub(super) fn slice_start(&self) -> SliceStart {
        SliceStart {
            output: self.output.len(),
            motion: self.motion.current(),
        }
    }

    /// Asks the script to stop: its motion ends now, every task is cancelled, and nothing new can
    /// be started.
    pub(super) fn begin_stop(&mut self, reason: EndReason, message: Option<String>) {
        if !self.is_running() {
            return;
        }
        let mut exit = ScriptExit { reason, message };
        if matches!(reason, EndReason::Done | EndReason::Shutdown)
            && let Some((_, text)) = self.failed_task.take()
        {
            exit.reason = EndReason::Error;
            exit.message = Some(format!("{text}\n(a task failed)"));
        }
        self.life = Life::Stopping {
            exit,
            deadline: self.now + STOP_TIME,
            spent: Duration::ZERO,
        };
        self.cancel_all();
    }

    /// Ends the motion now, cancels every task and removes every subscription.
    pub(super) fn cancel_all(&mut self) {
        if let Some(motion) = self.motion.release_any() {
            self.output.send(Intent::Release { motion });
        }
        let subscriptions: Vec<_> = self.subscriptions.keys().copied().collect();
        for id in subscriptions {
            self.unsubscribe(id);
        }
        for id in self.tasks.ids() {
            self.cancel(id);
        }
    }

    pub(super) fn is_out_of_time(&self) -> bool {
        match &self.life {
            Life::Stopping {
                deadline, spent, ..
            } => self.now >= *deadline || *spent >= STOP_TIME,
            _ => false,
        }
    }

    pub(super) fn end_stopped(&mut self) {
        if let Life::Stopping { exit, .. } = &self.life {
            let exit = exit.clone();
            self.cancel_docking();
            self.end(exit);
        }
    }

    /// Kills the script and undoes what it did since `before`. A script that was already stopping
    /// keeps its original reason.
    pub(super) fn kill(&mut self, reason: EndReason, message: Option<String>, before: SliceStart) {
        let exit = match &self.life {
            Life::Running => ScriptExit { reason, message },
            Life::Stopping { exit, .. } => {
                let exit = exit.clone();
                let text = message.unwrap_or_else(|| reason.sentence().to_owned());
                self.log(Level::Warn, &format!("while stopping: {text}"));
                exit
            }
            Life::Ended(_) => return,
        };
        self.output.withdraw_after(before.output);
        let _ = self.motion.release_any();
        if let Some(motion) = before.motion {
            self.output.send(Intent::Release { motion });
        }
        self.cancel_docking();
        self.end(exit);
    }

    fn cancel_docking(&mut self) {
        let docks = |wait: &Wait| matches!(wait, Wait::Dock(_));
        if !self.tasks.waiting_for(docks).is_empty() {
            self.output.send(Intent::CancelDock);
        }
    }

    fn end(&mut self, exit: ScriptExit) {
        self.tasks.clear();
        self.groups.clear();
        self.subscriptions.clear();
        self.stop_handlers.clear();
        self.modules.clear();
        self.frames.newest = None;
        if let Some(text) = self.frames.damage.rest() {
            self.log(Level::Warn, &text);
        }
        self.output.report_dropped();
        self.life = Life::Ended(exit);
    }

    pub(super) fn evaluated(&self, outcome: Outcome) -> Evaluated {
        match outcome {
            Outcome::Done(values) => Evaluated::Values(eval::shown(&values)),
            Outcome::Failed(text) => Evaluated::Failed(self.explained(&text)),
            Outcome::Cancelled => Evaluated::Cancelled,
        }
    }

    /// Gives each input its own chunk name, so that messages refer to lines of the right input.
    pub(super) fn next_input(&mut self, text: &str) -> String {
        self.inputs += 1;
        self.options.chunk = format!("input{}", self.inputs);
        text.clone_into(&mut self.failure_log.source);
        self.options.chunk.clone()
    }

    /// The picture of a frame; `None` for a damaged one, which is counted.
    pub(super) fn image(&mut self, frame: &Frame) -> Option<&Image> {
        if let Err(error) = self.frames.analyser.decode(frame.seq, &frame.jpeg) {
            self.note_damage(frame.seq, &error);
            return None;
        }
        // The frame is decoded already: this only borrows it again.
        self.frames.analyser.decode(frame.seq, &frame.jpeg).ok()
    }

    pub(super) fn find_blobs(
        &mut self,
        frame: &Frame,
        colours: &[Colour],
        options: &BlobOptions,
    ) -> Vec<Blob> {
        let found = self
            .frames
            .analyser
            .find_blobs(frame.seq, &frame.jpeg, colours, options);
        match found {
            Ok(blobs) => blobs.to_vec(),
            Err(error) => {
                self.note_damage(frame.seq, &error);
                Vec::new()
            }
        }
    }

    pub(super) fn find_line(
        &mut self,
        frame: &Frame,
        colours: &[Colour],
        part: Option<Roi>,
    ) -> Option<Line> {
        let found = self
            .frames
            .analyser
            .find_line(frame.seq, &frame.jpeg, colours, part);
        found.unwrap_or_else(|error| {
            self.note_damage(frame.seq, &error);
            None
        })
    }
}

/// One `robot.on` or `robot.once`.
pub(super) struct Subscription {
    pub(super) event: EventName,
    pub(super) function: LuaFunction,
    pub(super) once: bool,
    pub(super) latest: bool,
    /// The least time between the starts of two runs.
    pub(super) interval: Option<Duration>,
    queue: VecDeque<Payload>,
    next_run: Option<Instant>,
    /// Whether a run is queued or in progress, or a timer will queue it.
    pub(super) busy: Busy,
    /// Failed runs since the last successful one.
    pub(super) failures: u32,
    dropped: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Busy {
    No,
    Queued,
    Timed(Timer),
    Running(TaskId),
}

impl Subscription {
    pub(super) fn new(event: EventName, function: LuaFunction) -> Subscription {
        Subscription {
            event,
            function,
            once: false,
            latest: event.keeps_latest(),
            interval: None,
            queue: VecDeque::new(),
            next_run: None,
            busy: Busy::No,
            failures: 0,
            dropped: 0,
        }
    }

    /// Queues an event. Returns the number of events dropped so far if that number is worth a log
    /// line (1, 10, 100, ...).
    pub(super) fn push(&mut self, payload: Payload) -> Option<u64> {
        if self.latest {
            self.queue.clear();
            self.queue.push_back(payload);
            return None;
        }
        if self.queue.len() < MAX_QUEUE {
            self.queue.push_back(payload);
            return None;
        }
        self.dropped += 1;
        is_round(self.dropped).then_some(self.dropped)
    }

    pub(super) fn has_waiting(&self) -> bool {
        !self.queue.is_empty()
    }

    /// Takes the next event from the queue, and sets the earliest time of the run after it.
    pub(super) fn pop(&mut self, now: Instant) -> Option<Payload> {
        let payload = self.queue.pop_front()?;
        self.next_run = self.interval.map(|interval| now + interval);
        Some(payload)
    }

    pub(super) fn delayed_until(&self, now: Instant) -> Option<Instant> {
        self.next_run.filter(|at| *at > now)
    }
}

#[derive(Debug)]
pub(super) struct OutputQueue {
    waiting: Vec<FromHost>,
    intents: usize,
    speech: usize,
    window: Instant,
    lines: u32,
    dropped: u32,
}

impl OutputQueue {
    pub(super) fn new(now: Instant) -> OutputQueue {
        OutputQueue {
            waiting: Vec::new(),
            intents: 0,
            speech: 0,
            window: now,
            lines: 0,
            dropped: 0,
        }
    }

    /// Whether there is room for one more intent with `speech` bytes.
    pub(super) fn has_room(&self, speech: usize) -> bool {
        self.intents < MAX_INTENTS && self.speech + speech <= MAX_SPEECH
    }

    /// Queues an intent even if the queue is full: for intents of the runtime itself.
    pub(super) fn send(&mut self, intent: Intent) {
        self.intents += 1;
        if let Intent::Say(samples) = &intent {
            self.speech += samples.len();
        }
        self.waiting.push(FromHost::Intent(intent));
    }

    /// Queues a stop, even if the queue is full; a second stop directly after another is dropped.
    pub(super) fn send_stop(&mut self) {
        if self.waiting.last() != Some(&FromHost::Intent(Intent::Stop)) {
            self.send(Intent::Stop);
        }
    }

    /// Queues output whose number the caller bounds.
    pub(super) fn push(&mut self, output: FromHost) {
        self.waiting.push(output);
    }

    /// Queues a log line, or counts it if there were too many lines this second.
    pub(super) fn log(&mut self, line: LogLine, now: Instant) {
        self.roll_window(now);
        if self.lines < MAX_LINES {
            self.lines += 1;
            self.waiting.push(FromHost::Log(line));
        } else {
            self.dropped += 1;
        }
    }

    pub(super) fn params(&mut self, params: Vec<DeclaredParam>) {
        self.waiting
            .retain(|output| !matches!(output, FromHost::Params(_)));
        self.waiting.push(FromHost::Params(params));
    }

    /// Starts a new period once the last one is over, and reports how many lines were dropped in
    /// it.
    pub(super) fn roll_window(&mut self, now: Instant) {
        if now.saturating_duration_since(self.window) >= WINDOW {
            self.window = now;
            self.lines = 0;
            self.report_dropped();
        }
    }

    /// When [`OutputQueue::roll_window`] has something to report.
    pub(super) fn window_end(&self) -> Option<Instant> {
        (self.dropped > 0).then(|| self.window + WINDOW)
    }

    pub(super) fn report_dropped(&mut self) {
        if self.dropped > 0 {
            let text = format!("... and {} more lines", self.dropped);
            let line = LogLine::new(Level::Warn, &text);
            self.waiting.push(FromHost::Log(line));
            self.dropped = 0;
        }
    }

    pub(super) fn len(&self) -> usize {
        self.waiting.len()
    }

    /// Removes all but the first `kept` items, except log lines, parameters and saved pictures: those
    /// have already happened.
    pub(super) fn withdraw_after(&mut self, kept: usize) {
        let mut index = 0;
        self.waiting.retain(|output| {
            index += 1;
            let happened = matches!(
                output,
                FromHost::Log(_)
                    | FromHost::Params(_)
                    | FromHost::HostReport(HostReport::Picture { .. })
            );
            index <= kept || happened
        });
    }

    pub(super) fn take(&mut self) -> Vec<FromHost> {
        self.intents = 0;
        self.speech = 0;
        std::mem::take(&mut self.waiting)
    }
}

/// The state of the robot as known from the events that the script has received.
#[derive(Debug, Default)]
pub(super) struct RobotState {
    pub(super) info: Option<RobotInfo>,
    pub(super) connected: bool,
    pub(super) docked: bool,
    pub(super) battery: Option<(Battery, Instant)>,
    /// Whether something moves the robot, this script or something else.
    pub(super) moving: bool,
}

impl RobotState {
    pub(super) fn record(&mut self, event: &Event, now: Instant) {
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

fn refusal_pause(refused: bool) -> Duration {
    if refused {
        REFUSAL_PAUSE
    } else {
        Duration::ZERO
    }
}

/// Whether an event shows that the robot moves or may have moved.
pub(super) fn shows_motion(event: &Event) -> bool {
    matches!(
        event,
        Event::Moving { .. }
            | Event::Connected { .. }
            | Event::Docked
            | Event::Undocked
            | Event::BaseNotFound
    )
}

pub(super) enum Outcome {
    Done(LuaMultiValue),
    Failed(String),
    Cancelled,
}

impl Outcome {
    fn status(&self) -> Status {
        match self {
            Outcome::Done(_) => Status::Done,
            Outcome::Failed(_) => Status::Failed,
            Outcome::Cancelled => Status::Cancelled,
        }
    }

    fn text(&self) -> Option<String> {
        match self {
            Outcome::Failed(text) => Some(text.clone()),
            _ => None,
        }
    }
}

/// The state before a slice, to undo the slice if the script is killed in it.
#[derive(Debug, Clone, Copy)]
pub(super) struct SliceStart {
    /// The length of the queue of output.
    output: usize,
    motion: Option<MotionId>,
}
