//! Everything that a script's natives and its scheduler share.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::LuaFunction;
use tokio::time::Instant;

use super::api::{Album, HeldFrame};
use super::ending::Life;
use super::events::{EventName, Payload, Subscriptions, is_round};
use super::group::Group;
use super::modules::Modules;
use super::motion::{Motion, Owner};
use super::options::Options;
use super::output::{Level, LogLine, Outbox};
use super::queue::Tasks;
use super::sighting::{Seen, Sighting, Witness};
use super::sound::Loudness;
use super::stage::Stage;
use super::store::Store;
use super::task::{Answer, GroupId, Kind, SubscriptionId, Wait};
use crate::robot::{Battery, Event, Frame, Intent, RobotInfo};
use crate::vision::{Damage, Eyes, FrameError, judge};
use crate::wire::Stream;

/// Places whose complaints are counted; those of further places are logged each time.
const MAX_PLACES: usize = 256;

/// What the script knows of the robot, from the events it was told.
#[derive(Debug, Default)]
pub(super) struct Known {
    pub(super) info: Option<RobotInfo>,
    pub(super) connected: bool,
    pub(super) docked: bool,
    pub(super) battery: Option<(Battery, Instant)>,
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
            _ => {}
        }
    }
}

/// Puts the VM's text of a failure, such as `a.lua:3: attempt to index nil`, into words: the text,
/// the file, its source. `None` if it is not of this file, or has nothing to add.
pub type Explain = fn(text: &str, chunk: &str, source: &str) -> Option<String>;

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

/// Everything that natives and scheduler share.
pub(super) struct State {
    pub(super) options: Options,
    pub(super) explain: Option<Explain>,
    /// The script's text, to show its lines in messages.
    pub(super) source: String,
    /// Typed lines so far.
    pub(super) inputs: u64,
    pub(super) start: Instant,
    pub(super) now: Instant,
    pub(super) tasks: Tasks,
    pub(super) groups: BTreeMap<GroupId, Group>,
    pub(super) subscriptions: Subscriptions,
    pub(super) known: Known,
    pub(super) motion: Motion,
    pub(super) streams: Vec<Stream>,
    pub(super) newest: Option<Rc<HeldFrame>>,
    /// JPEG bytes of all frames that anyone holds.
    pub(super) frame_bytes: Rc<Cell<u64>>,
    pub(super) eyes: Eyes,
    /// Trackers and motion detectors that live.
    pub(super) watchers: Rc<Cell<u32>>,
    pub(super) album: Album,
    pub(super) store: Store,
    pub(super) modules: Modules,
    /// Whom a script asks that drives no robot.
    pub(super) stage: Option<Rc<dyn Stage>>,
    /// Names of `params.declare`, once it was called.
    pub(super) declared: Option<Vec<String>>,
    /// What is wrong with the values that were given to it.
    pub(super) refused: Option<String>,
    /// Only where someone wants to see what the script sees.
    witness: Option<Witness>,
    pub(super) outbox: Outbox,
    pub(super) farewells: VecDeque<LuaFunction>,
    pub(super) life: Life,
    /// No coroutine of the running task stands where it cannot yield.
    pub(super) can_wait: bool,
    /// The running task has called `script.stop`.
    pub(super) stop_asked: Option<Option<String>>,
    /// A native has panicked: nothing of the script can be trusted any more.
    pub(super) broken: bool,
    pub(super) usage: Usage,
    pub(super) last_call: u64,
    /// When a track last turned.
    moved: Option<Instant>,
    complaints: BTreeMap<String, u64>,
    pub(super) damage: Damage,
}

