//! Which behaviour drives when several want to, from the robot's view: the tracks change from one
//! to another without a gap or a jump.

use rustix::process::{Pid, Signal};
use spykee::wire::{Command, Engage, EngineReport, Led, Report};

use crate::rig::{Rig, Run, assert_contains, moves};

/// The beginning of every script here: `turn` waits for the test's signal.
const TURN: &str =
    "local function turn(code) repeat until robot.wait_for('engine').code == code end\n";

/// Running behaviours, each with name, priority and script.
struct Crew {
    run: Run,
    rig: Rig,
}

impl Crew {
    async fn new(crew: &[(&str, i16, &str)]) -> Crew {
        let rig = Rig::quiet().await;
        let mut config = "behaviours:\n".to_owned();
        for (name, priority, script) in crew {
            rig.file(&format!("{name}.lua"), &format!("{TURN}{script}"));
            config.push_str(&format!("- {{ file: {name}.lua, priority: {priority} }}\n"));
        }
        let run = rig.run_config(&config);
        Crew { rig, run }
    }

    /// Signals the scripts that wait for this code.
    fn turn(&self, code: u8) {
        self.rig
            .sim
            .inject(Report::Engine(EngineReport::Unknown(code)));
    }

    /// Waits until the tracks receive this power, from index `from` on; returns the next index.
    async fn wait_for_move(&self, from: usize, power: i8) -> usize {
        let left = power;
        let right = power;
        let wanted = Command::Move { left, right };
        self.rig.heard(from, |command| *command == wanted).await + 1
    }

    async fn light(&self) {
        let on = Command::Led {
            led: Led::Left,
            on: true,
        };
        self.rig.heard(0, |command| *command == on).await;
    }

    /// Checks all powers that the tracks received from the first motion on, without repetitions.
    async fn drove(&self, expected: &[i8]) {
        self.run.assert_powers(&self.tracks(), expected).await;
    }

    fn tracks(&self) -> Vec<i8> {
        let left = |command: &Command| match command {
            Command::Move { left, right } => {
                assert_eq!(left, right);
                Some(*left)
            }
            _ => None,
        };
        let heard = self.rig.commands(0);
        let mut tracks: Vec<i8> = heard.iter().filter_map(left).collect();
        tracks.dedup();
        let first = tracks.iter().position(|&power| power != 0).unwrap();
        tracks.split_off(first)
    }

    fn host(&self, name: &str) -> Pid {
        let is_its = |pid: &Pid| {
            let line = std::fs::read(format!("/proc/{}/cmdline", pid.as_raw_nonzero()));
            line.is_ok_and(|line| line.ends_with(format!("/{name}\0").as_bytes()))
        };
        self.run.hosts().into_iter().find(is_its).unwrap()
    }

    fn signal(&self, name: &str, signal: Signal) {
        rustix::process::kill_process(self.host(name), signal).unwrap();
    }
}

const PATROL: (&str, i16, &str) = ("patrol", 0, "robot.move(40, 40) turn(0)");

/// A script that drives after its first signal and releases the tracks after the second.
fn avoid(on: u8, off: u8, percent: i8) -> String {
    format!(
        "turn({on})\n\
         local drives = task.spawn(function() robot.move({percent}, {percent}) task.wait(600) end)\n\
         turn({off}) drives:cancel() turn(0)"
    )
}

