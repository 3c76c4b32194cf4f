//! Serves the behaviours' requests: motion goes to the watchdog; lights, sounds and streams go to
//! the robot if they change anything. Each function fails if the link is lost.

use std::time::Duration;

use bytes::Bytes;
use tokio::time::Instant;

use super::Pilot;
use super::lost::LinkLost;
use super::quiet_hours::QuietHours;
use super::restrictions::Restrictions;
use crate::robot::channel::{Quiet, Request, Role, RunningBehaviours};
use crate::robot::{BehaviourId, CallId, DockEnd, Event, Intent, Priority};
use crate::safety::{ALARM, Fact};
use crate::wire::{Command, Engage, Stream};

/// The delay for streams that a behaviour switches faster than allowed.
const STREAMS_LATER: Duration = Duration::from_millis(100);

impl Pilot {
    pub(super) fn serve(&mut self, request: Request) -> Result<(), LinkLost> {
        self.wake()?;
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
                self.seats.join(by, name, priority, role, events, &welcome);
                if role == Role::Rescuer {
                    self.defer(Fact::Rescuer(Some(by)));
                }
                Ok(())
            }
            Request::Intent(by, intent) => match self.seats.priority(by) {
                Some(priority) => self.intent(by, priority, intent),
                None => Ok(()),
            },
            Request::Alive(by) => {
                self.defer(Fact::Alive(by));
                Ok(())
            }
            Request::Gone(by) => {
                self.seats.leave(by);
                self.defer(Fact::Gone(by));
                self.apply_streams(false)
            }
            Request::Alarm => {
                self.alarm_due = true;
                self.sound_alarm()
            }
            Request::Running(reply) => {
                let (robot, behaviours) = (self.info.clone(), self.seats.behaviours());
                // The receiver may be gone.
                let _ = reply.send(RunningBehaviours { robot, behaviours });
                Ok(())
            }
            Request::Halt(on) => self.halt(on),
            Request::Release(release) => self.release(release),
            Request::Quiet(quiet) => self.set_quiet(quiet),
            Request::Sleep(sleep) => self.sleep(sleep),
        }
    }

    fn intent(
        &mut self,
        by: BehaviourId,
        priority: Priority,
        intent: Intent,
    ) -> Result<(), LinkLost> {
        match intent {
            Intent::Release { .. } => {
                self.defer(Fact::Asked {
                    by,
                    priority,
                    intent,
                });
                Ok(())
            }
            Intent::Dock { call, .. } if !self.admits(by, Engage::Dock) => {
                self.seats.tell(by, refused_docking(call));
                Ok(())
            }
            Intent::Undock { call, .. } if !self.admits(by, Engage::Undock) => {
                let end = DockEnd::Safety;
                self.seats.tell(by, Event::UndockEnded { call, end });
                Ok(())
            }
            Intent::Move { .. }
            | Intent::Stop
            | Intent::Dock { .. }
            | Intent::Undock { .. }
            | Intent::CancelDock => {
                self.stopwatch
                    .serving(matches!(intent, Intent::Move { .. }));
                let served = self.take(Fact::Asked {
                    by,
                    priority,
                    intent,
                });
                self.stopwatch.serving(false);
                served
            }
            Intent::Stream { stream, on } => self.stream(by, stream, on),
            Intent::Led { led, on } => self.signal(by, Command::Led { led, on }),
            Intent::Play(sound) => self.signal(by, Command::Play(sound)),
            Intent::StopSound => self.signal(by, Command::StopSound),
            Intent::Volume(percent) => self.signal(by, Command::Volume(percent.get())),
            Intent::Say(_) if self.seats.forbids(Stream::AudioOut) => Ok(()),
            Intent::Say(samples) => self.say(by, samples.into()),
        }
    }

    /// Switches a stream now, or a little later if the behaviour switches too often.
    fn stream(&mut self, by: BehaviourId, stream: Stream, on: bool) -> Result<(), LinkLost> {
        self.seats.want(by, stream, on);
        let now = Instant::now();
        if self.seats.admits(by, &Command::Stream { stream, on }, now) {
            return self.apply_streams(false);
        }
        self.streams_due.get_or_insert(now + STREAMS_LATER);
        Ok(())
    }

    /// Sends a light or a sound if it changes anything and the behaviour is allowed to.
    fn signal(&mut self, by: BehaviourId, command: Command) -> Result<(), LinkLost> {
        if !self.allows(by, &command)
            || !self.lights.is_news(&command)
            || !self.seats.admits(by, &command, Instant::now())
        {
            return Ok(());
        }
        self.flush_deferred()?;
        self.send(&[command])
    }

    /// Whether the current state allows a behaviour this light or sound.
    fn allows(&self, by: BehaviourId, command: &Command) -> bool {
        let restrictions = Restrictions::demanded_by(&self.watchdog);
        let role = self.seats.role(by).unwrap_or_default();
        self.quiet_hours.allows(role, command) && self.seats.allows(by, command, restrictions)
    }

    /// Begins or ends quiet hours.
    fn set_quiet(&mut self, quiet: Quiet) -> Result<(), LinkLost> {
        let quiet_hours = QuietHours::new(quiet);
        if std::mem::replace(&mut self.quiet_hours, quiet_hours) == quiet_hours {
            return Ok(());
        }
        let noise = quiet_hours.commands_at_start(self.watchdog.alarm_sounds());
        if let Some(writer) = &mut self.writer
            && !noise.is_empty()
        {
            writer.drop_audio();
        }
        self.flush_deferred()?;
        self.send(noise)
    }

    /// Releases the link, or reconnects: see [`Request::Release`].
    fn release(&mut self, release: bool) -> Result<(), LinkLost> {
        let away = self.watchdog.low().is_some() && !self.watchdog.docked();
        let busy = away || !self.seats.behaviours().is_empty();
        if release && (busy || self.writer.is_none()) {
            return Ok(());
        }
        let before = std::mem::replace(&mut self.released, release);
        if release && !before {
            Err(LinkLost::because("disconnected, no behaviour runs"))
        } else {
            Ok(())
        }
    }

    /// Takes in a fact and defers its acts until all pending requests are served, with nothing
    /// written in between: a behaviour that releases the tracks may take them again at once, and
    /// one of lower priority must not drive in that instant.
    fn defer(&mut self, fact: Fact) {
        self.watchdog.absorb(fact, Instant::now());
        self.has_deferred = true;
    }

    /// Executes the deferred acts.
    pub(super) fn flush_deferred(&mut self) -> Result<(), LinkLost> {
        if !std::mem::take(&mut self.has_deferred) {
            return Ok(());
        }
        let acts = self.watchdog.tick(Instant::now());
        self.perform(acts)
    }

    /// Sounds the alarm for a behaviour that was given up, as soon as the robot is connected. It is
    /// as loud as the watchdog's own.
    pub(super) fn sound_alarm(&mut self) -> Result<(), LinkLost> {
        if !self.alarm_due || self.writer.is_none() {
            return Ok(());
        }
        self.alarm_due = false;
        self.flush_deferred()?;
        let alarm: Vec<Command> = ALARM
            .into_iter()
            .filter(|command| self.quiet_hours.allows_alarm(command))
            .collect();
        self.send(&alarm)
    }

    fn say(&mut self, by: BehaviourId, samples: Bytes) -> Result<(), LinkLost> {
        let command = Command::Audio(samples.clone());
        if !self.allows(by, &command) || !self.seats.admits(by, &command, Instant::now()) {
            return Ok(());
        }
        self.flush_deferred()?;
        if let Some(writer) = &mut self.writer
            && !writer.say(&samples)?
        {
            self.seats.refuse(by);
            return Ok(());
        }
        self.tell_sound();
        Ok(())
    }

    /// Whether a behaviour may request one more docking or undocking.
    fn admits(&mut self, by: BehaviourId, engage: Engage) -> bool {
        self.seats
            .admits(by, &Command::Engine(engage), Instant::now())
    }

    /// Switches the streams of a behaviour that switched them too often, once the delay is over.
    pub(super) fn catch_up_streams(&mut self) -> Result<(), LinkLost> {
        match self.streams_due.take_if(|at| *at <= Instant::now()) {
            Some(_) => self.apply_streams(false),
            None => Ok(()),
        }
    }

    /// Switches the streams that the behaviours want; `after_login`: the login has switched all
    /// streams off.
    pub(super) fn apply_streams(&mut self, after_login: bool) -> Result<(), LinkLost> {
        let restrictions = Restrictions::demanded_by(&self.watchdog);
        let commands = self.seats.stream_changes(after_login, restrictions);
        if commands.is_empty() || self.writer.is_none() {
            return Ok(());
        }
        self.flush_deferred()?;
        let streaming = self.seats.streams(Stream::Video) || self.seats.streams(Stream::AudioIn);
        self.take(Fact::Streaming(streaming))?;
        self.send(&commands)
    }

    /// Switches off what a nearly empty battery must not feed, and the streams on again when it
    /// charges; drops queued speech when the alarm sounds or the battery is nearly empty. What the
    /// watchdog wants was sent before.
    pub(super) fn apply_restrictions(&mut self) -> Result<(), LinkLost> {
        let now = Restrictions::demanded_by(&self.watchdog);
        let before = std::mem::replace(&mut self.restrictions, now);
        if before == now {
            return Ok(());
        }
        if let Some(writer) = &mut self.writer
            && (now.shed || now.alarm)
        {
            writer.drop_audio();
        }
        if now.shed && !before.shed {
            let off = self.lights.off(now.alarm);
            self.send(&off)?;
        }
        self.apply_streams(false)
    }
}

/// The answer to a docking that is requested faster than the robot can take.
fn refused_docking(call: CallId) -> Event {
    Event::DockEnded {
        call,
        end: DockEnd::Safety,
        attempts: 0,
        took: Duration::ZERO,
    }
}
