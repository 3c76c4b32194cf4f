//! All safety rules combined: facts, requests and the time go in, acts come out.
//!
//! Every command that can move the robot is made here and nowhere else. A behaviour's motion
//! request goes through the [`Arbiter`], then through [`Watchdog::refusal`]; if it passes,
//! [`Tracks`] sends it.
//!
//! A docking belongs to the callers that wait for it and has the highest of their priorities. Like
//! a setpoint, it is refused while a higher priority drives, ends as `preempted` when a higher
//! priority wants to drive, and is cancelled only by its own callers and by equal or higher
//! priorities.

use std::time::Duration;

use tokio::time::Instant;

use super::docking::{ActiveDocking, Caller};
use super::{
    ALARM, Act, AfterRecharge, Arbiter, BatteryChange, BatteryMonitor, Charging, DockAction,
    DockState, DockTracker, Docking, Fact, Homing, HomingStep, HostLife, LastWords, Leases, Limits,
    LowCause, MotorLoad, PowerGauge, Recharge, Rescue, Tracks, capped,
};
use crate::robot::{
    Battery, BehaviourId, DockEnd, DockOutcome, DockPlan, EndReason, Event, Intent, MotionEnd,
    MotionId, Percent, Priority, STOP_HOLDS, SafetyAction, Setpoint, WatchdogState,
};
use crate::wire::{Command, Engage, EngineReport, Power};

/// The shortest timeout of a docking: with none at all there would be nothing to wait for.
const SHORTEST: Duration = Duration::from_millis(1);

/// The longest duration, thirty days; longer ones are shortened to it. A host may send any
/// duration, and adding it to the clock could overflow.
const LONGEST: Duration = Duration::from_secs(30 * 24 * 60 * 60);

/// The most calls that may wait for a docking; further requests are refused.
const MAX_CALLERS: usize = 64;

#[derive(Debug, Clone)]
struct Leaving {
    caller: Caller,
    until: Instant,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DockReport {
    /// The behaviour that asked for it first; `None` for the watchdog's own docking.
    pub by: Option<BehaviourId>,
    pub outcome: DockOutcome,
}

/// The safety rules as one state machine.
#[derive(Debug, Clone)]
pub struct Watchdog {
    limits: Limits,
    online: bool,
    /// A guardian answers, or none is wanted.
    guarded: bool,
    /// Without a guardian: until then setpoints are held.
    held_until: Option<Instant>,
    run_ending: bool,
    stopped_by_person: bool,
    dock_tracker: DockTracker,
    /// BASE_FIND was sent, and neither a report of the robot nor another command has ended the
    /// search.
    searching: bool,
    /// BASE_FIND was sent, and no report of the robot has ended the search: a stop alone may not end
    /// it, and a link may lose the BASE_FIND_CANCEL.
    may_search: bool,
    power_gauge: PowerGauge,
    battery_monitor: BatteryMonitor,
    arbiter: Arbiter,
    leases: Leases,
    tracks: Tracks,
    docking: Option<ActiveDocking>,
    leaving: Option<Leaving>,
    homing: Option<Homing>,
    recharge: Recharge,
    rescuer: Option<BehaviourId>,
    /// Since when the robot reports 0 % on its contacts.
    flat_since: Option<Instant>,
    streaming: bool,
    /// Since when the robot has moved without sending anything, pauses in the motion included.
    silent_motion_since: Option<Instant>,
    /// The time of the last [`Watchdog::poll`].
    ticked: Instant,
    acts: Vec<Act>,
    dock_report: Option<DockReport>,
}

impl Watchdog {
    /// The power with which a behaviour's docking backs off between attempts, percent.
    const BACK_OFF_PERCENT: f64 = 30.0;
    /// Of so many searches the rescue behaviour cannot give up the first before [`Watchdog::FULL_SEARCH`].
    const FULL_SEARCH_EVERY: u32 = 4;
    /// Of the simulated genuine robots that docked in flats, 55 of 74 did so within this time of the search's begin.
    const FULL_SEARCH: Duration = Duration::from_secs(60);
    /// The mean power of both tracks with which a robot is taken to search for its station.
    const SEARCH_EFFORT: f64 = 0.3;
    /// How long 0 % on the contacts may mean that the battery charges.
    const FLAT_TIME: Duration = Duration::from_secs(15 * 60);
    /// How long setpoints are held without a guardian; then they end.
    const LONGEST_HOLD: Duration = Duration::from_secs(3);

    // Construction, facts in, acts out.

    /// Begins without a link; nothing moves.
    pub fn new(limits: Limits, now: Instant) -> Watchdog {
        Watchdog {
            power_gauge: PowerGauge::new(limits.power),
            battery_monitor: BatteryMonitor::new(&limits),
            leases: Leases::new(limits.host_silence.get(), limits.host_grace.get()),
            dock_tracker: DockTracker::new(limits.charge_timeout.get()),
            limits,
            online: false,
            guarded: true,
            held_until: None,
            run_ending: false,
            stopped_by_person: false,
            searching: false,
            may_search: false,
            arbiter: Arbiter::default(),
            tracks: Tracks::new(now),
            docking: None,
            leaving: None,
            homing: None,
            recharge: Recharge::default(),
            rescuer: None,
            flat_since: None,
            streaming: false,
            silent_motion_since: None,
            ticked: now,
            acts: Vec::new(),
            dock_report: None,
        }
    }

    /// Returns the docking that has ended since the last call, if one has.
    pub fn take_dock_report(&mut self) -> Option<DockReport> {
        self.dock_report.take()
    }

    /// Takes a fact in and returns what to do now.
    pub fn handle(&mut self, fact: Fact, now: Instant) -> Vec<Act> {
        self.apply(fact, now);
        self.poll(now)
    }

    /// Takes a fact in without returning acts: they come with the next [`Watchdog::poll`] or
    /// [`Watchdog::handle`], which must follow immediately. For facts that arrive together.
    pub fn apply(&mut self, fact: Fact, now: Instant) {
        match fact {
            Fact::LinkUp { docked, power } => self.link_up(docked, power, now),
            Fact::LinkDown => self.link_down(now),
            Fact::BytesReceived => self.note_received(now),
            Fact::Power(power) => self.power(power, now),
            Fact::Engine(news) => self.engine(news, now),
            Fact::Pace(period) => self.tracks.set_pace(period),
            Fact::Streaming(on) => {
                if on && !self.streaming {
                    self.note_received(now);
                }
                self.streaming = on;
            }
            Fact::Alive(by) => self.leases.renew(by, now),
            Fact::Gone(by) => self.gone(by, now),
            Fact::Rescuer(by) => self.set_rescuer(by, now),
            Fact::Suspended => self.resume(now),
            Fact::Stalled {
                gap,
                guardian_wrote,
            } => self.end_stall(gap, guardian_wrote, now),
            Fact::StoppedByPerson(stopped) => self.set_stopped(stopped, now),
            Fact::Guarded(guarded) => self.set_guarded(guarded, now),
            Fact::RunEnding => self.end_run(now),
        }
    }

