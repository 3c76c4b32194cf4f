//! One open page: one task reads its messages and handles them at once; another sends it what it
//! shows.
//!
//! A slow viewer gets fewer frames, since the next is sent only when an earlier one was taken; of
//! other messages it gets the newest when there is room. If a message cannot be sent within
//! [`SEND_TIMEOUT`], or the page is silent for [`SILENCE_TIMEOUT`], the connection is closed.

use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, close_code};
use bytes::{BufMut as _, Bytes, BytesMut};
use futures_util::stream::SplitSink;
use futures_util::{SinkExt as _, StreamExt as _};
use serde_json::Value;
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, sleep, timeout};
use tokio_util::task::AbortOnDropHandle;

use super::broadcast::{Broadcast, text};
use super::log::Line;
use super::messages::{FromPage, ToPage, Watch};
use super::viewer::Viewer;
use super::world;
use crate::clock::every;
use crate::control::RunRequest;
use crate::http::Role;
use crate::rate_limit::TokenBucket;
use crate::robot::{Frame, Setpoint, Use};
use crate::wire::Stream;

/// Maximum length of a page's message, in bytes.
pub(super) const MAX_MESSAGE: usize = 16 * 1024;
const SEND_TIMEOUT: Duration = Duration::from_secs(10);
/// How long a page may be silent, without even a pong.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(10);
const PING: Duration = Duration::from_secs(2);
/// How often a page hears at least something, so that it knows that it is connected.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// Maximum number of a page's messages per second; an honest page sends twenty.
const MAX_MESSAGES: f64 = 200.0;
const MAX_COMMANDS: usize = 8;
/// Capacity of the queue of messages for this viewer only.
const MAX_WAITING: usize = 64;
/// Maximum number of frames sent and not yet taken.
const FRAMES: u32 = 2;
/// How long the last notice to a page has to leave.
const NOTICE_TIME: Duration = Duration::from_millis(200);
/// Maximum number of log lines in one message.
const MAX_LINES: usize = 100;

type Sink = SplitSink<WebSocket, Message>;

/// Serves a page until it is closed, or its token is revoked.
pub(super) async fn serve(socket: WebSocket, viewer: Viewer) {
    let (sink, mut stream) = socket.split();
    let (watch, watched) = watch::channel(Watch::default());
    let (taken, frames_taken) = watch::channel(0);
    let (messages, outgoing) = mpsc::channel(MAX_WAITING);
    let broadcast = viewer.broadcast.clone();
    let access = broadcast.access.clone();
    let visitor = viewer.visitor.clone();
    let mut revoked = pin!(access.revoked(&visitor));
    let writer = Writer {
        broadcast,
        watched,
        taken: frames_taken,
        outgoing,
        sent: 0,
        map: None,
        log: None,
        found: None,
    };
    let mut writing = AbortOnDropHandle::new(tokio::spawn(writer.run(sink, hello(&viewer))));
    let mut reader = Reader {
        viewer,
        watch,
        taken,
        messages,
        commands: Vec::new(),
        driving: None,
        rate: TokenBucket::new(MAX_MESSAGES, MAX_MESSAGES),
    };
    loop {
        let message = tokio::select! {
            biased;
            () = &mut revoked => return,
            () = reader.viewer.evicted.cancelled() => {
                reader.notice("evicted");
                sleep(NOTICE_TIME).await;
                return;
            }
            message = timeout(SILENCE_TIMEOUT, stream.next()) => message,
            _ = &mut writing => return,
        };
        let is_within_rate = reader.rate.take(1.0, Instant::now());
        match message {
            Ok(Some(Ok(Message::Text(text)))) if is_within_rate => reader.handle(&text).await,
            Ok(Some(Ok(Message::Ping(_) | Message::Pong(_)))) if is_within_rate => {}
            // Closed, broken, silent, too many messages, or binary.
            _ => return,
        }
    }
}

