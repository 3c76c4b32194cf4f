//! The state shared by all viewers of a run: the messages, which are built once for all viewers,
//! and the current driver.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

use axum::extract::ws::Utf8Bytes;
use parking_lot::{Mutex, MutexGuard};
use schemars::JsonSchema;
use serde::Serialize;
use tokio::sync::{Semaphore, broadcast, watch};
use tokio::time::{Instant, sleep, timeout};

use super::log::LogBuffer;
use super::messages::ToPage;
use super::metrics::Metrics;
use super::scripts::{Behaviour, RunDefinition};
use super::viewer::{OpenPage, TimedSetpoint, hold_tracks};
use super::{scripts, world};
use crate::agent::{BehaviourStatus, PilotClientError};
use crate::clock::every;
use crate::control::{Run, RunStatus};
use crate::http::Access;
use crate::robot::channel::{RunningBehaviour, RunningBehaviours};
use crate::robot::{AgentEvent, Battery, BusMessage, Frame, Intent, Listener, Percent, RobotInfo};
use crate::vision::validate_markers;
use crate::wire::Stream;

const STATE_POLL: Duration = Duration::from_millis(100);
/// How often the behaviours are sent, to update their running times.
const BEHAVIOURS: Duration = Duration::from_secs(1);
/// How often the pilot is checked for a response.
const PILOT_CHECK: Duration = Duration::from_secs(1);
/// Maximum number of threads that read the disk for viewers.
const READERS: usize = 2;
/// Number of detections that a viewer may lag behind.
const FOUND: usize = 32;

/// Period over which frames are counted.
const RATE: Duration = Duration::from_secs(1);

/// The state of the run and of its viewers.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct State {
    /// The state of the run.
    #[serde(flatten)]
    pub run: RunStatus,
    /// Frames per second.
    pub fps: u32,
    /// The viewer that drives by hand.
    pub driver: Option<Person>,
    /// The number of viewers.
    pub viewers: usize,
}

/// A viewer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Person {
    /// The viewer's number.
    pub id: u32,
    /// The viewer's name.
    pub name: String,
}

/// Counts frames per second.
#[derive(Debug)]
pub struct FrameRate {
    since: Instant,
    frames: u64,
    rate: u32,
}

impl FrameRate {
    pub fn new(now: Instant) -> FrameRate {
        FrameRate {
            since: now,
            frames: 0,
            rate: 0,
        }
    }

    /// The rate, given the number of frames so far.
    pub fn count(&mut self, frames: u64, now: Instant) -> u32 {
        let passed = now.saturating_duration_since(self.since);
        if passed >= RATE {
            let new = frames.saturating_sub(self.frames);
            self.rate = (new as f64 / passed.as_secs_f64()).round() as u32;
            self.since = now;
            self.frames = frames;
        }
        self.rate
    }
}

pub(super) struct Broadcast {
    pub(super) run: Run,
    pub(super) definition: watch::Receiver<RunDefinition>,
    pub(super) data: PathBuf,
    pub(super) access: Arc<Access>,
    /// Limits the number of concurrent disk reads.
    pub(super) reading: Semaphore,
    pub(super) camera: Arc<Camera>,
    pub(super) log_buffer: LogBuffer,
    pub(super) metrics: Metrics,
    pub(super) found: broadcast::Sender<Utf8Bytes>,
    pub(super) state: watch::Sender<Utf8Bytes>,
    pub(super) map: watch::Sender<Utf8Bytes>,
    pub(super) behaviours: watch::Sender<Utf8Bytes>,
    pub(super) history: Mutex<BatteryHistory>,
    viewers: Mutex<ViewerList>,
    robot: watch::Sender<Option<RobotInfo>>,
    alive: AtomicBool,
}

#[derive(Debug, Default)]
pub(super) struct ViewerList {
    /// Those that have come first come first.
    pub(super) open: Vec<OpenPage>,
    pub(super) driver: Option<(Person, watch::Sender<TimedSetpoint>)>,
}

