//! Who drives the real robots: learners wait for a turn, and each robot has at most one driver. Pure:
//! the time is an argument, what robots report comes in, and the robots that must stand go out. The
//! next turn on a robot begins only after it has executed the stop of the one before.

use std::collections::HashMap;
use std::ops::RangeInclusive;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

/// The length of a turn in minutes: the usual one, and what the teacher may choose.
const USUAL_MINUTES: u64 = 3;
pub(super) const MINUTES: RangeInclusive<u64> = 1..=30;
/// A turn in which no script has been started for this long is lost, and one whose page is gone.
const START_LIMIT: Duration = Duration::from_secs(60);
const GONE_LIMIT: Duration = Duration::from_secs(30);
/// A robot whose battery was low comes back at this level, in percent.
const CHARGED: u8 = 60;
/// The rest of a turn is given back if it is at least this long.
const SHORTEST_REST: Duration = Duration::from_secs(15);

/// What a robot's agent reports.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Facts {
    pub(super) connected: bool,
    pub(super) percent: Option<u8>,
    pub(super) charging: bool,
    pub(super) docked: bool,
    /// The battery is low, and the watchdog controls the robot.
    pub(super) low: bool,
    /// A person's STOP holds.
    pub(super) stopped: bool,
    /// No script runs, and the robot has executed its last stop.
    pub(super) stands: bool,
}

#[derive(Debug)]
pub(super) struct Turn {
    learner: String,
    /// Tells the turns apart.
    pub(super) number: u64,
    ends: Instant,
    /// When it is lost, as long as no script was started.
    start_by: Option<Instant>,
    /// Since when the learner's page is gone.
    gone: Option<Instant>,
    /// Cancelled when it is over, for what the learner sees of the robot.
    pub(super) over: CancellationToken,
}

impl Drop for Turn {
    fn drop(&mut self) {
        self.over.cancel();
    }
}

#[derive(Debug, Default)]
pub(super) struct Robot {
    name: String,
    facts: Facts,
    /// The battery was low, and is not charged yet.
    charges: bool,
    pub(super) turn: Option<Turn>,
    /// It was told to stand, and has not confirmed it yet.
    stopping: bool,
    /// The teacher has stopped it, and its agent has not heard it yet.
    pub(super) stop_waits: bool,
}

#[derive(Debug)]
struct Waiting {
    learner: String,
    since: Instant,
    /// What is left of a turn that the robot has ended: it comes first.
    rest: Option<Duration>,
}

/// Why something is refused; a sentence for the person.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum TurnError {
    #[error("this class has no real robots")]
    NoRobots,
    #[error("it is not your turn on a real robot")]
    NoTurn,
    #[error("the robot is about to stand: try again in a moment")]
    Stopping,
    #[error("the robot cannot drive now")]
    NotReady,
    #[error("the teacher has stopped everything for a moment")]
    Frozen,
    #[error("a turn takes 1 to 30 minutes")]
    Minutes,
}

#[derive(Debug, Default)]
pub(super) struct Queue {
    length: Duration,
    pub(super) robots: Vec<Robot>,
    waiting: Vec<Waiting>,
    /// How many turns each learner has had.
    had: HashMap<String, u32>,
    /// Since when everything stands.
    frozen: Option<Instant>,
    /// The number of turns so far.
    turns: u64,
}

impl Robot {
    fn is_ready(&self) -> bool {
        let stopped = self.facts.stopped || self.stop_waits;
        self.facts.connected && !self.facts.low && !stopped && !self.charges
    }

    /// Ends the turn on it, if there is one. It is told to stand in any case: the log of its agent
    /// ends with the turn, too.
    fn end_turn(&mut self) {
        if self.turn.take().is_some() {
            self.stopping = false;
            self.facts.stands = false;
        }
    }

    /// How long the turn on it still takes.
    pub(super) fn left(&self, now: Instant) -> Duration {
        let turn = self.turn.as_ref();
        turn.map_or(Duration::ZERO, |turn| {
            turn.ends.saturating_duration_since(now)
        })
    }

    /// A key of the pages' texts.
    fn state(&self) -> &'static str {
        match &self.turn {
            _ if self.stop_waits && !self.facts.connected => "stop_waits",
            _ if self.stop_waits => "stop_sending",
            _ if self.facts.stopped && !self.facts.stands => "stop_sending",
            _ if self.facts.stopped => "stopped",
            _ if !self.facts.connected => "disconnected",
            _ if self.charges && self.facts.charging => "charging",
            _ if self.charges => "going_home",
            _ if self.stopping => "stopping",
            Some(_) if self.facts.stands => "turn",
            Some(_) => "drives",
            None if self.facts.docked => "docked",
            None => "ready",
        }
    }
}

