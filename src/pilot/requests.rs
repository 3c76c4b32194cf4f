//! Serves the requests of the behaviours that run, and knows which events each receives and which
//! streams it wants: motion goes to the watchdog; lights, sounds and streams go to the robot if they
//! change anything. Each function fails if the link is lost.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use bytes::Bytes;
use tokio::time::Instant;
use tracing::warn;

use super::Pilot;
use super::outputs::Restrictions;
use super::throttle::Throttle;
use crate::link::LinkError;
use crate::robot::channel::{
    EventSender, Quiet, Request, Role, RunningBehaviour, RunningBehaviours,
};
use crate::robot::{
    BehaviourId, CallId, DockEnd, DockOutcome, EndReason, Event, Intent, Priority, Streams, Use,
};
use crate::safety::{ALARM, Fact};
use crate::wire::{Command, Engage, Stream};

/// The delay for streams that a behaviour switches faster than allowed.
const STREAMS_LATER: Duration = Duration::from_millis(100);

impl Pilot {
    pub(super) fn serve(&mut self, request: Request) -> Result<(), LinkError> {
        self.heartbeat()?;
        match request {
            Request::Join {
                by,
                name,
                priority,
                role,
                events,
            } => {
                let mut welcome = self.welcome();
                // `Connected` must stay the last event.
                welcome.insert(0, Event::Moving { on: self.moving });
                self.sessions
                    .join(by, name, priority, role, events, &welcome);
                if role == Role::Rescuer {
                    self.defer(Fact::Rescuer(Some(by)));
                }
                Ok(())
            }
            Request::Intent(by, intent) => match self.sessions.priority(by) {
                Some(priority) => self.intent(by, priority, intent),
                None => Ok(()),
            },
            Request::Alive(by) => {
                self.defer(Fact::Alive(by));
                Ok(())
            }
            Request::Gone(by) => {
                self.sessions.leave(by);
                self.defer(Fact::Gone(by));
                self.apply_streams(false)
            }
            Request::Alarm => {
                self.alarm_due = true;
                self.sound_alarm()
            }
            Request::Running(reply) => {
                let robot = self.info.clone();
                let behaviours = self.sessions.behaviours();
                // The receiver may be gone.
                let _ = reply.send(RunningBehaviours { robot, behaviours });
                Ok(())
            }
            Request::EmergencyStop(on) => self.set_emergency_stop(on),
            Request::Release(release) => self.release(release),
            Request::Quiet(quiet) => self.set_quiet(quiet),
            Request::Suspend(suspend) => self.suspend(suspend),
        }
    }

    fn intent(
        &mut self,
        by: BehaviourId,
        priority: Priority,
        intent: Intent,
    ) -> Result<(), LinkError> {
        match intent {
            Intent::Release { .. } => {
                self.watchdog.request(by, priority, intent, Instant::now());
                self.has_deferred = true;
                Ok(())
            }
            Intent::Dock { call, .. } if !self.admits(by, Engage::Dock) => {
                self.sessions.tell(by, refused_docking(call));
                Ok(())
            }
            Intent::Undock { call, .. } if !self.admits(by, Engage::Undock) => {
                let end = DockEnd::Safety;
                self.sessions.tell(by, Event::UndockEnded { call, end });
                Ok(())
            }
            Intent::Move { .. }
            | Intent::Stop
            | Intent::Dock { .. }
            | Intent::Undock { .. }
            | Intent::CancelDock => {
                self.stopwatch
                    .serving(matches!(intent, Intent::Move { .. }));
                let now = Instant::now();
                self.watchdog.request(by, priority, intent, now);
                let acts = self.watchdog.poll(now);
                let served = self.perform(acts);
                self.stopwatch.serving(false);
                served
            }
            Intent::Stream { stream, on } => self.stream(by, stream, on),
            Intent::Led { led, on } => self.signal(by, Command::Led { led, on }),
            Intent::Play(sound) => self.signal(by, Command::Play(sound)),
            Intent::StopSound => self.signal(by, Command::StopSound),
            Intent::Volume(percent) => self.signal(by, Command::Volume(percent.get())),
            Intent::Say(_) if self.sessions.forbids(Stream::AudioOut) => Ok(()),
            Intent::Say(samples) => self.say(by, samples.into()),
        }
    }

