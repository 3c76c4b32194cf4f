//! What the facts of a history imply, by a model much simpler than the watchdog, and the promises
//! that hold while the battery is low.

use super::*;

/// What the facts imply, without any of the watchdog's rules but one: where the watchdog is free to
/// believe good battery news later, the model follows it, provided that enough reports support what
/// it believes.
#[derive(Debug, Default)]
pub(super) struct Known {
    pub(super) online: bool,
    pub(super) on_station: bool,
    pub(super) charging: bool,
    /// It charges where it is: cleared by an undocking, and by a contact after an order to leave.
    pub(super) charges_here: bool,
    /// Since when it has been on its contacts, by its own report, without charging.
    pub(super) contact: Option<Instant>,
    /// It was told to leave the station, and has not reported its place since.
    pub(super) told_to_leave: bool,
    /// When it reported that it has left, as it was told to.
    pub(super) left: Option<Instant>,
    /// It was low and did not charge in time, and has not reported its place since.
    pub(super) idle: bool,
    pub(super) low: bool,
    pub(super) critical: bool,
    /// Consecutive reports of: charging; at least `ok`; more than `critical`.
    pub(super) charges: u32,
    pub(super) good: u32,
    pub(super) uncritical: u32,
    /// A report of charging came while the robot reported to be on its station.
    pub(super) touched: bool,
    /// The same, and it had not been told to leave.
    pub(super) surely_touched: bool,
    /// Whether charging is reported and not believed.
    pub(super) unconfirmed: bool,
    /// Since when charging is reported.
    pub(super) charging_since: Option<Instant>,
    /// The last news of a search was that it failed.
    pub(super) not_found: bool,
    pub(super) rescuer: Option<BehaviourId>,
    pub(super) run_ended: bool,
    pub(super) stopped: bool,
    /// The start of the battery's silence.
    pub(super) reported: Option<Instant>,
    /// The last report had no level.
    pub(super) no_level: bool,
    /// ... and was positive, while the robot was on its station by its own report: the watchdog may
    /// take it for charging.
    pub(super) unsigned: bool,
}

impl Known {
    pub(super) fn docked(&self) -> bool {
        self.on_station || self.charges_here
    }

    /// Whether the robot is on its station, with no reason to doubt it.
    pub(super) fn surely_docked(&self, limits: &Limits, now: Instant) -> bool {
        self.docked() && !self.told_to_leave && !self.idle && !self.is_idle(limits, now)
    }

    pub(super) fn is_idle(&self, limits: &Limits, now: Instant) -> bool {
        let due = |since: Instant| since + limits.charge_timeout.get() <= now;
        self.low && self.contact.is_some_and(due)
    }

    pub(super) fn record(&mut self, input: &Input, limits: &Limits, now: Instant) {
        self.idle |= self.is_idle(limits, now);
        if let Input::Fact(fact) = input {
            self.record_fact(fact, limits, now);
        }
        let place_reported = matches!(
            input,
            Input::Fact(Fact::Engine(EngineReport::Docked | EngineReport::Undocked))
        );
        self.idle &= self.on_station && !self.charges_here && !place_reported;
        let contact = self.on_station && !self.charges_here;
        self.contact = contact.then(|| self.contact.unwrap_or(now));
    }

    fn record_fact(&mut self, fact: &Fact, limits: &Limits, now: Instant) {
        match fact {
            Fact::LinkUp { docked, power } => {
                (self.online, self.on_station) = (true, *docked);
                (self.not_found, self.told_to_leave, self.left) = (false, false, None);
                self.power(*power, limits, now);
            }
            Fact::LinkDown => self.online = false,
            Fact::Rescuer(by) => self.rescuer = *by,
            Fact::Gone(by) if self.rescuer == Some(*by) => self.rescuer = None,
            Fact::RunEnding => self.run_ended = true,
            Fact::StoppedByPerson(stopped) => self.stopped = *stopped,
            Fact::Engine(EngineReport::BaseNotFound) => self.not_found = true,
            Fact::Power(power) => self.power(*power, limits, now),
            Fact::Engine(EngineReport::Docked) => {
                (self.on_station, self.not_found) = (true, false);
                self.charges_here &= !self.told_to_leave;
                (self.told_to_leave, self.left) = (false, None);
                self.touched |= self.charging;
                self.surely_touched |= self.charging;
            }
            Fact::Engine(EngineReport::Undocked) => {
                (self.on_station, self.charging) = (false, false);
                self.charges_here = false;
                (self.charges, self.touched, self.unconfirmed) = (0, false, false);
                self.surely_touched = false;
                self.left = self.told_to_leave.then_some(now);
                self.told_to_leave = false;
                self.reported = self.reported.map(|_| now);
            }
            _ => {}
        }
    }

