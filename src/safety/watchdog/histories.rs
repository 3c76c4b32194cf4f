//! The watchdog's promises over random histories of facts and times, held against a second, much
//! simpler account of what the facts say; and a count of what the histories reach, so that no
//! promise is kept for want of a temptation.
//!
//! `HISTORIES=1000000 cargo test histories` looks for longer.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, TestRunner};
use tokio::time::Instant;

use super::rig::{CANCEL, FIND, LEAVE, SECOND, sent, told};
use super::*;
use crate::robot::{DockPlan, MotionId, Percent, Priority, Seconds};
use crate::safety::{Ask, LastWords, Leg, Rescue};
use crate::wire::Sound;

/// One step of a random history.
#[derive(Debug, Clone)]
enum Step {
    Fact(Fact),
    /// Time passes and the watchdog is asked at each of its deadlines.
    Pass(Duration),
    /// The whole machine slept: the watchdog is asked once, when all is over.
    Jump(Duration),
    /// The watchdog is asked again though no time has passed.
    Still,
}

/// What the facts say, without any of the watchdog's rules but one: where it is free to believe good
/// news of the battery later, it is followed, if there are reports enough for what it believes.
#[derive(Debug, Default)]
struct Known {
    online: bool,
    on_station: bool,
    charging: bool,
    /// So it does, where it was when it was asked last to leave its station.
    charges_here: bool,
    /// Since when it has stood on its contacts, by its own word, without charging.
    contact: Option<Instant>,
    /// It was told to leave the station, and has said nothing since.
    told_to_leave: bool,
    /// It was low and did not charge in time, and has said nothing since.
    idle: bool,
    low: bool,
    critical: bool,
    /// Reports in a row that say: charging; at least ok; more than critical.
    charges: u32,
    good: u32,
    uncritical: u32,
    /// One of charging came while the robot said that it is on its station.
    touched: bool,
    /// And nobody had asked it to leave.
    surely_touched: bool,
    /// Charging is said and not believed, and since when.
    doubted: bool,
    said: Option<Instant>,
    /// The last that was heard of a search is that it failed.
    not_found: bool,
    rescuer: Option<BehaviourId>,
    parted: bool,
    /// From when on the battery's silence counts.
    reported: Option<Instant>,
}

impl Known {
    fn docked(&self) -> bool {
        self.on_station || self.charges_here
    }

    /// On the station, and nothing gives a reason to doubt it.
    fn surely_docked(&self, limits: &Limits, now: Instant) -> bool {
        self.docked() && !self.told_to_leave && !self.idle && !self.is_idle(limits, now)
    }

    fn is_idle(&self, limits: &Limits, now: Instant) -> bool {
        let due = |since: Instant| since + limits.charge_timeout.get() <= now;
        self.low && self.contact.is_some_and(due)
    }

    fn note(&mut self, fact: &Fact, limits: &Limits, now: Instant) {
        self.idle |= self.is_idle(limits, now);
        match fact {
            Fact::LinkUp { docked, power } => {
                (self.online, self.on_station) = (true, *docked);
                (self.not_found, self.told_to_leave) = (false, false);
                self.power(*power, limits, now);
            }
            Fact::LinkDown => self.online = false,
            Fact::Rescuer(by) => self.rescuer = *by,
            Fact::Gone(by) if self.rescuer == Some(*by) => self.rescuer = None,
            Fact::Parting => self.parted = true,
            Fact::Engine(EngineNews::BaseNotFound) => self.not_found = true,
            Fact::Power(power) => self.power(*power, limits, now),
            Fact::Engine(EngineNews::Docked) => {
                (self.on_station, self.not_found) = (true, false);
                self.charges_here &= !self.told_to_leave;
                self.told_to_leave = false;
                self.touched |= self.charging;
                self.surely_touched |= self.charging;
            }
            Fact::Engine(EngineNews::Undocked) => {
                (self.on_station, self.charging) = (false, false);
                self.charges_here = false;
                (self.charges, self.touched, self.doubted) = (0, false, false);
                self.surely_touched = false;
                self.told_to_leave = false;
                self.reported = self.reported.map(|_| now);
            }
            _ => {}
        }
        let said = matches!(
            fact,
            Fact::Engine(EngineNews::Docked | EngineNews::Undocked)
        );
        self.idle &= self.on_station && !self.charges_here && !said;
        let contact = self.on_station && !self.charges_here;
        self.contact = contact.then(|| self.contact.unwrap_or(now));
    }

