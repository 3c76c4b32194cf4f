//! What all viewers of a run share: what they are shown, made once for all, and who drives.

use std::future::Future;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use axum::extract::ws::Utf8Bytes;
use serde::Serialize;
use tokio::sync::{broadcast, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::camera::Camera;
use super::history::History;
use super::log::Book;
use super::messages::{Found, ToPage};
use super::metrics::Metrics;
use super::scripts::{self, Script};
use super::state::{self, People, Person, Rate};
use super::wheel::{self, Wish};
use super::world;
use crate::agent::SeatError;
use crate::control::Run;
use crate::http::{Role, Visitor};
use crate::robot::{Findings, Heard, Listener, Occurrence, RobotInfo, Setpoint};
use crate::sim;

/// How often is looked whether anything is new.
const LOOK: Duration = Duration::from_millis(100);
/// How often the behaviours are told anew, for the time that they have been running.
const BEHAVIOURS: Duration = Duration::from_secs(1);
/// How often the pilot is asked whether it lives.
const PULSE: Duration = Duration::from_secs(1);
/// Findings that a viewer may be behind.
const FOUND: usize = 32;

/// See the module.
pub(super) struct Hub {
    pub(super) run: Run,
    pub(super) sim: Option<sim::Handle>,
    pub(super) scripts: watch::Receiver<Vec<Script>>,
    pub(super) camera: Camera,
    pub(super) book: Book,
    pub(super) metrics: Metrics,
    pub(super) found: broadcast::Sender<Utf8Bytes>,
    /// The newest messages, for all viewers.
    pub(super) state: watch::Sender<Utf8Bytes>,
    pub(super) map: watch::Sender<Utf8Bytes>,
    pub(super) behaviours: watch::Sender<Utf8Bytes>,
    pub(super) history: Mutex<History>,
    people: Mutex<Folk>,
    robot: watch::Sender<Option<RobotInfo>>,
    /// The pilot answers.
    alive: AtomicBool,
    most_viewers: usize,
    /// STOP holds: its seat is kept until this is false.
    held: watch::Sender<bool>,
}

/// Who looks, and who has the wheel.
#[derive(Debug, Default)]
struct Folk {
    viewers: usize,
    driver: Option<(Person, watch::Sender<Wish>)>,
}

/// Counts the viewers of this program.
static NUMBER: AtomicU32 = AtomicU32::new(1);

/// One who looks, until it is dropped: then he has not the wheel any more.
pub(super) struct Ticket {
    hub: Arc<Hub>,
    pub(super) id: u32,
    pub(super) role: Role,
    name: Mutex<String>,
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.leave_wheel();
        self.hub.folk().viewers -= 1;
    }
}

/// Why the wheel is not had.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum NoWheel {
    /// Viewers do not drive.
    Viewer,
    /// STOP holds.
    Halted,
    /// He has it.
    Taken(String),
}

impl Hub {
    pub(super) fn new(
        run: Run,
        sim: Option<sim::Handle>,
        scripts: watch::Receiver<Vec<Script>>,
        most_viewers: u16,
    ) -> Arc<Hub> {
        let empty = || watch::Sender::new(Utf8Bytes::default());
        let metrics = Metrics::new(run.reactions.clone());
        Arc::new(Hub {
            run,
            sim,
            scripts,
            camera: Camera::new(),
            book: Book::new(),
            metrics,
            found: broadcast::Sender::new(FOUND),
            state: empty(),
            map: empty(),
            behaviours: empty(),
            history: Mutex::default(),
            people: Mutex::default(),
            robot: watch::Sender::new(None),
            alive: AtomicBool::new(true),
            most_viewers: usize::from(most_viewers),
            held: watch::Sender::new(false),
        })
    }

    /// For as long as it takes to look something up.
    fn folk(&self) -> MutexGuard<'_, Folk> {
        self.people.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One more looks; `None`: there are too many.
    pub(super) fn admit(self: &Arc<Hub>, visitor: &Visitor) -> Option<Ticket> {
        let mut folk = self.folk();
        if folk.viewers >= self.most_viewers {
            return None;
        }
        folk.viewers += 1;
        let id = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = visitor.token.clone().unwrap_or_else(|| format!("#{id}"));
        Some(Ticket {
            hub: self.clone(),
            id,
            role: visitor.role,
            name: Mutex::new(name),
        })
    }

    pub(super) fn viewers(&self) -> usize {
        self.folk().viewers
    }

    pub(super) fn robot(&self) -> Option<RobotInfo> {
        self.robot.borrow().clone()
    }

    /// STOP: first the robot, at once; then whoever drives by hand, and all behaviours.
    ///
    /// # Errors
    /// The run is over.
    pub(super) async fn stop(&self) -> Result<(), SeatError> {
        let halted = self.run.hold(true).await;
        self.folk().driver = None;
        if !self.held.send_replace(true) {
            tokio::spawn(wheel::hold(self.run.clone(), self.held.subscribe()));
        }
        halted
    }

    /// The robot may move again.
    ///
    /// # Errors
    /// The run is over.
    pub(super) async fn let_go(&self) -> Result<(), SeatError> {
        self.held.send_replace(false);
        self.run.hold(false).await
    }

    /// Whether the pilot answers. It is asked once a second, however often this is.
    pub(super) fn is_alive(&self) -> bool {
        self.alive.load(Ordering::Relaxed)
    }

