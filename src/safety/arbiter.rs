//! Who may drive now. Several behaviours may wish for a setpoint; the highest priority has it, and
//! among equals the one that came first keeps it.
//!
//! A wish with a duration that cannot have the tracks ends as `preempted` at once. A wish without
//! one stands by and takes the tracks over when it is its turn, without a gap. A wish that is held
//! keeps its place, but moves nothing.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{BehaviourId, MotionEnd, MotionId, Priority, Setpoint};

/// A setpoint that is over, to be told to its behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ended {
    /// Whose.
    pub by: BehaviourId,
    /// Which.
    pub motion: MotionId,
    /// How.
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

/// Holds at most one wish of each behaviour, the one that drives first.
#[derive(Debug, Clone, Default)]
pub struct Arbiter {
    wishes: Vec<Wish>,
}

impl Arbiter {
    /// Takes a wish, in place of an earlier one of the same behaviour. A behaviour that drives
    /// already keeps the tracks with its new setpoint.
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

    /// Wishes with a duration do not stand by.
    fn preempt_timed(&mut self) -> Vec<Ended> {
        let mut first = true;
        let keep = |wish: &Wish| std::mem::take(&mut first) || wish.until.is_none();
        self.end_unless(keep, MotionEnd::Preempted)
    }

    /// Ends a behaviour's wish if it is still this one.
    pub fn release(&mut self, by: BehaviourId, motion: MotionId) -> Vec<Ended> {
        self.end_unless(
            |wish| wish.by != by || wish.motion != motion,
            MotionEnd::Done,
        )
    }

    /// `robot.stop()`: ends the behaviour's own wish, and all of its priority or lower.
    pub fn stop(&mut self, by: BehaviourId, priority: Priority) -> Vec<Ended> {
        let mut ended = self.clear_of(by, MotionEnd::Cancelled);
        ended.extend(self.end_unless(|wish| wish.priority > priority, MotionEnd::Preempted));
        ended
    }

    /// Holds a behaviour's wish, or lets go of it again. Says whether that changes anything.
    pub fn hold(&mut self, by: BehaviourId, held: bool) -> bool {
        let wish = self
            .wishes
            .iter_mut()
            .find(|wish| wish.by == by && wish.held != held);
        wish.map(|wish| wish.held = held).is_some()
    }

    /// Drops a behaviour that is gone, without an answer.
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

    /// Ends the wishes whose time is over.
    pub fn expire(&mut self, now: Instant) -> Vec<Ended> {
        self.end_unless(
            |wish| wish.until.is_none_or(|until| until > now),
            MotionEnd::Done,
        )
    }

    /// What the tracks are to do now: nothing wished is a stop, and so is a wish that is held; the
    /// next in line does not take its place.
    pub fn setpoint(&self) -> Setpoint {
        self.wishes
            .first()
            .filter(|wish| !wish.held)
            .map_or(Setpoint::STOP, |wish| wish.setpoint)
    }

    /// Whose wish the tracks follow, held or not.
    pub fn driver(&self) -> Option<BehaviourId> {
        self.wishes.first().map(|wish| wish.by)
    }

    /// The priority of whose wish the tracks follow, held or not.
    pub fn priority(&self) -> Option<Priority> {
        self.wishes.first().map(|wish| wish.priority)
    }

    /// Behaviours that have a wish, driving or standing by.
    pub fn wishing(&self) -> impl Iterator<Item = BehaviourId> + '_ {
        self.wishes.iter().map(|wish| wish.by)
    }

    /// When the next wish expires.
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
