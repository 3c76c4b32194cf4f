//! The behaviours that run: which events each receives, and which streams they want.

use std::collections::{BTreeMap, BTreeSet};

use tokio::time::Instant;
use tracing::warn;

use super::restrictions::Restrictions;
use super::throttle::{SharedLimit, Throttle};
use crate::robot::channel::{EventSender, Role, RunningBehaviour};
use crate::robot::{BehaviourId, EndReason, Event, Priority, Streams, Use};
use crate::wire::{Command, Stream};

#[derive(Debug)]
struct Seat {
    name: String,
    priority: Priority,
    role: Role,
    events: EventSender,
    streams: BTreeSet<Stream>,
    throttle: Throttle,
}

impl Seat {
    /// Logs that commands were dropped, at growing intervals.
    fn log_refusals(&self) {
        if let Some(count) = self.throttle.refusals_to_log() {
            let behaviour = &self.name;
            warn!(
                behaviour,
                count, "sends more than the robot can take: commands were dropped"
            );
        }
    }
}

/// The seats of all behaviours that run.
#[derive(Debug, Default)]
pub(super) struct Seats {
    seats: BTreeMap<BehaviourId, Seat>,
    streaming: BTreeSet<Stream>,
    usage: Streams,
    /// The limit for all behaviours together; `None` before the first command.
    shared: Option<SharedLimit>,
}

impl Seats {
    /// Begins empty, with this use of the streams.
    pub(super) fn new(usage: Streams) -> Seats {
        Seats {
            usage,
            ..Seats::default()
        }
    }

    /// Adds a behaviour and sends it the current state.
    pub(super) fn join(
        &mut self,
        by: BehaviourId,
        name: String,
        priority: Priority,
        role: Role,
        mut events: EventSender,
        welcome: &[Event],
    ) {
        welcome.iter().for_each(|event| events.tell(event.clone()));
        self.seats.insert(
            by,
            Seat {
                name,
                priority,
                role,
                events,
                streams: BTreeSet::new(),
                throttle: Throttle::new(Instant::now()),
            },
        );
    }

    /// Whether the present restrictions allow a behaviour this command.
    pub(super) fn allows(
        &self,
        by: BehaviourId,
        command: &Command,
        restrictions: Restrictions,
    ) -> bool {
        let seat = self.seats.get(&by);
        seat.is_some_and(|seat| restrictions.allows(seat.role, command))
    }

    /// Whether a behaviour may send one more command that is not a motion.
    pub(super) fn admits(&mut self, by: BehaviourId, command: &Command, now: Instant) -> bool {
        let Some(seat) = self.seats.get_mut(&by) else {
            return false;
        };
        let shared = self.shared.get_or_insert_with(|| SharedLimit::new(now));
        if !seat.throttle.admits(command, now) {
            seat.log_refusals();
            return false;
        }
        if !shared.admits(command, now) {
            self.refuse(by);
            return false;
        }
        true
    }

    /// Counts a command that was within the behaviour's own share, but beyond that of all
    /// behaviours or of the link.
    pub(super) fn refuse(&mut self, by: BehaviourId) {
        if let Some(seat) = self.seats.get_mut(&by) {
            seat.throttle.refuse();
            seat.log_refusals();
        }
    }

    /// Removes a behaviour that has ended.
    pub(super) fn leave(&mut self, by: BehaviourId) {
        self.seats.remove(&by);
    }

    /// Has a behaviour's host ended; from now on its requests are ignored.
    pub(super) fn kill(&mut self, by: BehaviourId, reason: EndReason) {
        if let Some(seat) = self.seats.remove(&by) {
            seat.events.kill(reason);
        }
    }

    /// A behaviour's role; `None` if it has no seat.
    pub(super) fn role(&self, by: BehaviourId) -> Option<Role> {
        self.seats.get(&by).map(|seat| seat.role)
    }