    async fn feel_pulse(&self) {
        let mut beat = interval(PULSE);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            beat.tick().await;
            let alive = self.run.aboard().await.is_some();
            self.alive.store(alive, Ordering::Relaxed);
        }
    }

    fn is_halted(&self) -> bool {
        *self.held.borrow() || self.run.status.borrow().halted
    }

    /// Serves what is shared for as long as the run is on.
    pub(super) async fn serve(self: Arc<Hub>, bus: Listener) {
        let (camera, found) = (self.camera.serve(&self.run), self.pass_on_found());
        let pulse = self.feel_pulse();
        tokio::join!(
            camera,
            found,
            pulse,
            self.listen(bus),
            self.look(),
            self.tell()
        );
    }

    async fn pass_on_found(&self) {
        let mut findings = self.run.roster.findings();
        loop {
            match findings.recv().await {
                Ok(Findings {
                    behaviour,
                    frame,
                    list,
                }) => {
                    let marks = list.into_iter().map(Found::from).collect();
                    // Fails if nobody looks.
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

    /// Hears what happens.
    async fn listen(&self, mut bus: Listener) {
        if let Some(crew) = self.run.aboard().await {
            self.robot.send_if_modified(|robot| {
                robot.is_none() && {
                    *robot = crew.robot;
                    true
                }
            });
        }
        loop {
            match bus.next().await {
                Heard::Happening(happening) => {
                    self.metrics.count(&happening.what);
                    if let Occurrence::LinkUp { robot, .. } = &happening.what {
                        self.robot.send_replace(Some(robot.clone()));
                    }
                }
                Heard::Missed(missed) => tracing::debug!("the page has missed {missed} happenings"),
                Heard::Closed => return,
            }
        }
    }

    /// Makes the messages that all viewers are sent, whenever something is new.
    async fn look(&self) {
        let mut rate = Rate::new(Instant::now());
        let mut beat = interval(LOOK);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            beat.tick().await;
            let robot = self.robot();
            let state = state::state(&self.run, robot.as_ref(), self.people(), &mut rate);
            if let Some(battery) = self.run.status.borrow().battery {
                let mut history = self.history.lock().unwrap_or_else(PoisonError::into_inner);
                history.note(battery, Instant::now());
            }
            publish(&self.state, &ToPage::State(&state));
            if let Some(sim) = self.sim.as_ref().filter(|_| self.map.receiver_count() > 0) {
                publish(&self.map, &ToPage::Map(&world::map(sim)));
            }
        }
    }

    async fn tell(&self) {
        let mut members = self.run.roster.members();
        let mut beat = interval(BEHAVIOURS);
        beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            let over = tokio::select! {
                _ = beat.tick() => false,
                changed = members.changed() => changed.is_err(),
            };
            let list = scripts::behaviours(&self.scripts.borrow(), &members.borrow_and_update());
            publish(&self.behaviours, &ToPage::Behaviours { list });
            if over {
                return;
            }
        }
    }

    pub(super) fn people(&self) -> People {
        let folk = self.folk();
        let driver = folk.driver.as_ref().map(|(person, _)| person.clone());
        People {
            driver,
            viewers: folk.viewers,
        }
    }
}

impl Ticket {
    pub(super) fn hub(&self) -> &Arc<Hub> {
        &self.hub
    }

    /// What the others call him.
    pub(super) fn rename(&self, name: &str) {
        let name = crate::clean::line(name)
            .chars()
            .take(24)
            .collect::<String>();
        if !name.trim().is_empty() {
            *self.name() = name.trim().to_owned();
        }
    }

    fn name(&self) -> MutexGuard<'_, String> {
        self.name.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn person(&self) -> Person {
        Person {
            id: self.id,
            name: self.name().clone(),
        }
    }

    /// Takes the wheel: the task to be run that drives from now on.
    ///
    /// # Errors
    /// See [`NoWheel`].
    pub(super) fn take_wheel(
        &self,
    ) -> Result<Option<impl Future<Output = ()> + Send + use<>>, NoWheel> {
        if self.role != Role::Driver {
            return Err(NoWheel::Viewer);
        }
        if self.hub.is_halted() {
            return Err(NoWheel::Halted);
        }
        let mut folk = self.hub.folk();
        match &folk.driver {
            Some((person, _)) if person.id == self.id => return Ok(None),
            Some((person, _)) => return Err(NoWheel::Taken(person.name.clone())),
            None => {}
        }
        let person = self.person();
        let (wishes, wished) = watch::channel((Setpoint::STOP, Instant::now()));
        let name = person.name.clone();
        folk.driver = Some((person, wishes));
        Ok(Some(wheel::drive(self.hub.run.clone(), name, wished)))
    }

    /// He drives so from now on, for a moment; whether he has the wheel.
    pub(super) fn wish(&self, setpoint: Setpoint) -> bool {
        let mut folk = self.hub.folk();
        let id = self.id;
        let Some((_, wishes)) = folk.driver.as_ref().filter(|(person, _)| person.id == id) else {
            return false;
        };
        let drives = wishes.send((setpoint, Instant::now())).is_ok();
        if !drives {
            // The seat has ended: the watchdog, or the run, has taken it away.
            folk.driver = None;
        }
        drives
    }

    pub(super) fn leave_wheel(&self) {
        let mut folk = self.hub.folk();
        if folk
            .driver
            .as_ref()
            .is_some_and(|(person, _)| person.id == self.id)
        {
            folk.driver = None;
        }
    }
}

/// As text; what cannot be written says nothing.
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
