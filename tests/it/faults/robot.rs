//! Scenarios of the robot: unreachable, refusing logins, used by others, low, or away from its
//! station.

use std::time::Duration;

use spykee::sim::State;
use spykee::wire::{Command, Sound};

use super::fault_run::FaultRun;
use crate::rig::moves;

/// Below the watchdog's low level, above the critical one.
const LOW: f64 = 14.0;

pub async fn starts_afresh(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    fault_run.begin_faults();
    let gone = |state: &State| state.user.is_none();
    let state = fault_run.until("gone", gone).await;
    assert!(
        state.commanded.left == 0 && !state.streams.video,
        "{state:?}"
    );
    fault_run.comes_back(before).await;
    fault_run.says_more("frame", 3).await;
    fault_run.dropped_old_requests();
    fault_run.ends_well();
}

pub async fn stops_one_that_drove_on(fault_run: FaultRun) {
    let sim = &fault_run.rig.sim;
    fault_run.rig.heard_motion(sim.heard_count()).await;
    let before = fault_run.newest_client();
    fault_run.begin_faults();
    fault_run.run.says("hears disconnected").await;
    let state = fault_run.until("gone", |state| state.user.is_none()).await;
    assert!(state.commanded.left != 0, "{state:?}");
    let gone = fault_run.rig.sim.heard_count();
    let stop = fault_run.rig.heard_stop(gone).await;
    assert!(fault_run.rig.sim.heard_since(stop)[0].client > before);
    assert!(!fault_run.rig.commands_between(gone, stop).iter().any(moves));
    fault_run.comes_back(before).await;
    fault_run.dropped_old_requests();
    fault_run.ends_well();
}

pub async fn is_let_in_again(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    fault_run.begin_faults();
    fault_run.run.says("still not connected").await;
    fault_run.says_more("moved false disconnected", 2).await;
    fault_run.comes_back(before).await;
    fault_run.drives_on().await;
    fault_run.dropped_old_requests();
    fault_run.ends_well();
}

pub async fn waits_for_the_other(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    fault_run.begin_faults();
    fault_run.run.says("in use").await;
    let user = fault_run.rig.sim.state().user;
    assert_eq!(user.as_deref(), Some("second-user"));
    fault_run.run.says("in use by `second-user`").await;
    fault_run.comes_back(before).await;
    fault_run.drives_on().await;
    fault_run.dropped_old_requests();
    fault_run.ends_well();
}

pub async fn silence_counts_as_low(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.goes_home(from).await;
    fault_run.run.says("no battery level for").await;
    fault_run.ends_well();
}

pub async fn waits_for_a_level(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.run.says("sent no battery level within").await;
    let heard = fault_run.rig.sim.heard_since(from);
    let old = heard.first().map_or(0, |heard| heard.client);
    let mut anew = heard.iter().filter(|heard| heard.client > old);
    assert!(
        anew.all(|heard| matches!(heard.command, Command::Login(_))),
        "{heard:?}"
    );
    fault_run.comes_back(old).await;
    fault_run.drives_on().await;
    fault_run.ends_well();
}

pub async fn goes_home_in_one_write(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    let stop = fault_run.goes_home(from).await;
    assert_eq!(
        fault_run.rig.at(stop).1,
        fault_run.rig.at(stop + 1).1,
        "in one write"
    );
    fault_run.run.says("hears battery_low 5").await;
    fault_run.no_motion_since(stop);
    fault_run.drives_on().await;
    fault_run.ends_well();
}

pub async fn gets_home_through_garbage(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.rig.sim.set_battery(LOW);
    let stop = fault_run.goes_home(from).await;
    fault_run
        .until("home", |state| state.docked && state.charging)
        .await;
    fault_run.no_motion_since(stop);
    fault_run.ends_well();
}