    /// A behaviour's priority; `None` if it has no seat.
    pub(super) fn priority(&self, by: BehaviourId) -> Option<Priority> {
        self.seats.get(&by).map(|seat| seat.priority)
    }

    /// A behaviour's name; `None` if it has no seat.
    pub(super) fn name(&self, by: BehaviourId) -> Option<&str> {
        self.seats.get(&by).map(|seat| seat.name.as_str())
    }

    /// The behaviours that run, without persons.
    pub(super) fn behaviours(&self) -> Vec<RunningBehaviour> {
        let behaviours = self.seats.values();
        behaviours
            .filter(|seat| seat.role != Role::Person)
            .map(|seat| RunningBehaviour {
                name: seat.name.clone(),
                priority: seat.priority,
            })
            .collect()
    }

    /// Sends an event to one behaviour.
    pub(super) fn tell(&mut self, by: BehaviourId, event: Event) {
        if let Some(seat) = self.seats.get_mut(&by) {
            seat.events.tell(event);
        }
    }

    /// Notifies every behaviour of a newer picture.
    pub(super) fn notify_frame(&self) {
        self.seats
            .values()
            .for_each(|seat| seat.events.notify_frame());
    }

    /// Sends an event to every behaviour.
    pub(super) fn tell_all(&mut self, event: &Event) {
        self.seats
            .values_mut()
            .for_each(|seat| seat.events.tell(event.clone()));
    }

    /// Sends an event to the behaviours that want the microphone.
    pub(super) fn tell_listeners(&mut self, event: &Event) {
        let listens = |seat: &&mut Seat| seat.streams.contains(&Stream::AudioIn);
        let listeners = self.seats.values_mut().filter(listens);
        listeners.for_each(|seat| seat.events.tell(event.clone()));
    }

    /// Sends every behaviour the state after a login.
    pub(super) fn welcome_all(&mut self, welcome: &[Event]) {
        welcome.iter().for_each(|event| self.tell_all(event));
    }

    /// Notes that a behaviour wants a stream, or no longer wants it.
    pub(super) fn want(&mut self, by: BehaviourId, stream: Stream, on: bool) {
        let Some(seat) = self.seats.get_mut(&by) else {
            return;
        };
        if on {
            seat.streams.insert(stream)
        } else {
            seat.streams.remove(&stream)
        };
    }

    /// Whether the robot was told to stream this.
    pub(super) fn streams(&self, stream: Stream) -> bool {
        self.streaming.contains(&stream)
    }

    /// Whether a stream must stay off, even when a behaviour wants it.
    pub(super) fn forbids(&self, stream: Stream) -> bool {
        self.usage.usage(stream) == Use::Off
    }

    /// The streams that behaviours or the config want and that may be on.
    fn wanted(&self, restrictions: Restrictions) -> BTreeSet<Stream> {
        let always = self.usage.used(Use::On);
        let always = always.map(|stream| (Role::Behaviour, stream));
        self.seats
            .values()
            .flat_map(|seat| seat.streams.iter().map(|stream| (seat.role, *stream)))
            .chain(always)
            .filter(|(role, stream)| restrictions.allows_stream(*role, *stream))
            .map(|(_, stream)| stream)
            .filter(|stream| !self.forbids(*stream))
            .collect()
    }

    /// The commands that switch the robot's streams to those wanted; `after_login`: all streams of
    /// the robot are off.
    pub(super) fn stream_changes(
        &mut self,
        after_login: bool,
        restrictions: Restrictions,
    ) -> Vec<Command> {
        if after_login {
            self.streaming.clear();
        }
        let wanted = self.wanted(restrictions);
        let off = self
            .streaming
            .difference(&wanted)
            .map(|&stream| (stream, false));
        let on = wanted
            .difference(&self.streaming)
            .map(|&stream| (stream, true));
        let changes = off
            .chain(on)
            .map(|(stream, on)| Command::Stream { stream, on })
            .collect();
        self.streaming = wanted;
        changes
    }