#[tokio::test(flavor = "multi_thread")]
async fn the_tracks_go_to_the_higher_priority_and_back_to_the_newest_setpoint_of_the_lower() {
    let patrol = "robot.move(40, 40) turn(101)\n\
                  robot.move(60, 60) robot.led('left', true) turn(0)";
    let crew = Crew::new(&[("patrol", 0, patrol), ("avoid", 10, &avoid(100, 102, -50))]).await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    let at = crew.wait_for_move(at, -45).await;
    crew.turn(101);
    crew.light().await;
    crew.turn(102);
    crew.wait_for_move(at, 54).await;
    crew.drove(&[36, -45, 54]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_timed_move_is_preempted_by_a_timed_move_and_both_get_their_result() {
    let patrol = "print('patrol', robot.move(40, 40, 600)) robot.move(60, 60) turn(0)";
    let avoid = "turn(100) print('avoid', robot.move(-50, -50, 0.5)) turn(0)";
    let crew = Crew::new(&[("patrol", 0, patrol), ("avoid", 10, avoid)]).await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    let at = crew.wait_for_move(at, -45).await;
    crew.wait_for_move(at, 54).await;
    crew.run.says("patrol false preempted").await;
    crew.run.says("avoid true done").await;
    crew.drove(&[36, -45, 54]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn however_the_higher_behaviour_ends_the_lower_resumes_without_a_stop() {
    for end in [
        "return",
        "error('boom')",
        "while true do end",
        "script.stop()",
        "turn(0)",
    ] {
        let avoid = format!("turn(100) robot.move(-50, -50) turn(101) {end}");
        let crew = Crew::new(&[PATROL, ("avoid", 10, &avoid)]).await;
        let at = crew.wait_for_move(0, 36).await;
        crew.turn(100);
        let at = crew.wait_for_move(at, -45).await;
        match end {
            "turn(0)" => crew.signal("avoid", Signal::KILL),
            _ => crew.turn(101),
        }
        crew.wait_for_move(at, 36).await;
        eprintln!("{end}");
        crew.drove(&[36, -45, 36]).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frozen_higher_behaviour_is_stopped_before_the_lower_resumes() {
    let crew = Crew::new(&[PATROL, ("avoid", 10, &avoid(100, 101, -50))]).await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    let at = crew.wait_for_move(at, -45).await;
    crew.signal("avoid", Signal::STOP);
    crew.wait_for_move(at, 36).await;
    crew.drove(&[36, -45, 0, 36]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_behaviour_that_holds_the_tracks_still_does_not_count_as_dead() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("robot.move(0, 0) task.wait(1) print('alive')");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["alive"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frozen_lower_behaviour_without_the_tracks_does_not_disturb_the_higher() {
    let crew = Crew::new(&[PATROL, ("avoid", 10, &avoid(100, 101, -50))]).await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    let at = crew.wait_for_move(at, -45).await;
    crew.signal("patrol", Signal::STOP);
    crew.run.says("showed no life").await;
    crew.drove(&[36, -45]).await;
    crew.turn(101);
    crew.wait_for_move(at, 0).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn of_three_levels_the_highest_drives_and_a_middle_one_that_released_the_tracks_is_skipped() {
    let crew = Crew::new(&[
        PATROL,
        ("middle", 5, &avoid(100, 102, 60)),
        ("avoid", 10, &avoid(101, 103, -50)),
    ])
    .await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    let at = crew.wait_for_move(at, 54).await;
    crew.turn(101);
    let at = crew.wait_for_move(at, -45).await;
    crew.turn(102);
    crew.turn(103);
    crew.wait_for_move(at, 36).await;
    crew.drove(&[36, 54, -45, 36]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn among_equals_the_first_keeps_the_tracks_until_it_releases_them() {
    let other = "turn(100) robot.move(70, 70) robot.led('left', true) turn(0)";
    let crew = Crew::new(&[("first", 3, &avoid(99, 101, 40)), ("other", 3, other)]).await;
    crew.run.says("connected").await;
    let first = async {
        // The scripts may not be listening yet.
        while !crew.rig.commands(0).iter().any(moves) {
            crew.turn(99);
            tokio::time::sleep(std::time::Duration::from_millis(50)).await;
        }
    };
    first.await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    crew.light().await;
    crew.turn(101);
    crew.wait_for_move(at, 63).await;
    crew.drove(&[36, 63]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn no_change_of_priority_moves_a_robot_that_the_watchdog_sends_home() {
    let stubborn = "robot.move(40, 40) turn(101)\n\
                    print('patrol', robot.move(40, 40, 1)) robot.move(40, 40) turn(0)";
    let avoid = "turn(100)\n\
                 local drives = task.spawn(function() robot.move(-50, -50) task.wait(600) end)\n\
                 turn(101) drives:cancel() print('avoid', robot.move(-50, -50, 1)) turn(0)";
    let crew = Crew::new(&[("patrol", 0, stubborn), ("avoid", 10, avoid)]).await;
    let at = crew.wait_for_move(0, 36).await;
    crew.turn(100);
    crew.wait_for_move(at, -45).await;
    crew.rig.sim.hide_station(true);
    crew.rig.sim.set_battery(15.0);
    let dock = crew
        .rig
        .heard(0, |command| *command == Command::Engine(Engage::Dock))
        .await;
    crew.turn(101);
    crew.run.says("patrol false safety").await;
    crew.run.says("avoid false safety").await;
    assert!(!crew.rig.commands(dock).iter().any(moves));
    crew.drove(&[36, -45, 0]).await;
}
