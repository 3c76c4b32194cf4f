//! One viewer: name, role, and the drive lock if the viewer has it.
//!
//! Driving by hand is a client of the pilot with a priority above all behaviours, for one person at
//! a time. The viewer that has the drive lock controls the tracks, which stand still without a
//! setpoint. A setpoint is valid for 0.3 s. The task that enforces this also sends the client's
//! signs of life, so that the watchdog stops the robot if the task fails: at once if the client
//! ends, after 0.25 s if it is silent.

use std::cmp::Reverse;
use std::future::Future;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use parking_lot::Mutex;
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::info;

use super::broadcast::{Broadcast, Person, ViewerList};
use super::messages::ToPage;
use crate::agent::PilotClientError;
use crate::clock::{every, until};
use crate::control::Run;
use crate::http::{MAX_VIEWERS, Role, Visitor};
use crate::robot::{Event, Intent, Setpoint};
use crate::simulation::TimeScale;

static NUMBER: AtomicU32 = AtomicU32::new(1);

/// A viewer, until dropped. Dropping it releases the drive lock.
pub(super) struct Viewer {
    pub(super) broadcast: Arc<Broadcast>,
    pub(super) id: u32,
    pub(super) visitor: Visitor,
    /// Cancelled when another viewer needs the place.
    pub(super) evicted: CancellationToken,
    name: Mutex<String>,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.release_drive_lock();
        let mut viewers = self.broadcast.lock_viewers();
        viewers.open.retain(|page| page.id != self.id);
    }
}

#[derive(Debug)]
pub(super) struct OpenPage {
    id: u32,
    visitor: Visitor,
    evicted: CancellationToken,
}

impl ViewerList {
    /// Returns the page that must make room for one of this visitor: a viewer's for a driver's;
    /// among equals, one of those who have more pages open. Never the one that drives.
    fn to_evict(&self, visitor: &Visitor) -> Option<usize> {
        let count = |one: &Visitor| self.open.iter().filter(|page| page.visitor == *one).count();
        let own = count(visitor);
        let driver = self.driver.as_ref().map(|(person, _)| person.id);
        let yields = |page: &OpenPage| {
            let role = page.visitor.role;
            let has_more = role == visitor.role && count(&page.visitor) > own + 1;
            driver != Some(page.id) && (role < visitor.role || has_more)
        };
        let pages = self.open.iter().enumerate();
        pages
            .filter(|(_, page)| yields(page))
            .max_by_key(|(index, page)| {
                (
                    Reverse(page.visitor.role),
                    count(&page.visitor),
                    Reverse(*index),
                )
            })
            .map(|(index, _)| index)
    }
}

impl Viewer {
    /// Admits a viewer; `None` if there are too many, and none must make room for this one.
    pub(super) fn admit(broadcast: &Arc<Broadcast>, visitor: Visitor) -> Option<Viewer> {
        let mut viewers = broadcast.lock_viewers();
        if viewers.open.len() >= MAX_VIEWERS {
            let index = viewers.to_evict(&visitor)?;
            viewers.open.remove(index).evicted.cancel();
        }
        let id = NUMBER.fetch_add(1, Ordering::Relaxed);
        let evicted = CancellationToken::new();
        viewers.open.push(OpenPage {
            id,
            visitor: visitor.clone(),
            evicted: evicted.clone(),
        });
        let name = match &visitor.key {
            Some(key) => key.name.clone(),
            None => format!("#{id}"),
        };
        Some(Viewer {
            broadcast: broadcast.clone(),
            id,
            visitor,
            evicted,
            name: Mutex::new(name),
        })
    }

    pub(super) fn rename(&self, name: &str) {
        let name = crate::sanitize::line(name)
            .chars()
            .take(24)
            .collect::<String>();
        if !name.trim().is_empty() {
            *self.name.lock() = name.trim().to_owned();
        }
    }

    fn person(&self) -> Person {
        Person {
            id: self.id,
            name: self.name.lock().clone(),
        }
    }

