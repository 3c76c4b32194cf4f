//! The task that owns the robot's socket, and with it the watchdog: no other code can move the
//! robot. Facts go into the watchdog, its acts come out and are done here, all commands of one
//! batch in one write. Knows no script, no decoder and no lock.
//!
//! However this task ends, by order, by a panic or by being dropped, the [`Writer`]'s own drop
//! tells the tracks to stop.

mod lights;
mod line;
mod seats;
mod status;
mod throttle;

use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tracing::{debug, info, warn};

use crate::link::{LinkError, Writer};
use crate::robot::channel::Request;
use crate::robot::{BehaviourId, Event, Frame, Intent, Priority, RobotInfo};
use crate::safety::{Act, Ask, Fact, Limits, Watchdog};
use crate::wire::{Accepted, Command, EngineNews, Power, Report, Stream};

use self::lights::Lights;
pub use self::line::Dial;
use self::line::{Greeting, Line, News};
use self::seats::Seats;
pub use self::status::{LinkState, Status};

/// Requests served in a row before the robot is heard again.
const REQUESTS_IN_A_ROW: usize = 32;
/// When streams are switched that a behaviour switches faster than it may.
const STREAMS_LATER: Duration = Duration::from_millis(100);

/// How often the other tasks get a turn before a deadline is judged: once to read, once to pass on.
const HEARINGS: usize = 2;

/// How the run is told to come to its end.
#[derive(Debug, Clone, Default)]
pub struct Ending {
    /// Nothing may move any more; lights and sounds still work.
    pub parting: CancellationToken,
    /// Close the link and return.
    pub closing: CancellationToken,
}

/// What the pilot needs to know besides the line.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The numbers of the safety rules.
    pub limits: Limits,
    /// The line leads to the embedded simulator.
    pub simulated: bool,
    /// Seeds the jitter of the pauses between tries to connect.
    pub seed: u64,
    /// Times of the link.
    pub link: crate::link::Options,
}

/// The task's state. [`Pilot::run`] is its life.
#[derive(Debug)]
pub struct Pilot {
    watchdog: Watchdog,
    writer: Option<Writer>,
    seats: Seats,
    lights: Lights,
    frames: watch::Sender<Option<Frame>>,
    status: watch::Sender<Status>,
    battery: Option<Power>,
    info: Option<RobotInfo>,
    simulated: bool,
    unknown_kinds: Vec<u8>,
    streams_due: Option<Instant>,
}

impl Pilot {
    /// Without a link. Also returns the newest frame and the newest status.
    pub fn new(
        settings: &Settings,
    ) -> (
        Pilot,
        watch::Receiver<Option<Frame>>,
        watch::Receiver<Status>,
    ) {
        let (frames, newest_frame) = watch::channel(None);
        let (status, newest_status) = watch::channel(Status::default());
        let pilot = Pilot {
            watchdog: Watchdog::new(settings.limits.clone(), Instant::now()),
            writer: None,
            seats: Seats::default(),
            lights: Lights::default(),
            frames,
            status,
            battery: None,
            info: None,
            simulated: settings.simulated,
            unknown_kinds: Vec::new(),
            streams_due: None,
        };
        (pilot, newest_frame, newest_status)
    }

    /// Connects, serves and reconnects until told to close.
    ///
    /// # Errors
    /// [`LinkError`] if the very first connection fails: then a person is there to read it. Later
    /// failures are tried again for ever.
    pub async fn run(
        mut self,
        dial: Dial,
        settings: Settings,
        mut requests: mpsc::Receiver<Request>,
        ending: Ending,
    ) -> Result<(), LinkError> {
        let mut line = Line::new(dial, &settings.link, settings.seed);
        let mut parted = false;
        loop {
            let deadline = [self.watchdog.next_deadline(), self.streams_due];
            let deadline = deadline.into_iter().flatten().min();
            let lost = tokio::select! {
                biased;
                () = ending.closing.cancelled() => break,
                () = ending.parting.cancelled(), if !parted => {
                    parted = true;
                    self.take(Fact::Parting).await
                }
                () = until(deadline) => self.tick(&mut requests).await,
                news = line.next() => self.hear(news).await?,
                Some(request) = requests.recv() => self.serve(request).await,
            };
            let lost = self.serve_waiting(&mut requests).await.or(lost);
            if let Some(reason) = lost {
                line.hang_up();
                self.lose(reason).await;
            }
            self.publish();
        }
        self.close().await;
        Ok(())
    }

    /// What has come while this task, or the whole machine, slept is heard before anybody is judged
    /// by his silence.
    async fn tick(&mut self, requests: &mut mpsc::Receiver<Request>) -> Option<String> {
        for _ in 0..HEARINGS {
            tokio::task::yield_now().await;
        }
        let lost = self.serve_waiting(requests).await;
        let acts = self.watchdog.tick(Instant::now());
        let lost = self.perform(acts).await.or(lost);
        self.catch_up_streams().await.or(lost)
    }