impl Queue {
    pub(super) fn new(robots: impl IntoIterator<Item = String>) -> Queue {
        let robots = robots.into_iter().map(|name| Robot {
            name,
            ..Robot::default()
        });
        Queue {
            length: Duration::from_secs(60 * USUAL_MINUTES),
            robots: robots.collect(),
            ..Queue::default()
        }
    }

    /// The length of the turns that begin from now on.
    pub(super) fn set_minutes(&mut self, minutes: u64) -> Result<(), TurnError> {
        if !MINUTES.contains(&minutes) {
            return Err(TurnError::Minutes);
        }
        self.length = Duration::from_secs(60 * minutes);
        Ok(())
    }

    /// A learner asks for a turn; who waits already or has one keeps it.
    pub(super) fn ask(&mut self, learner: &str, now: Instant) -> Result<(), TurnError> {
        if self.robots.is_empty() {
            return Err(TurnError::NoRobots);
        }
        let waits = self.waiting.iter().any(|one| one.learner == learner);
        if !waits && self.robot_of(learner).is_none() {
            self.waiting.push(Waiting {
                learner: learner.to_owned(),
                since: now,
                rest: None,
            });
        }
        Ok(())
    }

    /// A learner wants no turn any more, or ends it early.
    pub(super) fn withdraw(&mut self, learner: &str) {
        self.waiting.retain(|one| one.learner != learner);
        if let Some(index) = self.robot_of(learner) {
            self.robots[index].end_turn();
        }
    }

    /// The robot of this name.
    pub(super) fn find(&self, name: &str) -> Option<usize> {
        self.robots.iter().position(|robot| robot.name == name)
    }

    /// The robot on which it is this learner's turn.
    pub(super) fn robot_of(&self, learner: &str) -> Option<usize> {
        let has = |robot: &Robot| matches!(&robot.turn, Some(turn) if turn.learner == learner);
        self.robots.iter().position(has)
    }

    /// The teacher stops a robot, or lets it go. Returns whether a STOP has waited for its agent.
    pub(super) fn stop(&mut self, index: usize, on: bool) -> bool {
        let robot = &mut self.robots[index];
        std::mem::replace(&mut robot.stop_waits, on && !robot.facts.stopped)
    }

    /// A learner starts a script on the robot, which is told so.
    pub(super) fn start(&mut self, learner: &str) -> Result<usize, TurnError> {
        let index = self.robot_of(learner).ok_or(TurnError::NoTurn)?;
        let robot = &mut self.robots[index];
        let turn = robot.turn.as_mut().ok_or(TurnError::NoTurn)?;
        match robot.stopping {
            _ if self.frozen.is_some() => return Err(TurnError::Frozen),
            true => return Err(TurnError::Stopping),
            false => turn.start_by = None,
        }
        if !robot.is_ready() {
            return Err(TurnError::NotReady);
        }
        robot.facts.stands = false;
        Ok(index)
    }

    /// A learner ends the script on the robot, which is to be told so; the turn goes on.
    pub(super) fn halt(&mut self, learner: &str) -> Result<usize, TurnError> {
        let index = self.robot_of(learner).ok_or(TurnError::NoTurn)?;
        self.robots[index].stopping = true;
        self.robots[index].facts.stands = false;
        Ok(index)
    }

    /// A robot reports; an earlier order has been carried out.
    pub(super) fn note(&mut self, index: usize, facts: Facts) {
        let robot = &mut self.robots[index];
        robot.facts = facts;
        robot.stopping &= !facts.stands;
        robot.stop_waits &= !facts.stopped;
        if facts.low {
            robot.charges = true;
        } else if facts.percent.is_some_and(|percent| percent >= CHARGED) {
            robot.charges = false;
        }
    }

    /// The time of turns, which stands while everything does.
    fn time(&self, now: Instant) -> Instant {
        self.frozen.unwrap_or(now)
    }