    /// Notes whether the watchdog tells the robot to leave its station.
    pub(super) fn note_acts(&mut self, acts: &[Act]) {
        self.told_to_leave |= sent(acts).contains(&LEAVE);
    }

    pub(super) fn power(&mut self, power: Power, limits: &Limits, now: Instant) {
        self.expire_unconfirmed(now);
        let just_left = self
            .left
            .is_some_and(|left| now < left + Duration::from_secs(10));
        let signed = power.charging && !just_left;
        self.no_level = power.level().is_none();
        self.unsigned = self.no_level && !signed && self.on_station;
        let power = Power {
            charging: signed || self.unsigned,
            ..power
        };
        if power.charging && !self.charging {
            self.charging_since = Some(now);
        }
        self.charging = power.charging;
        self.reported = self.reported.filter(|_| self.no_level).or(Some(now));
        self.charges_here = power.charging;
        self.unconfirmed &= power.charging;
        let count = |counted: &mut u32, says: bool| *counted = if says { *counted + 1 } else { 0 };
        count(&mut self.charges, power.charging);
        let touches = self.on_station && !self.unsigned;
        self.touched = power.charging && (self.touched || touches);
        let surely = self.surely_touched || (touches && !self.told_to_leave);
        self.surely_touched = power.charging && surely;
        if self.no_level {
            return;
        }
        count(&mut self.good, power.percent >= limits.ok.get());
        let critical = power.percent <= limits.critical.get();
        count(&mut self.uncritical, !critical);
        self.critical |= critical;
        self.low |= !power.charging && power.percent <= limits.low.get();
    }

    /// Adopts what the watchdog believes, after checking that it may believe it.
    pub(super) fn agree(&mut self, dog: &Watchdog, limits: &Limits) -> Kept {
        let charging = dog.battery_monitor.charging();
        if self.unsigned && charging == Charging::No {
            (self.charging, self.charges_here, self.charges) = (false, false, 0);
            (self.touched, self.surely_touched) = (false, false);
        }
        self.unsigned = false;
        prop_assert_eq!(self.charging, charging != Charging::No);
        let enough = self.touched || self.charges >= 2;
        prop_assert!(
            enough || charging != Charging::Confirmed,
            "one report of charging"
        );
        prop_assert!(
            !self.surely_touched || charging != Charging::Unconfirmed,
            "charging on its station"
        );
        self.unconfirmed = charging == Charging::Unconfirmed;
        let released = charging == Charging::Confirmed || self.good >= 3;
        prop_assert!(dog.low().is_some() || !self.low || released, "{:?}", self);
        let low = dog
            .battery_monitor
            .level()
            .is_some_and(|level| level <= limits.low);
        let late = self.charges > 0 && !self.charging && low;
        let still = self.no_level && !self.charging && dog.battery_monitor.at_or_below_low();
        let late = late || still;
        prop_assert!(dog.low().is_none() || self.low || late, "{:?}", self);
        self.low = dog.low().is_some();
        let may_be_full = self.no_level && charging == Charging::Confirmed;
        let uncritical = self.uncritical >= 3 || may_be_full;
        prop_assert!(dog.battery_monitor.critical() || !self.critical || uncritical);
        prop_assert!(!dog.battery_monitor.critical() || self.critical);
        self.critical = dog.battery_monitor.critical();
        Ok(())
    }

    /// Whether the robot searches on its own after this moment.
    pub(super) fn still_searches(&self, moment: &Moment<'_>, before: bool) -> bool {
        use EngineReport::{BaseNotFound, Docked};
        let over = match moment.input {
            Some(Input::Fact(Fact::Power(_))) => {
                moment.play.dog.battery_monitor.charging() == Charging::Confirmed
            }
            Some(Input::Fact(Fact::Engine(news))) => matches!(news, Docked | BaseNotFound),
            Some(Input::Fact(Fact::LinkDown | Fact::LinkUp { .. })) => true,
            _ => false,
        };
        let ends = |command: &Command| match command {
            Command::Move { .. } | Command::Engine(Engage::Undock | Engage::CancelDock) => {
                Some(false)
            }
            Command::Engine(Engage::Dock) => Some(true),
            _ => None,
        };
        let last = sent(&moment.acts).iter().filter_map(ends).next_back();
        self.online && last.unwrap_or(before && !over)
    }

    /// Whether a blind move or a grant may move a robot with a low battery.
    pub(super) fn allows_the_way_home(&self, limits: &Limits, now: Instant) -> bool {
        self.low && self.allows_a_grant(limits, now)
    }

    /// Whether a grant may move it: that of a low robot, or of a docking that somebody asked for.
    pub(super) fn allows_a_grant(&self, limits: &Limits, now: Instant) -> bool {
        let away = self.online && !self.surely_docked(limits, now);
        away && !self.run_ended && !self.stopped
    }