    /// Switches a stream now, or a little later if the behaviour switches too often.
    fn stream(&mut self, by: BehaviourId, stream: Stream, on: bool) -> Result<(), LinkError> {
        self.sessions.want(by, stream, on);
        let now = Instant::now();
        if self
            .sessions
            .admits(by, &Command::Stream { stream, on }, now)
        {
            return self.apply_streams(false);
        }
        self.streams_due.get_or_insert(now + STREAMS_LATER);
        Ok(())
    }

    /// Sends a light or a sound if it changes anything and the behaviour is allowed to.
    fn signal(&mut self, by: BehaviourId, command: Command) -> Result<(), LinkError> {
        if !self.allows(by, &command)
            || !self.actuators.is_news(&command)
            || !self.sessions.admits(by, &command, Instant::now())
        {
            return Ok(());
        }
        self.flush_deferred()?;
        self.send(&[command])
    }

    /// Whether the current state allows a behaviour this light or sound.
    fn allows(&self, by: BehaviourId, command: &Command) -> bool {
        let restrictions = Restrictions::demanded_by(&self.watchdog);
        let role = self.sessions.role(by).unwrap_or_default();
        self.quiet.allows(role, command) && self.sessions.allows(by, command, restrictions)
    }

    fn set_quiet(&mut self, quiet: Quiet) -> Result<(), LinkError> {
        if std::mem::replace(&mut self.quiet, quiet) == quiet {
            return Ok(());
        }
        let noise = quiet.commands_at_start(self.watchdog.alarm_sounds());
        if let Some(writer) = &mut self.writer
            && !noise.is_empty()
        {
            writer.drop_audio();
        }
        self.flush_deferred()?;
        self.send(noise)
    }

    /// Releases the link, or reconnects: see [`Request::Release`].
    fn release(&mut self, release: bool) -> Result<(), LinkError> {
        let away = self.watchdog.low().is_some() && !self.watchdog.docked();
        let busy = away || self.debt.is_owed() || !self.sessions.behaviours().is_empty();
        if release && (busy || self.writer.is_none()) {
            return Ok(());
        }
        let before = std::mem::replace(&mut self.released, release);
        if release && !before {
            Err(LinkError::ClosedHere(
                "disconnected, no behaviour runs".to_owned(),
            ))
        } else {
            Ok(())
        }
    }

    /// Takes in a fact and defers its acts until all pending requests are served, with nothing
    /// written in between: a behaviour that releases the tracks may take them again at once, and
    /// one of lower priority must not drive in that instant.
    fn defer(&mut self, fact: Fact) {
        self.watchdog.apply(fact, Instant::now());
        self.has_deferred = true;
    }

    pub(super) fn flush_deferred(&mut self) -> Result<(), LinkError> {
        if !std::mem::take(&mut self.has_deferred) {
            return Ok(());
        }
        let acts = self.watchdog.poll(Instant::now());
        self.perform(acts)
    }

    /// Sounds the alarm for a behaviour that was given up, as soon as the robot is connected. It is
    /// as loud as the watchdog's own.
    pub(super) fn sound_alarm(&mut self) -> Result<(), LinkError> {
        if !self.alarm_due || self.writer.is_none() {
            return Ok(());
        }
        self.alarm_due = false;
        self.flush_deferred()?;
        let alarm: Vec<Command> = ALARM
            .into_iter()
            .filter(|command| self.quiet.allows_alarm(command))
            .collect();
        self.send(&alarm)
    }

    fn say(&mut self, by: BehaviourId, samples: Bytes) -> Result<(), LinkError> {
        let command = Command::Audio(samples.clone());
        if !self.allows(by, &command) || !self.sessions.admits(by, &command, Instant::now()) {
            return Ok(());
        }
        self.flush_deferred()?;
        if let Some(writer) = &mut self.writer
            && !writer.say(&samples)?
        {
            self.sessions.refuse(by);
            return Ok(());
        }
        self.tell_sound();
        Ok(())
    }

    /// Whether a behaviour may request one more docking or undocking.
    fn admits(&mut self, by: BehaviourId, engage: Engage) -> bool {
        self.sessions
            .admits(by, &Command::Engine(engage), Instant::now())
    }

