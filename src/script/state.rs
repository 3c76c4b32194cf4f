//! Everything that a script's natives and its scheduler share.

mod delivery;
mod known;
mod streams;

use std::collections::{BTreeMap, BTreeSet};
use std::rc::Rc;
use std::time::Duration;

use tokio::time::Instant;

use self::known::Known;
use super::blockage::Blockage;
use super::complaints::{Complaints, Telling};
use super::declaration::Declaration;
use super::events::{EventName, Subscriptions};
use super::going::Going;
use super::group::Group;
use super::life::{Exit, Life};
use super::modules::Modules;
use super::motion::{Motion, Owner};
use super::odometry::{Driver, Odometry, drive_of};
use super::options::Options;
use super::output::{Level, LogLine, OutputQueue};
use super::params::ParamValue;
use super::picture_store::PictureStore;
use super::queue::Tasks;
use super::shares::Shares;
use super::sight::{HeldFrame, Look, Sight};
use super::sighting::{Seen, Sighting};
use super::stage::Stage;
use super::store::Store;
use super::streams::WantedStreams;
use super::task::{Answer, GroupId, TaskKind, Wait};
use crate::robot::{Intent, MotionEnd, MotionId};
use crate::vision::Skyline;

/// A turn from one frame to the next that is looked for in the pictures, radians.
const LEAST_TURN: f64 = 0.02;
/// Tracks and pictures are late, and so is the end of a turn in them.
const ROLLING_OUT: Duration = Duration::from_millis(500);

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
    pub(super) blockage: Blockage,
    pub(super) streams: WantedStreams,
    pub(super) sight: Sight,
    pub(super) picture_store: PictureStore,
    pub(super) store: Store,
    pub(super) shares: Shares,
    pub(super) modules: Modules,
    /// Whom a script asks that drives no robot.
    pub(super) stage: Option<Rc<dyn Stage>>,
    pub(super) params: Declared,
    pub(super) output: OutputQueue,
    pub(super) life: Life,
    pub(super) exit: Exit,
    /// No coroutine of the running task stands where it cannot yield.
    pub(super) can_wait: bool,
    pub(super) usage: Usage,
    pub(super) last_call: u64,
    /// When the robot last moved, for any reason.
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
        self.output.params(knobs.collect());
    }

    pub(super) fn new(options: Options, now: Instant) -> State {
        let picture_store = PictureStore::new(options.data_dir.clone(), &options.limits);
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
            picture_store,
            store: Store::default(),
            shares,
            modules,
            stage: None,
            params: Declared::default(),
            output: OutputQueue::new(now),
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
        if self.odometry.advance(self.now, self.driver()) {
            self.blockage.forget();
        }
        if self.motion.is_on() || self.known.moving {
            self.moved = Some(self.now);
        }
        self.note_used_streams();
        self.output.unfold(self.now);
    }

    /// Whether the robot has moved within the last `time`, for any reason.
    pub(super) fn has_moved_within(&self, time: Duration) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < time;
        self.motion.is_on() || self.known.moving || self.moved.is_some_and(lately)
    }

    /// Whether a task can run, or a frame is to be looked at for the robot's own movement.
    pub(super) fn is_ready(&self) -> bool {
        !self.has_ended() && (self.tasks.is_ready() || self.sight.look.is_some())
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

    /// While the script drives for a time, its pictures tell whether the robot turns, and whether it moves:
    /// after the script's own handlers, whose answer does not wait for that.
    fn plan_look(&mut self, held: &Rc<HeldFrame>) {
        let at = held.frame.at;
        self.odometry.mark(at);
        let calibration = self.options.calibration;
        let going = self.motion.timed().map(|(motion, setpoint, since)| Going {
            motion,
            since,
            drive: drive_of(setpoint, calibration),
            odometer: self.odometry.odometer(),
            heading: self.odometry.pose().heading,
        });
        let shown = self.odometry.last_shown();
        if shown.is_some_and(|shown| shown.most_turn() > LEAST_TURN) {
            self.sight.turned = Some(at);
        }
        let lately = |turned: Instant| at.saturating_duration_since(turned) < ROLLING_OUT;
        let turns = self.sight.turned.is_some_and(lately);
        if going.is_none() && !turns {
            return self.odometry.look(at, None);
        }
        let held = Rc::clone(held);
        self.sight.look = Some(Look { held, going, turns });
    }

    /// Looks at the last frame as planned, once.
    pub(super) fn look_where_it_goes(&mut self) {
        let Some(Look { held, going, turns }) = self.sight.look.take() else {
            return;
        };
        let (camera, frame) = (self.options.camera, &held.frame);
        let Ok(image) = self.sight.eyes.look(frame.seq, &frame.jpeg) else {
            return;
        };
        let skyline = turns.then(|| Skyline::of(image, camera));
        let held_since = going.and_then(|going| self.blockage.look(image, frame.at, camera, going));
        self.odometry.look(frame.at, skyline);
        if let (Some(since), Some(going)) = (held_since, going)
            && self
                .motion
                .timed()
                .is_some_and(|(motion, ..)| motion == going.motion)
        {
            self.end_blocked(going.motion, since);
        }
    }

    /// A motion leads nowhere: the tracks rest, and the waiting call returns the reason.
    fn end_blocked(&mut self, motion: MotionId, since: Instant) {
        self.odometry.rewind(since);
        self.motion.ended(motion);
        self.output.send(Intent::Release { motion });
        self.answer(Wait::Motion(motion), || Answer::Motion(MotionEnd::Blocked));
    }

    /// Takes note of what the script was told about a frame.
    pub(super) fn saw(&mut self, held: &HeldFrame, found: impl IntoIterator<Item = Seen>) {
        if let Some(witness) = &mut self.sight.witness {
            witness.note(&held.frame, self.now, found);
        }
    }

    /// See [`Script::take_sighting`](super::Script::take_sighting).
    pub(super) fn take_sighting(&mut self) -> Option<Sighting> {
        let newest = self.sight.newest.as_ref().map(|held| held.frame.seq);
        let busy = !self.has_ended() && self.tasks.is_ready();
        let witness = self.sight.witness.as_mut()?;
        witness.take_if(|sighting| !busy || newest != Some(sighting.frame.seq))
    }

    /// Writes a line of the runtime's own into the script's log.
    pub(super) fn log(&mut self, level: Level, text: &str) {
        self.output.log(LogLine::new(level, text), self.now);
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
            TaskKind::Handler(id) => Owner::Subscription(id),
            TaskKind::Line => Owner::Lines,
            _ => Owner::Task(task.handle.id),
        })
    }

    /// An owner is gone, and its setpoint with it.
    pub(super) fn release(&mut self, owner: Owner) {
        if let Some(motion) = self.motion.release(owner) {
            self.output.send(Intent::Release { motion });
        }
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
        let timers = [self.tasks.next_timer(), self.output.unfolds_at(), ending];
        timers
            .into_iter()
            .chain([self.next_stream_end()])
            .flatten()
            .min()
    }
}