impl State {
    pub(super) fn new(options: Options, now: Instant) -> State {
        let album = Album::new(options.data_dir.clone(), options.data_quota);
        let modules = Modules::new(&options.chunk);
        let eyes = Eyes::new(options.camera);
        let witness = options.annotate_dir.as_ref().map(|_| Witness::default());
        State {
            options,
            explain: None,
            source: String::new(),
            inputs: 0,
            start: now,
            now,
            tasks: Tasks::default(),
            groups: BTreeMap::new(),
            subscriptions: BTreeMap::new(),
            known: Known::default(),
            motion: Motion::default(),
            streams: Vec::new(),
            newest: None,
            frame_bytes: Rc::default(),
            eyes,
            watchers: Rc::default(),
            album,
            store: Store::default(),
            modules,
            stage: None,
            declared: None,
            refused: None,
            witness,
            outbox: Outbox::new(now),
            farewells: VecDeque::new(),
            life: Life::Running,
            can_wait: true,
            stop_asked: None,
            broken: false,
            usage: Usage::default(),
            last_call: 0,
            moved: None,
            complaints: BTreeMap::new(),
            damage: Damage::default(),
        }
    }

    /// The time never runs backwards.
    pub(super) fn tick(&mut self, now: Instant) {
        self.now = self.now.max(now);
        if self.motion.is_on() {
            self.moved = Some(self.now);
        }
        self.outbox.unfold(self.now);
    }

    /// Whether this script has moved the robot within the last `time`.
    pub(super) fn has_moved_within(&self, time: Duration) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < time;
        self.motion.is_on() || self.moved.is_some_and(lately)
    }

    /// Takes note of an event and hands it on.
    pub(super) fn deliver(&mut self, event: Event) {
        self.known.note(&event, self.now);
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
        let size = match judge(&frame.jpeg) {
            Ok(size) => size,
            Err(error) => return self.note_damage(frame.seq, &error),
        };
        let held = Rc::new(HeldFrame::new(frame, size, &self.frame_bytes));
        self.newest = Some(Rc::clone(&held));
        self.publish(EventName::Frame, Payload::Frame(held));
    }

    /// Takes note of what the script was told about a frame.
    pub(super) fn saw(&mut self, held: &HeldFrame, found: impl IntoIterator<Item = Seen>) {
        if let Some(witness) = &mut self.witness {
            witness.note(held.frame(), self.now, found);
        }
    }

    /// See [`Script::take_sighting`](super::Script::take_sighting).
    pub(super) fn take_sighting(&mut self) -> Option<Sighting> {
        let newest = self.newest.as_ref().map(|held| held.frame().seq);
        let busy = !self.has_ended() && self.tasks.is_ready();
        let witness = self.witness.as_mut()?;
        witness.take_if(|sighting| !busy || newest != Some(sighting.frame.seq))
    }

    fn hear(&mut self, samples: &[u8]) {
        if self.is_heard(EventName::Noise) {
            let dbfs = Loudness::of(samples).dbfs();
            if dbfs > self.options.limits.noise_dbfs {
                self.publish(EventName::Noise, Payload::Noise { dbfs });
            }
        }
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
        if let Some(text) = self.damage.note(seq, &error.to_string(), self.now) {
            self.log(Level::Warn, &text);
        }
    }

    /// Logs a failure, the first time and then ever more rarely for the same place.
    pub(super) fn complain(&mut self, text: &str) {
        let place = text.split(": ").next().unwrap_or(text);
        let known = self.complaints.contains_key(place);
        if !known && self.complaints.len() >= MAX_PLACES {
            return self.log(Level::Error, text);
        }
        let count = self.complaints.entry(place.to_owned()).or_default();
        *count += 1;
        let count = *count;
        if count == 1 {
            self.log(Level::Error, &self.explained(text));
        } else if is_round(count) {
            self.log(Level::Error, &format!("{text} ({count} times)"));
        }
    }

    /// A failure in words for people, with the line where it happened.
    pub(super) fn explained(&self, text: &str) -> String {
        let main = (self.options.chunk.as_str(), self.source.as_str());
        let mut files = std::iter::once(main).chain(self.modules.sources());
        let explained = self
            .explain
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
    pub(super) fn want(&mut self, stream: Stream) -> Result<(), String> {
        if let Some(why) = self.options.streams.refusal(stream) {
            return Err(why);
        }
        if !self.streams.contains(&stream) {
            self.streams.push(stream);
            self.outbox.send(Intent::Stream { stream, on: true });
        }
        Ok(())
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
        [self.tasks.next_timer(), self.outbox.unfolds_at(), ending]
            .into_iter()
            .flatten()
            .min()
    }
}
