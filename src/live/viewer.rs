//! One viewer: name, role, and the drive lock if the viewer has it.

use std::cmp::Reverse;
use std::future::Future;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::broadcast::{Broadcast, ViewerList};
use super::manual_drive;
use super::state::Person;
use crate::http::{MAX_VIEWERS, Role, Visitor};
use crate::robot::Setpoint;
use crate::simulation::TimeScale;

/// The number of the next viewer.
static NUMBER: AtomicU32 = AtomicU32::new(1);

/// A viewer, until dropped. Dropping it releases the drive lock.
pub(super) struct Viewer {
    broadcast: Arc<Broadcast>,
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

/// The place of a viewer.
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

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum DriveLockError {
    /// The role does not permit driving.
    Viewer,
    /// STOP holds.
    Stopped,
    /// The simulation's clock does not run at real time.
    NotRealTime,
    /// The viewer of this name has it.
    Taken(String),
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

    pub(super) fn broadcast(&self) -> &Arc<Broadcast> {
        &self.broadcast
    }

    pub(super) fn rename(&self, name: &str) {
        let name = crate::sanitize::line(name)
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

    /// Takes the drive lock. Returns the driving task, which the caller must run; `None` if this
    /// viewer already has the drive lock.
    ///
    /// # Errors
    /// See [`DriveLockError`].
    pub(super) fn take_drive_lock(
        &self,
    ) -> Result<Option<impl Future<Output = ()> + Send + use<>>, DriveLockError> {
        if self.visitor.role != Role::Driver {
            return Err(DriveLockError::Viewer);
        }
        if is_halted(&self.broadcast) {
            return Err(DriveLockError::Stopped);
        }
        if differs_from_real_time(&self.broadcast) {
            return Err(DriveLockError::NotRealTime);
        }
        let mut viewers = self.broadcast.lock_viewers();
        match &viewers.driver {
            Some((person, _)) if person.id == self.id => return Ok(None),
            Some((person, _)) => return Err(DriveLockError::Taken(person.name.clone())),
            None => {}
        }
        let person = self.person();
        let (setpoints, received) = watch::channel((Setpoint::STOP, Instant::now()));
        let name = person.name.clone();
        viewers.driver = Some((person, setpoints));
        Ok(Some(manual_drive::drive(
            self.broadcast.run.clone(),
            name,
            received,
        )))
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
        if viewers
            .driver
            .as_ref()
            .is_some_and(|(person, _)| person.id == self.id)
        {
            viewers.driver = None;
        }
    }
}

/// Whether the run's clock differs from real time, in which a person cannot drive by hand.
fn differs_from_real_time(broadcast: &Broadcast) -> bool {
    let sim_clock = broadcast
        .run
        .sim
        .as_ref()
        .and_then(|sim| sim.sim_clock.as_ref());
    sim_clock.is_some_and(|sim_clock| {
        let mode = sim_clock.mode();
        mode.paused || mode.factor != TimeScale::REAL
    })
}

fn is_halted(broadcast: &Broadcast) -> bool {
    broadcast.run.emergency_stop.is_on() || broadcast.run.status.borrow().emergency_stop
}