    pub(super) fn expire_unconfirmed(&mut self, now: Instant) {
        let over = |since: Instant| now >= since + BatteryMonitor::UNCONFIRMED_TIMEOUT;
        if self.unconfirmed && self.charging_since.is_some_and(over) {
            (self.charging, self.unconfirmed) = (false, false);
            self.charges_here = false;
            self.contact = self.on_station.then_some(now);
        }
    }

    pub(super) fn pass(&mut self, limits: &Limits, excused: bool, now: Instant) {
        self.idle |= self.is_idle(limits, now);
        if self.online {
            self.expire_unconfirmed(now);
        }
        match self.reported {
            Some(_) if self.online && excused => self.reported = Some(now),
            Some(at) if self.online => self.low |= now >= at + limits.power_silence.get(),
            _ => {}
        }
    }
}

/// What moves a robot with a low battery: blind moves of the watchdog, and grants.
#[derive(Debug, Default)]
pub(super) struct WayHome {
    /// Since when it moves.
    moves: Option<Instant>,
    /// Since when the tracks are granted, and to which behaviour.
    granted: Option<(Instant, BehaviourId)>,
}

fn longest_grant(limits: &Limits) -> Duration {
    limits.rescue_time.get().max(DriveGrant::LONGEST)
}

impl WayHome {
    const LONGEST_BLIND_MOVE: Duration = BlindMove::TURN.saturating_add(BlindMove::LONGEST);

    /// While low: any motion is an allowed blind move, slow and short, or an allowed grant.
    pub(super) fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play { dog, known, .. } = moment.play;
        self.see_grant(moment)?;
        for command in &sent(&moment.acts) {
            if !known.low {
                break;
            }
            let Command::Move { left, right } = *command else {
                continue;
            };
            let left = left.unsigned_abs();
            let right = right.unsigned_abs();
            let cap = f64::from(moment.play.limits.rescue_power.get()) * 0.9;
            let slow = f64::from(left.max(right)) <= cap;
            let is_blind_move = left == right && [0, 27].contains(&left);
            prop_assert!(
                is_blind_move || (self.granted.is_some() && slow),
                "{:?}",
                command
            );
        }
        if known.low && dog.moving() {
            self.see_motion(moment)
        } else {
            self.moves = None;
            Ok(())
        }
    }

    fn see_motion(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            known, limits, now, ..
        } = moment.play;
        prop_assert!(
            !known.on_station || known.told_to_leave,
            "driven off its contacts"
        );
        let began = *self.moves.get_or_insert(*now);
        let ends = match self.granted {
            Some((since, _)) => since + longest_grant(limits),
            None => began + WayHome::LONGEST_BLIND_MOVE,
        };
        moment.drives_until(ends)?;
        let blind_move = limits.blind_moves && known.not_found;
        prop_assert!(self.granted.is_some() || blind_move, "{:?}", known);
        Ok(())
    }

    fn see_grant(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            ..
        } = moment.play;
        let Some(by) = dog.grantee() else {
            self.granted = None;
            return Ok(());
        };
        prop_assert_eq!(known.rescuer, Some(by));
        prop_assert!(limits.rescue != Rescue::Off);
        let (since, whose) = *self.granted.get_or_insert((*now, by));
        prop_assert_eq!(whose, by);
        moment.drives_until(since + longest_grant(limits))
    }
}

/// Since when a robot with a low battery waits for BASE_FIND.
#[derive(Debug, Default)]
pub(super) struct LongestWait(Option<Instant>);

impl LongestWait {
    /// A robot that is low, online and not charging, that no person has stopped, and that does not
    /// report 0 % on its contacts, is sent BASE_FIND again within this time.
    fn longest(limits: &Limits) -> Duration {
        let moment = Duration::from_secs(1);
        let pause = limits.dock_pause.get().max(moment);
        let on_contact = limits.charge_timeout.get() * 2 + DockTracker::LONGEST_LEAVING;
        let driven = longest_grant(limits) + WayHome::LONGEST_BLIND_MOVE;
        limits.dock_timeout.get() + on_contact + pause + driven + moment
    }

    pub(super) fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            slept,
        } = moment.play;
        let charges = dog.dock_state() == DockState::Charging || dog.is_flat();
        let waits = known.online && known.low && !charges && !known.stopped;
        if !waits || moment.sends(&FIND) {
            self.0 = waits.then_some(*now);
            return Ok(());
        }
        let since = *self.0.get_or_insert(*now);
        let since = slept.map_or(since, |slept| slept.max(since));
        let waited = *now - since;
        prop_assert!(
            waited <= LongestWait::longest(limits),
            "{:?}: {:?}",
            waited,
            known
        );
        Ok(())
    }
}
