//! Decides which behaviour drives. Several behaviours may request a setpoint; the highest priority
//! drives, and among equals the first one keeps the tracks.
//!
//! A wish is such a request. A timed wish that cannot have the tracks ends as `preempted` at once.
//! An untimed wish stands by and takes over the tracks, without a gap, when it comes first. A held
//! wish keeps its place, but the tracks stand still.

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
struct Wish {
    by: BehaviourId,
    priority: Priority,
    motion: MotionId,
    setpoint: Setpoint,
    until: Option<Instant>,
    held: bool,
}

impl Wish {
    fn ended(&self, end: MotionEnd) -> Ended {
        Ended {
            by: self.by,
            motion: self.motion,
            end,
        }
    }
}

/// Holds at most one wish per behaviour, the driving one first.
#[derive(Debug, Clone, Default)]
pub struct Arbiter {
    wishes: Vec<Wish>,
}

impl Arbiter {
    /// Adds a wish, in place of an earlier one of the same behaviour. A behaviour that already
    /// drives keeps the tracks with its new setpoint.
    pub fn wish(
        &mut self,
        (by, priority): (BehaviourId, Priority),
        motion: MotionId,
        setpoint: Setpoint,
        duration: Option<Duration>,
        now: Instant,
    ) -> Vec<Ended> {
        let until = duration.map(|duration| now + duration);
        let wish = Wish {
            by,
            priority,
            motion,
            setpoint,
            until,
            held: false,
        };
        let mut ended = Vec::new();
        match self.wishes.iter().position(|wish| wish.by == by) {
            Some(place) => {
                ended.push(self.wishes[place].ended(MotionEnd::Preempted));
                self.wishes[place] = wish;
            }
            None => {
                let place = self
                    .wishes
                    .partition_point(|other| other.priority >= priority);
                self.wishes.insert(place, wish);
            }
        }
        ended.extend(self.preempt_timed());
        ended
    }

    /// Ends all timed wishes but the first: they do not stand by.
    fn preempt_timed(&mut self) -> Vec<Ended> {
        let mut first = true;
        let keep = |wish: &Wish| std::mem::take(&mut first) || wish.until.is_none();
        self.end_unless(keep, MotionEnd::Preempted)
    }

    /// Ends a behaviour's wish if it is still `motion`.
    pub fn release(&mut self, by: BehaviourId, motion: MotionId) -> Vec<Ended> {
        self.end_unless(
            |wish| wish.by != by || wish.motion != motion,
            MotionEnd::Done,
        )
    }

    /// `robot.stop()`: ends the behaviour's own wish, and every wish of equal or lower priority.
    pub fn stop(&mut self, by: BehaviourId, priority: Priority) -> Vec<Ended> {
        let mut ended = self.clear_of(by, MotionEnd::Cancelled);
        ended.extend(self.end_unless(|wish| wish.priority > priority, MotionEnd::Preempted));
        ended
    }

    /// Holds a behaviour's wish, or resumes it. Returns whether that changed anything.
    pub fn hold(&mut self, by: BehaviourId, held: bool) -> bool {
        let wish = self
            .wishes
            .iter_mut()
            .find(|wish| wish.by == by && wish.held != held);
        wish.map(|wish| wish.held = held).is_some()
    }

    /// Drops the wish of a behaviour that has ended, without a report.
    pub fn forget(&mut self, by: BehaviourId) {
        self.wishes.retain(|wish| wish.by != by);
    }

    /// Ends a behaviour's wish.
    pub fn clear_of(&mut self, by: BehaviourId, end: MotionEnd) -> Vec<Ended> {
        self.end_unless(|wish| wish.by != by, end)
    }

    /// Ends every wish.
    pub fn clear(&mut self, end: MotionEnd) -> Vec<Ended> {
        self.end_unless(|_| false, end)
    }

    /// Ends the wishes whose duration is over.
    pub fn expire(&mut self, now: Instant) -> Vec<Ended> {
        self.end_unless(
            |wish| wish.until.is_none_or(|until| until > now),
            MotionEnd::Done,
        )
    }

    /// The setpoint of the tracks: a stop without a wish, and a stop while the first wish is held;
    /// the next in line does not replace it.
    pub fn setpoint(&self) -> Setpoint {
        self.wishes
            .first()
            .filter(|wish| !wish.held)
            .map_or(Setpoint::STOP, |wish| wish.setpoint)
    }

    /// The behaviour whose wish comes first, held or not.
    pub fn driver(&self) -> Option<BehaviourId> {
        self.wishes.first().map(|wish| wish.by)
    }

    /// The priority of the wish that comes first, held or not.
    pub fn priority(&self) -> Option<Priority> {
        self.wishes.first().map(|wish| wish.priority)
    }

    /// All behaviours with a wish, driving or standing by.
    pub fn wishing(&self) -> impl Iterator<Item = BehaviourId> + '_ {
        self.wishes.iter().map(|wish| wish.by)
    }

    /// When the next timed wish expires.
    pub fn next_deadline(&self) -> Option<Instant> {
        self.wishes.iter().filter_map(|wish| wish.until).min()
    }

    fn end_unless(&mut self, keep: impl FnMut(&Wish) -> bool, end: MotionEnd) -> Vec<Ended> {
        let (kept, over): (Vec<Wish>, Vec<Wish>) = self.wishes.drain(..).partition(keep);
        self.wishes = kept;
        over.iter().map(|wish| wish.ended(end)).collect()
    }
}

#[cfg(test)]
mod tests;
