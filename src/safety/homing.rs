//! The way home of a robot with a low battery, from the first search until the battery is good
//! again. Its phases:
//!
//! - waiting: the robot stands until the next search;
//! - searching: the robot looks for its station on its own;
//! - granted: a behaviour that can see drives it elsewhere, for twice as long as the failed search
//!   took ([`DriveGrant`]);
//! - driving: the watchdog makes a short [`BlindMove`], where nothing can be granted or the grant
//!   was not used.
//!
//! A failed search is followed by a grant, a blind move or, where neither is allowed, a pause, and
//! that by the next search: one from the same place fails again and again. When too many searches
//! have failed, the alarm calls for a person, beside the phases: the searches continue.
//!
//! How the real robot handles a MOVE between two searches is not known (`PROTOCOL.md`, *Not
//! known*), so each grant and each blind move ends with a stop and a new BASE_FIND.

use std::fmt;
use std::time::Duration;

use tokio::time::Instant;

use super::docking::Caller;
use super::{BlindMove, DriveGrant, Limits};
use crate::robot::{BehaviourId, DockEnd, Setpoint};
use crate::wire::{Command, Led, Sound};

/// The commands that sound the alarm: at full volume, whatever volume was set before.
pub const ALARM: [Command; 2] = [Command::Volume(100), Command::Play(Sound::Alarm)];

/// What comes next. Its text is for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HomingStep {
    /// A search: now ([`Homing::poll`]), or within a moment ([`Homing::search_failed`]).
    Search,
    DriveGrant {
        by: BehaviourId,
        /// How long it may drive.
        time: Duration,
    },
    /// A blind move, with its number counted from 1; the search follows when it has ended.
    BlindMove(u32),
    /// The robot stands still for this long.
    Pause(Duration),
}

impl fmt::Display for HomingStep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            HomingStep::Search => f.write_str("searches again"),
            HomingStep::DriveGrant { time, .. } => write!(
                f,
                "a rescue behaviour may drive for {:.0} s, then it searches from there",
                time.as_secs_f64()
            ),
            HomingStep::BlindMove(number) => write!(
                f,
                "makes short blind move {number}, and searches from there"
            ),
            HomingStep::Pause(pause) => write!(f, "tries again in {:.0} s", pause.as_secs_f64()),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum HomingPhase {
    Waiting { until: Instant },
    Searching,
    Granted(DriveGrant),
    Driving(BlindMove),
}

#[derive(Debug, Clone, Copy)]
struct Alarm {
    next: Instant,
    flash_on: bool,
}

/// Lives from the moment the battery becomes low until the robot is released.
#[derive(Debug, Clone)]
pub struct Homing {
    began: Instant,
    grant_time: Duration,
    /// How long the robot stands after a search where neither a grant nor a blind move is allowed.
    pause: Duration,
    /// How many searches after the first may fail before the alarm.
    retries: u32,
    phase: HomingPhase,
    /// When the last search began.
    searched_at: Option<Instant>,
    /// The last search has found no station from where the robot stands.
    found_nothing: bool,
    failures: u32,
    blind_moves: u32,
    alarm: Option<Alarm>,
    /// The calls that wait until the robot is home.
    pub(super) callers: Vec<Caller>,
}

impl Homing {
    /// The shortest time from one search to the next, unless something has happened to the robot;
    /// also the time without commands after an interruption, for a link that seems dead.
    pub const MOMENT: Duration = Duration::from_secs(1);

    const ALARM_FLASH: Duration = Duration::from_secs(1);

    /// The battery has become low; the first search is due.
    pub fn new(limits: &Limits, now: Instant) -> Homing {
        Homing {
            began: now,
            grant_time: limits.rescue_time.get(),
            pause: limits.dock_pause.get(),
            retries: limits.dock_retries,
            phase: HomingPhase::Waiting { until: now },
            searched_at: None,
            found_nothing: false,
            failures: 0,
            blind_moves: 0,
            alarm: None,
            callers: Vec::new(),
        }
    }