    /// What the watchdog has said.
    fn hear(&mut self, acts: &[Act]) {
        self.told_to_leave |= sent(acts).contains(&LEAVE);
    }

    fn power(&mut self, power: Power, limits: &Limits, now: Instant) {
        self.end_doubt(now);
        if power.charging && !self.charging {
            self.said = Some(now);
        }
        (self.charging, self.reported) = (power.charging, Some(now));
        self.charges_here = power.charging;
        self.doubted &= power.charging;
        let count = |counted: &mut u32, says: bool| *counted = if says { *counted + 1 } else { 0 };
        count(&mut self.charges, power.charging);
        count(&mut self.good, power.percent >= limits.ok.get());
        let critical = power.percent <= limits.critical.get();
        count(&mut self.uncritical, !critical);
        self.touched = power.charging && (self.touched || self.on_station);
        let surely = self.surely_touched || (self.on_station && !self.told_to_leave);
        self.surely_touched = power.charging && surely;
        self.critical |= critical;
        self.low |= !power.charging && power.percent <= limits.low.get();
    }

    /// Follows the watchdog in what it believes, if it may believe that.
    fn agree(&mut self, dog: &Watchdog, limits: &Limits) -> Kept {
        let charging = dog.guard.charging();
        prop_assert_eq!(self.charging, charging != Charging::No);
        let enough = self.touched || self.charges >= 2;
        prop_assert!(
            enough || charging != Charging::Believed,
            "one report of charging"
        );
        prop_assert!(
            !self.surely_touched || charging != Charging::Said,
            "charging on its station"
        );
        self.doubted = charging == Charging::Said;
        let released = charging == Charging::Believed || self.good >= 3;
        prop_assert!(dog.low().is_some() || !self.low || released, "{:?}", self);
        let low = dog.guard.level().is_some_and(|level| level <= limits.low);
        let late = self.charges > 0 && !self.charging && low;
        prop_assert!(dog.low().is_none() || self.low || late, "{:?}", self);
        self.low = dog.low().is_some();
        prop_assert!(dog.guard.critical() || !self.critical || self.uncritical >= 3);
        prop_assert!(!dog.guard.critical() || self.critical);
        self.critical = dog.guard.critical();
        Ok(())
    }

    /// Whether the robot searches by itself after this moment.
    fn still_searches(&self, moment: &Moment<'_>, before: bool) -> bool {
        use EngineNews::{BaseNotFound, Docked};
        let over = match moment.fact {
            Some(Fact::Power(_)) => moment.play.dog.guard.charging() == Charging::Believed,
            Some(Fact::Engine(news)) => matches!(news, Docked | BaseNotFound),
            Some(Fact::LinkDown | Fact::LinkUp { .. }) => true,
            _ => false,
        };
        let ends = |command: &Command| match command {
            Command::Move { .. } | Command::Engine(Engage::Undock | Engage::CancelDock) => {
                Some(false)
            }
            Command::Engine(Engage::Dock) => Some(true),
            _ => None,
        };
        let said = sent(&moment.acts).iter().filter_map(ends).next_back();
        self.online && said.unwrap_or(before && !over)
    }

    /// Whether a low robot may be moved: by a leg or a loan.
    fn allows_the_way_home(&self, limits: &Limits, now: Instant) -> bool {
        let lost = self.low && !self.surely_docked(limits, now);
        self.online && lost && !self.parted
    }

    fn end_doubt(&mut self, now: Instant) {
        let over = |since: Instant| now >= since + BatteryGuard::DOUBT;
        if self.doubted && self.said.is_some_and(over) {
            (self.charging, self.doubted) = (false, false);
            self.charges_here = false;
        }
    }

    fn pass(&mut self, limits: &Limits, excused: bool, now: Instant) {
        self.idle |= self.is_idle(limits, now);
        if self.online {
            self.end_doubt(now);
        }
        match self.reported {
            Some(_) if self.online && excused => self.reported = Some(now),
            Some(at) if self.online => self.low |= now >= at + limits.power_silence.get(),
            _ => {}
        }
    }
}

