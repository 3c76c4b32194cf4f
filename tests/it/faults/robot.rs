//! Scenarios of the robot: unreachable, refusing logins, used by others, low, or away from its
//! station.

use spykee::sim::State;
use spykee::wire::{Command, Sound};

use super::stage::Stage;
use crate::rig::moves;

/// Below the watchdog's low level, above the critical one.
const LOW: f64 = 14.0;

pub async fn starts_afresh(stage: Stage) {
    let before = stage.newest_client();
    stage.begin_faults();
    let gone = |state: &State| state.user.is_none();
    let state = stage.until("gone", gone).await;
    assert!(
        state.commanded.left == 0 && !state.streams.video,
        "{state:?}"
    );
    stage.comes_back(before).await;
    stage.says_more("frame", 3).await;
    stage.dropped_old_requests();
    stage.ends_well();
}

pub async fn stops_one_that_drove_on(stage: Stage) {
    let before = stage.newest_client();
    stage.begin_faults();
    stage.run.says("hears disconnected").await;
    let state = stage.until("gone", |state| state.user.is_none()).await;
    assert!(state.commanded.left != 0, "{state:?}");
    let gone = stage.rig.sim.heard_count();
    let stop = stage.rig.heard_stop(gone).await;
    assert!(stage.rig.sim.heard_since(stop)[0].client > before);
    assert!(!stage.rig.commands(gone)[..stop - gone].iter().any(moves));
    stage.comes_back(before).await;
    stage.dropped_old_requests();
    stage.ends_well();
}

pub async fn is_let_in_again(stage: Stage) {
    let before = stage.newest_client();
    stage.begin_faults();
    stage.run.says("still not connected").await;
    stage.says_more("moved false disconnected", 2).await;
    stage.comes_back(before).await;
    stage.drives_on().await;
    stage.dropped_old_requests();
    stage.ends_well();
}

pub async fn waits_for_the_other(stage: Stage) {
    let before = stage.newest_client();
    stage.begin_faults();
    stage.run.says("in use").await;
    let user = stage.rig.sim.state().user;
    assert_eq!(user.as_deref(), Some("second-user"));
    stage.run.says("in use by `second-user`").await;
    stage.comes_back(before).await;
    stage.drives_on().await;
    stage.dropped_old_requests();
    stage.ends_well();
}

pub async fn silence_counts_as_low(stage: Stage) {
    let from = stage.begin_faults();
    stage.goes_home(from).await;
    stage.run.says("no battery level for").await;
    stage.ends_well();
}

pub async fn waits_for_a_level(stage: Stage) {
    let from = stage.begin_faults();
    stage.run.says("sent no battery level within").await;
    let heard = stage.rig.sim.heard_since(from);
    let old = heard.first().map_or(0, |heard| heard.client);
    let mut anew = heard.iter().filter(|heard| heard.client > old);
    assert!(
        anew.all(|heard| matches!(heard.command, Command::Login(_))),
        "{heard:?}"
    );
    stage.comes_back(old).await;
    stage.drives_on().await;
    stage.ends_well();
}

pub async fn goes_home_in_one_write(stage: Stage) {
    let from = stage.begin_faults();
    let stop = stage.goes_home(from).await;
    assert_eq!(
        stage.rig.at(stop).1,
        stage.rig.at(stop + 1).1,
        "in one write"
    );
    stage.run.says("hears battery_low 5").await;
    stage.no_motion_since(stop);
    stage.drives_on().await;
    stage.ends_well();
}

pub async fn gets_home_through_garbage(stage: Stage) {
    let from = stage.begin_faults();
    stage.rig.sim.set_battery(LOW);
    let stop = stage.goes_home(from).await;
    stage
        .until("home", |state| state.docked && state.charging)
        .await;
    stage.no_motion_since(stop);
    stage.ends_well();
}

pub async fn goes_home_though(stage: Stage) {
    let from = stage.begin_faults();
    stage.drives_on().await;
    stage.rig.sim.set_battery(LOW);
    let stop = stage.goes_home(from).await;
    stage.run.says("hears battery_low 14").await;
    stage
        .until("home", |state| state.docked && state.charging)
        .await;
    stage.no_motion_since(stop);
    stage.ends_well();
}

pub async fn goes_home_after_the_reconnect(stage: Stage) {
    stage.begin_faults();
    stage.run.says("hears disconnected").await;
    let gone = stage.rig.sim.heard_count();
    stage.rig.sim.set_battery(LOW);
    stage.goes_home(gone).await;
    stage.run.says("hears battery_low 14").await;
    stage.says_more("moved false safety", 1).await;
    stage.no_motion_since(gone);
    stage.dropped_old_requests();
    stage.ends_well();
}

pub async fn alarms_and_searches_on(stage: Stage) {
    let from = stage.begin_faults();
    stage.rig.sim.set_battery(LOW);
    let stop = stage.goes_home(from).await;
    hears_the_alarm_twice(&stage, stop).await;
    let mut search = stop;
    for _ in 0..3 {
        search = stage.rig.heard_dock(search + 1).await;
        assert_eq!(stage.rig.commands(search - 1)[0], Command::STOP);
    }
    let heard = stage.rig.commands(stop);
    let mut tracks: Vec<(i8, i8)> = heard.iter().filter_map(setpoint).collect();
    tracks.dedup();
    let (still, ahead, left) = ((0, 0), (27, 27), (-27, 27));
    assert_eq!(tracks[..6], [still, ahead, still, left, ahead, still]);
    stage.run.says("drives short leg 2").await;
    stage.says_more("moved false safety", 1).await;
    stage.ends_well();
}

fn setpoint(command: &Command) -> Option<(i8, i8)> {
    match command {
        Command::Move { left, right } => Some((*left, *right)),
        _ => None,
    }
}

pub async fn stays_on_the_dead_station(stage: Stage) {
    let from = stage.begin_faults();
    stage.rig.sim.set_battery(LOW);
    let stop = stage.goes_home(from).await;
    hears_the_alarm_twice(&stage, stop).await;
    let state = stage.until("on the station", |state| state.docked).await;
    assert!(!state.charging, "{state:?}");
    stage.no_motion_since(stop);
    stage.ends_well();
}

pub async fn goes_home_again(stage: Stage) {
    let from = stage.begin_faults();
    stage.rig.sim.set_battery(LOW);
    let first = stage.goes_home(from).await;
    stage
        .until("home", |state| state.docked && state.charging)
        .await;
    stage.until("lost", |state| !state.docked).await;
    stage.end_faults();
    let again = stage.goes_home(first + 2).await;
    stage
        .until("home again", |state| state.docked && state.charging)
        .await;
    stage.no_motion_since(again);
    stage.ends_well();
}

async fn hears_the_alarm_twice(stage: &Stage, from: usize) {
    let alarm = |command: &Command| *command == Command::Play(Sound::Alarm);
    let first = stage.rig.heard(from, alarm).await;
    stage.rig.heard(first + 1, alarm).await;
    stage.run.says("ALARM").await;
}
