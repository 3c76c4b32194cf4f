//! The watchdog's promises over random histories of facts and times, compared with a second, much
//! simpler model of the facts; and a count of the states that the histories reach, so that no
//! promise holds only because it was never tested.
//!
//! `scripts/nightly histories` plays more of them.

mod model;
mod reach;

use std::collections::BTreeMap;
use std::time::Duration;

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, TestRunner};
use tokio::time::Instant;

use self::model::{Known, LongestWait, WayHome};
use super::*;
use crate::robot::{DockPlan, MotionId, Percent, Priority, Seconds};
use crate::safety::{BlindMove, DriveGrant, LastWords, PowerMeaning, Rescue};
use crate::wire::Sound;

fn histories() -> Config {
    let asked = std::env::var("HISTORIES").ok();
    let cases = asked.and_then(|asked| asked.parse().ok());
    Config::with_cases(cases.unwrap_or(500))
}

/// The cause of a stop: a behaviour with the highest priority, or the end of the run.
#[derive(Debug, Clone, Copy)]
enum Stop {
    Asked,
    RunEnding,
}

impl Stop {
    fn input(self) -> Input {
        match self {
            Stop::RunEnding => Fact::RunEnding.into(),
            Stop::Asked => Input::Request(BehaviourId(9), Priority(i16::MAX), Intent::Stop),
        }
    }
}

proptest! {
    #![proptest_config(histories())]

    #[test]
    fn after_low_until_released_nothing_moves_but_short_slow_blind_moves_and_grants_that_end(
        limits in any_limits(),
        history in any_history(),
    ) {
        let mut way_home = WayHome::default();
        Play::new(&limits).steps(&history, &mut |moment| {
            let Play { dog, known, .. } = moment.play;
            prop_assert_eq!(dog.low().is_some(), known.low);
            prop_assert!(!known.low || !moment.moves() || dog.moving(), "{:?}", moment.acts);
            way_home.see(&moment)
        })?;
    }

    #[test]
    fn a_low_robot_that_does_not_charge_is_always_sent_home_again(
        limits in any_limits(),
        history in any_history(),
    ) {
        let mut wait = LongestWait::default();
        Play::new(&limits).steps(&history, &mut |moment| wait.see(&moment))?;
    }

    #[test]
    fn no_search_begins_on_the_station(limits in any_limits(), history in any_history()) {
        Play::new(&limits).steps(&history, &mut |moment| {
            let Play { dog, known, now, limits, .. } = moment.play;
            let surely = known.surely_docked(limits, *now);
            prop_assert!(dog.docked() || !surely, "{:?}", known);
            prop_assert!(known.docked() || !dog.docked(), "{:?}", known);
            let wrong = moment.sends(&FIND) || moment.moves();
            prop_assert!(!(surely && wrong), "{:?}", moment.acts);
            Ok(())
        })?;
    }

    #[test]
    fn the_last_words_never_leave_a_low_robot_standing_off_its_station(
        limits in any_limits(),
        history in any_history(),
    ) {
        let mut searching = false;
        Play::new(&limits).steps(&history, &mut |moment| {
            let Play { dog, known, .. } = moment.play;
            searching = known.still_searches(&moment, searching);
            let left = known.low && !known.docked();
            match dog.last_words() {
                LastWords::Stop => prop_assert!(!left),
                LastWords::StopAndDock => prop_assert!(known.low),
                LastWords::Nothing => prop_assert!(known.online && (searching || dog.docked())),
            }
            Ok(())
        })?;
    }

    #[test]
    fn a_stop_is_always_possible(
        limits in any_limits(),
        history in any_history(),
        stop in prop_oneof![Just(Stop::Asked), Just(Stop::RunEnding)],
        later in any_history(),
    ) {
        let mut play = Play::new(&limits);
        play.steps(&history, &mut |_| Ok(()))?;
        let was_moving = play.dog.moving();
        let online = play.known.online;
        let asked = matches!(stop, Stop::Asked);
        if asked && play.known.low {
            // A script may not stop a blind move of the watchdog.
            return Ok(());
        }
        // A docking without a caller is the watchdog's own, and goes on.
        let asked_home = play.dog.docking.as_ref()
            .is_some_and(|active| !active.forced && !active.callers.is_empty());
        play.handle(&stop.input(), &mut |moment| {
            let must = was_moving || (online && matches!(stop, Stop::RunEnding));
            let drives = |command: &Command| matches!(command, Command::Move { .. });
            let last = sent(&moment.acts).into_iter().rfind(drives);
            prop_assert!(last == must.then_some(Command::STOP) || last == Some(Command::STOP));
            prop_assert!(!moment.play.dog.moving());
            prop_assert!(!asked_home || moment.play.dog.state() != WatchdogState::Docking);
            Ok(())
        })?;
        play.pass(60 * SECOND, &mut |moment| {
            let Play { known, limits, now, .. } = moment.play;
            let blind_move = known.allows_the_way_home(limits, *now);
            prop_assert!(blind_move || !moment.moves(), "moves after the stop: {:?}", moment.acts);
            Ok(())
        })?;
        if let Stop::RunEnding = stop {
            play.steps(&later, &mut |moment| {
                let leaves = moment.sends(&Command::Engine(Engage::Undock));
                let searches = moment.sends(&FIND) && !moment.play.known.low;
                let drives = moment.moves() || leaves || searches;
                prop_assert!(!drives, "drives after the end: {:?}", moment.acts);
                Ok(())
            })?;
        }
    }

    #[test]
    fn the_next_deadline_is_always_in_the_future(limits in any_limits(), history in any_history()) {
        Play::new(&limits).steps(&history, &mut |moment| {
            let Play { dog, now, known, .. } = moment.play;
            let due = dog.next_deadline();
            prop_assert!(due.is_none_or(|due| due > *now), "{:?} ago", due.map(|due| *now - due));
            prop_assert!(!dog.moving() || due.is_some_and(|due| due <= *now + Tracks::RESEND));
            prop_assert!(known.online || (due.is_none() && !dog.moving()));
            Ok(())
        })?;
    }
}