/// A watchdog, what is known of its robot, and a clock.
struct Play {
    dog: Watchdog,
    known: Known,
    limits: Limits,
    now: Instant,
    /// When the whole machine woke up last.
    slept: Option<Instant>,
}

/// What the watchdog wants at one moment of a history.
struct Moment<'a> {
    play: &'a Play,
    /// `None`: time has passed.
    fact: Option<&'a Fact>,
    acts: Vec<Act>,
}

impl Moment<'_> {
    fn moves(&self) -> bool {
        let moves = |command: &Command| matches!(command, Command::Move { .. });
        sent(&self.acts)
            .iter()
            .any(|command| moves(command) && *command != Command::STOP)
    }

    fn sends(&self, command: &Command) -> bool {
        sent(&self.acts).contains(command)
    }
}

type Kept = Result<(), TestCaseError>;

/// What moves a low robot: legs of the watchdog's own, and loans.
#[derive(Debug, Default)]
struct WayHome {
    /// Since when it moves.
    moves: Option<Instant>,
    /// Since when the tracks are lent, and to whom.
    lent: Option<(Instant, BehaviourId)>,
}

impl WayHome {
    const LONGEST_LEG: Duration = Leg::TURN.saturating_add(Leg::LONGEST);

    /// While low: whatever moves is a leg, slow and short, or a loan, both allowed.
    fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play { dog, known, .. } = moment.play;
        self.see_loan(moment)?;
        for command in sent(&moment.acts).iter().filter(|_| known.low) {
            let Command::Move { left, right } = *command else {
                continue;
            };
            let (left, right) = (left.unsigned_abs(), right.unsigned_abs());
            let cap = f64::from(moment.play.limits.rescue_power.get()) * 0.9;
            let slow = f64::from(left.max(right)) <= cap;
            let is_leg = left == right && [0, 27].contains(&left);
            prop_assert!(is_leg || (self.lent.is_some() && slow), "{:?}", command);
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
            dog,
            known,
            limits,
            now,
            ..
        } = moment.play;
        let began = *self.moves.get_or_insert(*now);
        let ends = match self.lent {
            Some((since, _)) => since + limits.rescue_time.get(),
            None => began + WayHome::LONGEST_LEG,
        };
        prop_assert!(*now < ends && dog.next_deadline().is_some_and(|due| due <= ends));
        prop_assert!(known.allows_the_way_home(limits, *now), "{:?}", known);
        let leg = limits.recovery_legs > 0 && known.not_found;
        prop_assert!(self.lent.is_some() || leg, "{:?}", known);
        Ok(())
    }

    fn see_loan(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            ..
        } = moment.play;
        let Some(by) = dog.borrower() else {
            self.lent = None;
            return Ok(());
        };
        prop_assert_eq!(known.rescuer, Some(by));
        prop_assert!(limits.rescue != Rescue::Off);
        prop_assert!(known.allows_the_way_home(limits, *now), "{:?}", known);
        let (since, whose) = *self.lent.get_or_insert((*now, by));
        let ends = since + limits.rescue_time.get();
        prop_assert_eq!(whose, by);
        prop_assert!(*now < ends && dog.next_deadline().is_some_and(|due| due <= ends));
        Ok(())
    }
}

/// Since when a low robot waits for BASE_FIND.
#[derive(Debug, Default)]
struct Patience(Option<Instant>);

impl Patience {
    /// Low, online and not charging, it hears BASE_FIND again within this time.
    fn longest(limits: &Limits) -> Duration {
        let moment = Duration::from_secs(1);
        let pause = limits.recovery_longest_pause.get().max(moment);
        let on_contact = limits.charge_timeout.get() * 2 + Whereabouts::LONGEST_LEAVING;
        let driven = limits.rescue_time.get() + WayHome::LONGEST_LEG;
        limits.dock_timeout.get() + on_contact + pause + driven + moment
    }

