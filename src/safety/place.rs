//! Where the robot is: what it has said about that, and how long it is believed.
//!
//! | place | by | a script's motion | `undock` | `dock` | low battery |
//! | --- | --- | --- | --- | --- | --- |
//! | [`DockState::Charging`] | a POWER that says so, unless it comes within 10 s after the robot has left, as asked | refused, `docked` | CHARGE_STOP | `already_docked` | stays |
//! | [`DockState::ContactSaid`] | ENGINE 2, or the login's word | refused, `docked` | CHARGE_STOP | waits for charging | waits for charging, at most `charge_timeout`; then [`DockState::Unknown`] |
//! | [`DockState::Left`] | ENGINE 1, the login's word, or a POWER that charges no more after CHARGE_STOP | allowed | `not_docked` | BASE_FIND | BASE_FIND |
//! | [`DockState::Unknown`] | a CHARGE_STOP that is not confirmed in time; contact without charging while low; charging that ends though contact was never reported | allowed | CHARGE_STOP | BASE_FIND | BASE_FIND |
//!
//! From CHARGE_STOP until the robot has confirmed it, or its time is over, motion is refused as on
//! the station: the robot backs out by itself. What is allowed here may still be refused because the
//! battery is low.

use std::fmt;
use std::time::Duration;

use tokio::time::Instant;

/// Where the robot is. See the module for what each allows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DockState {
    /// On the station: it charges.
    Charging,
    /// On the station, it has said; it does not charge.
    ContactSaid,
    /// Off the station.
    Left(Evidence),
    /// On the station or off it.
    Unknown,
}

impl fmt::Display for DockState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DockState::Charging => "on its station, charging",
            DockState::ContactSaid => "on its station, not charging",
            DockState::Left(_) => "off its station",
            DockState::Unknown => "unknown",
        })
    }
}

/// By whose word the robot is off its station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Evidence {
    /// ENGINE 1.
    Engine,
    /// The answer to the login.
    Login,
    /// A POWER without charging, after CHARGE_STOP.
    Power,
}

/// Why a place is not believed any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Doubt {
    /// A CHARGE_STOP was not confirmed in time.
    Leaving,
    /// Contact has not become charging in time.
    Contact,
}

/// Follows what is said about the place.
#[derive(Debug, Clone)]
pub struct DockTracker {
    place: DockState,
    charge_timeout: Duration,
    /// The robot has spoken of contact, and of nothing else since.
    contact: bool,
    /// Contact is believed until then if the battery is low.
    charge_due: Option<Instant>,
    /// CHARGE_STOP was sent; the robot's word is awaited until then.
    leaving: Option<Instant>,
    /// CHARGE_STOP was sent since the robot last spoke of its place.
    asked: bool,
    /// When the robot said that it has left, as it was asked to.
    left: Option<Instant>,
}

impl DockTracker {
    /// The longest time that the robot's word is awaited after CHARGE_STOP.
    pub const LONGEST_LEAVING: Duration = Duration::from_secs(60);

    /// How long a POWER that says "charging" may be older than ENGINE 1.
    const JUST_LEFT: Duration = Duration::from_secs(10);

    /// Nothing has been said yet.
    pub fn new(charge_timeout: Duration) -> DockTracker {
        DockTracker {
            place: DockState::Unknown,
            charge_timeout,
            contact: false,
            charge_due: None,
            leaving: None,
            asked: false,
            left: None,
        }
    }

    /// Where it is.
    pub fn place(&self) -> DockState {
        self.place
    }

    /// On the station, by its word or because it charges.
    pub fn on_station(&self) -> bool {
        matches!(self.place, DockState::Charging | DockState::ContactSaid)
    }

    /// The robot has said that it is on its station, and nothing since denies it.
    pub fn has_contact(&self) -> bool {
        self.contact
    }

    /// CHARGE_STOP was sent and neither confirmed nor given up.
    pub fn is_leaving(&self) -> bool {
        self.leaving.is_some()
    }

    /// It was asked to leave, and has just said that it did: a POWER that says "charging" tells of the time before.
    pub fn has_just_left(&self, now: Instant) -> bool {
        self.left
            .is_some_and(|left| now < left + DockTracker::JUST_LEFT)
    }