fn hello(viewer: &Viewer) -> Utf8Bytes {
    let run = &viewer.broadcast.run;
    text(&ToPage::Hello {
        version: env!("CARGO_PKG_VERSION"),
        you: viewer.id,
        role: viewer.visitor.role,
        world: run.sim.is_some(),
        camera: run.streams.usage(Stream::Video) != Use::Off,
    })
}

/// Handles the messages of a page. Dropping it releases the drive lock.
struct Reader {
    viewer: Viewer,
    watch: watch::Sender<Watch>,
    taken: watch::Sender<u32>,
    messages: mpsc::Sender<Utf8Bytes>,
    commands: Vec<AbortOnDropHandle<()>>,
    driving: Option<AbortOnDropHandle<()>>,
    rate: TokenBucket,
}

impl Reader {
    async fn handle(&mut self, text: &str) {
        let message = match serde_json::from_str(text) {
            Ok(message) => message,
            Err(error) => {
                tracing::debug!("a page sent an invalid message: {error}");
                let number = serde_json::from_str::<Value>(text).ok();
                let number = number.and_then(|message| message["id"].as_u64()?.try_into().ok());
                return match number {
                    Some(id) => self.answer(id, false, error.to_string()),
                    None => self.notice("nonsense"),
                };
            }
        };
        match message {
            FromPage::Watch(watch) => {
                self.watch.send_replace(watch);
            }
            FromPage::FrameShown => {
                self.taken
                    .send_modify(|taken| *taken = taken.wrapping_add(1));
            }
            FromPage::Name { name } => self.viewer.rename(&name),
            FromPage::Stop => self.stop_or_reset(RunRequest::Stop),
            FromPage::ResetStop if self.viewer.visitor.role == Role::Driver => {
                self.stop_or_reset(RunRequest::ResetStop);
            }
            FromPage::ResetStop => self.notice("viewer_only"),
            FromPage::DriveLock { take: true } => self.take_drive_lock(),
            FromPage::DriveLock { take: false } => self.release_drive_lock(),
            FromPage::Drive { left, right } => self.drive(left, right),
            FromPage::Command { id, command } => self.execute(id, command),
        }
    }

    /// STOP does not wait for other commands, and its answer is in the state.
    fn stop_or_reset(&self, request: RunRequest) {
        let by = self.viewer.visitor.describe("the page");
        let run = self.viewer.broadcast.run.clone();
        tokio::spawn(async move { run.perform(request, &by).await });
    }

    fn take_drive_lock(&mut self) {
        match self.viewer.take_drive_lock() {
            Ok(Some(driving)) => {
                self.driving = Some(AbortOnDropHandle::new(tokio::spawn(driving)));
            }
            Ok(None) => {}
            Err(notice) => self.send(&notice),
        }
    }

    fn release_drive_lock(&mut self) {
        self.viewer.release_drive_lock();
        self.driving = None;
    }

    /// Sets the page's setpoint. Has no effect if the page does not have the drive lock; invalid
    /// numbers mean stop.
    fn drive(&mut self, left: f64, right: f64) {
        let setpoint = Setpoint::from_percent(left, right).unwrap_or(Setpoint::STOP);
        if !self.viewer.set_setpoint(setpoint) {
            self.driving = None;
        }
    }

    fn execute(&mut self, id: u32, command: RunRequest) {
        self.commands.retain(|command| !command.is_finished());
        if let Err(refusal) = self.viewer.visitor.require(command.role()) {
            return self.answer(id, false, refusal.to_string());
        }
        if self.commands.len() >= MAX_COMMANDS {
            return self.answer(id, false, "too many commands at once".to_owned());
        }
        let by = self.viewer.visitor.describe("the page");
        let run = self.viewer.broadcast.run.clone();
        let messages = self.messages.clone();
        let doing = tokio::spawn(async move {
            let answer = run.perform(command, &by).await;
            let error = answer.error();
            let end = answer.dock_end().map(|end| end.name().to_owned());
            let _ = messages.try_send(text(&ToPage::Answer {
                id,
                ok: error.is_none(),
                text: error.or(end).unwrap_or_default(),
            }));
        });
        self.commands.push(AbortOnDropHandle::new(doing));
    }