    fn see(&mut self, moment: &Moment<'_>) -> Kept {
        let Play {
            dog,
            known,
            limits,
            now,
            slept,
        } = moment.play;
        let waits = known.online && known.low && dog.place() != Place::Charging;
        if !waits || moment.sends(&FIND) {
            self.0 = waits.then_some(*now);
            return Ok(());
        }
        let since = *self.0.get_or_insert(*now);
        let since = slept.map_or(since, |slept| slept.max(since));
        let waited = *now - since;
        prop_assert!(
            waited <= Patience::longest(limits),
            "{:?}: {:?}",
            waited,
            known
        );
        Ok(())
    }
}

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
            Step::Fact(fact) => self.take(fact, see),
            Step::Still => self.tick(see),
            Step::Jump(span) => {
                self.now += *span;
                self.slept = Some(self.now);
                self.tick(see)
            }
            Step::Pass(span) => self.pass(*span, see),
        })
    }

    fn take(&mut self, fact: &Fact, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        self.known.note(fact, &self.limits, self.now);
        let acts = self.dog.take(fact.clone(), self.now);
        self.known.pass(&self.limits, self.dog.docked(), self.now);
        self.known.hear(&acts);
        self.known.agree(&self.dog, &self.limits)?;
        see(Moment {
            play: self,
            fact: Some(fact),
            acts,
        })
    }

    fn tick(&mut self, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        let acts = self.dog.tick(self.now);
        self.known.pass(&self.limits, self.dog.docked(), self.now);
        self.known.hear(&acts);
        self.known.agree(&self.dog, &self.limits)?;
        see(Moment {
            play: self,
            fact: None,
            acts,
        })
    }

    /// After very many deadlines the rest of the span is slept over.
    fn pass(&mut self, span: Duration, see: &mut impl FnMut(Moment<'_>) -> Kept) -> Kept {
        let end = self.now + span;
        for _ in 0..100 {
            let Some(due) = self.dog.next_deadline().filter(|due| *due <= end) else {
                self.now = end;
                return Ok(());
            };
            prop_assert!(due > self.now, "a deadline that has passed");
            self.now = due;
            self.tick(see)?;
        }
        self.now = end;
        self.slept = Some(end);
        self.tick(see)
    }
}

fn any_power() -> impl Strategy<Value = Power> {
    // Beyond 100 as well: the type allows it.
    let percent = prop_oneof![3 => 0..=100u8, 4 => 5..=25u8, 2 => 48..=52u8, 1 => any::<u8>()];
    (percent, prop::bool::weighted(0.25))
        .prop_map(|(percent, charging)| Power { percent, charging })
}

fn any_news() -> impl Strategy<Value = EngineNews> {
    let byte =
        prop_oneof![2 => Just(1), 2 => Just(2), 1 => Just(3), 4 => Just(8), 1 => any::<u8>()];
    byte.prop_map(|byte: u8| EngineNews::from(byte))
}

/// From none at all to more than any clock can hold: a host may say what it likes.
fn any_duration() -> impl Strategy<Value = Duration> {
    prop_oneof![
        1 => Just(Duration::ZERO),
        1 => Just(Duration::from_nanos(1)),
        1 => Just(Duration::MAX),
        4 => (1..3000u64).prop_map(Duration::from_millis),
        2 => (1..200u64).prop_map(Duration::from_secs),
    ]
}

fn any_ask() -> impl Strategy<Value = Ask> {
    let power = || prop_oneof![8 => -100.0..=100.0f64, 1 => Just(0.0), 1 => Just(-0.4)];
    let drive = (0..50u64, power(), power(), prop::option::of(any_duration()));
    let plan = (any_duration(), 0..3u32, any_duration());
    prop_oneof![
        8 => drive.prop_map(|(motion, left, right, duration)| Ask::Move {
            motion: MotionId(motion),
            setpoint: Setpoint::from_percent(left, right).unwrap(),
            duration,
        }),
        1 => (0..50u64).prop_map(|motion| Ask::Release(MotionId(motion))),
        1 => Just(Ask::Stop),
        3 => (0..50u64, plan).prop_map(|(call, (timeout, retries, charge_timeout))| {
            Ask::Dock(CallId(call), DockPlan { timeout, retries, charge_timeout })
        }),
        4 => (0..50u64, any_duration()).prop_map(|(call, timeout)| Ask::Undock(CallId(call), timeout)),
        1 => Just(Ask::CancelDock),
    ]
}

