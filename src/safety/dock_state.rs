//! Where the robot is: what it has reported about that, and how long each report is believed.
//!
//! | dock state | evidence | a script's motion | `undock` | `dock` | low battery |
//! | --- | --- | --- | --- | --- | --- |
//! | [`DockState::Charging`] | a POWER that reports charging, unless it comes within 10 s after an ENGINE 1 that followed CHARGE_STOP | refused, `docked` | CHARGE_STOP | `already_docked` | stays |
//! | [`DockState::ContactReported`] | ENGINE 2, or the answer to the login | refused, `docked` | CHARGE_STOP | waits for charging | waits for charging, at most `charge_timeout`; then [`DockState::Unknown`] |
//! | [`DockState::Left`] | ENGINE 1, the answer to the login, or, after CHARGE_STOP, a POWER that no longer reports charging | allowed | `not_docked` | BASE_FIND | BASE_FIND |
//! | [`DockState::Unknown`] | a CHARGE_STOP that is not confirmed in time; contact without charging while low; charging that ends though contact was never reported | allowed | CHARGE_STOP | BASE_FIND | BASE_FIND |
//!
//! From CHARGE_STOP until the robot has confirmed it, or its timeout is over, motion is refused as
//! on the station: the robot backs out on its own. A low battery may still refuse what this table
//! allows.

use std::fmt;
use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

/// Where the robot is. The module's table lists what each state allows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DockState {
    /// On the station and charging.
    Charging,
    /// On the station, by its own report, and not charging.
    #[serde(rename = "contact")]
    ContactReported,
    #[serde(rename = "off")]
    Left,
    /// On the station or off it.
    #[default]
    Unknown,
}

impl fmt::Display for DockState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            DockState::Charging => "on its station, charging",
            DockState::ContactReported => "on its station, not charging",
            DockState::Left => "off its station",
            DockState::Unknown => "unknown",
        })
    }
}

/// Why the robot is no longer believed to be on its station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contradiction {
    /// A CHARGE_STOP was not confirmed in time.
    Leaving,
    /// Charging has not begun in time after contact.
    Contact,
}

/// Tracks where the robot is, from its reports.
#[derive(Debug, Clone)]
pub struct DockTracker {
    dock_state: DockState,
    charge_timeout: Duration,
    /// The robot has reported contact, and nothing since contradicts it.
    contact: bool,
    /// While the battery is low, contact is believed until then.
    charge_due: Option<Instant>,
    /// CHARGE_STOP was sent; the robot's confirmation is awaited until then.
    leaving: Option<Instant>,
    /// CHARGE_STOP was sent since the robot's last report of its place.
    charge_stop_sent: bool,
    /// When the robot reported that it has left after a CHARGE_STOP.
    left_at: Option<Instant>,
}

impl DockTracker {
    /// The longest wait for the robot's confirmation after CHARGE_STOP.
    pub const LONGEST_LEAVING: Duration = Duration::from_secs(60);

    /// A POWER that reports charging within this time after ENGINE 1 is taken for older than ENGINE
    /// 1.
    const JUST_LEFT: Duration = Duration::from_secs(10);

    pub fn new(charge_timeout: Duration) -> DockTracker {
        DockTracker {
            dock_state: DockState::Unknown,
            charge_timeout,
            contact: false,
            charge_due: None,
            leaving: None,
            charge_stop_sent: false,
            left_at: None,
        }
    }

    pub fn dock_state(&self) -> DockState {
        self.dock_state
    }

    /// Whether the robot is on its station, by its own report or because it charges.
    pub fn on_station(&self) -> bool {
        matches!(
            self.dock_state,
            DockState::Charging | DockState::ContactReported
        )
    }

    /// Whether the robot has reported that it is on its station, and nothing since contradicts it.
    pub fn has_contact(&self) -> bool {
        self.contact
    }

    /// Whether a CHARGE_STOP was sent and is neither confirmed nor given up.
    pub fn is_leaving(&self) -> bool {
        self.leaving.is_some()
    }