impl Broadcast {
    pub(super) fn new(
        run: Run,
        definition: watch::Receiver<RunDefinition>,
        data: PathBuf,
        access: Arc<Access>,
    ) -> Arc<Broadcast> {
        let empty = || watch::Sender::new(Utf8Bytes::default());
        Arc::new(Broadcast {
            run,
            definition,
            data,
            access,
            reading: Semaphore::new(READERS),
            camera: Arc::default(),
            log_buffer: LogBuffer::new(),
            metrics: Metrics::default(),
            found: broadcast::Sender::new(FOUND),
            state: empty(),
            map: empty(),
            behaviours: empty(),
            history: Mutex::default(),
            viewers: Mutex::default(),
            robot: watch::Sender::new(None),
            alive: AtomicBool::new(true),
        })
    }

    /// Locks the viewers; only for short lookups. A driver whose task has ended is gone.
    pub(super) fn lock_viewers(&self) -> MutexGuard<'_, ViewerList> {
        let mut viewers = self.viewers.lock();
        viewers
            .driver
            .take_if(|(_, setpoints)| setpoints.is_closed());
        viewers
    }

    /// Whenever STOP holds, also one of an earlier program, holds the tracks and takes the drive
    /// lock from the viewer that drives.
    async fn hold_tracks(&self) {
        let mut stopped = self.run.emergency_stop.watch();
        while stopped.wait_for(Option::is_some).await.is_ok() {
            self.lock_viewers().driver = None;
            hold_tracks(self.run.clone(), stopped.clone()).await;
            // It may have ended early, with the run.
            let _ = stopped.wait_for(Option::is_none).await;
        }
    }

    /// Whether the pilot responds. It is checked once a second, however often this is called.
    pub(super) fn is_alive(&self) -> bool {
        self.alive.load(Ordering::Relaxed)
    }

    async fn check_pilot(&self) {
        let mut ticker = every(PILOT_CHECK);
        loop {
            ticker.tick().await;
            let alive = self.run.running_behaviours().await.is_some();
            self.alive.store(alive, Ordering::Relaxed);
        }
    }

    pub(super) fn now(&self) -> Instant {
        let sim_clock = self.run.sim.as_ref().and_then(|sim| sim.sim_clock.as_ref());
        sim_clock.map_or_else(Instant::now, |sim_clock| self.run.began + sim_clock.now())
    }

    pub(super) async fn serve(self: Arc<Broadcast>, bus: Listener) {
        tokio::join!(
            self.camera.serve(&self.run),
            self.pass_on_found(),
            self.check_pilot(),
            self.hold_tracks(),
            self.listen(bus),
            self.publish_state(),
            self.publish_behaviours()
        );
    }

    async fn pass_on_found(&self) {
        let mut detections = self.run.roster.detections();
        loop {
            match detections.recv().await {
                Ok(found) => {
                    // Fails without viewers.
                    let _ = self.found.send(text(&ToPage::Found {
                        behaviour: found.behaviour,
                        frame: found.frame,
                        marks: found.list,
                    }));
                }
                Err(broadcast::error::RecvError::Lagged(_)) => {}
                Err(broadcast::error::RecvError::Closed) => return,
            }
        }
    }

    async fn listen(&self, mut bus: Listener) {
        if let Some(running) = self.run.running_behaviours().await {
            self.robot.send_if_modified(|robot| {
                robot.is_none() && {
                    *robot = running.robot;
                    true
                }
            });
        }
        while let Some(message) = bus.next().await {
            match message {
                BusMessage::Event(event) => {
                    self.metrics.count(&event.what);
                    if let AgentEvent::LinkUp { robot, .. } = &event.what {
                        self.robot.send_replace(Some(robot.clone()));
                    }
                }
                BusMessage::Missed(missed) => {
                    tracing::debug!("the page has missed {missed} events")
                }
            }
        }
    }

    async fn publish_state(&self) {
        let mut rate = FrameRate::new(self.now());
        let mut ticker = every(STATE_POLL);
        loop {
            ticker.tick().await;
            let now = self.now();
            let state = self.state(&mut rate, now);
            if let Some(battery) = self.run.status.borrow().battery {
                let mut history = self.history.lock();
                history.record(battery, now);
            }
            publish(&self.state, &ToPage::State(&state));
            if let Some(sim) = &self.run.sim
                && self.map.receiver_count() > 0
            {
                publish(&self.map, &ToPage::Map(&world::map(sim)));
            }
        }
    }

    async fn publish_behaviours(&self) {
        let mut statuses = self.run.roster.statuses();
        let mut params = self.run.roster.params();
        let mut ticker = every(BEHAVIOURS);
        loop {
            let over = tokio::select! {
                _ = ticker.tick() => false,
                Ok(()) = params.changed() => false,
                changed = statuses.changed() => changed.is_err(),
            };
            statuses.mark_unchanged();
            params.mark_unchanged();
            let list = self.list();
            publish(&self.behaviours, &ToPage::Behaviours { list });
            if over {
                return;
            }
        }
    }

    fn list(&self) -> Vec<Behaviour> {
        let statuses = self.run.roster.statuses();
        let params = self.run.roster.params();
        let definition = self.definition.borrow();
        let statuses = statuses.borrow();
        let params = params.borrow();
        let behaviour = |status: &BehaviourStatus| {
            let script = scripts::find(&definition.scripts, &status.name);
            let declared = params.get(&status.name).cloned().unwrap_or_default();
            Behaviour::new(script, status, declared, self.now())
        };
        statuses.iter().map(behaviour).collect()
    }

    pub(super) fn running_behaviours(&self) -> Vec<RunningBehaviour> {
        let statuses = self.run.roster.statuses();
        let statuses = statuses.borrow();
        let running = statuses.iter().filter(|one| one.state.is_running());
        let named = |one: &BehaviourStatus| RunningBehaviour {
            name: one.name.clone(),
            priority: one.priority,
        };
        running.map(named).collect()
    }

    fn state(&self, rate: &mut FrameRate, now: Instant) -> State {
        let running = RunningBehaviours {
            robot: self.robot.borrow().clone(),
            behaviours: self.running_behaviours(),
        };
        let frames = self.run.status.borrow().frames;
        let viewers = self.lock_viewers();
        State {
            run: self.run.run_status(running, now),
            fps: rate.count(frames, now),
            driver: viewers.driver.as_ref().map(|(person, _)| person.clone()),
            viewers: viewers.open.len(),
        }
    }
}