    /// Switches the streams of a behaviour that switched them too often, once the delay is over.
    pub(super) fn catch_up_streams(&mut self) -> Result<(), LinkError> {
        match self.streams_due.take_if(|at| *at <= Instant::now()) {
            Some(_) => self.apply_streams(false),
            None => Ok(()),
        }
    }

    /// Switches the streams that the behaviours want; `after_login`: the login has switched all
    /// streams off.
    pub(super) fn apply_streams(&mut self, after_login: bool) -> Result<(), LinkError> {
        let restrictions = Restrictions::demanded_by(&self.watchdog);
        let commands = self.sessions.stream_changes(after_login, restrictions);
        if commands.is_empty() || self.writer.is_none() {
            return Ok(());
        }
        self.flush_deferred()?;
        let streaming =
            self.sessions.streams(Stream::Video) || self.sessions.streams(Stream::AudioIn);
        self.handle(Fact::Streaming(streaming))?;
        self.send(&commands)
    }
}

/// The answer to a docking that is requested faster than the robot can take.
fn refused_docking(call: CallId) -> Event {
    let outcome = DockOutcome::without_attempt(DockEnd::Safety);
    Event::DockEnded { call, outcome }
}

#[derive(Debug)]
struct Session {
    name: String,
    priority: Priority,
    role: Role,
    events: EventSender,
    streams: BTreeSet<Stream>,
    throttle: Throttle,
}

impl Session {
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

#[derive(Debug, Default)]
pub(super) struct Sessions {
    sessions: BTreeMap<BehaviourId, Session>,
    streaming: BTreeSet<Stream>,
    usage: Streams,
    /// The limit for all behaviours together; `None` before the first command.
    shared: Option<Throttle>,
}

impl Sessions {
    pub(super) fn new(usage: Streams) -> Sessions {
        Sessions {
            usage,
            ..Sessions::default()
        }
    }

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
        self.sessions.insert(
            by,
            Session {
                name,
                priority,
                role,
                events,
                streams: BTreeSet::new(),
                throttle: Throttle::new(),
            },
        );
    }

    pub(super) fn allows(
        &self,
        by: BehaviourId,
        command: &Command,
        restrictions: Restrictions,
    ) -> bool {
        let session = self.sessions.get(&by);
        session.is_some_and(|session| restrictions.allows(session.role, command))
    }