fn any_power() -> impl Strategy<Value = Power> {
    // Includes numbers above 100: no level.
    let percent = prop_oneof![3 => 0..=100u8, 3 => 5..=37u8, 2 => 48..=52u8, 1 => 101..=128u8];
    (percent, prop::bool::weighted(0.25))
        .prop_map(|(percent, charging)| Power { percent, charging })
}

fn any_news() -> impl Strategy<Value = EngineReport> {
    let byte =
        prop_oneof![2 => Just(1), 2 => Just(2), 1 => Just(3), 4 => Just(8), 1 => any::<u8>()];
    byte.prop_map(|byte: u8| EngineReport::from(byte))
}

/// From zero to more than any clock can hold: a host may send any duration.
fn any_duration() -> impl Strategy<Value = Duration> {
    prop_oneof![
        1 => Just(Duration::ZERO),
        1 => Just(Duration::from_nanos(1)),
        1 => Just(Duration::MAX),
        4 => (1..3000u64).prop_map(Duration::from_millis),
        2 => (1..200u64).prop_map(Duration::from_secs),
    ]
}

fn any_intent() -> impl Strategy<Value = Intent> {
    let power = || prop_oneof![8 => -100.0..=100.0f64, 1 => Just(0.0), 1 => Just(-0.4)];
    let drive = (0..50u64, power(), power(), prop::option::of(any_duration()));
    let plan = (any_duration(), 0..3u32, any_duration());
    prop_oneof![
        8 => drive.prop_map(|(motion, left, right, duration)| Intent::Move {
            motion: MotionId(motion),
            setpoint: Setpoint::from_percent(left, right).unwrap(),
            duration,
        }),
        1 => (0..50u64).prop_map(|motion| Intent::Release { motion: MotionId(motion) }),
        1 => Just(Intent::Stop),
        3 => (0..50u64, plan).prop_map(|(call, (timeout, retries, charge_timeout))| {
            Intent::Dock { call: CallId(call), plan: DockPlan { timeout, retries, charge_timeout } }
        }),
        4 => (0..50u64, any_duration()).prop_map(|(call, timeout)| Intent::Undock { call: CallId(call), timeout }),
        1 => Just(Intent::CancelDock),
    ]
}

fn who() -> impl Strategy<Value = BehaviourId> {
    (0..3u16).prop_map(BehaviourId)
}

fn any_input() -> impl Strategy<Value = Input> {
    let request = (who(), any_intent())
        .prop_map(|(by, intent)| Input::Request(by, Priority(by.0 as i16 / 2), intent));
    prop_oneof![53 => any_fact().prop_map(Input::Fact), 30 => request]
}

