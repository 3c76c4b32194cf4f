//! Decides which behaviour drives ([`Arbiter`]), and when the tracks are told so ([`Tracks`]). Several
//! behaviours may request a setpoint; the highest priority drives, and among equals the first one
//! keeps the tracks.
//!
//! Each request is a claim on the tracks. A timed claim that cannot have them ends as `preempted`
//! at once. An untimed claim stands by and takes over the tracks, without a gap, when it comes
//! first. A held claim keeps its place, but moves nothing. The time of a timed claim begins when
//! the robot executes its MOVE, which may wait for a slow robot's queue.

use std::time::Duration;

use tokio::time::Instant;

use super::Act;
use crate::robot::{BehaviourId, Event, MotionEnd, MotionId, Priority, Setpoint};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Start {
    /// Not known yet whether its MOVE waits.
    New,
    Waits,
    Begun,
}

#[derive(Debug, Clone, Copy)]
struct TimeLimit {
    duration: Duration,
    /// When it is over, unless it waits.
    until: Instant,
    start: Start,
}

#[derive(Debug, Clone)]
struct Claim {
    by: BehaviourId,
    priority: Priority,
    motion: MotionId,
    setpoint: Setpoint,
    limit: Option<TimeLimit>,
    held: bool,
}

impl Claim {
    /// Tells the behaviour that its setpoint has ended.
    fn ended(&self, end: MotionEnd) -> Act {
        let motion = self.motion;
        Act::Tell(self.by, Event::MotionEnded { motion, end })
    }