    /// Requests get their turn even if the robot never stops talking.
    async fn serve_waiting(&mut self, requests: &mut mpsc::Receiver<Request>) -> Option<String> {
        for _ in 0..REQUESTS_IN_A_ROW {
            let Ok(request) = requests.try_recv() else {
                break;
            };
            if let Some(reason) = self.serve(request).await {
                return Some(reason);
            }
        }
        None
    }

    // Everything below returns why the link is lost, if it is.

    async fn hear(&mut self, news: News) -> Result<Option<String>, LinkError> {
        match news {
            News::Up(greeting) => Ok(self.connected(*greeting).await),
            News::Report(report) => Ok(self.report(report).await),
            News::Lost(error) => Ok(Some(error.to_string())),
            News::Failed(error) if self.info.is_none() => Err(error),
            News::Failed(error) => {
                warn!("still not connected: {error}");
                Ok(None)
            }
        }
    }

    async fn connected(&mut self, greeting: Greeting) -> Option<String> {
        let Greeting {
            accepted,
            power,
            peer,
            early,
            writer,
        } = greeting;
        let Accepted {
            uid,
            name,
            firmware,
            docked,
            ..
        } = accepted;
        let address = peer.to_string();
        info!(%uid, %address, %firmware, docked, battery = power.percent, "connected");
        let info = RobotInfo {
            uid,
            name,
            firmware,
            address,
            simulated: self.simulated,
        };
        self.writer = Some(writer);
        self.lights.forget();
        self.info = Some(info);
        self.battery = Some(power);
        let mut lost = self.take(Fact::LinkUp { docked, power }).await;
        self.seats.welcome_all(&self.welcome());
        for report in early {
            lost = self.report(report).await.or(lost);
        }
        self.apply_streams(true).await.or(lost)
    }

    /// What a behaviour must know of a robot that is connected.
    fn welcome(&self) -> Vec<Event> {
        let (Some(info), Some(power)) = (&self.info, self.battery) else {
            return vec![];
        };
        if self.writer.is_none() {
            return vec![];
        }
        let connected = Event::Connected {
            info: info.clone(),
            docked: self.watchdog.docked(),
        };
        vec![Event::Battery(power.into()), connected]
    }

    async fn report(&mut self, report: Report) -> Option<String> {
        let lost = self.take(Fact::Heard).await;
        match report {
            Report::Power(power) => return self.power(power).await.or(lost),
            Report::Engine(news) => return self.engine(news).await.or(lost),
            Report::Video(jpeg) => self.frame(jpeg),
            Report::Audio(samples) => self.seats.tell_audience(&Event::Audio(samples)),
            Report::SoundFinished => self.seats.tell_all(&Event::SoundFinished),
            Report::Unknown(packet) => self.unknown(packet.kind),
            Report::Accepted(_) | Report::Refused(_) => debug!("a login's answer out of turn"),
            Report::Config(_) | Report::Networks(_) | Report::Log(_) => {}
        }
        lost
    }

    // A behaviour hears of a fact before it hears what came of it: an answer to a waiting call must
    // not overtake the news that brought it about. Telling never waits, so nothing is delayed.

    async fn power(&mut self, power: Power) -> Option<String> {
        let before = self.battery.replace(power);
        if before != Some(power) {
            self.seats.tell_all(&Event::Battery(power.into()));
        }
        if before.map(|power| power.charging) != Some(power.charging) {
            self.seats.tell_all(&Event::Charging { on: power.charging });
        }
        self.take(Fact::Power(power)).await
    }

    async fn engine(&mut self, news: EngineNews) -> Option<String> {
        let event = match news {
            EngineNews::Docked => Event::Docked,
            EngineNews::Undocked => Event::Undocked,
            EngineNews::Charged => Event::Charged,
            EngineNews::BaseNotFound => Event::BaseNotFound,
            EngineNews::Unknown(code) => Event::Engine { code },
        };
        info!("the robot says: {}", words(news));
        self.seats.tell_all(&event);
        self.take(Fact::Engine(news)).await
    }

    fn frame(&mut self, jpeg: bytes::Bytes) {
        let at = Instant::now();
        self.frames.send_modify(|newest| {
            let seq = newest.as_ref().map_or(0, |frame| frame.seq) + 1;
            *newest = Some(Frame { seq, at, jpeg });
        });
        self.status.send_if_modified(|status| status.count_frame());
    }

    fn unknown(&mut self, kind: u8) {
        if !self.unknown_kinds.contains(&kind) {
            self.unknown_kinds.push(kind);
            info!(
                kind,
                "a message of a type or length that nobody knows; said once per type"
            );
        }
    }