    /// The commands that switch every stream off, at the end.
    pub(super) fn streams_off(&mut self) -> Vec<Command> {
        self.seats.clear();
        self.usage = Streams::default();
        self.stream_changes(false, Restrictions::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::channel::{PilotMessage, events};

    const ONE: BehaviourId = BehaviourId(1);
    const TWO: BehaviourId = BehaviourId(2);
    const USUAL: Restrictions = Restrictions {
        shed: false,
        alarm: false,
    };

    fn video(on: bool) -> Command {
        Command::Stream {
            stream: Stream::Video,
            on,
        }
    }

    #[test]
    fn a_stream_is_on_while_any_behaviour_wants_it() {
        let mut seats = Seats::default();
        for by in [ONE, TWO] {
            seats.join(
                by,
                "one".to_owned(),
                Priority(0),
                Role::Behaviour,
                events().0,
                &[],
            );
            seats.want(by, Stream::Video, true);
        }
        assert_eq!(seats.stream_changes(false, USUAL), [video(true)]);
        assert_eq!(seats.stream_changes(false, USUAL), []);
        assert_eq!(
            seats.stream_changes(true, USUAL),
            [video(true)],
            "a login forgets streams"
        );
        seats.want(ONE, Stream::Video, false);
        assert_eq!(seats.stream_changes(false, USUAL), []);
        seats.leave(TWO);
        assert_eq!(seats.stream_changes(false, USUAL), [video(false)]);
    }

    #[test]
    fn a_forbidden_stream_stays_off_and_an_unconditional_one_is_on_to_the_end() {
        let mut seats = Seats::new(Streams {
            video: Use::On,
            audio_in: Use::Off,
            ..Streams::default()
        });
        seats.join(
            ONE,
            "one".to_owned(),
            Priority(0),
            Role::Behaviour,
            events().0,
            &[],
        );
        seats.want(ONE, Stream::AudioIn, true);
        assert_eq!(seats.stream_changes(true, USUAL), [video(true)]);
        assert!(seats.streams(Stream::Video) && !seats.streams(Stream::AudioIn));
        seats.want(ONE, Stream::Video, false);
        assert_eq!(seats.stream_changes(false, USUAL), []);
        assert_eq!(seats.streams_off(), [video(false)]);
    }

    #[test]
    fn with_a_nearly_empty_battery_only_the_rescuer_has_the_camera() {
        let empty = Restrictions {
            shed: true,
            ..USUAL
        };
        let mut seats = Seats::new(Streams {
            video: Use::On,
            ..Streams::default()
        });
        for (by, role) in [(ONE, Role::Behaviour), (TWO, Role::Rescuer)] {
            seats.join(by, "one".to_owned(), Priority(0), role, events().0, &[]);
            seats.want(by, Stream::AudioIn, true);
        }
        let audio = |on| Command::Stream {
            stream: Stream::AudioIn,
            on,
        };
        assert_eq!(
            seats.stream_changes(true, USUAL),
            [video(true), audio(true)]
        );
        let off = [video(false), audio(false)];
        assert_eq!(seats.stream_changes(false, empty), off);
        seats.want(TWO, Stream::Video, true);
        assert_eq!(seats.stream_changes(false, empty), [video(true)]);
        assert_eq!(seats.stream_changes(false, USUAL), [audio(true)]);
    }

    #[tokio::test]
    async fn requests_of_a_killed_behaviour_are_ignored() {
        let mut seats = Seats::default();
        let (events, mut inbox) = events();
        seats.join(
            ONE,
            "one".to_owned(),
            Priority(3),
            Role::Behaviour,
            events,
            &[],
        );
        assert_eq!(seats.priority(ONE), Some(Priority(3)));
        seats.kill(ONE, EndReason::Cpu);
        assert_eq!(seats.priority(ONE), None);
        assert_eq!(inbox.next().await, PilotMessage::Kill(EndReason::Cpu));
    }
}
