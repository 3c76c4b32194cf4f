//! Delivers events and frames to a script: calls that wait for them return, and listeners get the
//! payload.

use std::rc::Rc;
use std::time::Duration;

use tokio::time::Instant;

use super::State;
use super::robot_state::shows_motion;
use crate::robot::{Event, Frame};
use crate::script::Script;
use crate::script::events::{EventName, Payload};
use crate::script::frame_state::HeldFrame;
use crate::script::output::Level;
use crate::script::sound::Loudness;
use crate::script::task::{SubscriptionId, Wait, Wakeup};
use crate::vision::{FrameError, validate_markers};
use crate::wire::Stream;

/// After this long without a loud sound the next one is a new noise.
const QUIET: Duration = Duration::from_secs(1);
/// The motors may be heard for this long after the robot has moved.
const MOTOR: Duration = Duration::from_secs(1);
/// A sound of the robot may be heard for this long after it has begun.
const SOUND: Duration = Duration::from_secs(5);

impl Script {
    /// Delivers an event to the script.
    pub fn deliver(&mut self, event: Event, now: Instant) {
        let mut state = self.state.borrow_mut();
        state.tick(now);
        if !state.has_ended() {
            state.deliver(event);
        }
    }

    /// Delivers a frame to the script; it replaces one that no handler has taken. Returns `false`
    /// if its markers show that it is not a valid picture; the script then does not get it.
    pub fn deliver_frame(&mut self, frame: Frame, now: Instant) -> bool {
        let mut state = self.state.borrow_mut();
        state.tick(now);
        state.has_ended() || state.deliver_frame(frame)
    }

    /// Decodes the part of the next frame that has already arrived, so that examining the whole
    /// frame takes less time.
    pub fn decode_ahead(&mut self, beginning: &[u8]) {
        self.state
            .borrow_mut()
            .frames
            .analyser
            .decode_ahead(beginning);
    }

    /// Whether the script has examined the newest frame, rather than ignored or only saved it.
    pub fn examines_frames(&self) -> bool {
        let state = self.state.borrow();
        let newest = state.frames.newest.as_ref().map(|held| held.frame.seq);
        newest.is_some() && newest == state.frames.analyser.last_frame()
    }

    /// Whether the script needs frames: something listens to them or waits for one, or the script
    /// has switched the video on.
    pub fn wants_frames(&self) -> bool {
        let state = self.state.borrow();
        !state.has_ended()
            && (state.streams.is_on(Stream::Video) || state.has_listener(EventName::Frame))
    }
}

impl State {
    /// Records an event and passes it on.
    fn deliver(&mut self, event: Event) {
        self.robot.record(&event, self.now);
        if shows_motion(&event) {
            self.last_moved = Some(self.now);
        }
        if event == Event::Sounding {
            self.last_sounded = Some(self.now);
        }
        match event {
            Event::MotionEnded { motion, end } => {
                self.motion.ended(motion);
                self.answer(Wait::Motion(motion), || Wakeup::Motion(end));
            }
            Event::DockEnded {
                call,
                end,
                attempts,
                took,
            } => self.answer(Wait::Dock(call), || Wakeup::Dock {
                end,
                attempts,
                took,
            }),
            Event::UndockEnded { call, end } => {
                self.answer(Wait::Undock(call), || Wakeup::Undock(end));
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
    fn deliver_frame(&mut self, frame: Frame) -> bool {
        // For a script that is always busy: examine the last frame before its buffers are reused.
        self.examine_frame_for_motion();
        let size = match validate_markers(&frame.jpeg) {
            Ok(size) => size,
            Err(error) => {
                self.note_damage(frame.seq, &error);
                return false;
            }
        };
        let held = Rc::new(HeldFrame::new(frame, size, &self.frames.held_bytes));
        self.frames.newest = Some(Rc::clone(&held));
        self.plan_motion_check(&held);
        self.publish(EventName::Frame, Payload::Frame(held));
        true
    }

    /// Counts a frame that is not a valid picture; this is logged now and then.
    pub(in crate::script) fn note_damage(&mut self, seq: u64, error: &FrameError) {
        if let Some(text) = self.frames.damage.record(seq, &error.to_string(), self.now) {
            self.log(Level::Warn, &text);
        }
    }

    /// Publishes a `noise` event if this audio begins a loud sound and something listens for it.
    pub(super) fn detect_noise(&mut self, samples: &[u8]) {
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
    pub(super) fn becomes_loud(&mut self) -> bool {
        let before = self.last_loud.replace(self.now);
        before.is_none_or(|at| self.now.saturating_duration_since(at) >= QUIET)
    }

    /// Whether a sound may come from the robot's own motors or speaker.
    pub(super) fn may_be_own_sound(&self) -> bool {
        let lately = |at: Instant| self.now.saturating_duration_since(at) < SOUND;
        self.has_moved_within(MOTOR) || self.last_sounded.is_some_and(lately)
    }

    /// Whether a handler listens to this event or a task waits for it.
    pub(in crate::script) fn has_listener(&self, name: EventName) -> bool {
        let listens = self.subscriptions.values().any(|one| one.event == name);
        listens
            || !self
                .tasks
                .waiting_for(|wait| *wait == Wait::Event(name))
                .is_empty()
    }

    /// Wakes the tasks that wait for exactly this.
    pub(in crate::script) fn answer(&mut self, awaited: Wait, answer: impl Fn() -> Wakeup) {
        for id in self.tasks.waiting_for(|wait| *wait == awaited) {
            self.tasks.wake(id, answer(), self.now);
        }
    }

    pub(super) fn publish(&mut self, name: EventName, payload: Payload) {
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
}
