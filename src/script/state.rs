//! The state that a script's native functions and its scheduler share.

mod delivery;
mod robot_state;
mod streams;

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::time::Duration;

use tokio::time::Instant;

use self::robot_state::RobotState;
use super::annotated_frame::{AnnotatedFrame, LabelledBlob};
use super::daily_limits::DailyLimits;
use super::declaration::Declaration;
use super::events::{EventName, Subscriptions};
use super::failure_log::{FailureLog, LogForm};
use super::frame_state::{FrameState, HeldFrame, MotionCheck};
use super::group::Group;
use super::life::{Exit, Life};
use super::modules::Modules;
use super::motion::{Motion, Owner};
use super::options::Options;
use super::output::{Level, LogLine, OutputQueue};
use super::params::ParamValue;
use super::picture_store::PictureStore;
use super::queue::Tasks;
use super::scenario_api::ScenarioApi;
use super::store::Store;
use super::streams::WantedStreams;
use super::task::{GroupId, TaskKind, Wait, Wakeup};
use crate::odometry::{Blockage, Driver, Odometry, TimedMotion};
use crate::robot::{Intent, MotionEnd, MotionId};
use crate::vision::Skyline;

/// Least turn between two frames, in radians, that is searched for in the pictures.
const LEAST_TURN: f64 = 0.02;
/// How long after the tracks have stopped the pictures may still show a turn, because tracks and
/// pictures are late.
const COASTING_TIME: Duration = Duration::from_millis(500);

/// The resources that a script has used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Usage {
    /// Time spent running, by the wall clock.
    pub cpu: Duration,
    /// The longest time without waiting.
    pub worst_callback: Duration,
    /// The VM's memory, in bytes.
    pub memory_bytes: u64,
}

/// The parameters that the script has declared with `params.declare`.
#[derive(Default)]
pub(super) struct Declared {
    /// The names; `None` before `params.declare` was called.
    pub(super) names: Option<Vec<String>>,
    /// All of them with their values.
    pub(super) all: BTreeMap<String, (Declaration, ParamValue)>,
    /// The error message if the given values were refused.
    pub(super) refused: Option<String>,
}

/// The state that native functions and the scheduler share.
pub(super) struct State {
    pub(super) options: Options,
    pub(super) failure_log: FailureLog,
    /// Number of lines typed so far.
    pub(super) inputs: u64,
    pub(super) start: Instant,
    pub(super) now: Instant,
    pub(super) tasks: Tasks,
    pub(super) groups: BTreeMap<GroupId, Group>,
    pub(super) subscriptions: Subscriptions,
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
    /// The API of a scenario script.
    pub(super) scenario_api: Option<Rc<dyn ScenarioApi>>,
    pub(super) params: Declared,
    pub(super) output: OutputQueue,
    pub(super) life: Life,
    pub(super) exit: Exit,
    /// Whether the running task can yield; `false` inside a coroutine or callback that cannot.
    pub(super) can_wait: bool,
    pub(super) usage: Usage,
    pub(super) last_call: u64,
    /// When the robot last moved, whatever the cause.
    last_moved: Option<Instant>,
    /// When there was last a loud sound.
    last_loud: Option<Instant>,
    /// When the robot was last told to make a sound.
    last_sounded: Option<Instant>,
    /// Events that the script listens to although the config prevents them; each is logged once.
    pub(super) unavailable_events: BTreeSet<EventName>,
}

impl State {
    /// Sends the parameters to the people who are watching.
    pub(super) fn show_params(&mut self) {
        let all = self.params.all.iter();
        let params =
            all.map(|(name, (declaration, value))| declaration.declared(name, value.clone()));
        self.output.params(params.collect());
    }

    pub(super) fn new(options: Options, now: Instant) -> State {
        let picture_store = PictureStore::new(options.data_dir.clone(), &options.limits);
        let daily_limits = DailyLimits::new(&options.limits);
        let modules = Modules::new(&options.chunk);
        let frames = FrameState::new(&options);
        let odometry = Odometry::new(now, options.calibration.full_speed);
        State {
            options,
            failure_log: FailureLog::default(),
            inputs: 0,
            start: now,
            now,
            tasks: Tasks::default(),
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
            params: Declared::default(),
            output: OutputQueue::new(now),
            life: Life::Running,
            exit: Exit::default(),
            can_wait: true,
            usage: Usage::default(),
            last_call: 0,
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
        match self.motion.setpoint() {
            Some(setpoint) if !setpoint.is_stop() => {
                Driver::Script(self.options.calibration.drive(setpoint))
            }
            _ if self.robot.moving => Driver::Other,
            _ => Driver::None,
        }
    }

    /// Plans to examine a frame for the robot's own motion: for turns, and during a timed motion
    /// for a blockage. This happens after the script's own handlers, so that they are not delayed.
    fn plan_motion_check(&mut self, held: &Rc<HeldFrame>) {
        let at = held.frame.at;
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
        let held = Rc::clone(held);
        self.frames.motion_check = Some(MotionCheck { held, timed, turns });
    }

    /// Examines the last frame as planned, once.
    pub(super) fn examine_frame_for_motion(&mut self) {
        let Some(MotionCheck { held, timed, turns }) = self.frames.motion_check.take() else {
            return;
        };
        let camera = self.options.camera;
        let frame = &held.frame;
        let Ok(image) = self.frames.analyser.decode(frame.seq, &frame.jpeg) else {
            return;
        };
        let skyline = turns.then(|| Skyline::from_image(image, camera));
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

    /// Records what the script has found in a frame.
    pub(super) fn record_detections(
        &mut self,
        held: &HeldFrame,
        found: impl IntoIterator<Item = LabelledBlob>,
    ) {
        if let Some(recorder) = &mut self.frames.recorder {
            recorder.record(&held.frame, self.now, found);
        }
    }

    /// See [`Script::take_annotated_frame`](super::Script::take_annotated_frame).
    pub(super) fn take_annotated_frame(&mut self) -> Option<AnnotatedFrame> {
        let newest = self.frames.newest.as_ref().map(|held| held.frame.seq);
        let busy = !self.has_ended() && self.tasks.is_ready();
        let recorder = self.frames.recorder.as_mut()?;
        recorder.take_if(|annotated| !busy || newest != Some(annotated.frame.seq))
    }

    /// Writes a message of the runtime to the script's log.
    pub(super) fn log(&mut self, level: Level, text: &str) {
        self.output.log(LogLine::new(level, text), self.now);
    }

    /// Logs a failure: the first time, and then ever more rarely for the same place.
    pub(super) fn log_failure(&mut self, text: &str) {
        let text = match self.failure_log.count(text) {
            LogForm::Explained => self.explained(text),
            LogForm::Plain => text.to_owned(),
            LogForm::Counted(count) => format!("{text} ({count} times)"),
            LogForm::Silent => return,
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

    /// Releases the setpoint of an owner that has ended.
    pub(super) fn release(&mut self, owner: Owner) {
        if let Some(motion) = self.motion.release(owner) {
            self.output.send(Intent::Release { motion });
        }
    }

    /// Returns an id for a docking or undocking.
    pub(super) fn next_call(&mut self) -> crate::robot::CallId {
        self.last_call += 1;
        crate::robot::CallId(self.last_call)
    }

    /// When the next timer is due.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        let exit = match &self.life {
            Life::Stopping(stopping) => Some(stopping.deadline),
            Life::Running => None,
            Life::Ended(_) => return None,
        };
        let timers = [self.tasks.next_timer(), self.output.window_end(), exit];
        timers
            .into_iter()
            .chain([self.next_stream_end()])
            .flatten()
            .min()
    }
}