    /// When its time is over; `None` if it has no limit, or has not begun.
    fn deadline(&self) -> Option<Instant> {
        let limit = self.limit?;
        if limit.start == Start::Waits {
            return None;
        }
        Some(limit.until)
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
        by: BehaviourId,
        priority: Priority,
        motion: MotionId,
        setpoint: Setpoint,
        duration: Option<Duration>,
        now: Instant,
    ) -> Vec<Act> {
        let limit = duration.map(|duration| TimeLimit {
            duration,
            until: now + duration,
            start: Start::New,
        });
        let claim = Claim {
            by,
            priority,
            motion,
            setpoint,
            limit,
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
    fn preempt_timed(&mut self) -> Vec<Act> {
        let mut first = true;
        let keep = |claim: &Claim| std::mem::take(&mut first) || claim.limit.is_none();
        self.end_unless(keep, MotionEnd::Preempted)
    }

    /// Notes whether a MOVE with a new setpoint waits. Tells of the timed setpoint that has begun to
    /// wait, or has begun after it waited.
    pub fn set_waiting(&mut self, waits: bool, now: Instant) -> Option<Act> {
        let claim = self.claims.first_mut()?;
        let limit = claim.limit.as_mut()?;
        match (limit.start, waits) {
            (Start::Begun, _) | (Start::Waits, true) => return None,
            (Start::New, false) => {
                limit.start = Start::Begun;
                return None;
            }
            (Start::New, true) => limit.start = Start::Waits,
            (Start::Waits, false) => {
                limit.start = Start::Begun;
                limit.until = now + limit.duration;
            }
        }
        let motion = claim.motion;
        let event = Event::MotionWaiting { motion, on: waits };
        Some(Act::Tell(claim.by, event))
    }

    /// Ends a behaviour's claim if it is still `motion`.
    pub fn release(&mut self, by: BehaviourId, motion: MotionId) -> Vec<Act> {
        self.end_unless(
            |claim| claim.by != by || claim.motion != motion,
            MotionEnd::Done,
        )
    }

    /// `robot.stop()`: ends the behaviour's own claim, and every claim of equal or lower priority.
    pub fn stop(&mut self, by: BehaviourId, priority: Priority) -> Vec<Act> {
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

    pub fn clear_of(&mut self, by: BehaviourId, end: MotionEnd) -> Vec<Act> {
        self.end_unless(|claim| claim.by != by, end)
    }

    pub fn clear(&mut self, end: MotionEnd) -> Vec<Act> {
        self.end_unless(|_| false, end)
    }

    /// Ends the claims whose duration is over.
    pub fn expire(&mut self, now: Instant) -> Vec<Act> {
        self.end_unless(
            |claim| claim.deadline().is_none_or(|until| until > now),
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
        self.claims.iter().filter_map(Claim::deadline).min()
    }

    fn end_unless(&mut self, keep: impl FnMut(&Claim) -> bool, end: MotionEnd) -> Vec<Act> {
        let (kept, over): (Vec<Claim>, Vec<Claim>) = self.claims.drain(..).partition(keep);
        self.claims = kept;
        over.iter().map(|claim| claim.ended(end)).collect()
    }
}

/// The last setpoint sent to the robot. Decides when the wanted one is sent: a stop at once, any other
/// at most [`Tracks::PER_SECOND`] times a second, and every [`Tracks::RESEND`] while the tracks move.
#[derive(Debug, Clone)]
pub struct Tracks {
    wanted: Setpoint,
    last_sent: Setpoint,
    sent_at: Instant,
    /// The earliest time for the next setpoint that is not a stop.
    next_free: Instant,
    moving_since: Option<Instant>,
    resend: Duration,
}

impl Tracks {
    /// How often a moving setpoint is repeated (5 Hz), for a firmware that may forget it; less
    /// often if the robot executes so slowly that repeats would fill its queue.
    pub const RESEND: Duration = Duration::from_millis(200);
    /// The most MOVE messages in a second.
    pub const PER_SECOND: u32 = 50;
    const SPACING: Duration = Duration::from_millis(1000 / Tracks::PER_SECOND as u64);

    pub fn new(now: Instant) -> Tracks {
        let stop = Setpoint::STOP;
        Tracks {
            wanted: stop,
            last_sent: stop,
            sent_at: now,
            next_free: now,
            moving_since: None,
            resend: Tracks::RESEND,
        }
    }

    /// Sets the time that the robot takes to execute one message.
    pub fn set_pace(&mut self, period: Duration) {
        self.resend = Tracks::RESEND.max(period * 5 / 2);
    }

    /// Sets the wanted setpoint; the next [`Tracks::poll`] sends it.
    pub fn want(&mut self, setpoint: Setpoint) {
        self.wanted = setpoint;
    }

    /// Notes that the robot was stopped by other means, or that a new login has stopped it.
    pub fn note_stop(&mut self, now: Instant) {
        self.wanted = Setpoint::STOP;
        self.record(Setpoint::STOP, now);
    }

    pub fn poll(&mut self, now: Instant) -> Option<Setpoint> {
        if self.next_deadline().is_none_or(|due| due > now) {
            return None;
        }
        self.record(self.wanted, now);
        Some(self.wanted)
    }

    /// When [`Tracks::poll`] has something to send. A time in the past means at once.
    pub fn next_deadline(&self) -> Option<Instant> {
        match (self.wanted == self.last_sent, self.wanted.is_stop()) {
            (true, true) => None,
            (true, false) => Some(self.sent_at + self.resend),
            (false, true) => Some(self.sent_at),
            (false, false) => Some(self.next_free),
        }
    }

    pub fn last_sent(&self) -> Setpoint {
        self.last_sent
    }

    pub fn sent_at(&self) -> Instant {
        self.sent_at
    }

    /// Since when the setpoints sent have moved the robot without a stop; `None` at rest.
    pub fn moving_since(&self) -> Option<Instant> {
        self.moving_since
    }

    fn record(&mut self, setpoint: Setpoint, now: Instant) {
        (self.last_sent, self.sent_at) = (setpoint, now);
        self.next_free = self.next_free.max(now) + Tracks::SPACING;
        if setpoint.is_stop() {
            self.moving_since = None
        } else {
            self.moving_since = self.moving_since.or(Some(now))
        }
    }
}

#[cfg(test)]
mod tests {
    //! Who drives, as examples with numbers and compared with a simple model; and what is sent.

    use proptest::prelude::*;

    use super::*;

    const PATROL: (BehaviourId, Priority) = (BehaviourId(0), Priority(0));
    const AVOID: (BehaviourId, Priority) = (BehaviourId(1), Priority(10));
    const OTHER: (BehaviourId, Priority) = (BehaviourId(2), Priority(0));
    const MS: Duration = Duration::from_millis(1);
    const SECOND: Duration = Duration::from_secs(1);

    fn at(percent: f64) -> Setpoint {
        Setpoint::from_percent(percent, percent).unwrap()
    }

    fn ended(who: (BehaviourId, Priority), motion: u64, end: MotionEnd) -> Act {
        let motion = MotionId(motion);
        Act::Tell(who.0, Event::MotionEnded { motion, end })
    }

    #[test]
    fn a_timed_move_of_the_loser_is_preempted_before_and_after_the_winner_comes() {
        let mut arbiter = Arbiter::default();
        let now = Instant::now();
        arbiter.claim(PATROL.0, PATROL.1, MotionId(7), at(40.0), Some(SECOND), now);
        let over = arbiter.claim(AVOID.0, AVOID.1, MotionId(1), at(-20.0), None, now);
        assert_eq!(over, [ended(PATROL, 7, MotionEnd::Preempted)]);
        let over = arbiter.claim(PATROL.0, PATROL.1, MotionId(2), at(40.0), Some(SECOND), now);
        assert_eq!(over, [ended(PATROL, 2, MotionEnd::Preempted)]);
        assert_eq!(arbiter.setpoint(), at(-20.0));
    }

    #[test]
    fn a_newer_setpoint_of_the_same_behaviour_ends_the_older() {
        let mut arbiter = Arbiter::default();
        let now = Instant::now();
        arbiter.claim(PATROL.0, PATROL.1, MotionId(1), at(40.0), Some(SECOND), now);
        let over = arbiter.claim(PATROL.0, PATROL.1, MotionId(2), at(50.0), None, now);
        assert_eq!(over, [ended(PATROL, 1, MotionEnd::Preempted)]);
        assert_eq!(arbiter.release(PATROL.0, MotionId(1)), []);
        assert_eq!(arbiter.setpoint(), at(50.0));
    }

    #[test]
    fn the_time_of_a_timed_move_begins_when_its_move_no_longer_waits() {
        let mut arbiter = Arbiter::default();
        let now = Instant::now();
        let (by, priority) = PATROL;
        arbiter.claim(by, priority, MotionId(1), at(40.0), Some(SECOND), now);
        let motion = MotionId(1);
        let waiting = |on| Some(Act::Tell(by, Event::MotionWaiting { motion, on }));
        assert_eq!(arbiter.set_waiting(true, now), waiting(true));
        assert_eq!(arbiter.set_waiting(true, now + SECOND), None);
        assert_eq!(arbiter.expire(now + 2 * SECOND), []);
        assert_eq!(arbiter.next_deadline(), None);
        let written = now + 3 * SECOND;
        assert_eq!(arbiter.set_waiting(false, written), waiting(false));
        assert_eq!(arbiter.next_deadline(), Some(written + SECOND));
        // A repeat that waits does not prolong it.
        assert_eq!(arbiter.set_waiting(true, written + SECOND / 2), None);
        assert_eq!(
            arbiter.expire(written + SECOND),
            [ended(PATROL, 1, MotionEnd::Done)]
        );
    }

    #[test]
    fn a_held_claim_moves_nothing_and_keeps_its_place() {
        let mut arbiter = Arbiter::default();
        let now = Instant::now();
        arbiter.claim(PATROL.0, PATROL.1, MotionId(1), at(40.0), None, now);
        arbiter.claim(AVOID.0, AVOID.1, MotionId(1), at(-20.0), None, now);
        assert!(arbiter.hold(AVOID.0, true));
        assert!(!arbiter.hold(AVOID.0, true), "held already");
        assert_eq!(arbiter.setpoint(), Setpoint::STOP);
        assert!(arbiter.hold(AVOID.0, false));
        assert_eq!(arbiter.setpoint(), at(-20.0));
    }

    #[test]
    fn stop_ends_equals_and_lower_but_not_a_higher_priority() {
        let mut arbiter = Arbiter::default();
        let now = Instant::now();
        arbiter.claim(AVOID.0, AVOID.1, MotionId(1), at(-20.0), None, now);
        arbiter.claim(PATROL.0, PATROL.1, MotionId(2), at(40.0), None, now);
        arbiter.claim(OTHER.0, OTHER.1, MotionId(3), at(60.0), None, now);
        let over = arbiter.stop(OTHER.0, OTHER.1);
        let expected = [
            ended(OTHER, 3, MotionEnd::Cancelled),
            ended(PATROL, 2, MotionEnd::Preempted),
        ];
        assert_eq!(over, expected);
        assert_eq!(arbiter.setpoint(), at(-20.0));
    }

    /// What a behaviour or the pilot may do to the arbiter.
    #[derive(Debug, Clone)]
    enum Step {
        Claim(usize, f64, Option<u64>),
        Release(usize, bool),
        Stop(usize),
        Hold(usize, bool),
        Forget(usize),
        Clear,
        Pass(u64),
    }

    fn step() -> impl Strategy<Value = Step> {
        let who = 0usize..5;
        let percent = (-4i32..=4).prop_map(|power| f64::from(power) * 20.0);
        prop_oneof![
            6 => (who.clone(), percent, prop::option::weighted(0.4, 1u64..2_000))
                .prop_map(|(who, percent, ms)| Step::Claim(who, percent, ms)),
            3 => (who.clone(), any::<bool>()).prop_map(|(who, current)| Step::Release(who, current)),
            1 => who.clone().prop_map(Step::Stop),
            2 => (who.clone(), any::<bool>()).prop_map(|(who, held)| Step::Hold(who, held)),
            1 => who.prop_map(Step::Forget),
            1 => Just(Step::Clear),
            3 => (0u64..1_500).prop_map(Step::Pass),
        ]
    }

    /// Two at the bottom, two in the middle, one above.
    const BEHAVIOURS: [(BehaviourId, Priority); 5] = [
        (BehaviourId(0), Priority(0)),
        (BehaviourId(1), Priority(5)),
        (BehaviourId(2), Priority(0)),
        (BehaviourId(3), Priority(5)),
        (BehaviourId(4), Priority(10)),
    ];

    /// What one behaviour holds in the model.
    #[derive(Debug, Clone, Copy)]
    struct Held {
        setpoint: Setpoint,
        motion: MotionId,
        until: Option<Instant>,
        /// Its order among equals: the claim that has had the tracks, or has waited for them, longest
        /// comes first.
        since: usize,
        silent: bool,
    }

    /// The rule in its simplest form: a table, searched each time.
    #[derive(Debug, Default)]
    struct Model {
        held: [Option<Held>; 5],
    }

    impl Model {
        fn driver(&self) -> Option<usize> {
            let place = |who: usize| {
                self.held[who].map(|held| (BEHAVIOURS[who].1, std::cmp::Reverse(held.since)))
            };
            (0..5)
                .filter(|&who| self.held[who].is_some())
                .max_by_key(|&who| place(who))
        }

        fn setpoint(&self) -> Setpoint {
            let held = self.driver().and_then(|who| self.held[who]);
            held.filter(|held| !held.silent)
                .map_or(Setpoint::STOP, |held| held.setpoint)
        }

        fn drop_where(&mut self, over: impl Fn(usize, Held) -> bool) {
            for who in 0..5 {
                self.held[who] = self.held[who].filter(|&held| !over(who, held));
            }
        }

        fn follow(&mut self, step: &Step, count: usize, now: Instant) {
            match *step {
                Step::Claim(who, percent, ms) => {
                    let since = self.held[who].map_or(count, |held| held.since);
                    self.held[who] = Some(Held {
                        setpoint: at(percent),
                        motion: MotionId(count as u64),
                        until: ms.map(|ms| now + Duration::from_millis(ms)),
                        since,
                        silent: false,
                    });
                    let driver = self.driver();
                    self.drop_where(|who, held| held.until.is_some() && Some(who) != driver);
                }
                Step::Release(who, current) => self.drop_where(|other, _| other == who && current),
                Step::Stop(who) => {
                    self.drop_where(|other, _| BEHAVIOURS[other].1 <= BEHAVIOURS[who].1)
                }
                Step::Hold(who, silent) => {
                    self.held[who] = self.held[who].map(|held| Held { silent, ..held });
                }
                Step::Forget(who) => self.drop_where(|other, _| other == who),
                Step::Clear => self.drop_where(|_, _| true),
                Step::Pass(_) => {
                    self.drop_where(|_, held| held.until.is_some_and(|until| until <= now))
                }
            }
        }
    }

    proptest! {
            #[test]
            fn the_tracks_always_follow_the_highest_claim_and_never_a_released_one(
                steps in prop::collection::vec(step(), 1..80),
            ) {
                let mut arbiter = Arbiter::default();
    let mut model = Model::default();
    let mut now = Instant::now();
                for (count, step) in steps.iter().enumerate() {
                    let before = model.held;
                    if let Step::Pass(ms) = step {
                        now += Duration::from_millis(*ms);
                    }
                    let over = match *step {
                        Step::Claim(who, percent, ms) => {
                            let duration = ms.map(Duration::from_millis);
                            arbiter.claim(BEHAVIOURS[who].0, BEHAVIOURS[who].1, MotionId(count as u64), at(percent), duration, now)
                        }
                        Step::Release(who, current) => {
                            let motion = match model.held[who] {
                                Some(held) if current => held.motion,
                                _ => MotionId(u64::MAX),
                            };
                            arbiter.release(BEHAVIOURS[who].0, motion)
                        }
                        Step::Stop(who) => arbiter.stop(BEHAVIOURS[who].0, BEHAVIOURS[who].1),
                        Step::Hold(who, silent) => {
                            arbiter.hold(BEHAVIOURS[who].0, silent);
                            vec![]
                        }
                        Step::Forget(who) => {
                            arbiter.forget(BEHAVIOURS[who].0);
                            vec![]
                        }
                        Step::Clear => arbiter.clear(MotionEnd::Safety),
                        Step::Pass(_) => arbiter.expire(now),
                    };
                    model.follow(step, count, now);
                    prop_assert_eq!(arbiter.setpoint(), model.setpoint(), "after {:?}", step);
                    prop_assert_eq!(arbiter.driver(), model.driver().map(|who| BEHAVIOURS[who].0));
                    // A behaviour that lost its setpoint is told so once, unless it has ended.
                    let holds = |held: &[Option<Held>; 5], ended: &Act| match ended {
                        Act::Tell(_, Event::MotionEnded { motion, .. }) => {
                            held.iter().flatten().any(|held| held.motion == *motion)
                        }
                        _ => false,
                    };
                    for ended in &over {
                        prop_assert!(!holds(&model.held, ended), "{:?} still holds", ended);
                    }
                    let lost = before.iter().flatten().filter(|old| {
                        !model.held.iter().flatten().any(|held| held.motion == old.motion)
                    });
                    let expected = match step {
                        Step::Forget(_) => 0,
                        _ => lost.count(),
                    };
                    let of_before = over.iter().filter(|ended| holds(&before, ended)).count();
                    prop_assert_eq!(of_before, expected, "{:?}: {:?}", step, over);
                    prop_assert!(arbiter.next_deadline().is_none_or(|due| due > now));
                }
            }
        }

    #[test]
    fn a_setpoint_goes_out_once_and_is_repeated_at_5_hz_while_moving() {
        let now = Instant::now();
        let mut tracks = Tracks::new(now);
        tracks.want(at(50.0));
        assert_eq!(tracks.poll(now), Some(at(50.0)));
        assert_eq!(tracks.poll(now + 199 * MS), None);
        assert_eq!(tracks.poll(now + 200 * MS), Some(at(50.0)));
        tracks.want(Setpoint::STOP);
        assert_eq!(tracks.poll(now + 201 * MS), Some(Setpoint::STOP));
        assert_eq!(tracks.next_deadline(), None);
    }

    #[test]
    fn a_stop_never_waits() {
        let now = Instant::now();
        let mut tracks = Tracks::new(now);
        tracks.want(at(50.0));
        tracks.poll(now);
        tracks.want(Setpoint::STOP);
        assert_eq!(tracks.poll(now), Some(Setpoint::STOP));
    }

    #[test]
    fn standing_still_sends_nothing() {
        let now = Instant::now();
        let mut tracks = Tracks::new(now);
        tracks.want(Setpoint::STOP);
        assert_eq!(tracks.poll(now + 1000 * MS), None);
    }

    proptest! {
        #[test]
        fn at_most_fifty_a_second_and_the_newest_wins(
            wanted in prop::collection::vec((0u32..30, -2i32..3), 1..400),
        ) {
            let start = Instant::now();
            let mut tracks = Tracks::new(start);
            let mut now = start;
            let mut sent = Vec::new();
            for (pause, power) in wanted {
                now += pause * MS;
                tracks.want(at(f64::from(power) * 40.0));
                sent.extend(tracks.poll(now).map(|_| now));
            }
            for window in sent.windows(Tracks::PER_SECOND as usize + 2) {
                let span = *window.last().unwrap() - window[0];
                prop_assert!(span >= Duration::from_secs(1), "{span:?}");
            }
            tracks.want(at(100.0));
            let due = tracks.next_deadline().unwrap().max(now);
            prop_assert_eq!(tracks.poll(due), Some(at(100.0)));
        }
    }
}