fn any_fact() -> impl Strategy<Value = Fact> {
    let login = (prop::bool::weighted(0.2), any_power());
    prop_oneof![
        3 => login.prop_map(|(docked, power)| Fact::LinkUp { docked, power }),
        2 => Just(Fact::LinkDown),
        2 => any::<bool>().prop_map(Fact::Streaming),
        3 => Just(Fact::BytesReceived),
        10 => any_power().prop_map(Fact::Power),
        12 => any_news().prop_map(Fact::Engine),
        8 => who().prop_map(Fact::Alive),
        2 => who().prop_map(Fact::Gone),
        1 => Just(Fact::RunEnding),
        2 => Just(Fact::Suspended),
        2 => (0..3000u64, any::<bool>()).prop_map(|(gap, guardian_wrote)| Fact::Stalled {
            gap: Duration::from_millis(gap),
            guardian_wrote,
        }),
        1 => prop::bool::weighted(0.85).prop_map(Fact::Guarded),
        1 => prop::bool::weighted(0.3).prop_map(Fact::StoppedByPerson),
        4 => prop::option::weighted(0.9, who()).prop_map(Fact::Rescuer),
    ]
}

fn any_step() -> impl Strategy<Value = Step> {
    let jump = prop_oneof![3 => 0..400u64, 1 => 0..700_000u64].prop_map(Duration::from_millis);
    prop_oneof![
        30 => any_input().prop_map(Step::Input),
        12 => (0..300u64).prop_map(|ms| Step::Pass(Duration::from_millis(ms))),
        4 => (0..40u32).prop_map(|seconds| Step::Pass(seconds * SECOND)),
        2 => (0..700u32).prop_map(|seconds| Step::Pass(seconds * SECOND)),
        2 => jump.prop_map(Step::Jump),
        2 => Just(Step::Still),
    ]
}

/// Mostly the defaults, otherwise any limits that a config may hold.
fn any_limits() -> impl Strategy<Value = Limits> {
    let time = || prop_oneof![Just(0.05), 0.05..10.0, Just(86_400.0)];
    let time = move || time().prop_map(|seconds| Seconds::new(seconds).unwrap());
    let levels = (0..98u8, 1..99u8, 1..99u8).prop_map(|(critical, low, ok)| {
        let low = critical.saturating_add(low).min(99);
        let level = |percent| Percent::new(percent).unwrap();
        (
            level(critical),
            level(low),
            level(low.saturating_add(ok).min(100)),
        )
    });
    let times = (
        time(),
        time(),
        time(),
        time(),
        time(),
        time(),
        time(),
        time(),
    );
    let count = || prop_oneof![0..3u32, Just(u32::MAX)];
    let odd = (levels, times, count(), any::<bool>());
    let odd = odd.prop_map(
        |((critical, low, ok), times, dock_retries, blind_moves)| Limits {
            power: PowerMeaning::Percent,
            low,
            ok,
            critical,
            dock_timeout: times.0,
            charge_timeout: times.1,
            dock_retries,
            dock_pause: times.2,
            power_silence: times.3,
            host_silence: times.4,
            host_grace: times.5,
            host_idle_silence: Limits::default().host_idle_silence,
            stream_silence: times.6,
            alarm_every: times.7,
            blind_moves,
            rescue_time: times.2,
            rescue_power: ok,
            rescue: if dock_retries == 1 {
                Rescue::Off
            } else {
                Rescue::Builtin
            },
        },
    );
    let usual = Limits {
        power: PowerMeaning::Percent,
        ..Limits::default()
    };
    prop_oneof![4 => Just(usual), 1 => odd]
}

/// A robot with a low battery that does not find its station in the first attempts, and perhaps is
/// told to stop soon after.
fn lost() -> impl Strategy<Value = Vec<Step>> {
    let stop = prop::option::weighted(0.4, 0..2500u64);
    (9..20u8, stop).prop_map(|(percent, stop)| {
        let power = Power {
            percent,
            charging: false,
        };
        let not_found = Step::from(Fact::Engine(EngineReport::BaseNotFound));
        let login = Step::from(Fact::LinkUp {
            docked: false,
            power,
        });
        let tries = [20, 20, 20, 0].map(|pause| [not_found.clone(), Step::Pass(pause * SECOND)]);
        let wait = |ms| Step::Pass(Duration::from_millis(ms));
        let stop = stop.map(|ms| [wait(ms), Step::Input(Stop::Asked.input())]);
        let all = std::iter::once(login).chain(tries.into_iter().flatten());
        all.chain(stop.into_iter().flatten()).collect()
    })
}