pub async fn goes_home_though(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.drives_on().await;
    fault_run.rig.sim.set_battery(LOW);
    let stop = fault_run.goes_home(from).await;
    fault_run.run.says("hears battery_low 14").await;
    fault_run
        .until("home", |state| state.docked && state.charging)
        .await;
    fault_run.no_motion_since(stop);
    fault_run.ends_well();
}

pub async fn goes_home_after_the_reconnect(fault_run: FaultRun) {
    fault_run.begin_faults();
    fault_run.run.says("hears disconnected").await;
    let gone = fault_run.rig.sim.heard_count();
    fault_run.rig.sim.set_battery(LOW);
    fault_run.goes_home(gone).await;
    fault_run.run.says("hears battery_low 14").await;
    fault_run.says_more("moved false safety", 1).await;
    fault_run.no_motion_since(gone);
    fault_run.dropped_old_requests();
    fault_run.ends_well();
}

pub async fn alarms_and_searches_on(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.rig.sim.set_battery(LOW);
    let stop = fault_run.goes_home(from).await;
    hears_the_alarm_twice(&fault_run, stop).await;
    let mut search = stop;
    let mut begun = Vec::new();
    for _ in 0..3 {
        search = fault_run.rig.heard_dock(search + 1).await;
        assert_eq!(fault_run.rig.commands(search - 1)[0], Command::STOP);
        let blind_move = fault_run.rig.heard(search, moves).await;
        begun.push(fault_run.rig.at(blind_move).0 - fault_run.rig.at(search).0);
    }
    // A busy machine may begin the second one when its turn of 0.95 s is over.
    let turn_is_missed = begun[1] > begun[0] + Duration::from_millis(700);
    let heard = fault_run.rig.commands(stop);
    let mut tracks: Vec<(i8, i8)> = heard.iter().filter_map(setpoint).collect();
    tracks.dedup();
    let still = (0, 0);
    let ahead = (27, 27);
    let left = (-27, 27);
    // A stall of the machine stops the tracks for a moment.
    if fault_run.run.has_stalled().await {
        tracks.retain(|one| *one != still);
        tracks.dedup();
        assert_eq!(tracks[..3], [ahead, left, ahead]);
    } else {
        let expected = match turn_is_missed {
            false => [still, ahead, still, left, ahead, still],
            true => [still, ahead, still, ahead, still, (-27, -27)],
        };
        assert_eq!(tracks[..6], expected, "{begun:?}\n{}", fault_run.run.text());
    }
    fault_run.run.says("makes short blind move 2").await;
    fault_run.says_more("moved false safety", 1).await;
    fault_run.ends_well();
}

fn setpoint(command: &Command) -> Option<(i8, i8)> {
    match command {
        Command::Move { left, right } => Some((*left, *right)),
        _ => None,
    }
}

pub async fn stays_on_the_dead_station(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.rig.sim.set_battery(LOW);
    let stop = fault_run.goes_home(from).await;
    hears_the_alarm_twice(&fault_run, stop).await;
    let state = fault_run
        .until("on the station", |state| state.docked)
        .await;
    assert!(!state.charging, "{state:?}");
    fault_run.no_motion_since(stop);
    fault_run.ends_well();
}

pub async fn goes_home_again(fault_run: FaultRun) {
    let from = fault_run.begin_faults();
    fault_run.rig.sim.set_battery(LOW);
    let first = fault_run.goes_home(from).await;
    fault_run
        .until("home", |state| state.docked && state.charging)
        .await;
    fault_run.until("lost", |state| !state.docked).await;
    fault_run.end_faults();
    let again = fault_run.goes_home(first + 2).await;
    fault_run
        .until("home again", |state| state.docked && state.charging)
        .await;
    fault_run.no_motion_since(again);
    fault_run.ends_well();
}

async fn hears_the_alarm_twice(fault_run: &FaultRun, from: usize) {
    let alarm = |command: &Command| *command == Command::Play(Sound::Alarm);
    let first = fault_run.rig.heard(from, alarm).await;
    fault_run.rig.heard(first + 1, alarm).await;
    fault_run.run.says("ALARM").await;
}
