//! The situations that the histories reach, by name.

use super::*;

/// Names all situations that must be reached, and whether each holds at this moment.
fn situations(moment: &Moment<'_>, note: &mut impl FnMut(&str, bool)) {
    use WatchdogState::{Alarm, Docked, Docking, Free, LowGoingHome, Offline};
    let Play { dog, known, .. } = moment.play;
    for state in [Offline, Free, Docked, Docking, LowGoingHome, Alarm] {
        note(&format!("state {state:?}"), dog.state() == state);
    }
    for words in [LastWords::Stop, LastWords::StopAndDock, LastWords::Nothing] {
        note(&format!("last words {words:?}"), dog.last_words() == words);
    }
    let has = |wanted: fn(&Act) -> bool| moment.acts.iter().any(wanted);
    note("kill", has(|act| matches!(act, Act::Kill(..))));
    note("reconnect", has(|act| matches!(act, Act::Reconnect(_))));
    let docking = dog.docking.as_ref();
    let forced = docking.is_some_and(|active| active.forced);
    note("moves", moment.moves());
    note("searches", moment.sends(&FIND));
    note("cancels the search", moment.sends(&CANCEL));
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
    note("critical", dog.battery_monitor.critical());
    let unconfirmed = dog.battery_monitor.charging() == Charging::Unconfirmed;
    note(
        "low with unconfirmed charging",
        unconfirmed && dog.low().is_some(),
    );
    note(
        "low when unconfirmed charging expires",
        moment.input.is_none() && known.charges > 0 && dog.low().is_some() && !known.docked(),
    );
    note("several wish to drive", dog.arbiter.claimants().count() > 1);
    note("backs off", docking.is_some() && dog.moving());
    let alarm = dog.state() == WatchdogState::Alarm;
    let low_moves = known.low && dog.moving();
    let granted = dog.grantee().is_some();
    note("makes a blind move", low_moves && !granted);
    note("grants the tracks", granted);
    note("drives in a grant", low_moves && granted);
    note(
        "drives at the critical level",
        low_moves && dog.battery_monitor.critical(),
    );
    let grant = |event: &Event| matches!(event, Event::DriveGrant { .. });
    note("announces a grant", events(&moment.acts).iter().any(grant));
    note("searches under alarm", alarm && moment.sends(&FIND));
    note(
        "stands still under alarm, off the station",
        alarm && !known.docked() && docking.is_none() && !dog.moving(),
    );
    note(
        "asked to stop in a blind move",
        alarm && dog.moving() && matches!(moment.input, Some(Input::Request(_, _, Intent::Stop))),
    );
    note(
        "asked to stop while it moves",
        matches!(moment.input, Some(Input::Request(_, _, Intent::Stop)))
            && moment.sends(&Command::STOP),
    );
    note(
        "a behaviour waits for the watchdog's docking",
        forced
            && dog
                .homing
                .as_ref()
                .is_some_and(|homing| !homing.callers.is_empty()),
    );
    note("the run ends while low", dog.run_ending && forced);
    note("dock state unknown", dog.dock_state() == DockState::Unknown);
    note(
        "dock state unknown while low",
        known.low && dog.dock_state() == DockState::Unknown,
    );
    note("backs out", dog.dock_tracker.is_leaving());
    note(
        "an unknown engine code",
        matches!(
            moment.input,
            Some(Input::Fact(Fact::Engine(EngineReport::Unknown(_))))
        ),
    );
}

/// Names what was done or answered at this moment.
fn done(moment: &Moment<'_>) -> Vec<String> {
    let name = |act: &Act| match act {
        Act::Announce(Event::Safety { action, .. }) => Some(format!("does {action:?}")),
        Act::Tell(_, Event::MotionEnded { end, .. }) => Some(format!("motion {end:?}")),
        Act::Tell(_, Event::DockEnded { outcome, .. }) => Some(format!("dock {:?}", outcome.end)),
        Act::Tell(_, Event::UndockEnded { end, .. }) => Some(format!("undock {end:?}")),
        _ => None,
    };
    moment.acts.iter().filter_map(name).collect()
}

/// All names that [`done`] must have returned in the end.
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
    // `Blocked` is detected by the script; the watchdog never reports it.
    let of_motion = MotionEnd::ALL
        .iter()
        .filter(|end| **end != MotionEnd::Blocked);
    all.extend(of_motion.map(|end| format!("motion {end:?}")));
    all.extend(
        SafetyAction::ALL
            .iter()
            .map(|action| format!("does {action:?}")),
    );
    all
}

#[test]
fn histories_reach_every_situation() {
    let mut runner = TestRunner::deterministic();
    let mut reached = BTreeMap::<String, u32>::new();
    for _ in 0..2000 {
        let history = any_history().new_tree(&mut runner).unwrap().current();
        let mut of_this = BTreeMap::<String, bool>::new();
        let mut see = |moment: Moment<'_>| {
            situations(&moment, &mut |name, holds| {
                *of_this.entry(name.to_owned()).or_default() |= holds;
            });
            of_this.extend(done(&moment).into_iter().map(|name| (name, true)));
            Ok(())
        };
        Play::new(&Limits::default())
            .steps(&history, &mut see)
            .unwrap();
        for (what, holds) in of_this {
            *reached.entry(what).or_default() += u32::from(holds);
        }
    }
    for what in all_there_is() {
        reached.entry(what).or_default();
    }
    reached.retain(|_, histories| *histories < 10);
    assert!(reached.is_empty(), "hardly ever happen: {reached:#?}");
}