/// Nearly always begins with a login: without one nothing can go wrong.
fn any_history() -> impl Strategy<Value = Vec<Step>> {
    let login = any_power().prop_map(|power| {
        Step::from(Fact::LinkUp {
            docked: false,
            power,
        })
    });
    let rest = prop::collection::vec(any_step(), 1..80);
    let login = prop::option::weighted(0.95, login).prop_map(|login| login.into_iter().collect());
    let begin = prop_oneof![8 => login, 1 => lost()];
    (begin, rest).prop_map(|(begin, rest): (Vec<Step>, Vec<Step>)| [begin, rest].concat())
}

/// One step of a random history.
#[derive(Debug, Clone)]
enum Step {
    Input(Input),
    /// Time passes, and the watchdog is ticked at each of its deadlines.
    Pass(Duration),
    /// The whole machine sleeps: the watchdog is ticked once, at the end.
    Jump(Duration),
    /// The watchdog is ticked though no time has passed.
    Still,
}

impl From<Fact> for Step {
    fn from(fact: Fact) -> Step {
        Step::Input(fact.into())
    }
}

/// A watchdog, what is known of its robot, and a clock.
struct Play {
    dog: Watchdog,
    known: Known,
    limits: Limits,
    now: Instant,
    /// When the whole machine last woke up.
    slept: Option<Instant>,
}

/// The watchdog's output at one moment of a history.
struct Moment<'a> {
    play: &'a Play,
    /// `None` if time has passed instead.
    input: Option<&'a Input>,
    acts: Vec<Act>,
}

impl Moment<'_> {
    fn moves(&self) -> bool {
        let moves = |command: &Command| matches!(command, Command::Move { .. });
        sent(&self.acts)
            .iter()
            .any(|command| moves(command) && *command != Command::STOP)
    }

    /// Checks that a robot on its way home may be moved, and only until `ends`.
    fn drives_until(&self, ends: Instant) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            ..
        } = self.play;
        prop_assert!(*now < ends && dog.next_deadline().is_some_and(|due| due <= ends));
        prop_assert!(known.allows_a_grant(limits, *now), "{:?}", known);
        Ok(())
    }

    fn sends(&self, command: &Command) -> bool {
        sent(&self.acts).contains(command)
    }
}

type Kept = Result<(), TestCaseError>;

impl Play {
    fn new(limits: &Limits) -> Play {
        let now = Instant::now();
        Play {
            dog: Watchdog::new(limits.clone(), now),
            known: Known::default(),
            limits: limits.clone(),
            now,
            slept: None,
        }
    }

    fn steps(&mut self, steps: &[Step], see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        steps.iter().try_for_each(|step| match step {
            Step::Input(input) => self.handle(input, see),
            Step::Still => self.poll(see),
            Step::Jump(span) => {
                self.now += *span;
                self.slept = Some(self.now);
                self.poll(see)
            }
            Step::Pass(span) => self.pass(*span, see),
        })
    }

    fn handle(&mut self, input: &Input, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        self.known.record(input, &self.limits, self.now);
        input.clone().apply(&mut self.dog, self.now);
        let acts = self.dog.poll(self.now);
        self.show(Some(input), acts, see)
    }

    fn show(
        &mut self,
        input: Option<&Input>,
        acts: Vec<Act>,
        see: &mut impl FnMut(Moment<'_>) -> Kept,
    ) -> Kept {
        self.known.pass(&self.limits, self.dog.docked(), self.now);
        self.known.note_acts(&acts);
        self.known.agree(&self.dog, &self.limits)?;
        let play = self;
        see(Moment { play, input, acts })
    }

    fn poll(&mut self, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        let acts = self.dog.poll(self.now);
        self.show(None, acts, see)
    }

    /// After very many deadlines the rest of the span is skipped as if the machine slept.
    fn pass(&mut self, span: Duration, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        let end = self.now + span;
        for _ in 0..100 {
            let Some(due) = self.dog.next_deadline().filter(|due| *due <= end) else {
                self.now = end;
                return Ok(());
            };
            prop_assert!(due > self.now, "a deadline that has passed");
            self.now = due;
            self.poll(see)?;
        }
        self.now = end;
        self.slept = Some(end);
        self.poll(see)
    }
}