    /// Whether a behaviour may send one more command that is not a motion.
    pub(super) fn admits(&mut self, by: BehaviourId, command: &Command, now: Instant) -> bool {
        let Some(session) = self.sessions.get_mut(&by) else {
            return false;
        };
        let shared = self.shared.get_or_insert_with(Throttle::shared);
        if !session.throttle.admits(command, now) {
            session.log_refusals();
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
        if let Some(session) = self.sessions.get_mut(&by) {
            session.throttle.refuse();
            session.log_refusals();
        }
    }

    pub(super) fn leave(&mut self, by: BehaviourId) {
        self.sessions.remove(&by);
    }

    /// Has a behaviour's host ended; from now on its requests are ignored.
    pub(super) fn kill(&mut self, by: BehaviourId, reason: EndReason) {
        if let Some(session) = self.sessions.remove(&by) {
            session.events.kill(reason);
        }
    }

    pub(super) fn role(&self, by: BehaviourId) -> Option<Role> {
        self.sessions.get(&by).map(|session| session.role)
    }

    pub(super) fn priority(&self, by: BehaviourId) -> Option<Priority> {
        self.sessions.get(&by).map(|session| session.priority)
    }

    pub(super) fn name(&self, by: BehaviourId) -> Option<&str> {
        self.sessions.get(&by).map(|session| session.name.as_str())
    }

    /// The behaviours that run, without persons.
    pub(super) fn behaviours(&self) -> Vec<RunningBehaviour> {
        let behaviours = self.sessions.values();
        behaviours
            .filter(|session| session.role != Role::Person)
            .map(|session| RunningBehaviour {
                name: session.name.clone(),
                priority: session.priority,
            })
            .collect()
    }

    pub(super) fn tell(&mut self, by: BehaviourId, event: Event) {
        if let Some(session) = self.sessions.get_mut(&by) {
            session.events.tell(event);
        }
    }

    pub(super) fn notify_frame(&self) {
        self.sessions
            .values()
            .for_each(|session| session.events.notify_frame());
    }

    pub(super) fn tell_all(&mut self, event: &Event) {
        self.sessions
            .values_mut()
            .for_each(|session| session.events.tell(event.clone()));
    }

    pub(super) fn tell_listeners(&mut self, event: &Event) {
        let listens = |session: &&mut Session| session.streams.contains(&Stream::AudioIn);
        let listeners = self.sessions.values_mut().filter(listens);
        listeners.for_each(|session| session.events.tell(event.clone()));
    }

    /// Notes that a behaviour wants a stream, or no longer wants it.
    pub(super) fn want(&mut self, by: BehaviourId, stream: Stream, on: bool) {
        let Some(session) = self.sessions.get_mut(&by) else {
            return;
        };
        if on {
            session.streams.insert(stream)
        } else {
            session.streams.remove(&stream)
        };
    }

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
        self.sessions
            .values()
            .flat_map(|session| session.streams.iter().map(|stream| (session.role, *stream)))
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

    pub(super) fn streams_off(&mut self) -> Vec<Command> {
        self.sessions.clear();
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

    fn join(sessions: &mut Sessions, by: BehaviourId, role: Role) {
        sessions.join(by, "one".to_owned(), Priority(0), role, events().0, &[]);
    }

    #[test]
    fn a_stream_is_on_while_any_behaviour_wants_it() {
        let mut sessions = Sessions::default();
        for by in [ONE, TWO] {
            join(&mut sessions, by, Role::Behaviour);
            sessions.want(by, Stream::Video, true);
        }
        assert_eq!(sessions.stream_changes(false, USUAL), [video(true)]);
        assert_eq!(sessions.stream_changes(false, USUAL), []);
        assert_eq!(
            sessions.stream_changes(true, USUAL),
            [video(true)],
            "a login forgets streams"
        );
        sessions.want(ONE, Stream::Video, false);
        assert_eq!(sessions.stream_changes(false, USUAL), []);
        sessions.leave(TWO);
        assert_eq!(sessions.stream_changes(false, USUAL), [video(false)]);
    }

    #[test]
    fn a_forbidden_stream_stays_off_and_an_unconditional_one_is_on_to_the_end() {
        let mut sessions = Sessions::new(Streams {
            video: Use::On,
            audio_in: Use::Off,
            ..Streams::default()
        });
        join(&mut sessions, ONE, Role::Behaviour);
        sessions.want(ONE, Stream::AudioIn, true);
        assert_eq!(sessions.stream_changes(true, USUAL), [video(true)]);
        assert!(sessions.streams(Stream::Video) && !sessions.streams(Stream::AudioIn));
        sessions.want(ONE, Stream::Video, false);
        assert_eq!(sessions.stream_changes(false, USUAL), []);
        assert_eq!(sessions.streams_off(), [video(false)]);
    }

    #[test]
    fn with_a_nearly_empty_battery_only_the_rescuer_has_the_camera() {
        let empty = Restrictions {
            shed: true,
            ..USUAL
        };
        let mut sessions = Sessions::new(Streams {
            video: Use::On,
            ..Streams::default()
        });
        for (by, role) in [(ONE, Role::Behaviour), (TWO, Role::Rescuer)] {
            join(&mut sessions, by, role);
            sessions.want(by, Stream::AudioIn, true);
        }
        let audio = |on| Command::Stream {
            stream: Stream::AudioIn,
            on,
        };
        assert_eq!(
            sessions.stream_changes(true, USUAL),
            [video(true), audio(true)]
        );
        let off = [video(false), audio(false)];
        assert_eq!(sessions.stream_changes(false, empty), off);
        sessions.want(TWO, Stream::Video, true);
        assert_eq!(sessions.stream_changes(false, empty), [video(true)]);
        assert_eq!(sessions.stream_changes(false, USUAL), [audio(true)]);
    }

    #[tokio::test]
    async fn requests_of_a_killed_behaviour_are_ignored() {
        let mut sessions = Sessions::default();
        let (events, mut inbox) = events();
        sessions.join(
            ONE,
            "one".to_owned(),
            Priority(3),
            Role::Behaviour,
            events,
            &[],
        );
        assert_eq!(sessions.priority(ONE), Some(Priority(3)));
        sessions.kill(ONE, EndReason::Cpu);
        assert_eq!(sessions.priority(ONE), None);
        assert_eq!(inbox.next().await, PilotMessage::Kill(EndReason::Cpu));
    }
}