fn any_fact() -> impl Strategy<Value = Fact> {
    let who = || (0..3u16).prop_map(BehaviourId);
    let login = (prop::bool::weighted(0.2), any_power());
    prop_oneof![
        3 => login.prop_map(|(docked, power)| Fact::LinkUp { docked, power }),
        2 => Just(Fact::LinkDown),
        2 => any::<bool>().prop_map(Fact::Listening),
        3 => Just(Fact::Heard),
        10 => any_power().prop_map(Fact::Power),
        12 => any_news().prop_map(Fact::Engine),
        8 => who().prop_map(Fact::Alive),
        2 => who().prop_map(Fact::Gone),
        30 => (who(), any_ask()).prop_map(|(by, ask)| Fact::Asked {
            by,
            priority: Priority(by.0 as i16 / 2),
            ask,
        }),
        1 => Just(Fact::Parting),
        2 => Just(Fact::Suspended),
        4 => prop::option::weighted(0.9, who()).prop_map(Fact::Rescuer),
    ]
}

fn any_step() -> impl Strategy<Value = Step> {
    let jump = prop_oneof![3 => 0..400u64, 1 => 0..700_000u64].prop_map(Duration::from_millis);
    prop_oneof![
        30 => any_fact().prop_map(Step::Fact),
        12 => (0..300u64).prop_map(|ms| Step::Pass(Duration::from_millis(ms))),
        4 => (0..40u32).prop_map(|seconds| Step::Pass(seconds * SECOND)),
        2 => (0..700u32).prop_map(|seconds| Step::Pass(seconds * SECOND)),
        2 => jump.prop_map(Step::Jump),
        2 => Just(Step::Still),
    ]
}

/// The defaults mostly, or any that a config may hold.
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
        time(),
        time(),
    );
    let count = || prop_oneof![0..3u32, Just(u32::MAX)];
    let odd = (levels, times, count(), count());
    let odd = odd.prop_map(
        |((critical, low, ok), times, dock_retries, recovery_legs)| Limits {
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
            recovery_legs,
            recovery_pause: times.8,
            recovery_longest_pause: times.9,
            rescue_time: times.2,
            rescue_power: ok,
            rescue: if dock_retries == 1 {
                Rescue::Off
            } else {
                Rescue::Builtin
            },
        },
    );
    prop_oneof![4 => Just(Limits::default()), 1 => odd]
}

/// A robot with a low battery that does not find its station in any of the first tries, and perhaps
/// is told to stop soon after.
fn lost() -> impl Strategy<Value = Vec<Step>> {
    let stop = prop::option::weighted(0.4, 0..2500u64);
    (9..20u8, stop).prop_map(|(percent, stop)| {
        let power = Power {
            percent,
            charging: false,
        };
        let not_found = Step::Fact(Fact::Engine(EngineNews::BaseNotFound));
        let login = Step::Fact(Fact::LinkUp {
            docked: false,
            power,
        });
        let tries = [20, 20, 20, 0].map(|pause| [not_found.clone(), Step::Pass(pause * SECOND)]);
        let wait = |ms| Step::Pass(Duration::from_millis(ms));
        let stop = stop.map(|ms| [wait(ms), Step::Fact(Stop::Asked.fact())]);
        let all = std::iter::once(login).chain(tries.into_iter().flatten());
        all.chain(stop.into_iter().flatten()).collect()
    })
}

/// Nearly always begins with a login: without one nothing can go wrong.
fn any_history() -> impl Strategy<Value = Vec<Step>> {
    let login = any_power().prop_map(|power| {
        Step::Fact(Fact::LinkUp {
            docked: false,
            power,
        })
    });
    let rest = prop::collection::vec(any_step(), 1..80);
    let login = prop::option::weighted(0.95, login).prop_map(|login| login.into_iter().collect());
    let begin = prop_oneof![8 => login, 1 => lost()];
    (begin, rest).prop_map(|(begin, rest): (Vec<Step>, Vec<Step>)| [begin, rest].concat())
}

fn histories() -> Config {
    let asked = std::env::var("HISTORIES").ok();
    let cases = asked.and_then(|asked| asked.parse().ok());
    Config::with_cases(cases.unwrap_or(5_000))
}

/// How a stop comes: by the behaviour that may do everything, or because the run ends.
#[derive(Debug, Clone, Copy)]
enum Stop {
    Asked,
    Parting,
}

impl Stop {
    fn fact(self) -> Fact {
        match self {
            Stop::Parting => Fact::Parting,
            Stop::Asked => Fact::Asked {
                by: BehaviourId(9),
                priority: Priority(i16::MAX),
                ask: Ask::Stop,
            },
        }
    }
}

