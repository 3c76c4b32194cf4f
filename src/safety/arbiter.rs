//! Decides which behaviour drives. Several behaviours may request a setpoint; the highest priority
//! drives, and among equals the first one keeps the tracks.
//!
//! Each request is a claim on the tracks. A timed claim that cannot have them ends as `preempted`
//! at once. An untimed claim stands by and takes over the tracks, without a gap, when it comes
//! first. A held claim keeps its place, but moves nothing.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{BehaviourId, MotionEnd, MotionId, Priority, Setpoint};

/// A setpoint that has ended, to be reported to its behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ended {
    /// The behaviour that set it.
    pub by: BehaviourId,
    /// Its number.
    pub motion: MotionId,
    /// How it ended.
    pub end: MotionEnd,
}

#[derive(Debug, Clone)]
struct Claim {
    by: BehaviourId,
    priority: Priority,
    motion: MotionId,
    setpoint: Setpoint,
    until: Option<Instant>,
    held: bool,
}

impl Claim {
    fn ended(&self, end: MotionEnd) -> Ended {
        Ended {
            by: self.by,
            motion: self.motion,
            end,
        }
    }
}

/// Holds at most one claim per behaviour, the driving one first.
#[derive(Debug, Clone, Default)]
pub struct Arbiter {
    claims: Vec<Claim>,
}

impl Arbiter {
    /// Adds a claim, in place of an earlier one of the same behaviour. A behaviour that already
    /// drives keeps the tracks with its new setpoint.
    pub fn claim(
        &mut self,
        (by, priority): (BehaviourId, Priority),
        motion: MotionId,
        setpoint: Setpoint,
        duration: Option<Duration>,
        now: Instant,
    ) -> Vec<Ended> {
        let until = duration.map(|duration| now + duration);
        let claim = Claim {
            by,
            priority,
            motion,
            setpoint,
            until,
            held: false,
        };
        let mut ended = Vec::new();
        match self.claims.iter().position(|claim| claim.by == by) {
            Some(place) => {
                ended.push(self.claims[place].ended(MotionEnd::Preempted));
                self.claims[place] = claim;
            }
            None => {
                let place = self
                    .claims
                    .partition_point(|other| other.priority >= priority);
                self.claims.insert(place, claim);
            }
        }
        ended.extend(self.preempt_timed());
        ended
    }

    /// Ends all timed claims but the first: they do not stand by.
    fn preempt_timed(&mut self) -> Vec<Ended> {
        let mut first = true;
        let keep = |claim: &Claim| std::mem::take(&mut first) || claim.until.is_none();
        self.end_unless(keep, MotionEnd::Preempted)
    }

    /// Ends a behaviour's claim if it is still `motion`.
    pub fn release(&mut self, by: BehaviourId, motion: MotionId) -> Vec<Ended> {
        self.end_unless(
            |claim| claim.by != by || claim.motion != motion,
            MotionEnd::Done,
        )
    }

    /// `robot.stop()`: ends the behaviour's own claim, and every claim of equal or lower priority.
    pub fn stop(&mut self, by: BehaviourId, priority: Priority) -> Vec<Ended> {
        let mut ended = self.clear_of(by, MotionEnd::Cancelled);
        ended.extend(self.end_unless(|claim| claim.priority > priority, MotionEnd::Preempted));
        ended
    }

    /// Holds a behaviour's claim, or resumes it. Returns whether that changed anything.
    pub fn hold(&mut self, by: BehaviourId, held: bool) -> bool {
        let claim = self
            .claims
            .iter_mut()
            .find(|claim| claim.by == by && claim.held != held);
        claim.map(|claim| claim.held = held).is_some()
    }

    /// Drops the claim of a behaviour that has ended, without a report.
    pub fn forget(&mut self, by: BehaviourId) {
        self.claims.retain(|claim| claim.by != by);
    }

    /// Ends a behaviour's claim.
    pub fn clear_of(&mut self, by: BehaviourId, end: MotionEnd) -> Vec<Ended> {
        self.end_unless(|claim| claim.by != by, end)
    }

    /// Ends every claim.
    pub fn clear(&mut self, end: MotionEnd) -> Vec<Ended> {
        self.end_unless(|_| false, end)
    }

    /// Ends the claims whose duration is over.
    pub fn expire(&mut self, now: Instant) -> Vec<Ended> {
        self.end_unless(
            |claim| claim.until.is_none_or(|until| until > now),
            MotionEnd::Done,
        )
    }

    /// The setpoint of the tracks: a stop without a claim, and a stop while the first claim is
    /// held; the next in line does not replace it.
    pub fn setpoint(&self) -> Setpoint {
        self.claims
            .first()
            .filter(|claim| !claim.held)
            .map_or(Setpoint::STOP, |claim| claim.setpoint)
    }

    /// The behaviour whose claim comes first, held or not.
    pub fn driver(&self) -> Option<BehaviourId> {
        self.claims.first().map(|claim| claim.by)
    }

    /// The priority of the claim that comes first, held or not.
    pub fn priority(&self) -> Option<Priority> {
        self.claims.first().map(|claim| claim.priority)
    }

    /// All behaviours with a claim, driving or standing by.
    pub fn claimants(&self) -> impl Iterator<Item = BehaviourId> + '_ {
        self.claims.iter().map(|claim| claim.by)
    }

    /// When the next timed claim expires.
    pub fn next_deadline(&self) -> Option<Instant> {
        self.claims.iter().filter_map(|claim| claim.until).min()
    }

    fn end_unless(&mut self, keep: impl FnMut(&Claim) -> bool, end: MotionEnd) -> Vec<Ended> {
        let (kept, over): (Vec<Claim>, Vec<Claim>) = self.claims.drain(..).partition(keep);
        self.claims = kept;
        over.iter().map(|claim| claim.ended(end)).collect()
    }
}

#[cfg(test)]
mod tests;