    /// Advances the time and returns what to do now.
    pub fn poll(&mut self, now: Instant) -> Vec<Act> {
        self.ticked = now;
        self.check_hold(now);
        self.check_hosts(now);
        self.check_stream(now);
        let over = self.arbiter.expire(now);
        self.acts.extend(over);
        self.check_flat(now);
        self.check_place(now);
        self.check_power_silence(now);
        self.continue_docking(now);
        // Before the recharge, which waits until nobody is leaving the station.
        self.check_leaving(now);
        self.check_recharge(now);
        self.sound_alarm(now);
        self.drive(now);
        std::mem::take(&mut self.acts)
    }

    /// Notes whether a MOVE with a new setpoint waits for or in the robot's queue; it may also wait
    /// here. Tells of the timed setpoint that has begun to wait, or has begun after it
    /// waited.
    pub fn note_setpoint_queued(&mut self, queued: bool, now: Instant) -> Option<Act> {
        let waits = queued || self.arbiter.setpoint() != self.tracks.last_sent();
        self.arbiter.set_waiting(waits, now)
    }

    /// When [`Watchdog::poll`] has something to do, seen from its last call. A time in the past
    /// means at once.
    pub fn next_deadline(&self) -> Option<Instant> {
        if !self.online {
            return None;
        }
        let docking = match &self.docking {
            Some(active) if !self.may_charge() && !self.waits_flat() => {
                active.docking.next_deadline()
            }
            _ => None,
        };
        let silence = if self.docked() {
            None
        } else {
            self.battery_monitor.next_deadline()
        };
        [
            self.arbiter.next_deadline(),
            self.leases
                .next_deadline(self.arbiter.claimants(), self.ticked),
            self.tracks.next_deadline(),
            self.stream_deadline(),
            self.leaving.as_ref().map(|leaving| leaving.until),
            self.dock_tracker
                .next_deadline(self.battery_monitor.low().is_some()),
            self.homing.as_ref().and_then(Homing::alarm_deadline),
            self.between_searches()
                .and_then(|homing| homing.next_deadline(self.ticked)),
            silence,
            self.held_until,
            self.flat_deadline(),
            self.battery_monitor.unconfirmed_deadline(),
            self.recharge_due(),
            docking,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    // What others may know.

    /// The state shown in the status line.
    pub fn state(&self) -> WatchdogState {
        if !self.online {
            WatchdogState::Offline
        } else if self.is_alarming() {
            WatchdogState::Alarm
        } else if self.docked() {
            WatchdogState::Docked
        } else if self.battery_monitor.low().is_some() {
            WatchdogState::LowGoingHome
        } else if self.docking.is_some() {
            WatchdogState::Docking
        } else {
            WatchdogState::Free
        }
    }

    /// Why the battery counts as low; `None` if it does not, or the robot was released.
    pub fn low(&self) -> Option<LowCause> {
        self.battery_monitor.low()
    }

    pub fn dock_state(&self) -> DockState {
        self.dock_tracker.dock_state()
    }

    /// Whether the robot is on its station, by its own report or because it charges.
    pub fn docked(&self) -> bool {
        self.dock_tracker.on_station()
    }

    /// What is believed of the battery, without an estimate of the minutes left; `None` before the
    /// first report.
    pub fn battery(&self) -> Option<Battery> {
        if !self.battery_monitor.has_report() {
            return None;
        }
        Some(Battery {
            percent: self.battery_monitor.level(),
            charging: self.battery_monitor.charging() == Charging::Confirmed,
            minutes_left: None,
        })
    }

    /// Whether the number in POWER is taken for a voltage.
    pub fn reads_voltage(&self) -> bool {
        self.power_gauge.is_voltage()
    }

    /// Whether it is on its station and was not told to leave it: it does not drive.
    pub fn is_docked_and_still(&self) -> bool {
        self.docked() && !self.is_robot_moving()
    }

    /// The last [`Fact::Guarded`]; `true` before the first.
    pub fn is_guarded(&self) -> bool {
        self.guarded
    }

    /// Whether the last setpoint sent to the tracks moves them.
    pub fn moving(&self) -> bool {
        self.tracks.moving_since().is_some()
    }

    /// Whether the robot may be in motion: its tracks were told to move, it searches for its
    /// station, or it leaves it.
    pub fn is_robot_moving(&self) -> bool {
        self.moving() || self.searching || self.leaving.is_some() || self.dock_tracker.is_leaving()
    }

    /// Why no behaviour, except one that the tracks are granted to, may move the robot now; `None`
    /// if all may, though their setpoints may be held.
    pub fn refusal(&self) -> Option<MotionEnd> {
        if !self.online {
            Some(MotionEnd::Disconnected)
        } else if self.run_ending {
            Some(MotionEnd::Cancelled)
        } else if !(self.guarded || self.held_until.is_some())
            || self.stopped_by_person
            || self.battery_monitor.low().is_some()
            || self.battery_monitor.critical()
        {
            Some(MotionEnd::Safety)
        } else if self.docked() || self.dock_tracker.is_leaving() {
            Some(MotionEnd::Docked)
        } else if self.docking.is_some() {
            Some(MotionEnd::Preempted)
        } else {
            None
        }
    }

    /// The commands to send if the agent dies now; valid once the last batch of acts is executed.
    ///
    /// - [`LastWords::Nothing`] on the station, unless the robot backs out of it, and while the
    ///   robot searches for it because its battery is low.
    /// - [`LastWords::StopAndDock`] in all other cases of a low battery: waiting for the next
    ///   search, driven by the watchdog or a grantee, or backing out of the station.
    /// - [`LastWords::Stop`] otherwise: with a good battery the robot stays where it is until
    ///   somebody controls it again, also if a behaviour asked for a search.
    ///
    /// Without a link, these commands are sent if a login is given up half way: a stop, and
    /// BASE_FIND if the battery was low and the robot not known to be on its station, or else
    /// BASE_FIND_CANCEL.
    pub fn last_words(&self) -> LastWords {
        let low = self.battery_monitor.low().is_some();
        let stays = self.docked() && !self.dock_tracker.is_leaving();
        if self.online && (stays || (low && self.searching)) {
            LastWords::Nothing
        } else if low && !stays {
            LastWords::StopAndDock
        } else {
            LastWords::Stop
        }
    }

    /// Whether a rescue behaviour should be running: the robot is not on its station, and its battery
    /// is low or a docking that somebody asked for wants it. True some time before the first grant, so
    /// that its host has time to start.
    pub fn wants_rescue(&self) -> bool {
        let docking = self.docking.as_ref();
        let asked = docking.is_some_and(ActiveDocking::wants_rescue);
        let off = self.run_ending || self.stopped_by_person || self.limits.rescue == Rescue::Off;
        !off && (asked || self.battery_monitor.low().is_some()) && !self.is_in_place()
    }

    /// Whether to switch off everything that the way home does not need: the battery is nearly
    /// empty and does not charge. The rescue behaviour's camera and the alarm are needed.
    pub fn shed(&self) -> bool {
        self.battery_monitor.critical() && self.dock_state() != DockState::Charging
    }

    /// Whether the alarm controls volume, headlight and sounds. It sets the volume to 100 % each
    /// time, because a script may have set it to 0 before. The volume is not restored: after the
    /// alarm it stays until the next script sets it.
    pub fn alarm_sounds(&self) -> bool {
        self.is_alarming() && self.online
    }

    // The link and the life of the run.

    /// While a person's STOP holds, a robot with a low battery stays where it is: its way home is
    /// interrupted, and goes on from there when STOP is released.
    fn set_stopped(&mut self, stopped: bool, now: Instant) {
        if !stopped && !self.stopped_by_person {
            return;
        }
        // It holds until the dockings that it ends have ended, also when it is released.
        self.stopped_by_person = true;
        self.end_motion(MotionEnd::Safety);
        let away = !self.docked();
        let is_over = |one: &ActiveDocking| one.is_asked() || (one.forced && away);
        if self.docking.as_ref().is_some_and(is_over) {
            self.end_docking(DockEnd::Cancelled, now);
        }
        self.interrupt_homing(now);
        if !stopped
            && away
            && self.online
            && let Some(cause) = self.low()
        {
            let reason = format!("{cause}: goes home, STOP is released");
            self.announce(SafetyAction::Dock, reason);
        }
        self.stopped_by_person = stopped;
    }

    fn link_up(&mut self, docked: bool, power: Power, now: Instant) {
        if self.online {
            self.link_down(now);
        }
        self.online = true;
        self.streaming = false;
        let low = self.battery_monitor.low().is_some() && !self.is_flat();
        self.dock_tracker.login(docked, low, now);
        self.tracks.note_stop(now);
        self.cancel_earlier_search(now);
        self.note_received(now);
        self.search_at_once(now);
        self.power(power, now);
    }

    fn note_received(&mut self, now: Instant) {
        self.silent_motion_since = self.tracks.moving_since().map(|_| now);
    }

    fn link_down(&mut self, now: Instant) {
        self.online = false;
        self.searching = false;
        self.tracks.note_stop(now);
        self.end_motion(MotionEnd::Disconnected);
        if let Some(leaving) = self.leaving.take() {
            self.answer_undock(leaving.caller, DockEnd::Disconnected);
        }
        if let Some(active) = &mut self.docking {
            active.docking.cancel(DockEnd::Disconnected, now);
            self.answer_docking(now);
        }
        self.answer_waiting(DockEnd::Disconnected, now);
        self.interrupt_homing(now);
    }

    /// Handles the end of a suspension. Nothing old is repeated: all requests end as if the link
    /// had been lost, the tracks stop, and a robot with a low battery searches at once.
    fn resume(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        self.link_down(now);
        self.online = true;
        self.cancel_earlier_search(now);
        self.stop_tracks(now);
        self.dock_tracker.contradict_leaving();
        self.search_at_once(now);
    }

    /// Handles the end of a stall, whose time counts neither as a host's silence nor as the robot's.
    /// The tracks stop; a setpoint moves them again as soon as its host shows life. A search or an
    /// undocking that the guardian has ended begins again.
    fn end_stall(&mut self, gap: Duration, guardian_wrote: bool, now: Instant) {
        self.leases.excuse_stall(now);
        let moving: Vec<BehaviourId> = self.arbiter.claimants().collect();
        for by in moving {
            self.arbiter.hold(by, true);
        }
        if !self.online {
            return;
        }
        if self.moving() {
            self.stop_tracks(now);
        }
        if let Some(since) = &mut self.silent_motion_since {
            *since = now.min(*since + gap);
        }
        if !guardian_wrote {
            return;
        }
        let searches = |active: &ActiveDocking| active.docking.is_searching();
        match self.docking.as_ref().map(searches) {
            Some(true) if !self.docked() => {
                self.execute_dock_actions(vec![DockAction::Find], now);
            }
            Some(_) => {}
            None => self.search_at_once(now),
        }
        if self.dock_tracker.is_leaving() {
            self.send(Command::Engine(Engage::Undock));
        }
    }

    /// Without a guardian nothing drives, because nothing would stop the robot if this program died
    /// too: the tracks stop, and dockings and undockings end. Setpoints are held: they move the robot
    /// again if a guardian answers soon. A robot with a low battery still searches.
    fn set_guarded(&mut self, guarded: bool, now: Instant) {
        if std::mem::replace(&mut self.guarded, guarded) == guarded {
            return;
        }
        self.held_until = None;
        if guarded {
            let reason = "a guardian process watches again: the robot may move";
            return self.announce(SafetyAction::Release, reason.to_owned());
        }
        let reason = "no guardian process answers, which would stop the robot if this program \
                      died: the robot stands until one does";
        self.announce(SafetyAction::Hold, reason.to_owned());
        if !self.online {
            return;
        }
        if self.homing.is_some() {
            self.end_motion(MotionEnd::Safety);
        } else {
            self.held_until = Some(now + Watchdog::LONGEST_HOLD);
        }
        if let Some(leaving) = self.leaving.take() {
            self.answer_undock(leaving.caller, DockEnd::Safety);
        }
        if self.docking.as_ref().is_some_and(|active| active.forced) {
            return;
        }
        self.end_docking(DockEnd::Safety, now);
        self.interrupt_homing(now);
        self.cancel_earlier_search(now);
        self.stop_tracks(now);
        self.dock_tracker.contradict_leaving();
        self.search_at_once(now);
    }

    fn check_hold(&mut self, now: Instant) {
        if self.held_until.take_if(|until| *until <= now).is_some() {
            self.end_motion(MotionEnd::Safety);
        }
    }

    /// Stops all motion. If the watchdog sends the robot home, BASE_FIND is sent again, since the
    /// stop may have ended the search.
    fn end_run(&mut self, now: Instant) {
        self.run_ending = true;
        self.end_motion(MotionEnd::Cancelled);
        self.cancel_docks(None, now);
        if !self.online {
            return;
        }
        self.stop_tracks(now);
        if self.docking.is_none() {
            self.search_at_once(now);
        }
        if self.docking.as_ref().is_some_and(|active| active.forced) && !self.docked() {
            self.send(Command::Engine(Engage::Dock));
        }
    }

    // From POWER to stop and BASE_FIND.

    fn power(&mut self, power: Power, now: Instant) {
        let power = Power {
            charging: power.charging && !self.dock_tracker.has_just_left(now),
            ..power
        };
        let load = self.motor_load();
        let power = self.power_gauge.read(power, load, now);
        let was_critical = self.battery_monitor.critical();
        let contact = self.dock_tracker.has_contact();
        let change = self.battery_monitor.report(power, contact, now);
        let was_docked = self.docked();
        let charges = self.battery_monitor.charging() != Charging::No;
        self.dock_tracker.power(charges, now);
        if self.docked() && !was_docked {
            self.end_motion(MotionEnd::Docked);
            self.interrupt_homing(now);
        }
        self.apply_battery_change(change, now);
        if self.battery_monitor.critical() && !was_critical {
            if self.grantee().is_none() {
                self.end_motion(MotionEnd::Safety);
            }
            let reason = format!(
                "battery at {} %: motion is refused except on the way home",
                power.percent
            );
            self.announce(SafetyAction::Hold, reason);
        }
    }

    fn motor_load(&self) -> MotorLoad {
        let effort = if self.moving() {
            self.tracks.last_sent().effort()
        } else if self.is_robot_moving() {
            Watchdog::SEARCH_EFFORT
        } else {
            0.0
        };
        let since = self.tracks.moving_since();
        MotorLoad {
            effort,
            since: since.unwrap_or(self.tracks.sent_at()),
        }
    }

    /// Acts on the charging state, and on a change of the battery's state if there is one.
    fn apply_battery_change(&mut self, change: Option<BatteryChange>, now: Instant) {
        let charging = self.charging_here();
        let actions = match &mut self.docking {
            None => vec![],
            Some(active) => match charging {
                Charging::No => vec![],
                Charging::Unconfirmed => active.docking.wait(),
                Charging::Confirmed => active.docking.charging(now),
            },
        };
        if charging == Charging::Confirmed {
            self.search_ended();
            self.end_alarm();
        }
        self.execute_dock_actions(actions, now);
        match change {
            Some(BatteryChange::BecameLow(cause)) => self.became_low(cause, now),
            Some(BatteryChange::Released) => self.released(now),
            None => {}
        }
    }

    /// Whether a single unconfirmed report says that the robot charges: nothing may drive it away
    /// then.
    fn may_charge(&self) -> bool {
        self.charging_here() == Charging::Unconfirmed
    }

    fn charging_here(&self) -> Charging {
        match self.dock_state() {
            DockState::Charging => self.battery_monitor.charging(),
            _ => Charging::No,
        }
    }

    /// The rule with the highest precedence: stop and go home, in one batch of acts.
    fn became_low(&mut self, cause: LowCause, now: Instant) {
        self.recharge.forget();
        self.end_motion(MotionEnd::Safety);
        self.dock_tracker.expect_charge(now);
        if let Some(battery) = self.battery() {
            self.acts.push(Act::Announce(Event::BatteryLow(battery)));
        }
        if self.docked() {
            let reason = format!("{cause}: stays on the station and waits for charging");
            self.announce(SafetyAction::Hold, reason);
        } else if self.stopped_by_person {
            let reason = format!("{cause}: stays where it is; {STOP_HOLDS}");
            self.announce(SafetyAction::Hold, reason);
        } else {
            self.announce(SafetyAction::Dock, format!("{cause}: stops and goes home"));
        }
        self.homing = Some(Homing::new(&self.limits, now));
        self.pursue_home(now);
    }

    /// Starts or continues the way home if the battery is low and no docking of the watchdog's is
    /// under way: waits on the station for charging, or begins the next search or blind move when
    /// it is due. A behaviour's docking becomes the watchdog's own.
    fn pursue_home(&mut self, now: Instant) {
        let underway = matches!(&self.docking, Some(active) if active.forced);
        if !self.online || self.battery_monitor.low().is_none() || underway {
            return;
        }
        if self.docked() {
            return self.send_home(now);
        }
        if self.is_flat() || self.stopped_by_person {
            return;
        }
        if self.docking.is_some() {
            self.search_at_once(now);
        }
        let may_drive = self.may_move_blindly();
        let Some(homing) = &mut self.homing else {
            return;
        };
        match homing.poll(may_drive, now) {
            None => {}
            Some(HomingStep::Search) => self.send_home(now),
            // A blind move in place of a grant that was not used.
            Some(next) => {
                self.end_motion(MotionEnd::Safety);
                let reason = format!("no behaviour has driven: {next}");
                self.announce(SafetyAction::Dock, reason);
            }
        }
    }

    /// Begins a search of the watchdog's own or, on the station, the wait for charging.
    fn send_home(&mut self, now: Instant) {
        let plan = self.own_dock_plan(0);
        if let Some(active) = self.docking.take()
            && let Some(homing) = &mut self.homing
        {
            homing.callers.extend(active.callers);
        }
        self.end_motion(MotionEnd::Safety);
        self.start_docking(plan, true, vec![], now);
    }

    fn start_docking(&mut self, plan: DockPlan, forced: bool, callers: Vec<Caller>, now: Instant) {
        self.end_motion(MotionEnd::Preempted);
        let (docking, actions) = Docking::start(plan, forced, self.docked(), now);
        let active = ActiveDocking {
            docking,
            forced,
            callers,
        };
        self.begin_docking(active, actions, now);
    }

    fn begin_docking(&mut self, active: ActiveDocking, actions: Vec<DockAction>, now: Instant) {
        self.tracks.want(Setpoint::STOP);
        self.docking = Some(active);
        self.execute_dock_actions(actions, now);
    }

    /// The plan of a docking that no behaviour has asked for.
    fn own_dock_plan(&self, retries: u32) -> DockPlan {
        DockPlan {
            timeout: self.limits.dock_timeout.get(),
            retries,
            charge_timeout: self.limits.charge_timeout.get(),
        }
    }

    fn continue_docking(&mut self, now: Instant) {
        if !self.online || self.may_charge() {
            return;
        }
        self.watch_grantee(now);
        let waits = self.waits_flat();
        if let Some(active) = &mut self.docking
            && !waits
        {
            let actions = active.docking.poll(now);
            self.execute_dock_actions(actions, now);
        }
        self.pursue_home(now);
    }

    /// Executes the docking's actions, then checks whether it has ended.
    fn execute_dock_actions(&mut self, actions: Vec<DockAction>, now: Instant) {
        for action in actions {
            match action {
                DockAction::Find => {
                    self.end_motion(MotionEnd::Preempted);
                    self.stop_tracks(now);
                    self.send(Command::Engine(Engage::Dock));
                }
                DockAction::Cancel => self.cancel_search(now),
                DockAction::Reverse => self.drive_elsewhere(now),
                DockAction::Stop => {
                    self.end_motion(MotionEnd::Preempted);
                    self.stop_tracks(now);
                }
                DockAction::Undock => {
                    let timeout = Docking::LEAVE_TIMEOUT;
                    self.dock_tracker.leave_station(timeout, now);
                    self.send(Command::Engine(Engage::Undock));
                }
            }
        }
        self.answer_docking(now);
    }

    /// Between two attempts of a docking: the rescue behaviour drives, if there is one; else the robot
    /// backs off.
    fn drive_elsewhere(&mut self, now: Instant) {
        self.stop_tracks(now);
        let least = self.limits.rescue_time.get();
        if let Some(by) = self.grantable()
            && let Some(active) = &mut self.docking
            && active.wants_rescue()
        {
            let time = active.docking.grant(by, least, now);
            self.tell_grant(by, time);
            let next = HomingStep::DriveGrant { by, time };
            return self.announce(SafetyAction::Dock, format!("docking failed: {next}"));
        }
        let back = -Watchdog::BACK_OFF_PERCENT;
        let setpoint = Setpoint::from_percent(back, back);
        self.tracks.want(setpoint.unwrap_or(Setpoint::STOP));
    }

    /// Answers the calls that wait for a docking that has ended; a failure of the watchdog's own
    /// goes to [`Watchdog::handle_failed_search`].
    fn answer_docking(&mut self, now: Instant) {
        let over = |active: &mut ActiveDocking| active.docking.outcome().is_some();
        let Some(active) = self.docking.take_if(over) else {
            return;
        };
        let Some(outcome) = active.docking.outcome() else {
            return;
        };
        if self.recharge.is_docking() {
            self.recharge_ended(outcome, now);
        }
        // The watchdog's own docking has no callers: those wait for the way home.
        let by = active.callers.first().map(|caller| caller.by);
        self.dock_report = Some(DockReport { by, outcome });
        for caller in active.callers {
            self.answer_dock(caller, outcome);
        }
        if !active.forced {
            return;
        }
        match outcome.end {
            DockEnd::Done | DockEnd::AlreadyDocked => self.answer_waiting(DockEnd::Done, now),
            DockEnd::Cancelled if self.stopped_by_person => {
                self.answer_waiting(DockEnd::Cancelled, now);
            }
            DockEnd::Disconnected => self.answer_waiting(DockEnd::Disconnected, now),
            end => self.handle_failed_search(end, now),
        }
    }

    /// Tells the callers that wait for the watchdog's way home how it ended.
    fn answer_waiting(&mut self, end: DockEnd, now: Instant) {
        let Some(homing) = &mut self.homing else {
            return;
        };
        let callers = std::mem::take(&mut homing.callers);
        let attempts = homing.failures() + u32::from(end == DockEnd::Done);
        let took = now.saturating_duration_since(homing.began());
        let outcome = DockOutcome {
            end,
            attempts,
            took,
        };
        for caller in callers {
            self.answer_dock(caller, outcome);
        }
    }

    /// The battery is good again: the way home ends where it is. A docking under way continues for
    /// the behaviours that wait for it.
    fn released(&mut self, now: Instant) {
        self.end_alarm();
        let mut callers = Vec::new();
        if let Some(homing) = self.homing.take() {
            callers = homing.callers;
            self.end_motion(MotionEnd::Safety);
        }
        if let Some(battery) = self.battery() {
            let reason = match battery.percent {
                Some(percent) => format!("battery at {percent}"),
                None => "the battery charges, at an unknown level".to_owned(),
            };
            self.announce(SafetyAction::Release, reason);
            self.acts.push(Act::Announce(Event::BatteryOk(battery)));
        }
        match &mut self.docking {
            Some(active) if active.forced && callers.is_empty() => {
                self.end_docking(DockEnd::Cancelled, now);
            }
            Some(active) if active.forced => {
                active.forced = false;
                active.callers = callers;
            }
            _ => {
                for caller in callers {
                    self.answer_dock(caller, DockOutcome::without_attempt(DockEnd::Safety));
                }
            }
        }
    }

    // Between two searches.

    fn handle_failed_search(&mut self, end: DockEnd, now: Instant) {
        let rescuer = self.grantable();
        let may_drive = self.may_move_blindly();
        let stuck = end == DockEnd::NotCharging && self.dock_state() == DockState::Unknown;
        let Some(homing) = &mut self.homing else {
            return;
        };
        let next = homing.search_failed(end, rescuer, may_drive, now);
        let failures = homing.failures();
        if homing.has_failed_too_often() || stuck {
            homing.start_alarm(now);
            self.answer_waiting(DockEnd::Safety, now);
        }
        let action = if self.is_alarming() {
            SafetyAction::Alarm
        } else {
            SafetyAction::Dock
        };
        if let HomingStep::DriveGrant { by, time } = next {
            self.tell_grant(by, time);
        }
        self.announce(
            action,
            format!("docking failed ({end}) {failures} times: {next}"),
        );
    }

    /// The behaviour that the tracks may be granted to.
    fn grantable(&self) -> Option<BehaviourId> {
        let off = self.run_ending || self.is_in_place() || self.limits.rescue == Rescue::Off;
        if off || self.stopped_by_person {
            None
        } else {
            self.rescuer
        }
    }

    fn tell_grant(&mut self, by: BehaviourId, seconds: Duration) {
        let power = self.limits.rescue_power;
        self.acts
            .push(Act::Tell(by, Event::DriveGrant { seconds, power }));
    }

    /// Notes whether the grantee drives, and ends its grant if its host falls silent meanwhile.
    fn watch_grantee(&mut self, now: Instant) {
        let Some(by) = self.grantee() else {
            return;
        };
        let moves = self.arbiter.claimants().any(|claimant| claimant == by);
        let silent = moves && self.leases.host_life(by, now) != HostLife::Alive;
        if let Some(homing) = &mut self.homing {
            homing.note_motion(moves, now);
        }
        if let Some(active) = &mut self.docking {
            active.docking.note_motion(moves, now);
        }
        if silent {
            self.end_grant(now);
        }
    }

    /// Whether a blind move is allowed: by the config, off the station, and before the run ends.
    fn may_move_blindly(&self) -> bool {
        let free = !self.run_ending && !self.stopped_by_person && self.guarded;
        free && !self.is_in_place() && self.limits.blind_moves
    }

    /// Whether it is on its station, or has reported contact and not that it has left: it may be on
    /// its contacts, and no blind move or grant drives it off them.
    fn is_in_place(&self) -> bool {
        self.docked() || self.dock_tracker.has_contact()
    }

    /// Whether it reports 0 % on its contacts. That may mean that it charges: the sign that says so
    /// cannot be told at 0 (`PROTOCOL.md`, *POWER*).
    fn is_flat(&self) -> bool {
        let empty = self.battery_monitor.level().map(Percent::get) == Some(0);
        empty && self.dock_tracker.has_contact() && !self.dock_tracker.is_leaving()
    }

    /// Whether it stands on its contacts for as long as it reports 0 %.
    fn waits_flat(&self) -> bool {
        let searches = |active: &ActiveDocking| active.docking.is_searching();
        self.is_flat() && !self.docking.as_ref().is_some_and(searches)
    }

    fn flat_deadline(&self) -> Option<Instant> {
        if self.homing.is_none() || self.is_alarming() {
            return None;
        }
        Some(self.flat_since? + Watchdog::FLAT_TIME)
    }

    /// Leaves a robot that reports 0 % on its contacts there, and calls a person if that lasts.
    fn check_flat(&mut self, now: Instant) {
        if !self.is_flat() {
            self.flat_since = None;
            return;
        }
        self.flat_since.get_or_insert(now);
        self.dock_tracker.excuse_contact(now);
        if !self.online || self.flat_deadline().is_none_or(|due| due > now) {
            return;
        }
        if let Some(homing) = &mut self.homing {
            homing.start_alarm(now);
        }
        self.answer_waiting(DockEnd::Safety, now);
        let minutes = Watchdog::FLAT_TIME.as_secs() / 60;
        self.announce(
            SafetyAction::Alarm,
            format!("battery at 0 % on the station for {minutes} min: it does not charge"),
        );
    }

    /// The way home, while the robot is in reach, off its station, and neither a docking is under way
    /// nor a person's STOP holds.
    fn between_searches(&self) -> Option<&Homing> {
        let may_go = self.online && !self.is_flat() && !self.stopped_by_person;
        if may_go && !self.docked() && self.docking.is_none() {
            self.homing.as_ref()
        } else {
            None
        }
    }

    fn homing_setpoint(&self, now: Instant) -> Setpoint {
        let blind_move = self
            .between_searches()
            .and_then(|homing| homing.setpoint(now));
        match blind_move {
            _ if !self.guarded => Setpoint::STOP,
            _ if self.grantee().is_some() => self.arbiter.setpoint(),
            Some(setpoint) if self.may_move_blindly() => setpoint,
            _ => Setpoint::STOP,
        }
    }

    fn grantee(&self) -> Option<BehaviourId> {
        match &self.docking {
            Some(_) if self.is_in_place() => None,
            Some(active) => active.docking.grantee(),
            None => self.between_searches().and_then(Homing::grantee),
        }
    }

    fn end_grant(&mut self, now: Instant) {
        if let Some(homing) = &mut self.homing {
            homing.end_drive(now);
        }
        if let Some(active) = &mut self.docking {
            let actions = active.docking.end_grant(now);
            self.execute_dock_actions(actions, now);
        }
    }

    /// Sets the behaviour that the tracks may be granted to. A grant to another behaviour ends.
    fn set_rescuer(&mut self, by: Option<BehaviourId>, now: Instant) {
        self.rescuer = by;
        let homing = self.homing.as_ref().and_then(Homing::grantee);
        let grantee = self.grantee().or(homing);
        if grantee.is_some_and(|grantee| by != Some(grantee)) {
            self.end_grant(now);
        }
    }

    /// Out of reach, or on the station: ends a grant, a blind move or a search.
    fn interrupt_homing(&mut self, now: Instant) {
        if let Some(homing) = &mut self.homing {
            homing.interrupt(now);
        }
    }

    /// The robot was moved, or its activity is not known: with a low battery it searches from there
    /// now.
    fn search_at_once(&mut self, now: Instant) {
        if let Some(homing) = &mut self.homing {
            homing.search_at_once(now);
        }
    }

    fn is_alarming(&self) -> bool {
        self.homing.as_ref().is_some_and(Homing::is_alarming)
    }

    fn sound_alarm(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        let Some(homing) = &mut self.homing else {
            return;
        };
        for command in homing.poll_alarm(self.limits.alarm_every.get(), now) {
            self.send(command);
        }
    }

    /// Ends the alarm and switches off the light if the alarm has switched it on.
    fn end_alarm(&mut self) {
        if let Some(off) = self.homing.as_mut().and_then(Homing::end_alarm) {
            self.send(off);
        }
    }

    // A station that no longer charges.

    /// Whether nothing else is under way and nobody drives.
    fn is_at_rest(&self) -> bool {
        let free = self.online && self.guarded && !self.run_ending && !self.stopped_by_person;
        let idle = self.docking.is_none() && self.homing.is_none() && self.leaving.is_none();
        free && idle && !self.dock_tracker.is_leaving()
    }

    /// When the robot leaves its station to dock again, or searches again for the station that it has
    /// left.
    fn recharge_due(&self) -> Option<Instant> {
        if !self.is_at_rest() {
            None
        } else if self.dock_state() == DockState::ContactReported {
            let level = self.battery_monitor.level()?;
            self.recharge.due(level, self.limits.low)
        } else {
            self.recharge.due_again()
        }
    }

    fn check_recharge(&mut self, now: Instant) {
        let driven = self.moving() && self.docking.is_none();
        match self.dock_state() {
            DockState::ContactReported if self.is_at_rest() => {
                if let Some(level) = self.battery_monitor.level() {
                    self.recharge.stand(level, self.limits.low, now);
                }
            }
            DockState::ContactReported => {}
            DockState::Charging if self.charging_here() == Charging::Confirmed => {
                self.recharge.forget();
            }
            DockState::Charging => {}
            DockState::Left | DockState::Unknown => {
                if driven || !self.recharge.is_away() {
                    self.recharge.forget();
                }
            }
        }
        if self.recharge_due().is_some_and(|due| due <= now) {
            self.dock_again(now);
        }
    }

    /// Docks again, from the station or off it. Nothing of it is forced: a behaviour that wants to
    /// drive ends it.
    fn dock_again(&mut self, now: Instant) {
        let plan = self.own_dock_plan(DockPlan::default().retries);
        let level = self.battery_monitor.level();
        self.recharge.begin(level, self.limits.low);
        if !self.docked() {
            return self.start_docking(plan, false, vec![], now);
        }
        let at = level.map_or_else(String::new, |level| format!(", at {level}"));
        let reason = format!("its station does not charge{at}: leaves it and docks again");
        self.announce(SafetyAction::Dock, reason);
        self.end_motion(MotionEnd::Docked);
        let (docking, actions) = Docking::leave(plan, now);
        let active = ActiveDocking {
            docking,
            forced: false,
            callers: vec![],
        };
        self.begin_docking(active, actions, now);
    }

    fn recharge_ended(&mut self, outcome: DockOutcome, now: Instant) {
        let end = outcome.end;
        match self.recharge.ended(end, now) {
            AfterRecharge::Nothing => {}
            AfterRecharge::Again(pause) => {
                let seconds = pause.as_secs();
                let reason = format!("docking again failed ({end}): tries again in {seconds} s");
                self.announce(SafetyAction::Dock, reason);
            }
            AfterRecharge::Alarm => {
                let place = if outcome.attempts == 0 {
                    "it does not leave its station, which does not charge"
                } else if self.docked() {
                    "its station does not charge"
                } else {
                    "it does not get back onto its station, which did not charge"
                };
                self.announce(
                    SafetyAction::Alarm,
                    format!("docking again failed ({end}): {place}"),
                );
                for command in ALARM {
                    self.send(command);
                }
            }
        }
    }

    // ENGINE.

    fn engine(&mut self, news: EngineReport, now: Instant) {
        match news {
            EngineReport::Docked => {
                self.search_ended();
                self.dock_tracker.docked(now);
                self.end_motion(MotionEnd::Docked);
                self.interrupt_homing(now);
            }
            EngineReport::Undocked => self.undocked(now),
            EngineReport::BaseNotFound => self.search_ended(),
            EngineReport::Charged => self.battery_monitor.full(),
            EngineReport::Unknown(_) => {}
        }
        if let Some(active) = &mut self.docking {
            let actions = active.docking.engine(news, now);
            self.execute_dock_actions(actions, now);
        }
        if news == EngineReport::Undocked && self.docking.is_none() {
            self.search_at_once(now);
        }
        let change = match news {
            EngineReport::Docked => self.battery_monitor.contact(now),
            _ => None,
        };
        self.apply_battery_change(change, now);
    }

    fn undocked(&mut self, now: Instant) {
        self.dock_tracker.undocked(now);
        self.battery_monitor.undocked(now);
        self.battery_monitor.excuse_silence(now);
        if let Some(leaving) = self.leaving.take() {
            self.answer_undock(leaving.caller, DockEnd::Done);
        }
    }

    fn cancel_search(&mut self, now: Instant) {
        self.send(Command::Engine(Engage::CancelDock));
        self.stop_tracks(now);
    }

    /// Ends a search from before the link was lost or the machine slept, unless the battery is low:
    /// then another search follows.
    fn cancel_earlier_search(&mut self, now: Instant) {
        if self.may_search && self.battery_monitor.low().is_none() {
            self.cancel_search(now);
        }
    }

    /// The robot's reports show that it does not search.
    fn search_ended(&mut self) {
        self.searching = false;
        self.may_search = false;
    }

    // Requests.

    /// Takes in what a behaviour asks of the robot, like [`Watchdog::apply`]: the acts come with
    /// the next [`Watchdog::poll`], which must follow immediately. An intent that moves nothing is
    /// ignored.
    pub fn request(&mut self, by: BehaviourId, priority: Priority, intent: Intent, now: Instant) {
        self.leases.renew(by, now);
        let caller = |call| Caller { by, priority, call };
        match intent {
            Intent::Move {
                motion,
                setpoint,
                duration,
            } => self.move_asked(by, priority, motion, setpoint, duration, now),
            Intent::Release { motion } => {
                let over = self.arbiter.release(by, motion);
                self.acts.extend(over);
            }
            Intent::Stop => self.stop_asked(by, priority, now),
            Intent::Dock { call, plan } => self.dock_asked(caller(call), plan, now),
            Intent::Undock { call, timeout } => self.undock_asked(caller(call), timeout, now),
            Intent::CancelDock if self.rescuer == Some(by) => self.give_up_search(by, now),
            Intent::CancelDock => self.cancel_docks(Some((by, priority)), now),
            Intent::Led { .. }
            | Intent::Play(_)
            | Intent::StopSound
            | Intent::Volume(_)
            | Intent::Say(_)
            | Intent::Stream { .. } => {}
        }
    }

    fn move_asked(
        &mut self,
        by: BehaviourId,
        priority: Priority,
        motion: MotionId,
        setpoint: Setpoint,
        duration: Option<Duration>,
        now: Instant,
    ) {
        let docks = self.refusal() == Some(MotionEnd::Preempted) && self.rescuer != Some(by);
        if docks && self.outranks_docking(priority) {
            self.end_docking(DockEnd::Preempted, now);
        }
        let is_grantee = self.guarded && self.grantee() == Some(by);
        let refusal = match self.refusal() {
            None if self.rescuer == Some(by) => Some(MotionEnd::Preempted),
            refusal => refusal,
        };
        if let (Some(end), false) = (refusal, is_grantee) {
            let earlier = self.arbiter.clear_of(by, MotionEnd::Preempted);
            self.acts.extend(earlier);
            let event = Event::MotionEnded { motion, end };
            return self.acts.push(Act::Tell(by, event));
        }
        let allowed = if is_grantee {
            capped(setpoint, self.limits.rescue_power)
        } else {
            setpoint
        };
        let duration = duration.map(|duration| duration.min(LONGEST));
        let over = self
            .arbiter
            .claim(by, priority, motion, allowed, duration, now);
        self.acts.extend(over);
    }

    /// No behaviour can stop the way home of a robot with a low battery, except its own part of it:
    /// a grantee's stop returns the tracks. A rescuer stops no docking that others have asked for.
    fn stop_asked(&mut self, by: BehaviourId, priority: Priority, now: Instant) {
        if self.grantee() == Some(by) {
            self.end_grant(now);
        } else if self.between_searches().and_then(Homing::grantee).is_some() {
            return;
        }
        if self.rescuer == Some(by) && self.docking.is_some() {
            return;
        }
        let over = self.arbiter.stop(by, priority);
        self.acts.extend(over);
        if self.docking.as_ref().is_some_and(|active| !active.forced) {
            self.cancel_docks(Some((by, priority)), now);
        }
    }

    fn dock_asked(&mut self, caller: Caller, plan: DockPlan, now: Instant) {
        if let Some(end) = self.dock_refusal(caller) {
            return self.answer_dock(caller, DockOutcome::without_attempt(end));
        }
        if let Some(homing) = &mut self.homing {
            return homing.callers.push(caller);
        }
        if let Some(active) = &mut self.docking {
            return active.callers.push(caller);
        }
        let plan = DockPlan {
            timeout: plan.timeout.clamp(SHORTEST, LONGEST),
            charge_timeout: plan.charge_timeout.clamp(SHORTEST, LONGEST),
            ..plan
        };
        self.start_docking(plan, false, vec![caller], now);
    }

    fn dock_refusal(&self, caller: Caller) -> Option<DockEnd> {
        let called = self
            .docking
            .as_ref()
            .map_or(0, |active| active.callers.len());
        let waiting = self
            .homing
            .as_ref()
            .map_or(0, |homing| homing.callers.len());
        let crowded = called + waiting >= MAX_CALLERS;
        if !self.online {
            Some(DockEnd::Disconnected)
        } else if self.run_ending {
            Some(DockEnd::Cancelled)
        } else if self.dock_state() == DockState::Charging {
            Some(DockEnd::AlreadyDocked)
        } else if self.stopped_by_person
            || self.is_alarming()
            || crowded
            || !(self.guarded || self.homing.is_some())
        {
            Some(DockEnd::Safety)
        } else if self.is_outranked(caller.priority) {
            Some(DockEnd::Preempted)
        } else {
            None
        }
    }

    fn undock_asked(&mut self, caller: Caller, timeout: Duration, now: Instant) {
        if let Some(end) = self.undock_refusal(caller) {
            return self.answer_undock(caller, end);
        }
        if let Some(earlier) = self.leaving.take() {
            self.answer_undock(earlier.caller, DockEnd::Cancelled);
        }
        let timeout = timeout.min(LONGEST);
        let until = now + timeout;
        self.leaving = Some(Leaving { caller, until });
        self.dock_tracker.leave_station(timeout, now);
        self.send(Command::Engine(Engage::Undock));
    }

    fn undock_refusal(&self, caller: Caller) -> Option<DockEnd> {
        let left = matches!(self.dock_state(), DockState::Left) && !self.dock_tracker.is_leaving();
        let low = self.battery_monitor.low().is_some() || !self.battery_monitor.may_leave();
        if !self.online {
            Some(DockEnd::Disconnected)
        } else if self.run_ending {
            Some(DockEnd::Cancelled)
        } else if left {
            Some(DockEnd::NotDocked)
        } else if self.stopped_by_person || low || self.battery_monitor.critical() || !self.guarded
        {
            Some(DockEnd::Safety)
        } else if self.is_outranked(caller.priority) || self.docks_above(caller.priority) {
            Some(DockEnd::Preempted)
        } else {
            None
        }
    }

    /// Ends waiting docking calls as `cancelled`: those of `by` itself and those of equal or lower
    /// priority; with `None`, all. When no call is left the docking ends, unless it is the
    /// watchdog's own.
    fn cancel_docks(&mut self, by: Option<(BehaviourId, Priority)>, now: Instant) {
        let stays = |caller: &Caller| {
            by.is_some_and(|(by, priority)| caller.by != by && caller.priority > priority)
        };
        let mut over = Vec::new();
        if let Some(homing) = &mut self.homing {
            over.extend(homing.callers.extract_if(.., |caller| !stays(caller)));
        }
        match &mut self.docking {
            // Nobody's but the watchdog's: only the end of the run ends it here.
            Some(active) if active.callers.is_empty() && by.is_some() => {}
            Some(active) if !active.forced => {
                if !active.callers.iter().any(stays) {
                    return self.end_docking(DockEnd::Cancelled, now);
                }
                over.extend(active.callers.extract_if(.., |caller| !stays(caller)));
            }
            _ => {}
        }
        for caller in over {
            self.answer_dock(caller, DockOutcome::without_attempt(DockEnd::Cancelled));
        }
    }

    /// The rescue behaviour has seen that the search is in vain. The first search and each fourth one after it last
    /// [`Watchdog::FULL_SEARCH`] at least, in case the behaviour is wrong.
    fn give_up_search(&mut self, by: BehaviourId, now: Instant) {
        let may_drive = self.grantable() == Some(by);
        let failures = self.homing.as_ref().map_or(0, Homing::failures);
        if let Some(active) = &mut self.docking
            && may_drive
            && (active.forced || active.wants_rescue())
            && (active.docking.time_since_search(now) >= Watchdog::FULL_SEARCH
                || !(failures + active.docking.earlier_attempts())
                    .is_multiple_of(Watchdog::FULL_SEARCH_EVERY))
        {
            let actions = active.docking.give_up(now);
            self.execute_dock_actions(actions, now);
            if let Some(homing) = &mut self.homing {
                homing.forbid_blind_move();
            }
        }
    }

    fn end_docking(&mut self, end: DockEnd, now: Instant) {
        if let Some(active) = &mut self.docking {
            let actions = active.docking.cancel(end, now);
            self.execute_dock_actions(actions, now);
        }
    }

    /// Whether the docking under way belongs to behaviours that all have lower priority.
    fn outranks_docking(&self, priority: Priority) -> bool {
        let lower = |active: &ActiveDocking| !active.forced && active.priority() < Some(priority);
        self.docking.as_ref().is_some_and(lower)
    }

    /// Whether a behaviour of higher priority drives, or waits for an undocking.
    fn is_outranked(&self, priority: Priority) -> bool {
        let leaves = self.leaving.as_ref().map(|leaving| leaving.caller.priority);
        self.arbiter.priority().max(leaves) > Some(priority)
    }

    fn docks_above(&self, priority: Priority) -> bool {
        let active = self.docking.as_ref();
        active.and_then(ActiveDocking::priority) > Some(priority)
    }

    fn gone(&mut self, by: BehaviourId, now: Instant) {
        self.arbiter.forget(by);
        self.leases.forget(by);
        if self
            .leaving
            .as_ref()
            .is_some_and(|leaving| leaving.caller.by == by)
        {
            self.leaving = None;
        }
        if let Some(homing) = &mut self.homing {
            homing.callers.retain(|caller| caller.by != by);
        }
        if self.rescuer == Some(by) {
            self.set_rescuer(None, now);
        }
        let Some(active) = &mut self.docking else {
            return;
        };
        let called = !active.callers.is_empty();
        active.callers.retain(|caller| caller.by != by);
        if called && active.callers.is_empty() && !active.forced {
            let actions = active.docking.cancel(DockEnd::Cancelled, now);
            self.execute_dock_actions(actions, now);
        }
    }

    // Rules that depend on time.

    /// Holds the motion of a host that shows no life, and ends the host if it stays silent.
    fn check_hosts(&mut self, now: Instant) {
        let moving: Vec<BehaviourId> = self.arbiter.claimants().collect();
        for by in moving {
            match self.leases.host_life(by, now) {
                HostLife::Alive => {
                    self.arbiter.hold(by, false);
                }
                HostLife::Silent => self.hold_silent(by, now),
                HostLife::Dead => self.end_silent(by, now),
            }
        }
    }

    /// A silent host that stands by does no harm: it is only kept from getting the tracks.
    fn hold_silent(&mut self, by: BehaviourId, now: Instant) {
        if self.arbiter.hold(by, true) && self.arbiter.driver() == Some(by) {
            self.stop_tracks(now);
            let silence = self.limits.host_silence.get().as_millis();
            self.announce(
                SafetyAction::Stop,
                format!("a script showed no life for {silence} ms"),
            );
        }
    }

    fn end_silent(&mut self, by: BehaviourId, now: Instant) {
        if self.arbiter.driver() == Some(by) {
            self.stop_tracks(now);
        }
        self.arbiter.forget(by);
        self.leases.forget(by);
        let silence = self.limits.host_silence.get() + self.limits.host_grace.get();
        let reason = format!("a script showed no life for {} ms", silence.as_millis());
        self.announce(SafetyAction::Kill, reason);
        self.acts.push(Act::Kill(by, EndReason::Cpu));
    }

    fn stream_deadline(&self) -> Option<Instant> {
        if !self.streaming {
            return None;
        }
        let since = self.silent_motion_since?;
        Some(since + self.limits.stream_silence.get())
    }

    /// Stops a robot that moves while its stream is silent, and reconnects to find out whether it
    /// still answers.
    fn check_stream(&mut self, now: Instant) {
        if self.stream_deadline().is_none_or(|due| due > now) {
            return;
        }
        self.silent_motion_since = None;
        self.stop_tracks(now);
        self.end_motion(MotionEnd::Disconnected);
        self.interrupt_homing(now);
        let silence = self.limits.stream_silence.get().as_secs_f64();
        let reason = format!("no bytes from the robot for {silence} s while it moves");
        self.announce(SafetyAction::Reconnect, reason.clone());
        self.acts.push(Act::Reconnect(reason));
    }

    fn check_power_silence(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        if self
            .battery_monitor
            .unconfirmed_deadline()
            .is_some_and(|due| due <= now)
        {
            let change = self.battery_monitor.expire_unconfirmed(now);
            self.dock_tracker.power(false, now);
            self.apply_battery_change(change, now);
        }
        if self.docked() {
            self.battery_monitor.excuse_silence(now);
        } else if let Some(BatteryChange::BecameLow(cause)) = self.battery_monitor.poll(now) {
            self.became_low(cause, now);
        }
    }

    /// Lets a robot with a low battery search for its station when it may no longer be on it. If
    /// the contacts did not charge, the docking ends as failed, and the alarm calls for a person.
    fn check_place(&mut self, now: Instant) {
        let low = self.battery_monitor.low().is_some();
        let Some(contradiction) = self.dock_tracker.poll(low, now) else {
            return;
        };
        if !low {
            return;
        }
        if let Some(active) = self.docking.as_mut().filter(|active| active.forced) {
            let actions = active.docking.lost_contact(contradiction, now);
            self.execute_dock_actions(actions, now);
        }
        self.search_at_once(now);
    }

    fn check_leaving(&mut self, now: Instant) {
        if let Some(leaving) = self.leaving.take_if(|leaving| leaving.until <= now) {
            self.answer_undock(leaving.caller, DockEnd::Timeout);
        }
    }

    // The acts.

    /// The only place that makes a MOVE other than a stop.
    fn drive(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        if self.docking.is_none() || self.grantee().is_some() {
            let wanted = match self.refusal() {
                None if self.guarded => self.arbiter.setpoint(),
                _ => self.homing_setpoint(now),
            };
            self.tracks.want(wanted);
        }
        if let Some(setpoint) = self.tracks.poll(now) {
            if !setpoint.is_stop() {
                self.silent_motion_since.get_or_insert(now);
            }
            self.send(setpoint.command());
        }
    }

    /// Stops the tracks in this batch of acts, whatever was sent before.
    fn stop_tracks(&mut self, now: Instant) {
        self.tracks.note_stop(now);
        let sent = |act: &Act| matches!(act, Act::Send(_));
        let stop = Act::Send(Command::STOP);
        if self.acts.iter().rfind(|act| sent(act)) != Some(&stop) {
            self.send(Command::STOP);
        }
    }

    fn end_motion(&mut self, end: MotionEnd) {
        let over = self.arbiter.clear(end);
        self.acts.extend(over);
    }

    fn answer_dock(&mut self, Caller { by, call, .. }: Caller, outcome: DockOutcome) {
        self.acts
            .push(Act::Tell(by, Event::DockEnded { call, outcome }));
    }

    fn answer_undock(&mut self, Caller { by, call, .. }: Caller, end: DockEnd) {
        self.acts
            .push(Act::Tell(by, Event::UndockEnded { call, end }));
    }

    fn announce(&mut self, action: SafetyAction, reason: String) {
        self.acts
            .push(Act::Announce(Event::Safety { action, reason }));
    }

    fn send(&mut self, command: Command) {
        match command {
            Command::Engine(Engage::Dock) => {
                self.searching = true;
                self.may_search = true;
            }
            Command::Engine(_) | Command::Move { .. } => self.searching = false,
            _ => {}
        }
        self.acts.push(Act::Send(command));
    }
}

#[cfg(test)]
mod tests;
