//! The ticket of one viewer: name, role, and the wheel if the viewer has it.

use std::future::Future;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;
use tokio::time::Instant;

use super::hub::Hub;
use super::manual_drive;
use super::state::Person;
use crate::http::{Role, Visitor};
use crate::lab::Factor;
use crate::robot::Setpoint;

/// The number of the next viewer.
static NUMBER: AtomicU32 = AtomicU32::new(1);

/// A viewer, until dropped. Dropping it releases the wheel.
pub(super) struct Ticket {
    hub: Arc<Hub>,
    pub(super) id: u32,
    pub(super) visitor: Visitor,
    name: Mutex<String>,
}

impl Drop for Ticket {
    fn drop(&mut self) {
        self.leave_wheel();
        self.hub.lock_viewers().count -= 1;
    }
}

/// Why the wheel cannot be taken.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum WheelError {
    /// The role does not permit driving.
    Viewer,
    /// STOP holds.
    Halted,
    /// The simulation's clock does not run at real time.
    NotRealTime,
    /// The viewer of this name has it.
    Taken(String),
}

impl Ticket {
    /// Admits a viewer; `None` if there are too many.
    pub(super) fn admit(hub: &Arc<Hub>, visitor: Visitor) -> Option<Ticket> {
        let mut viewers = hub.lock_viewers();
        if viewers.count >= hub.most_viewers {
            return None;
        }
        viewers.count += 1;
        let id = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = match &visitor.key {
            Some(key) => key.name.clone(),
            None => format!("#{id}"),
        };
        Some(Ticket {
            hub: hub.clone(),
            id,
            visitor,
            name: Mutex::new(name),
        })
    }

    pub(super) fn hub(&self) -> &Arc<Hub> {
        &self.hub
    }

    /// Sets the name that other viewers see.
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

    /// Takes the wheel. Returns the driving task, which the caller must run; `None` if this viewer
    /// already has the wheel.
    ///
    /// # Errors
    /// See [`WheelError`].
    pub(super) fn take_wheel(
        &self,
    ) -> Result<Option<impl Future<Output = ()> + Send + use<>>, WheelError> {
        if self.visitor.role != Role::Driver {
            return Err(WheelError::Viewer);
        }
        if is_halted(&self.hub) {
            return Err(WheelError::Halted);
        }
        if differs_from_real_time(&self.hub) {
            return Err(WheelError::NotRealTime);
        }
        let mut viewers = self.hub.lock_viewers();
        match &viewers.driver {
            Some((person, _)) if person.id == self.id => return Ok(None),
            Some((person, _)) => return Err(WheelError::Taken(person.name.clone())),
            None => {}
        }
        let person = self.person();
        let (setpoints, received) = watch::channel((Setpoint::STOP, Instant::now()));
        let name = person.name.clone();
        viewers.driver = Some((person, setpoints));
        Ok(Some(manual_drive::drive(
            self.hub.run.clone(),
            name,
            received,
        )))
    }

    /// Sets the setpoint, which is valid for 0.3 s. Returns whether this viewer has the wheel.
    pub(super) fn set_setpoint(&self, setpoint: Setpoint) -> bool {
        let not_real_time = differs_from_real_time(&self.hub);
        let mut viewers = self.hub.lock_viewers();
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
            // The watchdog or the run has ended the seat, or the simulation no longer runs in real
            // time.
            viewers.driver = None;
        }
        drives
    }

    pub(super) fn leave_wheel(&self) {
        let mut viewers = self.hub.lock_viewers();
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
fn differs_from_real_time(hub: &Hub) -> bool {
    let tempo = hub.sim.as_ref().and_then(|sim| sim.tempo.as_ref());
    tempo.is_some_and(|tempo| {
        let mode = tempo.mode();
        mode.paused || mode.factor != Factor::REAL
    })
}

fn is_halted(hub: &Hub) -> bool {
    hub.run.stop_latch.is_on() || hub.run.status.borrow().halted
}