/// Serialises a message; empty if that fails.
pub(super) fn text(message: &impl Serialize) -> Utf8Bytes {
    serde_json::to_string(message).map_or_else(|_| Utf8Bytes::default(), Utf8Bytes::from)
}

fn publish(to: &watch::Sender<Utf8Bytes>, message: &ToPage<'_>) {
    let text = text(message);
    to.send_if_modified(|last| {
        *last != text && {
            *last = text;
            true
        }
    });
}

/// Maximum number of points; beyond that, every other point of the older half is deleted.
const MAX_POINTS: usize = 600;
/// Interval at which an unchanged level is recorded.
const EVERY: Duration = Duration::from_secs(30);

/// Battery levels for the plot, with their times: bounded in number, fewer of older ones.
#[derive(Debug, Default)]
pub(super) struct BatteryHistory(VecDeque<(Instant, Battery)>);

impl BatteryHistory {
    /// Records a level if it has changed or the last record is old. Returns whether it was
    /// recorded.
    pub(super) fn record(&mut self, battery: Battery, at: Instant) -> bool {
        let is_same = |(last_at, last): &(Instant, Battery)| {
            (last.percent, last.charging) == (battery.percent, battery.charging)
                && at.saturating_duration_since(*last_at) < EVERY
        };
        if self.0.back().is_some_and(is_same) {
            return false;
        }
        self.0.push_back((at, battery));
        if self.0.len() > MAX_POINTS {
            let mut index = 0;
            self.0.retain(|_| {
                index += 1;
                index > MAX_POINTS / 2 || index % 2 == 1
            });
        }
        true
    }

    /// Returns seconds before now, percent if it is known, charging; oldest first.
    pub(super) fn points(&self, now: Instant) -> Vec<(f32, Option<u8>, bool)> {
        let point = |(at, battery): &(Instant, Battery)| {
            let ago = now.saturating_duration_since(*at).as_secs_f32();
            (ago, battery.percent.map(Percent::get), battery.charging)
        };
        self.0.iter().map(point).collect()
    }
}