    /// The login has said whether it is docked. While the battery is low that word gives contact no
    /// new time: a link that drops again and again does not keep the robot from searching.
    pub fn login(&mut self, docked: bool, low: bool, now: Instant) {
        self.has_spoken();
        let tried = low && self.charge_due.is_some_and(|due| due <= now);
        if !docked {
            return self.leave(Evidence::Login);
        }
        self.contact = true;
        if tried {
            self.doubt(Doubt::Contact);
        } else {
            self.place = DockState::ContactSaid;
            self.charge_due.get_or_insert(now + self.charge_timeout);
        }
    }

    /// ENGINE 2: on the station. Said again in time it changes nothing.
    pub fn docked(&mut self, now: Instant) {
        self.has_spoken();
        self.contact = true;
        let late = self.charge_due.is_some_and(|due| due <= now);
        if late || !self.on_station() {
            self.place = DockState::ContactSaid;
            self.charge_due = Some(now + self.charge_timeout);
        }
    }

    /// ENGINE 1: has left the station.
    pub fn undocked(&mut self, now: Instant) {
        let left = self.asked.then_some(now);
        self.has_spoken();
        self.leave(Evidence::Engine);
        self.left = left;
    }

    /// A battery level came.
    pub fn power(&mut self, charging: bool, now: Instant) {
        if charging {
            (self.place, self.charge_due) = (DockState::Charging, None);
        } else if self.place == DockState::Charging {
            self.charging_ended(now);
        }
    }

    /// CHARGE_STOP was sent; the robot's word is awaited for so long, at most
    /// [`DockTracker::LONGEST_LEAVING`].
    pub fn leave_station(&mut self, timeout: Duration, now: Instant) {
        self.asked = true;
        self.leaving = Some(now + timeout.min(DockTracker::LONGEST_LEAVING));
    }

    /// The outcome of a CHARGE_STOP is not known any more.
    pub fn doubt_leaving(&mut self) -> Option<Doubt> {
        self.leaving.take()?;
        self.on_station().then(|| self.doubt(Doubt::Leaving))
    }

    /// The battery has become low: from now on contact has its time to become charging.
    pub fn expect_charge(&mut self, now: Instant) {
        if self.place == DockState::ContactSaid {
            self.charge_due = Some(now + self.charge_timeout);
        }
    }

    /// Time passes. Says why the robot is not believed to be on its station any more.
    pub fn poll(&mut self, low: bool, now: Instant) -> Option<Doubt> {
        if self.leaving.is_some_and(|until| until <= now) {
            return self.doubt_leaving();
        }
        self.charge_due.filter(|due| *due <= now)?;
        if !low {
            self.charge_due = None;
        }
        let waits = low && self.place == DockState::ContactSaid;
        waits.then(|| self.doubt(Doubt::Contact))
    }

    /// When [`DockTracker::poll`] has something to do.
    pub fn next_deadline(&self, low: bool) -> Option<Instant> {
        let waits = low && self.place == DockState::ContactSaid;
        let charge_due = self.charge_due.filter(|_| waits);
        [self.leaving, charge_due].into_iter().flatten().min()
    }

    /// Should it charge after all, its word of contact was right.
    fn doubt(&mut self, why: Doubt) -> Doubt {
        self.place = DockState::Unknown;
        self.contact &= why == Doubt::Contact;
        why
    }

    /// The robot has spoken of its place: nothing of a CHARGE_STOP before is open any more.
    fn has_spoken(&mut self) {
        (self.leaving, self.asked, self.left) = (None, false, None);
    }

    fn leave(&mut self, word: Evidence) {
        (self.place, self.contact, self.charge_due) = (DockState::Left(word), false, None);
    }

    fn charging_ended(&mut self, now: Instant) {
        if self.is_leaving() {
            self.leave(Evidence::Power);
        } else if self.contact {
            self.place = DockState::ContactSaid;
            self.charge_due = Some(now + self.charge_timeout);
        } else {
            self.place = DockState::Unknown;
        }
    }
}

#[cfg(test)]
mod tests;
