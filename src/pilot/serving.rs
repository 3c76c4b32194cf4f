//! What the pilot does with what behaviours ask: motion goes to the watchdog, lights, sounds and
//! streams to the robot if they change anything. Each function returns why the link is lost, if it
//! is.

use std::time::Duration;

use tokio::time::Instant;

use super::Pilot;
use crate::robot::channel::Request;
use crate::robot::{BehaviourId, Intent, Priority};
use crate::safety::{Ask, Fact};
use crate::wire::{Command, Sound, Stream};

/// When streams are switched that a behaviour switches faster than it may.
const STREAMS_LATER: Duration = Duration::from_millis(100);

impl Pilot {
    pub(super) async fn serve(&mut self, request: Request) -> Option<String> {
        match request {
            Request::Join {
                by,
                name,
                priority,
                outbox,
            } => {
                let welcome = self.welcome();
                self.seats.join(by, name, priority, outbox, &welcome);
                None
            }
            Request::Intent(by, intent) => match self.seats.priority(by) {
                Some(priority) => self.intent(by, priority, intent).await,
                None => None,
            },
            Request::Alive(by) => self.put_off(Fact::Alive(by)),
            Request::Gone(by) => {
                self.seats.leave(by);
                self.put_off(Fact::Gone(by));
                self.apply_streams(false).await
            }
            Request::Alarm => {
                self.alarm_due = true;
                self.sound_alarm().await
            }
        }
    }

    async fn intent(
        &mut self,
        by: BehaviourId,
        priority: Priority,
        intent: Intent,
    ) -> Option<String> {
        let command = match intent {
            Intent::Move {
                motion,
                setpoint,
                duration,
            } => {
                return self
                    .ask(
                        by,
                        priority,
                        Ask::Move {
                            motion,
                            setpoint,
                            duration,
                        },
                    )
                    .await;
            }
            Intent::Release { motion } => {
                let ask = Ask::Release(motion);
                return self.put_off(Fact::Asked { by, priority, ask });
            }
            Intent::Stop => return self.ask(by, priority, Ask::Stop).await,
            Intent::Dock { call, plan } => {
                return self.ask(by, priority, Ask::Dock(call, plan)).await;
            }
            Intent::Undock { call, timeout } => {
                return self.ask(by, priority, Ask::Undock(call, timeout)).await;
            }
            Intent::CancelDock => return self.ask(by, priority, Ask::CancelDock).await,
            Intent::Stream { stream, on } => {
                self.seats.want(by, stream, on);
                let command = Command::Stream { stream, on };
                let now = Instant::now();
                if self.seats.admits(by, &command, now) {
                    return self.apply_streams(false).await;
                }
                self.streams_due.get_or_insert(now + STREAMS_LATER);
                return None;
            }
            Intent::Led { led, on } => Command::Led { led, on },
            Intent::Play(sound) => Command::Play(sound),
            Intent::StopSound => Command::StopSound,
            Intent::Volume(percent) => Command::Volume(percent.get()),
            Intent::Say(_) if self.seats.forbids(Stream::AudioOut) => return None,
            Intent::Say(samples) => Command::Audio(samples.into()),
        };
        if !self.lights.is_news(&command) || !self.seats.admits(by, &command, Instant::now()) {
            return None;
        }
        self.lights.note(&command);
        let lost = self.settle().await;
        self.write(&[command]).await.or(lost)
    }

    /// A behaviour that lets go of the tracks may take them again at once, and what waits below it
    /// must not drive for that instant: what comes of it is seen when all that has come is served.
    /// Nothing is written in between.
    fn put_off(&mut self, fact: Fact) -> Option<String> {
        self.watchdog.absorb(fact, Instant::now());
        self.unsettled = true;
        None
    }

    /// Does what was put off.
    pub(super) async fn settle(&mut self) -> Option<String> {
        if !std::mem::take(&mut self.unsettled) {
            return None;
        }
        let acts = self.watchdog.tick(Instant::now());
        self.perform(acts).await
    }

    /// The alarm of a behaviour that was given up, as soon as there is a robot to sound it.
    pub(super) async fn sound_alarm(&mut self) -> Option<String> {
        if !self.alarm_due || self.writer.is_none() {
            return None;
        }
        self.alarm_due = false;
        let alarm = Command::Play(Sound::Alarm);
        self.lights.note(&alarm);
        let lost = self.settle().await;
        self.write(&[alarm]).await.or(lost)
    }

    async fn ask(&mut self, by: BehaviourId, priority: Priority, ask: Ask) -> Option<String> {
        self.take(Fact::Asked { by, priority, ask }).await
    }

    /// The streams of a behaviour that switched them too often are switched after a while.
    pub(super) async fn catch_up_streams(&mut self) -> Option<String> {
        self.streams_due.take_if(|at| *at <= Instant::now())?;
        self.apply_streams(false).await
    }

    /// Switches the streams that the behaviours want; `anew` after a login, which forgets them.
    pub(super) async fn apply_streams(&mut self, anew: bool) -> Option<String> {
        let commands = self.seats.stream_changes(anew);
        if commands.is_empty() || self.writer.is_none() {
            return None;
        }
        let settled = self.settle().await;
        let listening = self.seats.streams(Stream::Video) || self.seats.streams(Stream::AudioIn);
        let lost = self.take(Fact::Listening(listening)).await;
        self.write(&commands).await.or(lost).or(settled)
    }
}