    fn answer(&self, id: u32, ok: bool, text: String) {
        self.send(&ToPage::Answer { id, ok, text });
    }

    fn notice(&self, key: &'static str) {
        let name = String::new();
        self.send(&ToPage::Notice { key, name });
    }

    /// Sends a message to this page; dropped if the page does not read its messages.
    fn send(&self, message: &ToPage<'_>) {
        let _ = self.messages.try_send(text(message));
    }
}

struct Writer {
    broadcast: Arc<Broadcast>,
    watched: watch::Receiver<Watch>,
    taken: watch::Receiver<u32>,
    outgoing: mpsc::Receiver<Utf8Bytes>,
    sent: u32,
    map: Option<watch::Receiver<Utf8Bytes>>,
    log: Option<broadcast::Receiver<Line>>,
    found: Option<broadcast::Receiver<Utf8Bytes>>,
}

impl Writer {
    async fn run(mut self, mut sink: Sink, hello: Utf8Bytes) {
        if self.show(&mut sink, hello).await.is_none() {
            let frame = CloseFrame {
                code: close_code::POLICY,
                reason: "too slow".into(),
            };
            let _ = timeout(SEND_TIMEOUT, sink.send(Message::Close(Some(frame)))).await;
        }
    }

    async fn show(&mut self, sink: &mut Sink, hello: Utf8Bytes) -> Option<()> {
        send(sink, Message::Text(hello)).await?;
        send(sink, Message::Text(self.battery())).await?;
        let broadcast = self.broadcast.clone();
        let mut state = broadcast.state.subscribe();
        let mut behaviours = broadcast.behaviours.subscribe();
        state.mark_changed();
        behaviours.mark_changed();
        let mut frames = broadcast.camera.newest.subscribe();
        let mut camera = None;
        let mut ping = every(PING);
        let opened = Instant::now();
        let mut heartbeat = every(HEARTBEAT);
        loop {
            let watch = *self.watched.borrow();
            let ready = watch.camera && self.frames_under_way() < FRAMES;
            tokio::select! {
                Some(message) = self.outgoing.recv() => send(sink, Message::Text(message)).await?,
                changed = self.watched.changed() => {
                    changed.ok()?;
                    let watch = *self.watched.borrow_and_update();
                    if !watch.camera {
                        camera = None;
                    } else if camera.is_none() {
                        camera = Some(broadcast.camera.register());
                    }
                    self.update(watch, sink).await?;
                }
                changed = self.taken.changed() => changed.ok()?,
                _ = heartbeat.tick() => {
                    let milliseconds = opened.elapsed().as_millis() as u64;
                    send_text(sink, text(&ToPage::Heartbeat { milliseconds })).await?;
                }
                text = newest(Some(&mut state)) => send_text(sink, text).await?,
                text = newest(Some(&mut behaviours)) => send_text(sink, text).await?,
                Ok(()) = frames.changed(), if ready => {
                    let frame = frames.borrow_and_update().clone();
                    if let Some(frame) = frame {
                        self.sent = self.sent.wrapping_add(1);
                        send(sink, Message::Binary(packed(&frame, broadcast.now()))).await?;
                    }
                }
                text = newest(self.map.as_mut()) => send_text(sink, text).await?,
                lines = lines(&mut self.log) => send_text(sink, lines).await?,
                found = next_found(&mut self.found) => send_text(sink, found).await?,
                _ = ping.tick() => send(sink, Message::Ping(Bytes::new())).await?,
            }
        }
    }