    /// Advances the way home, off the station while no docking is under way; `may_drive` tells
    /// whether a blind move is allowed now: a blind move that is no longer allowed ends.
    pub fn poll(&mut self, may_drive: bool, now: Instant) -> Option<HomingStep> {
        match self.phase {
            HomingPhase::Waiting { .. } => {}
            // The search has ended, but no report says that it failed.
            HomingPhase::Searching => self.wait(Duration::ZERO, now),
            HomingPhase::Granted(grant) if !grant.is_over(now) => return None,
            HomingPhase::Granted(grant) if !grant.used() && self.found_nothing && may_drive => {
                return Some(self.begin_blind_move(now));
            }
            HomingPhase::Granted(_) => self.wait(Duration::ZERO, now),
            HomingPhase::Driving(blind_move) if may_drive && blind_move.setpoint(now).is_some() => {
                return None;
            }
            HomingPhase::Driving(_) => return Some(self.begin_search(now)),
        }
        match self.phase {
            HomingPhase::Waiting { until } if until <= now => Some(self.begin_search(now)),
            _ => None,
        }
    }

    /// When [`Homing::poll`] has something to do or [`Homing::setpoint`] changes, seen from
    /// `now`. A time in the past means at once.
    pub fn next_deadline(&self, now: Instant) -> Option<Instant> {
        match self.phase {
            HomingPhase::Waiting { until } => Some(until),
            HomingPhase::Granted(grant) => Some(grant.next_deadline()),
            HomingPhase::Driving(blind_move) => blind_move.next_deadline(now).or(Some(now)),
            HomingPhase::Searching => None,
        }
    }

    /// Handles a failed search and begins what follows: `rescuer` is the behaviour that the tracks
    /// may be granted to, `may_drive` tells whether a blind move is allowed now.
    pub fn search_failed(
        &mut self,
        end: DockEnd,
        rescuer: Option<BehaviourId>,
        may_drive: bool,
        now: Instant,
    ) -> HomingStep {
        self.failures = self.failures.saturating_add(1);
        self.found_nothing = end == DockEnd::BaseNotFound;
        if end == DockEnd::NotCharging {
            self.wait(Duration::ZERO, now);
            HomingStep::Search
        } else if let Some(by) = rescuer {
            let began = self.searched_at.unwrap_or(now);
            let took = now.saturating_duration_since(began);
            let time = DriveGrant::time_after(took, self.grant_time);
            self.phase = HomingPhase::Granted(DriveGrant::start(by, time, now));
            HomingStep::DriveGrant { by, time }
        } else if self.found_nothing && may_drive {
            self.begin_blind_move(now)
        } else {
            self.wait(self.pause, now);
            HomingStep::Pause(self.pause)
        }
    }

    /// The robot itself has not reported that it found nothing.
    pub fn forbid_blind_move(&mut self) {
        self.found_nothing = false;
    }

    fn begin_blind_move(&mut self, now: Instant) -> HomingStep {
        self.phase = HomingPhase::Driving(BlindMove::start(self.blind_moves, now));
        self.blind_moves = self.blind_moves.saturating_add(1);
        HomingStep::BlindMove(self.blind_moves)
    }

    fn begin_search(&mut self, now: Instant) -> HomingStep {
        self.phase = HomingPhase::Searching;
        self.searched_at = Some(now);
        HomingStep::Search
    }

    /// Waits for the next search: for `pause`, and until [`Homing::MOMENT`] after the last one.
    fn wait(&mut self, pause: Duration, now: Instant) {
        let earliest = self.searched_at.map_or(now, |at| at + Homing::MOMENT);
        let until = earliest.max(now + pause);
        self.phase = HomingPhase::Waiting { until };
    }

    /// Ends a grant or a blind move; the search from here comes next.
    pub fn end_drive(&mut self, now: Instant) {
        if matches!(
            self.phase,
            HomingPhase::Granted(_) | HomingPhase::Driving(_)
        ) {
            self.wait(Duration::ZERO, now);
        }
    }