    async fn serve(&mut self, request: Request) -> Option<String> {
        match request {
            Request::Join {
                by,
                priority,
                outbox,
            } => {
                self.seats.join(by, priority, outbox, &self.welcome());
                None
            }
            Request::Intent(by, intent) => match self.seats.priority(by) {
                Some(priority) => self.intent(by, priority, intent).await,
                None => None,
            },
            Request::Alive(by) => self.take(Fact::Alive(by)).await,
            Request::Gone(by) => {
                self.seats.leave(by);
                let lost = self.take(Fact::Gone(by)).await;
                self.apply_streams(false).await.or(lost)
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
                return self.ask(by, priority, Ask::Release(motion)).await;
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
            Intent::Say(samples) => Command::Audio(samples.into()),
        };
        if !self.lights.is_news(&command) || !self.seats.admits(by, &command, Instant::now()) {
            return None;
        }
        self.lights.note(&command);
        self.write(&[command]).await
    }

    async fn ask(&mut self, by: BehaviourId, priority: Priority, ask: Ask) -> Option<String> {
        self.take(Fact::Asked { by, priority, ask }).await
    }

    /// The streams of a behaviour that switched them too often are switched after a while.
    async fn catch_up_streams(&mut self) -> Option<String> {
        self.streams_due.take_if(|at| *at <= Instant::now())?;
        self.apply_streams(false).await
    }

    /// Switches the streams that the behaviours want; `anew` after a login, which forgets them.
    async fn apply_streams(&mut self, anew: bool) -> Option<String> {
        let commands = self.seats.stream_changes(anew);
        if commands.is_empty() || self.writer.is_none() {
            return None;
        }
        let listening = self.seats.wants(Stream::Video) || self.seats.wants(Stream::AudioIn);
        let lost = self.take(Fact::Listening(listening)).await;
        self.write(&commands).await.or(lost)
    }

    async fn take(&mut self, fact: Fact) -> Option<String> {
        let acts = self.watchdog.take(fact, Instant::now());
        self.perform(acts).await
    }

    /// Does what the watchdog wants: first all commands in one write, then the rest.
    async fn perform(&mut self, acts: Vec<Act>) -> Option<String> {
        let commands: Vec<Command> = acts.iter().filter_map(Act::command).collect();
        let mut lost = match commands.is_empty() {
            true => None,
            false => self.write(&commands).await,
        };
        for act in acts {
            match act {
                Act::Send(_) => {}
                Act::Tell(by, event) => self.seats.tell(by, event),
                Act::Announce(event) => {
                    if let Event::Safety { action, reason } = &event {
                        warn!(%action, "watchdog: {reason}");
                    }
                    self.seats.tell_all(&event);
                }
                Act::Kill(by, reason) => self.seats.kill(by, reason),
                Act::Reconnect(reason) => lost = lost.or(Some(reason)),
            }
        }
        lost
    }

    /// Without a link nothing is kept for later: the robot's next login begins with a stop.
    async fn write(&mut self, commands: &[Command]) -> Option<String> {
        let writer = self.writer.as_mut()?;
        writer
            .write(commands)
            .await
            .err()
            .map(|error| error.to_string())
    }

    /// The link is gone: a last stop is tried without waiting, by the writer's drop.
    async fn lose(&mut self, reason: String) {
        if self.writer.take().is_none() {
            return;
        }
        warn!("disconnected: {reason}; connecting anew");
        let acts = self.watchdog.take(Fact::LinkDown, Instant::now());
        self.perform(acts).await;
        self.seats.tell_all(&Event::Disconnected { reason });
    }

    fn publish(&self) {
        let link = match (&self.writer, &self.info) {
            (Some(_), _) => LinkState::Up,
            (None, Some(_)) => LinkState::Lost,
            (None, None) => LinkState::Connecting,
        };
        let (safety, battery) = (self.watchdog.state(), self.battery.map(Into::into));
        let low = self.watchdog.low().is_some();
        self.status
            .send_if_modified(|status| status.update(link, safety, battery, low));
    }

    /// Streams off, everything flushed, then closed. The stop was written when the run parted.
    async fn close(mut self) {
        let parting = self.take(Fact::Parting).await;
        let off = self.seats.streams_off();
        if !off.is_empty() && parting.is_none() {
            self.write(&off).await;
        }
        if let Some(writer) = self.writer.take() {
            writer.close().await;
        }
    }
}

fn words(news: EngineNews) -> String {
    match news {
        EngineNews::Docked => "on the station".to_owned(),
        EngineNews::Undocked => "off the station".to_owned(),
        EngineNews::Charged => "the battery is full".to_owned(),
        EngineNews::BaseNotFound => "station not found".to_owned(),
        EngineNews::Unknown(code) => format!("ENGINE {code}, which nobody knows"),
    }
}

async fn until(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}