    /// Everything stands, and the time of turns with it, or goes on.
    pub(super) fn freeze(&mut self, on: bool, now: Instant) {
        match self.frozen {
            None if on => self.frozen = Some(now),
            Some(since) if !on => {
                self.frozen = None;
                for turn in self.robots.iter_mut().filter_map(|one| one.turn.as_mut()) {
                    turn.ends += now - since;
                    turn.start_by = turn.start_by.map(|at| at + (now - since));
                    turn.gone = None;
                }
            }
            _ => {}
        }
    }

    /// Ends and begins turns. Returns the robots that are to be told to stand. `here` says whether a
    /// learner's page is open.
    pub(super) fn poll(&mut self, now: Instant, here: impl Fn(&str) -> bool) -> Vec<usize> {
        let now = self.time(now);
        let mut told = Vec::new();
        for index in 0..self.robots.len() {
            self.end_turn(index, now, &here);
            let frozen = self.frozen.is_some();
            let robot = &mut self.robots[index];
            let drives = matches!(&robot.turn, Some(turn) if turn.gone.is_none());
            if (frozen || !drives) && !robot.facts.stands && !robot.stopping {
                robot.stopping = true;
                told.push(index);
            }
            let free = robot.turn.is_none() && robot.facts.stands && robot.is_ready();
            if free && !frozen {
                self.begin_turn(index, now, &here);
            }
        }
        told
    }

    /// Ends the turn on a robot, if it is over.
    fn end_turn(&mut self, index: usize, now: Instant, here: impl Fn(&str) -> bool) {
        let robot = &mut self.robots[index];
        let ready = robot.is_ready();
        let Some(turn) = &mut robot.turn else { return };
        turn.gone = if here(&turn.learner) {
            None
        } else {
            turn.gone.or(Some(now))
        };
        let passed = |at: Option<Instant>| at.is_some_and(|at| now >= at);
        let gone = turn.gone.map(|since| since + GONE_LIMIT);
        let over = passed(Some(turn.ends)) || passed(turn.start_by) || passed(gone);
        if ready && !over {
            return;
        }
        let rest = turn.ends.saturating_duration_since(now);
        if !ready && !over && rest >= SHORTEST_REST {
            self.waiting.push(Waiting {
                learner: turn.learner.clone(),
                since: now,
                rest: Some(rest),
            });
        }
        robot.end_turn();
    }

    fn begin_turn(&mut self, index: usize, now: Instant, here: impl Fn(&str) -> bool) {
        let mut order = self.order().into_iter();
        let Some(first) = order.find(|one| here(&one.learner)) else {
            return;
        };
        let learner = first.learner.clone();
        let rest = first.rest;
        self.waiting.retain(|one| one.learner != learner);
        if rest.is_none() {
            *self.had.entry(learner.clone()).or_default() += 1;
        }
        self.turns += 1;
        self.robots[index].turn = Some(Turn {
            learner,
            number: self.turns,
            ends: now + rest.unwrap_or(self.length),
            start_by: Some(now + START_LIMIT),
            gone: None,
            over: CancellationToken::new(),
        });
    }

    /// Those who wait, the next one first: what is left of a turn, then who has waited longest, where
    /// each turn that somebody has had counts as a turn's time less.
    fn order(&self) -> Vec<&Waiting> {
        let mut order: Vec<&Waiting> = self.waiting.iter().collect();
        order.sort_by_key(|one| {
            let had = self.had.get(&one.learner).copied().unwrap_or(0);
            (one.rest.is_none(), one.since + self.length * had)
        });
        order
    }

    /// How long the one at this place will wait, as far as is known; `None` without a robot.
    fn wait(&self, place: usize, now: Instant) -> Option<Duration> {
        let ready = self.robots.iter().filter(|robot| robot.is_ready());
        let ready = ready.map(|robot| robot.left(now));
        let mut left: Vec<Duration> = ready.collect();
        left.sort();
        let first = left.get(place.checked_rem(left.len())?)?;
        Some(*first + self.length * u32::try_from(place / left.len()).ok()?)
    }

    /// What a learner's page shows; `null` without robots.
    pub(super) fn seen_by(&self, learner: &str, now: Instant) -> Value {
        if self.robots.is_empty() {
            return Value::Null;
        }
        let now = self.time(now);
        let mut order = self.order().into_iter();
        let place = order.position(|one| one.learner == learner);
        let wait = place.and_then(|place| self.wait(place, now));
        let turn = self.robot_of(learner).map(|index| {
            let robot = &self.robots[index];
            let turn = robot.turn.as_ref();
            let starts = turn.is_some_and(|turn| turn.start_by.is_some());
            json!({
                "robot": robot.name, "state": robot.state(), "number": turn.map(|turn| turn.number),
                "left": turn.map(|turn| seconds(turn.ends, now)),
                "starts": starts, "runs": !robot.facts.stands,
            })
        });
        json!({
            "place": place.map(|place| place + 1), "wait": wait.map(|wait| wait.as_secs()),
            "turn": turn, "ready": self.robots.iter().any(Robot::is_ready),
        })
    }