    fn frames_under_way(&self) -> u32 {
        let under_way = self.sent.wrapping_sub(*self.taken.borrow());
        // A page that reports more frames taken than were sent gets no advantage.
        if under_way > u32::MAX / 2 {
            0
        } else {
            under_way
        }
    }

    fn battery(&self) -> Utf8Bytes {
        let history = self.broadcast.history.lock();
        text(&ToPage::Battery {
            points: history.points(self.broadcast.now()),
        })
    }

    async fn update(&mut self, watch: Watch, sink: &mut Sink) -> Option<()> {
        match (&self.broadcast.run.sim, watch.map) {
            (Some(sim), true) if self.map.is_none() => {
                send_text(sink, text(&ToPage::World(&world::world_plan(&sim.robot)))).await?;
                let mut map = self.broadcast.map.subscribe();
                // While the clock stands, there is no other.
                if !map.borrow().is_empty() {
                    map.mark_changed();
                }
                self.map = Some(map);
            }
            (_, false) => self.map = None,
            _ => {}
        }
        if !watch.log {
            self.log = None;
        } else if self.log.is_none() {
            let (lines, news) = self.broadcast.log_buffer.read();
            send_text(sink, text(&ToPage::Log { lines, missed: 0 })).await?;
            self.log = Some(news);
        }
        if !watch.found {
            self.found = None;
        } else if self.found.is_none() {
            self.found = Some(self.broadcast.found.subscribe());
        }
        Some(())
    }
}

/// Packs a frame: number, age, and the JPEG as received.
fn packed(frame: &Frame, now: Instant) -> Bytes {
    let age = now.saturating_duration_since(frame.at).as_millis();
    let mut packed = BytesMut::with_capacity(8 + frame.jpeg.len());
    packed.put_u32(frame.seq as u32);
    packed.put_u32(u32::try_from(age).unwrap_or(u32::MAX));
    packed.put_slice(&frame.jpeg);
    packed.freeze()
}

/// The newest text, when it has changed; never without a sender. Cancel-safe.
async fn newest(texts: Option<&mut watch::Receiver<Utf8Bytes>>) -> Utf8Bytes {
    if let Some(texts) = texts
        && texts.changed().await.is_ok()
    {
        return texts.borrow_and_update().clone();
    }
    std::future::pending().await
}

async fn next_found(found: &mut Option<broadcast::Receiver<Utf8Bytes>>) -> Utf8Bytes {
    loop {
        match found {
            Some(news) => match news.recv().await {
                Ok(text) => return text,
                Err(broadcast::error::RecvError::Lagged(_)) => {}
                Err(broadcast::error::RecvError::Closed) => *found = None,
            },
            None => std::future::pending().await,
        }
    }
}

/// Waits for log lines and returns all waiting ones in one message.
async fn lines(log: &mut Option<broadcast::Receiver<Line>>) -> Utf8Bytes {
    let Some(news) = log else {
        return std::future::pending().await;
    };
    let mut lines = Vec::new();
    let mut missed = 0;
    match news.recv().await {
        Ok(line) => lines.push(line),
        Err(broadcast::error::RecvError::Lagged(count)) => missed += count,
        Err(broadcast::error::RecvError::Closed) => return std::future::pending().await,
    }
    while lines.len() < MAX_LINES {
        match news.try_recv() {
            Ok(line) => lines.push(line),
            Err(broadcast::error::TryRecvError::Lagged(count)) => missed += count,
            Err(_) => break,
        }
    }
    text(&ToPage::Log { lines, missed })
}

async fn send_text(sink: &mut Sink, text: Utf8Bytes) -> Option<()> {
    if text.is_empty() {
        Some(())
    } else {
        send(sink, Message::Text(text)).await
    }
}

/// Sends a message; `None` if the page is gone or too slow.
async fn send(sink: &mut Sink, message: Message) -> Option<()> {
    timeout(SEND_TIMEOUT, sink.send(message)).await.ok()?.ok()
}