    /// The robot is out of reach, or on its station: ends a search, a grant or a blind move, but
    /// not a pause. A search from wherever the robot is then follows, no sooner than
    /// [`Homing::MOMENT`] after what was ended: nothing is sent over a dead link.
    pub fn interrupt(&mut self, now: Instant) {
        self.found_nothing = false;
        if !matches!(self.phase, HomingPhase::Waiting { .. }) {
            let until = now + Homing::MOMENT;
            self.phase = HomingPhase::Waiting { until };
        }
    }

    /// The robot was moved, or its activity is not known: a search comes next, at once.
    pub fn search_at_once(&mut self, now: Instant) {
        self.found_nothing = false;
        self.phase = HomingPhase::Waiting { until: now };
    }

    pub fn note_motion(&mut self, moves: bool, now: Instant) {
        if let HomingPhase::Granted(grant) = &mut self.phase {
            grant.record(moves, now);
        }
    }

    pub fn grantee(&self) -> Option<BehaviourId> {
        match &self.phase {
            HomingPhase::Granted(grant) => Some(grant.grantee()),
            _ => None,
        }
    }

    /// The setpoint of the tracks; `None` unless a blind move is under way.
    pub fn setpoint(&self, now: Instant) -> Option<Setpoint> {
        match self.phase {
            HomingPhase::Driving(blind_move) => blind_move.setpoint(now),
            _ => None,
        }
    }

    /// When the battery became low.
    pub fn began(&self) -> Instant {
        self.began
    }

    /// The number of failed searches.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    /// Whether the first search and all further ones that the limits allow have failed: a person
    /// must help.
    pub fn has_failed_too_often(&self) -> bool {
        self.failures > self.retries
    }

    // The alarm, beside the phases.

    /// Begins the alarm, unless it sounds already.
    pub fn start_alarm(&mut self, now: Instant) {
        self.alarm.get_or_insert(Alarm {
            next: now,
            flash_on: false,
        });
    }

    pub fn is_alarming(&self) -> bool {
        self.alarm.is_some()
    }

    /// The commands of the alarm that are due: once per `every` it sounds and flashes.
    pub fn poll_alarm(&mut self, every: Duration, now: Instant) -> Vec<Command> {
        let Some(alarm) = &mut self.alarm else {
            return vec![];
        };
        if alarm.next > now {
            return vec![];
        }
        alarm.flash_on = !alarm.flash_on;
        let flash = Command::Led {
            led: Led::Flash,
            on: alarm.flash_on,
        };
        if alarm.flash_on {
            alarm.next = now + Homing::ALARM_FLASH;
            ALARM.into_iter().chain([flash]).collect()
        } else {
            let pause = every.saturating_sub(Homing::ALARM_FLASH);
            alarm.next = now + pause.max(Homing::ALARM_FLASH);
            vec![flash]
        }
    }

    /// When [`Homing::poll_alarm`] has commands.
    pub fn alarm_deadline(&self) -> Option<Instant> {
        self.alarm.as_ref().map(|alarm| alarm.next)
    }