    /// Whether the robot has just confirmed a CHARGE_STOP: a POWER that reports charging then is
    /// taken for older than that.
    pub fn has_just_left(&self, now: Instant) -> bool {
        self.left_at
            .is_some_and(|left| now < left + DockTracker::JUST_LEFT)
    }

    /// Handles the login's answer whether the robot is docked. While the battery is low, it does
    /// not extend the time for charging to begin: a link that drops repeatedly does not keep the
    /// robot from searching.
    pub fn login(&mut self, docked: bool, low: bool, now: Instant) {
        self.settle_charge_stop();
        let tried = low && self.charge_due.is_some_and(|due| due <= now);
        if !docked {
            return self.set_left();
        }
        self.contact = true;
        if tried {
            self.contradict(Contradiction::Contact);
        } else {
            self.dock_state = DockState::ContactReported;
            self.charge_due.get_or_insert(now + self.charge_timeout);
        }
    }

    /// ENGINE 2: on the station. If that is known already, it does not extend `charge_due` before
    /// that is over.
    pub fn docked(&mut self, now: Instant) {
        self.settle_charge_stop();
        self.contact = true;
        let late = self.charge_due.is_some_and(|due| due <= now);
        if late || !self.on_station() {
            self.dock_state = DockState::ContactReported;
            self.charge_due = Some(now + self.charge_timeout);
        }
    }

    /// ENGINE 1: off the station.
    pub fn undocked(&mut self, now: Instant) {
        let left = self.charge_stop_sent.then_some(now);
        self.settle_charge_stop();
        self.set_left();
        self.left_at = left;
    }

    pub fn power(&mut self, charging: bool, now: Instant) {
        if charging {
            (self.dock_state, self.charge_due) = (DockState::Charging, None);
        } else if self.dock_state == DockState::Charging {
            self.charging_ended(now);
        }
    }

    /// CHARGE_STOP was sent; waits for the robot's confirmation for `timeout`, at most
    /// [`DockTracker::LONGEST_LEAVING`].
    pub fn leave_station(&mut self, timeout: Duration, now: Instant) {
        self.charge_stop_sent = true;
        self.leaving = Some(now + timeout.min(DockTracker::LONGEST_LEAVING));
    }

    /// Gives up waiting for the confirmation of a CHARGE_STOP.
    pub fn contradict_leaving(&mut self) -> Option<Contradiction> {
        self.leaving.take()?;
        if self.on_station() {
            Some(self.contradict(Contradiction::Leaving))
        } else {
            None
        }
    }

    /// The battery has become low: from now on contact must become charging within the timeout.
    pub fn expect_charge(&mut self, now: Instant) {
        if self.dock_state == DockState::ContactReported {
            self.charge_due = Some(now + self.charge_timeout);
        }
    }

    /// Begins the time for charging anew, if it runs.
    pub fn excuse_contact(&mut self, now: Instant) {
        self.charge_due = self.charge_due.map(|_| now + self.charge_timeout);
    }

    /// Handles timeouts. Returns why the robot is no longer believed to be on its station.
    pub fn poll(&mut self, low: bool, now: Instant) -> Option<Contradiction> {
        if self.leaving.is_some_and(|until| until <= now) {
            return self.contradict_leaving();
        }
        self.charge_due.filter(|due| *due <= now)?;
        if !low {
            self.charge_due = None;
        }
        if low && self.dock_state == DockState::ContactReported {
            Some(self.contradict(Contradiction::Contact))
        } else {
            None
        }
    }

    /// When [`DockTracker::poll`] has something to do.
    pub fn next_deadline(&self, low: bool) -> Option<Instant> {
        let waits = low && self.dock_state == DockState::ContactReported;
        let charge_due = if waits { self.charge_due } else { None };
        [self.leaving, charge_due].into_iter().flatten().min()
    }

    /// With [`Contradiction::Contact`] the report of contact stays: it was right if the robot
    /// charges after all.
    fn contradict(&mut self, why: Contradiction) -> Contradiction {
        self.dock_state = DockState::Unknown;
        self.contact &= why == Contradiction::Contact;
        why
    }

