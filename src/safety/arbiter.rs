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
#[derive(Debug, Default)]
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

    /// Drops a behaviour; nobody is left to be told.
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
mod tests {
    use super::*;

    const PATROL: (BehaviourId, Priority) = (BehaviourId(0), Priority(0));
    const AVOID: (BehaviourId, Priority) = (BehaviourId(1), Priority(10));
    const OTHER: (BehaviourId, Priority) = (BehaviourId(2), Priority(0));
    const SECOND: Duration = Duration::from_secs(1);

    fn at(percent: f64) -> Setpoint {
        Setpoint::from_percent(percent, percent).unwrap()
    }

    fn ended(who: (BehaviourId, Priority), motion: u64, end: MotionEnd) -> Ended {
        Ended {
            by: who.0,
            motion: MotionId(motion),
            end,
        }
    }

    #[test]
    fn the_higher_priority_drives_and_the_lower_takes_over_again() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        assert_eq!(arbiter.wish(PATROL, MotionId(1), at(40.0), None, now), []);
        assert_eq!(arbiter.wish(AVOID, MotionId(1), at(-20.0), None, now), []);
        assert_eq!(arbiter.setpoint(), at(-20.0));
        arbiter.release(AVOID.0, MotionId(1));
        assert_eq!(arbiter.setpoint(), at(40.0));
    }

    #[test]
    fn a_timed_move_of_the_loser_is_preempted_when_the_winner_comes() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(PATROL, MotionId(7), at(40.0), Some(SECOND), now);
        let over = arbiter.wish(AVOID, MotionId(1), at(-20.0), Some(SECOND), now);
        assert_eq!(over, [ended(PATROL, 7, MotionEnd::Preempted)]);
    }

    #[test]
    fn a_timed_move_below_the_driver_is_preempted_at_once() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(AVOID, MotionId(1), at(-20.0), None, now);
        let over = arbiter.wish(PATROL, MotionId(2), at(40.0), Some(SECOND), now);
        assert_eq!(over, [ended(PATROL, 2, MotionEnd::Preempted)]);
        assert_eq!(arbiter.setpoint(), at(-20.0));
    }

    #[test]
    fn among_equals_the_first_keeps_the_tracks() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(PATROL, MotionId(1), at(40.0), None, now);
        arbiter.wish(OTHER, MotionId(1), at(90.0), None, now);
        assert_eq!(arbiter.setpoint(), at(40.0));
        arbiter.wish(PATROL, MotionId(2), at(50.0), None, now);
        assert_eq!(arbiter.setpoint(), at(50.0));
    }

    #[test]
    fn a_newer_setpoint_of_the_same_behaviour_ends_the_older() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(PATROL, MotionId(1), at(40.0), Some(SECOND), now);
        let over = arbiter.wish(PATROL, MotionId(2), at(50.0), None, now);
        assert_eq!(over, [ended(PATROL, 1, MotionEnd::Preempted)]);
        assert_eq!(arbiter.release(PATROL.0, MotionId(1)), []);
        assert_eq!(arbiter.setpoint(), at(50.0));
    }

    #[test]
    fn time_ends_a_move() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(PATROL, MotionId(1), at(40.0), Some(SECOND), now);
        assert_eq!(arbiter.next_deadline(), Some(now + SECOND));
        assert_eq!(arbiter.expire(now + SECOND / 2), []);
        assert_eq!(
            arbiter.expire(now + SECOND),
            [ended(PATROL, 1, MotionEnd::Done)]
        );
        assert_eq!(arbiter.setpoint(), Setpoint::STOP);
    }

    #[test]
    fn a_held_wish_moves_nothing_and_keeps_its_place() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(PATROL, MotionId(1), at(40.0), None, now);
        arbiter.wish(AVOID, MotionId(1), at(-20.0), None, now);
        assert!(arbiter.hold(AVOID.0, true));
        assert!(!arbiter.hold(AVOID.0, true), "held already");
        assert_eq!(arbiter.setpoint(), Setpoint::STOP);
        assert!(arbiter.hold(AVOID.0, false));
        assert_eq!(arbiter.setpoint(), at(-20.0));
    }

    #[test]
    fn stop_ends_equals_and_lower_but_not_a_higher_priority() {
        let (mut arbiter, now) = (Arbiter::default(), Instant::now());
        arbiter.wish(AVOID, MotionId(1), at(-20.0), None, now);
        arbiter.wish(PATROL, MotionId(2), at(40.0), None, now);
        arbiter.wish(OTHER, MotionId(3), at(60.0), None, now);
        let over = arbiter.stop(OTHER.0, OTHER.1);
        let expected = [
            ended(OTHER, 3, MotionEnd::Cancelled),
            ended(PATROL, 2, MotionEnd::Preempted),
        ];
        assert_eq!(over, expected);
        assert_eq!(arbiter.setpoint(), at(-20.0));
    }
}