    /// Ends the alarm. Returns the command that switches its light off, if it is on.
    pub fn end_alarm(&mut self) -> Option<Command> {
        let alarm = self.alarm.take()?;
        let off = Command::Led {
            led: Led::Flash,
            on: false,
        };
        if alarm.flash_on { Some(off) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);
    const WHO: BehaviourId = BehaviourId(7);

    fn searching() -> (Homing, Instant) {
        let now = Instant::now();
        let mut homing = Homing::new(&Limits::default(), now);
        assert_eq!(homing.poll(true, now), Some(HomingStep::Search));
        assert_eq!(homing.next_deadline(now), None);
        (homing, now + 60 * SECOND)
    }

    #[test]
    fn a_blind_move_begins_at_once_and_a_search_follows_it() {
        let (mut homing, now) = searching();
        let next = homing.search_failed(DockEnd::BaseNotFound, None, true, now);
        assert_eq!(next, HomingStep::BlindMove(1));
        assert!(homing.setpoint(now + SECOND).is_some());
        let due = homing.next_deadline(now).unwrap();
        assert_eq!(due, now + 2 * SECOND);
        assert_eq!(homing.next_deadline(due), Some(due), "at once");
        assert_eq!(homing.poll(true, now + SECOND), None);
        assert_eq!(homing.poll(true, due), Some(HomingStep::Search));
        assert_eq!(homing.setpoint(due), None);
        let next = homing.search_failed(DockEnd::BaseNotFound, None, true, due);
        assert_eq!(next, HomingStep::BlindMove(2));
        homing.end_drive(due);
        assert_eq!(homing.poll(true, due + SECOND), Some(HomingStep::Search));
        let due = due + SECOND;
        assert_eq!(homing.poll(true, due), None, "not twice in a second");
    }

    #[test]
    fn a_search_that_ended_without_a_report_is_followed_by_another() {
        let (mut homing, now) = searching();
        assert_eq!(homing.poll(true, now), Some(HomingStep::Search));
        assert_eq!(homing.poll(true, now), None, "not twice in a second");
        assert_eq!(homing.next_deadline(now), Some(now + SECOND));
    }

    #[test]
    fn a_grant_is_twice_as_long_as_the_search_before_it_within_bounds() {
        for (search, grant) in [(3, 8), (12, 24), (60, 40)] {
            let now = Instant::now();
            let mut homing = Homing::new(&Limits::default(), now);
            assert_eq!(homing.poll(true, now), Some(HomingStep::Search));
            let failed = now + search * SECOND;
            homing.search_failed(DockEnd::BaseNotFound, Some(WHO), true, failed);
            homing.note_motion(true, failed);
            assert_eq!(homing.next_deadline(failed), Some(failed + grant * SECOND));
        }
    }

    #[test]
    fn an_interruption_ends_everything_but_a_pause() {
        let (mut homing, now) = searching();
        homing.search_failed(DockEnd::BaseNotFound, None, true, now);
        homing.interrupt(now);
        assert_eq!(homing.next_deadline(now), Some(now + SECOND));
        assert_eq!(homing.poll(true, now + SECOND), Some(HomingStep::Search));
        homing.search_failed(DockEnd::Timeout, None, false, now + SECOND);
        let due = homing.next_deadline(now);
        homing.interrupt(now + 2 * SECOND);
        assert_eq!(homing.next_deadline(now), due);
        homing.search_at_once(now + 3 * SECOND);
        assert_eq!(
            homing.poll(true, now + 3 * SECOND),
            Some(HomingStep::Search)
        );
    }

    #[test]
    fn ending_a_grant_changes_nothing_in_a_pause_or_a_search() {
        let (mut homing, now) = searching();
        homing.end_drive(now);
        assert_eq!(homing.next_deadline(now), None);
        homing.search_failed(DockEnd::BaseNotFound, None, false, now);
        homing.end_drive(now);
        assert_eq!(homing.next_deadline(now), Some(now + 20 * SECOND));
        homing.search_at_once(now);
        homing.poll(true, now);
        homing.search_failed(DockEnd::BaseNotFound, None, true, now + SECOND);
        homing.end_drive(now + 2 * SECOND);
        assert_eq!(
            homing.poll(true, now + 2 * SECOND),
            Some(HomingStep::Search)
        );
    }

    #[test]
    fn the_alarm_flashes_for_a_second_and_sounds_again_after_its_pause() {
        let (mut homing, now) = searching();
        assert_eq!(homing.poll_alarm(15 * SECOND, now), []);
        homing.start_alarm(now);
        let flash = |on| Command::Led {
            led: Led::Flash,
            on,
        };
        let [volume, sound] = ALARM;
        let alarm = [volume, sound, flash(true)];
        assert_eq!(homing.poll_alarm(15 * SECOND, now), alarm);
        homing.start_alarm(now);
        assert_eq!(homing.poll_alarm(15 * SECOND, now), [], "it sounds already");
        let off = now + SECOND;
        assert_eq!(homing.alarm_deadline(), Some(off));
        assert_eq!(homing.poll_alarm(15 * SECOND, off), [flash(false)]);
        assert_eq!(homing.alarm_deadline(), Some(now + 15 * SECOND));
        assert_eq!(homing.poll_alarm(15 * SECOND, now + 15 * SECOND), alarm);
        assert_eq!(homing.end_alarm(), Some(flash(false)));
        assert_eq!(homing.end_alarm(), None);
    }
}
