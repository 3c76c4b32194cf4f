//! The state shared by all viewers of a run: the messages, which are built once for all viewers,
//! and the current driver.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::extract::ws::Utf8Bytes;
use serde::Serialize;
use tokio::sync::{Semaphore, broadcast, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::battery_history::BatteryHistory;
use super::camera::Camera;
use super::log::LogBuffer;
use super::manual_drive::{self, TimedSetpoint};
use super::messages::{Found, ToPage};
use super::metrics::Metrics;
use super::scripts::{self, Behaviour, RunDefinition};
use super::state::{self, People, Person, Rate};
use super::world::{self, SimulatedRobot};
use crate::agent::{BehaviourState, PilotClientError};
use crate::control::Run;
use crate::http::Access;
use crate::robot::{AgentEvent, BusMessage, Detections, Listener, RobotInfo};

/// Polling interval for changes.
const STATE_POLL: Duration = Duration::from_millis(100);
/// How often the behaviours are sent, to update their running times.
const BEHAVIOURS: Duration = Duration::from_secs(1);
/// How often the pilot is checked for a response.
const PILOT_CHECK: Duration = Duration::from_secs(1);
/// Maximum number of threads that read the disk for viewers.
const READERS: usize = 2;
/// Number of detections that a viewer may lag behind.
const FOUND: usize = 32;

pub(super) struct Broadcast {
    pub(super) run: Run,
    pub(super) sim: Option<SimulatedRobot>,
    pub(super) definition: watch::Receiver<RunDefinition>,
    pub(super) data: PathBuf,
    pub(super) access: Arc<Access>,
    /// Limits the number of concurrent disk reads.
    pub(super) reading: Semaphore,
    pub(super) camera: Camera,
    pub(super) log_buffer: LogBuffer,
    pub(super) metrics: Metrics,
    pub(super) found: broadcast::Sender<Utf8Bytes>,
    /// The newest messages, for all viewers.
    pub(super) state: watch::Sender<Utf8Bytes>,
    pub(super) map: watch::Sender<Utf8Bytes>,
    pub(super) behaviours: watch::Sender<Utf8Bytes>,
    pub(super) history: Mutex<BatteryHistory>,
    viewers: Mutex<ViewerList>,
    robot: watch::Sender<Option<RobotInfo>>,
    /// Whether the pilot responds.
    alive: AtomicBool,
    pub(super) most_viewers: usize,
}

/// The number of viewers, and the viewer that has the drive lock.
#[derive(Debug, Default)]
pub(super) struct ViewerList {
    pub(super) count: usize,
    pub(super) driver: Option<(Person, watch::Sender<TimedSetpoint>)>,
}

impl Broadcast {
    pub(super) fn new(
        run: Run,
        sim: Option<SimulatedRobot>,
        definition: watch::Receiver<RunDefinition>,
        data: PathBuf,
        access: Arc<Access>,
        most_viewers: u16,
    ) -> Arc<Broadcast> {
        let empty = || watch::Sender::new(Utf8Bytes::default());
        let metrics = Metrics::new(run.reactions.clone());
        Arc::new(Broadcast {
            run,
            sim,
            definition,
            data,
            access,
            reading: Semaphore::new(READERS),
            camera: Camera::new(),
            log_buffer: LogBuffer::new(),
            metrics,
            found: broadcast::Sender::new(FOUND),
            state: empty(),
            map: empty(),
            behaviours: empty(),
            history: Mutex::default(),
            viewers: Mutex::default(),
            robot: watch::Sender::new(None),
            alive: AtomicBool::new(true),
            most_viewers: usize::from(most_viewers),
        })
    }

    /// Locks the viewers; only for short lookups.
    pub(super) fn lock_viewers(&self) -> MutexGuard<'_, ViewerList> {
        self.viewers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn viewer_count(&self) -> usize {
        self.lock_viewers().count
    }

    pub(super) fn robot(&self) -> Option<RobotInfo> {
        self.robot.borrow().clone()
    }

    /// Executes STOP: stops the robot at once, takes the drive lock from the viewer that drives,
    /// and holds the tracks against all behaviours.
    ///
    /// # Errors
    /// If the run has ended.
    pub(super) async fn stop(&self) -> Result<(), PilotClientError> {
        let sent = self.run.set_emergency_stop(true).await;
        self.lock_viewers().driver = None;
        sent
    }

    /// Releases STOP: the robot may move again.
    ///
    /// # Errors
    /// If the run has ended.
    pub(super) async fn release_stop(&self) -> Result<(), PilotClientError> {
        self.run.set_emergency_stop(false).await
    }

    /// Holds the tracks whenever STOP holds, also one of an earlier program.
    async fn hold_tracks(&self) {
        let mut stopped = self.run.emergency_stop.watch();
        while stopped.wait_for(|stopped| *stopped).await.is_ok() {
            manual_drive::hold_tracks(self.run.clone(), stopped.clone()).await;
            // It may have ended early, with the run.
            let _ = stopped.wait_for(|stopped| !stopped).await;
        }
    }

    /// Whether the pilot responds. It is checked once a second, however often this is called.
    pub(super) fn is_alive(&self) -> bool {
        self.alive.load(Ordering::Relaxed)
    }

    async fn check_pilot(&self) {
        let mut ticker = interval(PILOT_CHECK);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            ticker.tick().await;
            let alive = self.run.running_behaviours().await.is_some();
            self.alive.store(alive, Ordering::Relaxed);
        }
    }

    /// Returns the time of the run's clock, which may be simulated.
    pub(super) fn now(&self) -> Instant {
        let sim_clock = self.sim.as_ref().and_then(|sim| sim.sim_clock.as_ref());
        sim_clock.map_or_else(Instant::now, |sim_clock| self.run.began + sim_clock.now())
    }

    /// Serves the shared parts until the run has ended.
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
                Ok(Detections {
                    behaviour,
                    frame,
                    list,
                }) => {
                    let marks = list.into_iter().map(Found::from).collect();
                    // Fails without viewers.
                    let _ = self.found.send(text(&ToPage::Found {
                        behaviour,
                        frame,
                        marks,
                    }));
                }
                Err(broadcast::error::RecvError::Lagged(_)) => {}
                Err(broadcast::error::RecvError::Closed) => return,
            }
        }
    }

    /// Handles the events of the bus.
    async fn listen(&self, mut bus: Listener) {
        if let Some(running) = self.run.running_behaviours().await {
            self.robot.send_if_modified(|robot| {
                robot.is_none() && {
                    *robot = running.robot;
                    true
                }
            });
        }
        loop {
            match bus.next().await {
                BusMessage::Event(event) => {
                    self.metrics.count(&event.what);
                    if let AgentEvent::LinkUp { robot, .. } = &event.what {
                        self.robot.send_replace(Some(robot.clone()));
                    }
                }
                BusMessage::Missed(missed) => {
                    tracing::debug!("the page has missed {missed} events")
                }
                BusMessage::Closed => return,
            }
        }
    }

    /// Builds the messages for all viewers whenever something has changed.
    async fn publish_state(&self) {
        let mut rate = Rate::new(self.now());
        let mut ticker = interval(STATE_POLL);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            ticker.tick().await;
            let robot = self.robot();
            let now = self.now();
            let state = state::state(&self.run, robot.as_ref(), self.people(), &mut rate, now);
            if let Some(battery) = self.run.status.borrow().battery {
                let mut history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
                history.record(battery, now);
            }
            publish(&self.state, &ToPage::State(&state));
            if let Some(sim) = self.sim.as_ref().filter(|_| self.map.receiver_count() > 0) {
                publish(&self.map, &ToPage::Map(&world::map(sim)));
            }
        }
    }

    async fn publish_behaviours(&self) {
        let mut statuses = self.run.roster.statuses();
        let mut params = self.run.roster.params();
        let mut ticker = interval(BEHAVIOURS);
        ticker.set_missed_tick_behavior(MissedTickBehavior::Delay);
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

    /// Returns the current state of all behaviours.
    pub(super) fn list(&self) -> Vec<Behaviour> {
        let statuses = self.run.roster.statuses();
        let params = self.run.roster.params();
        let definition = self.definition.borrow();
        let statuses = statuses.borrow();
        let params = params.borrow();
        scripts::behaviours(&definition.scripts, &statuses, &params, self.now())
    }

    /// Returns the names of the behaviours that run.
    pub(super) fn running_behaviours(&self) -> Vec<String> {
        let receiver = self.run.roster.statuses();
        let statuses = receiver.borrow();
        let running = statuses.iter().filter(|behaviour_status| {
            matches!(behaviour_status.state, BehaviourState::Running { .. })
        });
        running
            .map(|behaviour_status| behaviour_status.name.clone())
            .collect()
    }

    pub(super) fn people(&self) -> People {
        let viewers = self.lock_viewers();
        let driver = viewers.driver.as_ref().map(|(person, _)| person.clone());
        People {
            driver,
            viewers: viewers.count,
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
