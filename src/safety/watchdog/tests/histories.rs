//! The watchdog's promises over random histories of facts and times, compared with a second, much
//! simpler model of the facts; and a count of the states that the histories reach, so that no
//! promise holds only because it was never tested.
//!
//! `scripts/nightly histories` plays more of them.
mod any;
mod known;
mod play;
mod promises;
mod reach;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{Config, TestRunner};
use tokio::time::Instant;

use self::any::{any_history, any_limits};
use self::known::Known;
use self::play::{Kept, Moment, Play, Step};
use self::promises::{LongestWait, WayHome};
use super::rig::{CANCEL, FIND, LEAVE, SECOND, events, sent};
use super::*;
use crate::robot::{DockPlan, MotionId, Percent, Priority, Seconds};
use crate::safety::{BlindMove, LastWords, Rescue};
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
    fn fact(self) -> Fact {
        match self {
            Stop::RunEnding => Fact::RunEnding,
            Stop::Asked => Fact::Asked {
                by: BehaviourId(9),
                priority: Priority(i16::MAX),
                intent: Intent::Stop,
            },
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
        let asked_home = play.dog.docking.as_ref().is_some_and(|active| !active.forced);
        play.handle(&stop.fact(), &mut |moment| {
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