    /// What the wall shows.
    pub(super) fn wall(&self, now: Instant) -> Value {
        let now = self.time(now);
        let robot = |robot: &Robot| {
            let turn = robot.turn.as_ref();
            json!({
                "name": robot.name, "state": robot.state(), "percent": robot.facts.percent,
                "charging": robot.facts.charging,
                "stopped": robot.facts.stopped || robot.stop_waits,
                "driver": turn.map(|turn| &turn.learner),
                "left": turn.map(|turn| seconds(turn.ends, now)),
            })
        };
        let robots: Vec<Value> = self.robots.iter().map(robot).collect();
        let waiting: Vec<&str> = self.order().iter().map(|one| &*one.learner).collect();
        json!({ "robots": robots, "waiting": waiting, "minutes": self.length.as_secs() / 60 })
    }
}

fn seconds(at: Instant, now: Instant) -> u64 {
    at.saturating_duration_since(now).as_secs()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use rand::rngs::StdRng;
    use rand::{RngExt as _, SeedableRng as _};

    use super::*;

    const READY: Facts = Facts {
        connected: true,
        percent: Some(90),
        charging: false,
        docked: false,
        low: false,
        stopped: false,
        stands: true,
    };
    /// How many lessons are played with each luck.
    const LESSONS: u64 = 100;
    const MINUTE: Duration = Duration::from_secs(60);

    /// As it is while its agent does not run.
    const GONE: Facts = Facts {
        connected: false,
        percent: None,
        ..READY
    };

    fn everybody(_: &str) -> bool {
        true
    }

    fn queue(robots: usize) -> Queue {
        let mut queue = Queue::new((1..=robots).map(|number| number.to_string()));
        (0..robots).for_each(|index| queue.note(index, READY));
        queue
    }

    fn turn(queue: &Queue, index: usize) -> Option<u64> {
        queue.robots[index].turn.as_ref().map(|turn| turn.number)
    }

    fn driver(queue: &Queue, index: usize) -> Option<&str> {
        let turn = queue.robots[index].turn.as_ref();
        turn.map(|turn| &*turn.learner)
    }

    #[test]
    fn the_next_turn_begins_when_the_robot_has_executed_its_stop() {
        let mut queue = queue(1);
        let now = Instant::now();
        queue.ask("Ada", now).unwrap();
        queue.ask("Bo", now).unwrap();
        assert!(queue.poll(now, everybody).is_empty());
        assert_eq!(driver(&queue, 0), Some("Ada"));
        assert_eq!(queue.start("Bo"), Err(TurnError::NoTurn));
        assert_eq!(queue.start("Ada"), Ok(0));
        let end = now + 3 * MINUTE;
        assert!(
            queue
                .poll(end - Duration::from_secs(1), everybody)
                .is_empty()
        );
        assert_eq!(queue.poll(end, everybody), [0], "it is told to stand, once");
        assert!(queue.poll(end, everybody).is_empty());
        assert_eq!(driver(&queue, 0), None);
        assert_eq!(queue.seen_by("Bo", end)["place"], 1);
        queue.note(0, READY);
        queue.poll(end, everybody);
        assert_eq!(driver(&queue, 0), Some("Bo"));
        queue.withdraw("Bo");
        queue.ask("Ada", end).unwrap();
        assert_eq!(queue.poll(end, everybody), [0], "the log ends, too");
        queue.note(0, READY);
        queue.poll(end, everybody);
        assert_eq!(
            driver(&queue, 0),
            Some("Ada"),
            "Bo has ended the turn early"
        );
    }

    #[test]
    fn who_does_not_start_or_is_gone_loses_the_turn_and_a_closed_page_ends_the_script() {
        let now = Instant::now();
        let mut queue = queue(2);
        queue.ask("Ada", now).unwrap();
        queue.ask("Bo", now).unwrap();
        queue.poll(now, everybody);
        queue.start("Bo").unwrap();
        let gone = |learner: &str| learner != "Bo";
        assert_eq!(queue.poll(now, gone), [1], "the script ends at once");
        assert_eq!(queue.start("Bo"), Err(TurnError::Stopping));
        queue.poll(now + GONE_LIMIT - Duration::from_secs(1), everybody);
        queue.poll(now + START_LIMIT - Duration::from_secs(1), gone);
        assert_eq!(driver(&queue, 1), Some("Bo"), "the page was back meanwhile");
        queue.poll(now + START_LIMIT, gone);
        assert_eq!(driver(&queue, 0), None, "Ada has not started");
        queue.poll(now + START_LIMIT + GONE_LIMIT, gone);
        assert_eq!(driver(&queue, 1), None);
    }

    #[test]
    fn a_robot_that_is_low_stopped_or_lost_gives_the_rest_back_and_comes_back() {
        for (trouble, stays, back) in [
            (Facts { low: true, ..READY }, Some(59), Some(60)),
            (
                Facts {
                    stopped: true,
                    ..READY
                },
                None,
                Some(30),
            ),
            (
                Facts {
                    connected: false,
                    ..READY
                },
                None,
                Some(30),
            ),
        ] {
            let now = Instant::now();
            let mut queue = queue(1);
            queue.ask("Ada", now).unwrap();
            queue.poll(now, everybody);
            queue.ask("Bo", now - MINUTE).unwrap();
            queue.start("Ada").unwrap();
            queue.note(
                0,
                Facts {
                    stands: false,
                    ..trouble
                },
            );
            let later = now + MINUTE;
            assert_eq!(queue.poll(later, everybody), [0]);
            assert_eq!(queue.start("Ada"), Err(TurnError::NoTurn));
            queue.note(0, trouble);
            queue.poll(later, everybody);
            for (percent, driver_then) in [(stays, None), (back, Some("Ada"))] {
                let Some(percent) = percent else { continue };
                queue.note(
                    0,
                    Facts {
                        percent: Some(percent),
                        ..READY
                    },
                );
                queue.poll(later, everybody);
                assert_eq!(driver(&queue, 0), driver_then, "{trouble:?} {percent}");
            }
            queue.start("Ada").unwrap();
            queue.poll(later + 2 * MINUTE - Duration::from_secs(1), everybody);
            assert_eq!(driver(&queue, 0), Some("Ada"), "two minutes were left");
            assert_eq!(queue.poll(later + 2 * MINUTE, everybody), [0]);
        }
    }

    #[test]
    fn freezing_stops_all_robots_and_the_time_of_the_turns() {
        let now = Instant::now();
        let mut queue = queue(1);
        queue.ask("Ada", now).unwrap();
        queue.poll(now, everybody);
        queue.start("Ada").unwrap();
        queue.freeze(true, now);
        assert_eq!(queue.poll(now, everybody), [0]);
        queue.note(0, READY);
        assert_eq!(queue.start("Ada"), Err(TurnError::Frozen));
        let later = now + 10 * MINUTE;
        assert!(queue.poll(later, everybody).is_empty());
        assert_eq!(queue.seen_by("Ada", later)["turn"]["left"], 180);
        queue.freeze(false, later);
        queue.poll(later + 2 * MINUTE, everybody);
        assert_eq!(queue.start("Ada"), Ok(0));
        // A robot that is lost meanwhile gives back what was left when it was told to stand.
        let end = later + 2 * MINUTE;
        queue.freeze(true, end);
        queue.note(0, GONE);
        queue.poll(end + MINUTE, everybody);
        queue.freeze(false, end + MINUTE);
        queue.note(0, READY);
        queue.poll(end + MINUTE, everybody);
        assert_eq!(queue.seen_by("Ada", end + MINUTE)["turn"]["left"], 60);
    }

    #[test]
    fn the_teachers_stop_waits_for_the_agent() {
        let now = Instant::now();
        let mut queue = queue(1);
        queue.ask("Ada", now).unwrap();
        queue.poll(now, everybody);
        let over = queue.robots[0].turn.as_ref().unwrap().over.clone();
        queue.note(0, GONE);
        assert!(!queue.stop(0, true));
        for (facts, state) in [(GONE, "stop_waits"), (READY, "stop_sending")] {
            queue.note(0, facts);
            queue.poll(now, everybody);
            assert_eq!(driver(&queue, 0), None);
            assert_eq!(queue.wall(now)["robots"][0]["state"], state);
        }
        assert!(over.is_cancelled());
        let stopped = Facts {
            stopped: true,
            ..READY
        };
        queue.note(0, stopped);
        assert!(!queue.stop(0, true), "it holds already");
        assert_eq!(queue.wall(now)["robots"][0]["state"], "stopped");
        assert!(!queue.robots[0].stop_waits);
        queue.note(0, READY);
        queue.poll(now, everybody);
        assert_eq!(driver(&queue, 0), Some("Ada"));
    }

    #[test]
    fn minutes_have_limits_and_nobody_waits_twice() {
        let mut queue = queue(1);
        for wrong in [0, 31, 1_000_000_000, u64::MAX] {
            assert_eq!(queue.set_minutes(wrong), Err(TurnError::Minutes));
        }
        queue.set_minutes(1).unwrap();
        let now = Instant::now();
        (0..3).for_each(|_| queue.ask("Ada", now).unwrap());
        queue.poll(now, everybody);
        queue.ask("Ada", now).unwrap();
        assert!(queue.waiting.is_empty());
        let mut empty = Queue::new([]);
        assert_eq!(empty.ask("Ada", now), Err(TurnError::NoRobots));
        assert_eq!(empty.seen_by("Ada", now), Value::Null);
    }

    /// A robot as its agent reports it: a script ends, and the robot stands, some seconds after the
    /// order.
    #[derive(Debug, Default)]
    struct Model {
        /// Whose script moves it.
        script: Option<String>,
        /// The seconds until it stands.
        standing: Option<u64>,
        /// The seconds until it is ready again, and what it reports until then.
        trouble: u64,
        facts: Facts,
    }

    /// A class of 25 learners and two robots for 40 minutes, a second a step.
    struct Lesson {
        queue: Queue,
        robots: [Model; 2],
        random: StdRng,
        bad_luck: bool,
        turns: BTreeMap<String, u32>,
        asked: BTreeMap<String, Instant>,
        away: BTreeMap<String, u64>,
        longest: Duration,
    }

    impl Lesson {
        fn new(seed: u64, minutes: u64, bad_luck: bool) -> Lesson {
            let mut queue = queue(2);
            queue.set_minutes(minutes).unwrap();
            let ready = || Model {
                facts: READY,
                ..Model::default()
            };
            Lesson {
                queue,
                robots: [ready(), ready()],
                random: StdRng::seed_from_u64(seed),
                bad_luck,
                turns: (1..=25)
                    .map(|number| (format!("L{number:02}"), 0))
                    .collect(),
                asked: BTreeMap::new(),
                away: BTreeMap::new(),
                longest: Duration::ZERO,
            }
        }

        fn chance(&mut self, one_in: u32) -> bool {
            self.random.random_range(0..one_in) == 0
        }

        fn play(&mut self) {
            let began = Instant::now();
            for second in 0..40 * 60 {
                let now = began + Duration::from_secs(second);
                self.learners_act(now);
                self.robots_act();
                let before = [0, 1].map(|index| turn(&self.queue, index));
                let away = self.away.clone();
                let told = self.queue.poll(now, |learner| !away.contains_key(learner));
                for index in told {
                    let wait = self.random.random_range(0..3);
                    self.robots[index].standing.get_or_insert(wait);
                }
                for (index, turn) in before.into_iter().enumerate() {
                    if self::turn(&self.queue, index) != turn {
                        self.begun(index, now);
                    }
                }
                self.check();
            }
        }

        fn begun(&mut self, index: usize, now: Instant) {
            let Some(learner) = driver(&self.queue, index).map(str::to_owned) else {
                return;
            };
            assert_eq!(self.robots[index].script, None, "a robot still drives");
            let Some(asked) = self.asked.remove(&learner) else {
                return; // the rest of a turn
            };
            self.longest = self.longest.max(now - asked);
            let had = self.turns[&learner];
            for (other, since) in &self.asked {
                let at_least = self.turns[other] <= had && *since <= asked;
                let better = at_least && (self.turns[other] < had || *since < asked);
                // The other robot's turn may have begun in the same moment.
                let waits = self.queue.robot_of(other).is_none();
                let here = waits && !self.away.contains_key(other);
                assert!(!(better && here), "{learner} was preferred to {other}");
            }
            *self.turns.get_mut(&learner).unwrap() += 1;
        }

        fn learners_act(&mut self, now: Instant) {
            self.away.retain(|_, left| {
                *left -= 1;
                *left > 0
            });
            for learner in self.turns.keys().cloned().collect::<Vec<_>>() {
                if self.bad_luck && self.chance(2000) {
                    let time = self.random.random_range(1..300);
                    self.away.insert(learner.clone(), time);
                }
                if self.away.contains_key(&learner) {
                    continue;
                }
                let Some(index) = self.queue.robot_of(&learner) else {
                    let waiting = &self.queue.waiting;
                    let waits = waiting.iter().any(|one| one.learner == learner);
                    if !waits && self.chance(20) {
                        self.queue.ask(&learner, now).unwrap();
                        self.asked.insert(learner, now);
                    } else if waits && self.bad_luck && self.chance(5000) {
                        self.queue.withdraw(&learner);
                        self.asked.remove(&learner);
                    }
                    continue;
                };
                if self.chance(8) && self.queue.start(&learner).is_ok() {
                    // A script that runs already is ended first.
                    self.robots[index].script = Some(learner.clone());
                    self.robots[index].facts.stands = false;
                    self.robots[index].standing = None;
                } else if self.chance(60) && self.queue.halt(&learner).is_ok() {
                    self.robots[index].standing = Some(1);
                }
            }
        }

        fn robots_act(&mut self) {
            for index in 0..2 {
                let unlucky = self.bad_luck && self.chance(600);
                let time = self.random.random_range(20..240);
                let which = self.random.random_range(0..3);
                let robot = &mut self.robots[index];
                robot.trouble = robot.trouble.saturating_sub(1);
                let stands = robot.facts.stands;
                if robot.trouble == 0 {
                    robot.facts = Facts { stands, ..READY };
                }
                if unlucky && robot.trouble == 0 {
                    robot.trouble = time;
                    robot.facts.low = which == 0;
                    robot.facts.stopped = which == 1;
                    robot.facts.connected = which != 2;
                }
                match robot.standing {
                    Some(0) => {
                        robot.standing = None;
                        robot.script = None;
                        robot.facts.stands = true;
                    }
                    Some(left) => robot.standing = Some(left - 1),
                    None => {}
                }
                let facts = robot.facts;
                self.queue.note(index, facts);
            }
        }

        fn check(&self) {
            let drivers: Vec<&str> = (0..2).filter_map(|at| driver(&self.queue, at)).collect();
            assert!(drivers.len() < 2 || drivers[0] != drivers[1]);
            for (index, robot) in self.robots.iter().enumerate() {
                let turn = driver(&self.queue, index);
                let foreign =
                    turn.is_some() && robot.script.is_some() && turn != robot.script.as_deref();
                assert!(
                    !foreign,
                    "{turn:?} has the turn, and {:?} drives",
                    robot.script
                );
                let here = |learner: &String| !self.away.contains_key(learner);
                let idle = turn.is_none() && robot.trouble == 0 && robot.facts.stands;
                let waits = self.asked.keys().any(here);
                let known =
                    self.queue.robots[index].is_ready() && self.queue.robots[index].facts.stands;
                assert!(
                    !(idle && known && waits),
                    "a robot stands idle while somebody waits"
                );
            }
        }
    }

    /// `scripts/class --queue` prints what this counts.
    #[test]
    fn in_forty_minutes_two_robots_give_each_of_25_learners_a_turn_and_never_have_two_drivers() {
        for (minutes, bad_luck) in [(3, false), (2, true)] {
            let mut longest = Duration::ZERO;
            let mut fewest = u32::MAX;
            let mut most = 0;
            let mut without = 0;
            for seed in 0..LESSONS {
                let mut lesson = Lesson::new(seed, minutes, bad_luck);
                lesson.play();
                let turns = lesson.turns.values().copied();
                without += turns.clone().filter(|turns| *turns == 0).count();
                fewest = fewest.min(turns.clone().min().unwrap());
                most = most.max(turns.max().unwrap());
                longest = longest.max(lesson.longest);
                if seed == 0 {
                    println!(
                        "turns of {minutes} minutes, bad luck {bad_luck}: {:?}",
                        lesson.turns
                    );
                }
            }
            println!(
                "{LESSONS} lessons, turns of {minutes} minutes, bad luck {bad_luck}: {fewest} to {most} \
                 turns each, {without} of {} learners without one, longest wait {:.1} minutes",
                25 * LESSONS,
                longest.as_secs_f64() / 60.0
            );
            assert!(bad_luck || without == 0, "{without} without a turn");
        }
    }
}