proptest! {
    #![proptest_config(histories())]

    #[test]
    fn after_low_until_released_nothing_moves_but_short_slow_legs_and_loans_that_end(
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
    fn a_low_robot_that_does_not_charge_is_sent_home_again_and_again_whatever_happens(
        limits in any_limits(),
        history in any_history(),
    ) {
        let mut patience = Patience::default();
        Play::new(&limits).steps(&history, &mut |moment| patience.see(&moment))?;
    }

    #[test]
    fn the_station_is_never_searched_from_the_station(limits in any_limits(), history in any_history()) {
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
        stop in prop_oneof![Just(Stop::Asked), Just(Stop::Parting)],
        later in any_history(),
    ) {
        let mut play = Play::new(&limits);
        play.steps(&history, &mut |_| Ok(()))?;
        let (was_moving, online) = (play.dog.moving(), play.known.online);
        let asked = matches!(stop, Stop::Asked);
        if asked && play.known.low {
            // A leg of the watchdog is no script's to stop.
            return Ok(());
        }
        let asked_home = play.dog.homing.as_ref().is_some_and(|homing| !homing.forced);
        play.take(&stop.fact(), &mut |moment| {
            let must = was_moving || (online && matches!(stop, Stop::Parting));
            let drives = |command: &Command| matches!(command, Command::Move { .. });
            let last = sent(&moment.acts).into_iter().rfind(drives);
            prop_assert!(last == must.then_some(Command::STOP) || last == Some(Command::STOP));
            prop_assert!(!moment.play.dog.moving());
            prop_assert!(!asked_home || moment.play.dog.state() != WatchdogState::Docking);
            Ok(())
        })?;
        play.pass(60 * SECOND, &mut |moment| {
            let Play { known, limits, now, .. } = moment.play;
            let leg = known.allows_the_way_home(limits, *now);
            prop_assert!(leg || !moment.moves(), "moves on by itself: {:?}", moment.acts);
            Ok(())
        })?;
        if let Stop::Parting = stop {
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

/// Names what a moment shows.
fn seen(moment: &Moment<'_>) -> Vec<String> {
    let Play { dog, known, .. } = moment.play;
    let mut seen = vec![format!("state {:?}", dog.state())];
    let mut note = |name: &str, holds: bool| seen.extend(holds.then(|| name.to_owned()));
    let homing = dog.homing.as_ref();
    let forced = homing.is_some_and(|homing| homing.forced);
    note("moves", moment.moves());
    note("searches", moment.sends(&FIND));
    note("gives the search up", moment.sends(&CANCEL));
    note(
        "sounds the alarm",
        moment.sends(&Command::Play(Sound::Alarm)),
    );
    note(
        "low by level",
        matches!(dog.low(), Some(LowCause::Level(_))),
    );
    note(
        "low by silence",
        matches!(dog.low(), Some(LowCause::Silence(_))),
    );
    note("low on the station", dog.low().is_some() && known.docked());
    note("critical", dog.guard.critical());
    let said = dog.guard.charging() == Charging::Said;
    note(
        "low, and charging is only said",
        said && dog.low().is_some(),
    );
    note(
        "low when the doubt ends",
        moment.fact.is_none() && known.charges > 0 && dog.low().is_some() && !known.docked(),
    );
    note("several wish to drive", dog.arbiter.wishing().count() > 1);
    note("backs off", homing.is_some() && dog.moving());
    let alarm = dog.state() == WatchdogState::Alarm;
    let low_moves = known.low && dog.moving();
    let lent = dog.borrower().is_some();
    note("drives a leg", low_moves && !lent);
    note("lends the tracks", lent);
    note("drives in a loan", low_moves && lent);
    note(
        "drives at the critical level",
        low_moves && dog.guard.critical(),
    );
    let loan = |event: &Event| matches!(event, Event::Loan { .. });
    note("tells of a loan", told(&moment.acts).iter().any(loan));
    note("searches under alarm", alarm && moment.sends(&FIND));
    note(
        "stands still under alarm, off the station",
        alarm && !known.docked() && homing.is_none() && !dog.moving(),
    );
    note(
        "asked to stop in a leg",
        alarm && dog.moving() && matches!(moment.fact, Some(Fact::Asked { ask: Ask::Stop, .. })),
    );
    note(
        "asked to stop while it moves",
        matches!(moment.fact, Some(Fact::Asked { ask: Ask::Stop, .. }))
            && moment.sends(&Command::STOP),
    );
    note(
        "a behaviour waits for the watchdog's docking",
        forced && !dog.waiting.is_empty(),
    );
    note("the run ends while low", dog.parting && forced);
    note("place unknown", dog.place() == Place::Unknown);
    note(
        "place unknown while low",
        known.low && dog.place() == Place::Unknown,
    );
    note("backs out", dog.whereabouts.is_leaving());
    note(&format!("last words {:?}", dog.last_words()), true);
    note(
        "an engine code nobody knows",
        matches!(moment.fact, Some(Fact::Engine(EngineNews::Unknown(_)))),
    );
    for act in &moment.acts {
        match act {
            Act::Kill(..) => seen.push("kill".into()),
            Act::Reconnect(_) => seen.push("reconnect".into()),
            Act::Announce(Event::Safety { action, .. }) => seen.push(format!("does {action:?}")),
            _ => {}
        }
    }
    seen.extend(told(&moment.acts).iter().filter_map(|event| match event {
        Event::MotionEnded { end, .. } => Some(format!("motion {end:?}")),
        Event::DockEnded { end, .. } => Some(format!("dock {end:?}")),
        Event::UndockEnded { end, .. } => Some(format!("undock {end:?}")),
        _ => None,
    }));
    seen
}

/// What [`seen`] must have named in the end.
fn all_there_is() -> Vec<String> {
    let ends = |what: &str, ends: &[DockEnd]| {
        let named = ends.iter().map(|end| format!("{what} {end:?}"));
        named.collect::<Vec<_>>()
    };
    let of_undocking = [
        DockEnd::Done,
        DockEnd::NotDocked,
        DockEnd::Timeout,
        DockEnd::Cancelled,
        DockEnd::Preempted,
        DockEnd::Disconnected,
        DockEnd::Safety,
    ];
    let of_docking = DockEnd::ALL.iter().copied();
    let of_docking: Vec<DockEnd> = of_docking
        .filter(|end| *end != DockEnd::NotDocked)
        .collect();
    let mut all = [ends("dock", &of_docking), ends("undock", &of_undocking)].concat();
    all.extend(MotionEnd::ALL.iter().map(|end| format!("motion {end:?}")));
    all.extend(
        SafetyAction::ALL
            .iter()
            .map(|action| format!("does {action:?}")),
    );
    let others = [
        "state Offline",
        "state Free",
        "state Docked",
        "state Docking",
        "state LowGoingHome",
        "state Alarm",
        "moves",
        "searches",
        "gives the search up",
        "backs off",
        "drives a leg",
        "lends the tracks",
        "drives in a loan",
        "drives at the critical level",
        "tells of a loan",
        "asked to stop in a leg",
        "searches under alarm",
        "stands still under alarm, off the station",
        "low by level",
        "low by silence",
        "low on the station",
        "critical",
        "low, and charging is only said",
        "low when the doubt ends",
        "sounds the alarm",
        "several wish to drive",
        "asked to stop while it moves",
        "a behaviour waits for the watchdog's docking",
        "the run ends while low",
        "an engine code nobody knows",
        "place unknown",
        "place unknown while low",
        "backs out",
        "last words Stop",
        "last words StopAndDock",
        "last words Nothing",
        "kill",
        "reconnect",
    ];
    all.extend(others.map(String::from));
    all
}

#[test]
fn histories_reach_all_there_is_to_reach() {
    let mut runner = TestRunner::deterministic();
    let mut reached = BTreeMap::<String, u32>::new();
    for _ in 0..2000 {
        let history = any_history().new_tree(&mut runner).unwrap().current();
        let mut of_this = BTreeSet::new();
        let mut see = |moment: Moment<'_>| {
            of_this.extend(seen(&moment));
            Ok(())
        };
        Play::new(&Limits::default())
            .steps(&history, &mut see)
            .unwrap();
        for what in of_this {
            *reached.entry(what).or_default() += 1;
        }
    }
    let rare: Vec<String> = all_there_is()
        .into_iter()
        .filter(|what| reached.get(what).is_none_or(|&histories| histories < 10))
        .collect();
    assert!(rare.is_empty(), "{rare:?} hardly ever happen: {reached:#?}");
}