    /// The robot has reported its place: an earlier CHARGE_STOP is settled.
    fn settle_charge_stop(&mut self) {
        (self.leaving, self.charge_stop_sent, self.left_at) = (None, false, None);
    }

    fn set_left(&mut self) {
        (self.dock_state, self.contact, self.charge_due) = (DockState::Left, false, None);
    }

    fn charging_ended(&mut self, now: Instant) {
        if self.is_leaving() {
            self.set_left();
        } else if self.contact {
            self.dock_state = DockState::ContactReported;
            self.charge_due = Some(now + self.charge_timeout);
        } else {
            self.dock_state = DockState::Unknown;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    #[test]
    fn each_place_has_a_description() {
        let texts = [
            DockState::Charging,
            DockState::ContactReported,
            DockState::Left,
            DockState::Unknown,
        ];
        let texts = texts.map(|text| text.to_string());
        assert_eq!(texts[0], "on its station, charging");
        assert_eq!(texts[2], "off its station");
        assert!(texts.iter().all(|text| !text.is_empty()));
    }

    fn nowhere() -> (DockTracker, Instant) {
        (DockTracker::new(30 * SECOND), Instant::now())
    }

    fn on_contact() -> (DockTracker, Instant) {
        let (mut tracker, now) = nowhere();
        tracker.login(true, false, now);
        (tracker, now)
    }

    #[test]
    fn each_report_sets_its_place() {
        let (mut tracker, now) = nowhere();
        assert_eq!(tracker.dock_state(), DockState::Unknown);
        tracker.login(false, false, now);
        assert_eq!(tracker.dock_state(), DockState::Left);
        tracker.docked(now);
        assert_eq!(tracker.dock_state(), DockState::ContactReported);
        tracker.power(true, now);
        assert_eq!(tracker.dock_state(), DockState::Charging);
        tracker.docked(now);
        assert_eq!(tracker.dock_state(), DockState::Charging, "a late report");
        tracker.power(false, now);
        assert_eq!(
            tracker.dock_state(),
            DockState::ContactReported,
            "full, or no current"
        );
        tracker.undocked(now);
        assert_eq!(tracker.dock_state(), DockState::Left);
    }

    #[test]
    fn charging_that_ends_without_reported_contact_leaves_the_place_unknown() {
        let (mut tracker, now) = nowhere();
        tracker.login(false, false, now);
        tracker.power(true, now);
        tracker.power(false, now);
        assert_eq!(tracker.dock_state(), DockState::Unknown);
    }

    #[test]
    fn an_unconfirmed_undocking_leaves_the_place_unknown() {
        let (mut tracker, now) = on_contact();
        tracker.power(true, now);
        tracker.leave_station(20 * SECOND, now);
        assert_eq!(tracker.next_deadline(false), Some(now + 20 * SECOND));
        tracker.poll(false, now + 19 * SECOND);
        assert!(tracker.on_station() && tracker.is_leaving());
        assert_eq!(
            tracker.poll(false, now + 20 * SECOND),
            Some(Contradiction::Leaving)
        );
        assert_eq!(tracker.dock_state(), DockState::Unknown);
        assert!(!tracker.is_leaving());
        assert_eq!(tracker.next_deadline(false), None);
    }

    #[test]
    fn a_confirmation_is_awaited_for_a_minute_at_most() {
        let (mut tracker, now) = on_contact();
        tracker.leave_station(Duration::MAX, now);
        tracker.poll(false, now + 60 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::Unknown);
    }

    #[test]
    fn charging_that_ends_after_charge_stop_is_evidence_and_the_robot_still_backs_out() {
        let (mut tracker, now) = on_contact();
        tracker.power(true, now);
        tracker.leave_station(20 * SECOND, now);
        tracker.power(false, now + SECOND);
        assert_eq!(tracker.dock_state(), DockState::Left);
        assert!(tracker.is_leaving());
        tracker.poll(false, now + 20 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::Left);
        assert!(!tracker.is_leaving());
    }

    #[test]
    fn a_report_ends_the_wait_for_a_confirmation() {
        for docked in [true, false] {
            let (mut tracker, now) = on_contact();
            tracker.leave_station(20 * SECOND, now);
            if docked {
                tracker.docked(now);
            } else {
                tracker.undocked(now);
            }
            assert!(!tracker.is_leaving());
            tracker.poll(false, now + 60 * SECOND);
            assert_eq!(tracker.on_station(), docked);
        }
    }

    #[test]
    fn contact_without_charging_expires_only_while_low() {
        let (mut tracker, now) = on_contact();
        tracker.poll(false, now + 3600 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::ContactReported);
        let low = now + 7200 * SECOND;
        tracker.expect_charge(low);
        assert_eq!(tracker.next_deadline(true), Some(low + 30 * SECOND));
        assert_eq!(tracker.next_deadline(false), None);
        tracker.poll(true, low + 29 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::ContactReported);
        assert_eq!(
            tracker.poll(true, low + 30 * SECOND),
            Some(Contradiction::Contact)
        );
        assert_eq!(tracker.dock_state(), DockState::Unknown);
    }

    #[test]
    fn a_new_login_does_not_extend_contact_while_low() {
        let (mut tracker, now) = on_contact();
        for second in 1..30 {
            tracker.login(true, true, now + second * SECOND);
            assert_eq!(tracker.next_deadline(true), Some(now + 30 * SECOND));
        }
        tracker.login(true, true, now + 30 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::Unknown);
        tracker.docked(now + 40 * SECOND);
        assert_eq!(tracker.next_deadline(true), Some(now + 70 * SECOND));
    }

    #[test]
    fn a_new_login_renews_contact_once_the_battery_was_good() {
        let (mut tracker, now) = on_contact();
        tracker.expect_charge(now);
        tracker.poll(true, now + 30 * SECOND);
        tracker.poll(false, now + 31 * SECOND);
        tracker.login(true, true, now + 40 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::ContactReported);
    }

    #[test]
    fn expired_contact_is_not_believed_at_the_next_login_while_low() {
        let (mut tracker, now) = on_contact();
        assert_eq!(
            tracker.poll(true, now + 30 * SECOND),
            Some(Contradiction::Contact)
        );
        assert!(tracker.has_contact());
        tracker.login(true, true, now + 31 * SECOND);
        assert_eq!(tracker.dock_state(), DockState::Unknown);
    }

    #[test]
    fn contact_reported_after_its_expiry_has_new_time() {
        let (mut tracker, now) = on_contact();
        tracker.docked(now + 10 * SECOND);
        assert_eq!(tracker.next_deadline(true), Some(now + 30 * SECOND));
        tracker.docked(now + 30 * SECOND);
        assert_eq!(tracker.next_deadline(true), Some(now + 60 * SECOND));
    }

    #[test]
    fn charging_that_ends_on_the_contacts_may_resume_in_time() {
        let (mut tracker, now) = on_contact();
        tracker.power(true, now);
        assert_eq!(tracker.next_deadline(true), None);
        tracker.power(false, now + 100 * SECOND);
        assert_eq!(tracker.next_deadline(true), Some(now + 130 * SECOND));
    }

    #[test]
    fn an_unconfirmed_undocking_clears_contact() {
        let (mut tracker, now) = on_contact();
        tracker.leave_station(20 * SECOND, now);
        assert!(tracker.has_contact());
        tracker.poll(false, now + 20 * SECOND);
        assert!(!tracker.has_contact());
    }

    #[test]
    fn after_a_suspension_an_undocking_is_in_doubt() {
        let (mut tracker, now) = on_contact();
        tracker.contradict_leaving();
        assert_eq!(tracker.dock_state(), DockState::ContactReported);
        tracker.leave_station(20 * SECOND, now);
        tracker.contradict_leaving();
        assert_eq!(tracker.dock_state(), DockState::Unknown);
    }
}