/// How long the stream stays on after the last viewer.
const LINGER: Duration = Duration::from_secs(2);

/// Delay of frames for viewers. Behaviours get a frame first: sending it to many viewers keeps a
/// small machine busy for longer than a behaviour needs to react.
const AFTER_BEHAVIOURS: Duration = Duration::from_millis(5);

/// One client of the pilot requests the stream while there are viewers; each viewer takes the
/// newest frame when ready.
#[derive(Debug, Default)]
pub(super) struct Camera {
    pub(super) newest: watch::Sender<Option<Frame>>,
    viewers: watch::Sender<usize>,
    /// Of all frames so far.
    pub(super) bytes: AtomicU64,
}

#[derive(Debug)]
pub(super) struct CameraViewer(Arc<Camera>);

impl Drop for CameraViewer {
    fn drop(&mut self) {
        self.0
            .viewers
            .send_modify(|viewers| *viewers = viewers.saturating_sub(1));
    }
}

impl Camera {
    pub(super) fn register(self: &Arc<Camera>) -> CameraViewer {
        self.viewers.send_modify(|viewers| *viewers += 1);
        CameraViewer(self.clone())
    }

    pub(super) async fn serve(&self, run: &Run) {
        tokio::join!(self.pass_on(run), self.request_stream(run));
    }

    async fn pass_on(&self, run: &Run) {
        let mut pictures = run.pictures.clone();
        let mut last = 0;
        while pictures.changed().await.is_ok() {
            sleep(AFTER_BEHAVIOURS).await;
            let newest = pictures.borrow_and_update().newest.clone();
            let sound = |frame: &Frame| validate_markers(&frame.jpeg).is_ok();
            if let Some(frame) = newest.filter(|frame| frame.seq != last && sound(frame)) {
                last = frame.seq;
                self.bytes
                    .fetch_add(frame.jpeg.len() as u64, Ordering::Relaxed);
                self.newest.send_replace(Some(frame));
            }
        }
    }

    /// Requests the stream while there are viewers, and for a while after.
    async fn request_stream(&self, run: &Run) {
        let mut viewers = self.viewers.subscribe();
        while viewers.wait_for(|viewers| *viewers > 0).await.is_ok() {
            let Err(error) = watch_on(run, &mut viewers).await else {
                continue;
            };
            tracing::debug!("the page cannot get the camera stream now: {error}");
            if run.requests.is_closed() {
                return;
            }
            sleep(LINGER).await;
        }
    }
}

async fn watch_on(run: &Run, viewers: &mut watch::Receiver<usize>) -> Result<(), PilotClientError> {
    let mut client = run.pilot_client("the page").await?;
    let stream = Stream::Video;
    let on = true;
    client.send_intent(Intent::Stream { stream, on }).await?;
    let gone = async {
        loop {
            let nobody = viewers.wait_for(|viewers| *viewers == 0).await.is_err();
            let back = timeout(LINGER, viewers.wait_for(|viewers| *viewers > 0)).await;
            if nobody || back.is_err() {
                return;
            }
        }
    };
    tokio::pin!(gone);
    loop {
        tokio::select! {
            () = &mut gone => return Ok(()),
            event = client.next_event() => drop(event?),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;

    fn battery(percent: u8) -> Battery {
        Battery {
            percent: Some(Percent::saturating(percent)),
            charging: false,
            minutes_left: None,
        }
    }

    #[test]
    fn a_month_fits_and_includes_the_newest_and_the_oldest() {
        let mut history = BatteryHistory::default();
        let start = Instant::now();
        for hour in 0..24 * 30 {
            let at = start + Duration::from_secs(3600) * hour;
            assert!(history.record(battery((hour % 100) as u8), at));
            assert!(!history.record(battery((hour % 100) as u8), at));
        }
        let points = history.points(start + Duration::from_secs(3600) * 24 * 30);
        assert!(points.len() <= MAX_POINTS, "{}", points.len());
        assert!(points[0].0 > points[1].0);
        assert_eq!(points.last().map(|last| last.0), Some(3600.0));
    }
}
