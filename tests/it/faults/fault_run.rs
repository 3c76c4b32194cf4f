//! The set-up of all scenarios: a robot with faults, the binary with a small driving script, and
//! functions that wait for events.

use std::time::Duration;

use spykee::sim::{Fault, Firmware, Options, State, World};
use spykee::wire::{Command, Sound};
use tokio::time::{sleep, timeout};

use super::table::{Scenario, Script};
use crate::rig::{Rig, Run, WAIT_LIMIT, moves};

/// The station is near, so most ways home take seconds.
const WORLD: &str = "
name: test
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
start: { at: [1.4, 4], heading_degrees: 180 }
battery: { level: 90, idle_drain_per_minute: 0.01, driving_drain_per_minute: 0.01 }
";

/// Short times, to keep the tests short; the rules are the same.
const CONFIG: &str = "
watchdog: { power_silence: 5, dock_pause: 0.2, dock_retries: 1, charge_timeout: 1, blind_moves: true, rescue: off }
";

/// Prints the events that it receives, and requests a sound while no robot is connected.
const LISTEN: &str = r#"
robot.on("connected", function() print("hears connected") end)
robot.on("disconnected", function()
	print("hears disconnected")
	robot.play("bomb")
end)
robot.on("battery_low", function(battery) print("hears battery_low", battery.percent) end)
"#;

/// Drives in circles forever, in short moves with short pauses.
const DRIVE: &str = r#"
while true do
	print("moved", robot.move(20, 40, 0.3))
	task.wait(0.1)
end
"#;

/// Drives in circles forever without a pause.
const CRUISE: &str = r#"
while true do
	robot.move(20, 40)
	task.wait(0.2)
	print(if robot.connected() then "moved true done" else "moved false disconnected")
end
"#;

/// Also analyses the camera's frames.
const WATCH: &str = r#"
local seen, blind = 0, 0
robot.on("frame", function(frame)
	local floor = frame:brightness()
	frame:find_blobs("red")
	if floor then seen += 1 else blind += 1 end
	print("frame", frame.bytes, "seen", seen, "blind", blind)
end)
"#;

/// A scenario that is running.
pub struct FaultRun {
    pub run: Run,
    pub rig: Rig,
    faults: Vec<Fault>,
}

impl FaultRun {
    /// Starts the scenario: the robot drives in circles, with or without the camera, and no fault
    /// is active yet.
    pub async fn set(scenario: &Scenario) -> FaultRun {
        let list = format!("faults: [{}]", scenario.fault);
        let faults = Fault::list_from_yaml(&list, scenario.name).unwrap();
        let firmware = Firmware {
            power_period: Duration::from_millis(200),
            search_limit: Duration::from_millis(300),
            ..Firmware::default()
        };
        let options = Options {
            firmware,
            fps: Some(6.0),
            seed: 11,
            faults: Some(vec![]),
            ..Options::default()
        };
        let rig = Rig::with(World::from_yaml(WORLD, "test world").unwrap(), options).await;
        let config = rig.file("spykee.yaml", CONFIG);
        let script = match scenario.script {
            Script::Drives => [LISTEN, DRIVE].concat(),
            Script::Watches => [LISTEN, WATCH, DRIVE].concat(),
            Script::Cruises => [LISTEN, WATCH, CRUISE].concat(),
        };
        let script = rig.file("script.lua", &script);
        let script = script.to_str().unwrap();
        let config = config.to_str().unwrap();
        let run = rig.spykee(&["run", script, "--config", config, "--robot", &rig.address]);
        rig.heard_motion(0).await;
        if scenario.script != Script::Drives {
            run.says("seen 3").await;
        }
        FaultRun { rig, run, faults }
    }

    /// Starts the faults; returns the index of the next command in the robot's journal.
    pub fn begin_faults(&self) -> usize {
        let index = self.rig.sim.heard_count();
        self.faults
            .iter()
            .for_each(|fault| self.rig.sim.begin(*fault));
        index
    }

    /// Ends all faults.
    pub fn end_faults(&self) {
        self.rig.sim.clear_faults();
    }

    /// How often a text has been printed so far.
    pub fn said(&self, text: &str) -> usize {
        self.run.text().matches(text).count()
    }

    /// Waits until a text has been printed `count` more times.
    pub async fn says_more(&self, text: &str, count: usize) {
        let enough = self.said(text) + count;
        let said = async {
            while self.said(text) < enough {
                sleep(Duration::from_millis(10)).await;
            }
        };
        let waited = timeout(WAIT_LIMIT, said).await;
        waited.unwrap_or_else(|_| panic!("`{text}` was not printed:\n{}", self.run.text()));
    }

    /// Waits until the script completes two more moves.
    pub async fn drives_on(&self) {
        self.says_more("moved true done", 2).await;
    }

    /// The connection from which the newest command came.
    pub fn newest_client(&self) -> u64 {
        let heard = self.rig.sim.heard();
        heard.last().map_or(0, |heard| heard.client)
    }

    /// Waits until a connection newer than `before` moves the robot; every session must begin with
    /// a stop.
    pub async fn comes_back(&self, before: u64) {
        let back = async {
            loop {
                let index = self.rig.heard_motion(self.rig.sim.heard_count()).await;
                if self.rig.sim.heard_since(index)[0].client > before {
                    return;
                }
            }
        };
        let waited = timeout(WAIT_LIMIT, back).await;
        waited.unwrap_or_else(|_| panic!("the agent does not reconnect:\n{}", self.run.text()));
        self.sessions_begin_with_a_stop();
        assert!(self.said("hears disconnected") > 0, "{}", self.run.text());
    }

    pub async fn until(&self, what: &str, wanted: impl Fn(&State) -> bool) -> State {
        let reached = timeout(WAIT_LIMIT, self.rig.sim.wait_state(wanted)).await;
        let failed = || {
            panic!(
                "never {what}: {:?}\n{}",
                self.rig.sim.state(),
                self.run.text()
            )
        };
        reached.unwrap_or_else(|_| failed())
    }

    /// Waits for a stop followed directly by BASE_FIND; returns the index of the stop.
    pub async fn goes_home(&self, from: usize) -> usize {
        let dock = self.rig.heard_dock(from).await;
        assert_eq!(self.rig.commands(dock - 1)[0], Command::STOP);
        dock - 1
    }

    pub fn no_motion_since(&self, index: usize) {
        let heard = self.rig.commands(index);
        assert!(!heard.iter().any(moves), "{heard:?}");
    }

    /// After a while without a link: requests made meanwhile were not carried out later.
    pub fn dropped_old_requests(&self) {
        let heard = self.rig.commands(0);
        assert!(!heard.contains(&Command::Play(Sound::Bomb)), "{heard:?}");
    }

    /// The first command after each login is a stop.
    pub fn sessions_begin_with_a_stop(&self) {
        let heard = self.rig.sim.heard();
        let newest = heard.last().map_or(0, |heard| heard.client);
        for client in 0..=newest {
            let of_one = heard.iter().filter(|heard| heard.client == client);
            let mut commands = of_one.map(|heard| &heard.command);
            assert!(
                commands
                    .next()
                    .is_none_or(|first| matches!(first, Command::Login(_)))
            );
            let second = commands.next();
            assert!(
                second.is_none_or(|second| *second == Command::STOP),
                "{second:?}"
            );
        }
    }

    /// After any fault: the agent still runs without an internal error, and every session began
    /// with a stop.
    pub fn ends_well(mut self) {
        assert!(self.run.lives(), "{}", self.run.text());
        assert_eq!(self.said("internal error"), 0, "{}", self.run.text());
        self.sessions_begin_with_a_stop();
    }
}