    /// Takes the drive lock. Returns the driving task, which the caller must run; `None` if this
    /// viewer already has the drive lock.
    ///
    /// # Errors
    /// What to tell the page.
    pub(super) fn take_drive_lock(
        &self,
    ) -> Result<Option<impl Future<Output = ()> + Send + use<>>, ToPage<'static>> {
        let notice = |key| ToPage::Notice {
            key,
            name: String::new(),
        };
        if self.visitor.role != Role::Driver {
            return Err(notice("viewer_only"));
        }
        let run = &self.broadcast.run;
        if run.emergency_stop.is_on() || run.status.borrow().emergency_stop {
            return Err(notice("drive_stopped"));
        }
        if differs_from_real_time(&self.broadcast) {
            return Err(notice("drive_not_real_time"));
        }
        let mut viewers = self.broadcast.lock_viewers();
        match &viewers.driver {
            Some((person, _)) if person.id == self.id => return Ok(None),
            Some((person, _)) => {
                let name = person.name.clone();
                let key = "drive_taken";
                return Err(ToPage::Notice { key, name });
            }
            None => {}
        }
        let person = self.person();
        let (setpoints, received) = watch::channel((Setpoint::STOP, Instant::now()));
        let name = person.name.clone();
        viewers.driver = Some((person, setpoints));
        Ok(Some(drive(self.broadcast.run.clone(), name, received)))
    }

    /// Sets the setpoint, which is valid for 0.3 s. Returns whether this viewer has the drive lock.
    pub(super) fn set_setpoint(&self, setpoint: Setpoint) -> bool {
        let not_real_time = differs_from_real_time(&self.broadcast);
        let mut viewers = self.broadcast.lock_viewers();
        let id = self.id;
        let Some((_, setpoints)) = viewers
            .driver
            .as_ref()
            .filter(|(person, _)| person.id == id)
        else {
            return false;
        };
        let drives = !not_real_time && setpoints.send((setpoint, Instant::now())).is_ok();
        if !drives {
            // The watchdog or the run has ended the client, or the simulation no longer runs in
            // real time.
            viewers.driver = None;
        }
        drives
    }

    pub(super) fn release_drive_lock(&self) {
        let mut viewers = self.broadcast.lock_viewers();
        viewers.driver.take_if(|(person, _)| person.id == self.id);
    }
}

/// Whether the run's clock differs from real time, in which a person cannot drive by hand.
fn differs_from_real_time(broadcast: &Broadcast) -> bool {
    let sim = broadcast.run.sim.as_ref();
    sim.and_then(|sim| sim.sim_clock.as_ref())
        .is_some_and(|sim_clock| {
            let mode = sim_clock.mode();
            mode.paused || mode.factor != TimeScale::REAL
        })
}

/// How long a setpoint is valid.
pub(super) const LIFE: Duration = Duration::from_millis(300);
/// How often the client sends a sign of life; the watchdog stops the tracks after 0.25 s without
/// one.
const HEARTBEAT_INTERVAL: Duration = Duration::from_millis(50);

/// Pause before STOP takes the tracks again.
const AGAIN: Duration = Duration::from_millis(200);

pub(super) type TimedSetpoint = (Setpoint, Instant);

/// Drives with the viewer's setpoints until the viewer releases the drive lock, or somebody orders
/// the robot to its station; such an order that was given before ends here. Leaving the pilot stops
/// the robot, or lets the behaviour with the next lower priority drive.
pub(super) async fn drive(run: Run, name: String, mut setpoints: watch::Receiver<TimedSetpoint>) {
    info!("{name} drives by hand");
    if let Err(error) = steer(&run, &name, &mut setpoints).await {
        info!("{name} can no longer drive by hand: {error}");
    } else {
        info!("{name} has stopped driving by hand");
    }
}

async fn steer(
    run: &Run,
    name: &str,
    setpoints: &mut watch::Receiver<TimedSetpoint>,
) -> Result<(), PilotClientError> {
    let mut client = run.pilot_client(name).await?;
    client.send_intent(Intent::CancelDock).await?;
    client.drive(Setpoint::STOP).await?;
    let mut heartbeat = every(HEARTBEAT_INTERVAL);
    let mut ends = None;
    loop {
        tokio::select! {
            biased;
            () = until(ends) => {
                ends = None;
                client.drive(Setpoint::STOP).await?;
            }
            changed = setpoints.changed() => {
                if changed.is_err() {
                    return Ok(());
                }
                let (setpoint, came) = *setpoints.borrow_and_update();
                let dies = came + LIFE;
                // Ignore a setpoint that has already expired.
                let alive = !setpoint.is_stop() && dies > Instant::now();
                ends = if alive { Some(dies) } else { None };
                client.drive(if alive { setpoint } else { Setpoint::STOP }).await?;
            }
            _ = heartbeat.tick() => client.alive().await?,
            event = client.next_event() => {
                if client.has_lost_tracks(&event?) {
                    info!("the robot was ordered to its station");
                    return Ok(());
                }
            }
        }
    }
}

/// Holds the tracks with a separate client of the pilot while STOP is set: behaviours, which have a
/// lower priority, do not get the tracks and are informed of that.
pub(super) async fn hold_tracks(run: Run, mut held: watch::Receiver<Option<Instant>>) {
    let holding = async {
        let mut client = run.pilot_client("STOP").await?;
        let mut heartbeat = every(HEARTBEAT_INTERVAL);
        // When to take the tracks (again): this fails on the station or without a link.
        let mut take = Some(Instant::now());
        loop {
            tokio::select! {
                () = until_free(&mut held) => return Ok::<(), PilotClientError>(()),
                () = until(take) => {
                    take = None;
                    client.drive(Setpoint::STOP).await?;
                }
                _ = heartbeat.tick() => client.alive().await?,
                event = client.next_event() => {
                    if let Event::MotionEnded { .. } = event? {
                        take = Some(Instant::now() + AGAIN);
                    }
                }
            }
        }
    };
    if let Err(error) = holding.await {
        info!("STOP: {error}");
    }
}

/// Waits until STOP is released; also returns if the server has ended.
async fn until_free(held: &mut watch::Receiver<Option<Instant>>) {
    let _ = held.wait_for(Option::is_none).await;
}
