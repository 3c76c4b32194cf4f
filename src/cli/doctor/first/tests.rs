//! Robots that strangers have set are described rightly, in virtual time.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use super::*;
use crate::config::Config;
use crate::sim::{self, Firmware, World};
use crate::simulation::{self, Simulation};

/// What a stranger sets, and what must be said of it.
struct Case {
    firmware: &'static str,
    room: &'static str,
    leaves: &'static str,
    battery: &'static str,
    dead_zone: f64,
    camera: &'static str,
    /// People who walk through its view: what they hide may be `not known`.
    walkers: &'static str,
    /// What may be `not known` of it without them.
    unclear: &'static str,
    /// Commands per second; `None`: more than can be told.
    executes: Option<f64>,
    answers: &'static str,
    power: &'static str,
}

const USUAL: Case = Case {
    firmware: "",
    room: "classroom",
    leaves: "backward",
    battery: "{ level: 90 }",
    dead_zone: 20.0,
    camera: "{}",
    walkers: "",
    unclear: "",
    executes: None,
    answers: "POWER, CONFIG, LOG",
    power: "90 %, charging",
};

/// What was said, and whether the tracks ran at the end of the time without a connection.
struct Description {
    findings: Vec<Finding>,
    /// For the config.
    lines: Vec<String>,
    drove_on: bool,
}

impl Description {
    fn of(&self, what: &str) -> &str {
        let finding = self.findings.iter().find(|finding| finding.what == what);
        &finding.unwrap_or_else(|| panic!("nothing of {what}")).found
    }
}

impl Case {
    /// Its world, with the robot on its station.
    fn world(&self) -> World {
        let yaml = World::builtin_yaml(self.room).unwrap();
        let mut world: serde_yaml::Mapping = serde_yaml::from_str(yaml).unwrap();
        let value = |text: &str| serde_yaml::from_str::<serde_yaml::Value>(text).unwrap();
        world.remove("start");
        world.insert("preset".into(), "exact".into()); // what a case does not say is no finding
        world.insert("battery".into(), value(self.battery));
        world.insert("camera".into(), value(self.camera));
        let tracks = format!("{{ dead_zone: {}, unequal: 0.02 }}", self.dead_zone);
        world.insert("tracks".into(), value(&tracks));
        if !self.walkers.is_empty() {
            world.insert("walkers".into(), value(self.walkers));
        }
        let station = world.get_mut("station").unwrap().as_mapping_mut().unwrap();
        station.insert("leaves".into(), self.leaves.into());
        World::from_yaml(&serde_yaml::to_string(&world).unwrap(), "world").unwrap()
    }

    fn is_described_rightly(&self) {
        let options = simulation::Options {
            sim: sim::Options {
                firmware: Firmware::from_yaml(self.firmware, "firmware").unwrap(),
                ..sim::Options::default()
            },
            ..simulation::Options::default()
        };
        let said = simulation::run(self.world(), options, describe).unwrap();
        let executes = said.of("executes commands");
        match self.executes {
            None => assert_eq!(executes, "at once"),
            Some(rate) => {
                let told = executes.strip_prefix("about ").unwrap();
                let told: f64 = told.strip_suffix(" a second").unwrap().parse().unwrap();
                assert!((told / rate - 1.0).abs() < 0.1, "{rate}: {executes}");
            }
        }
        assert_eq!(said.of("answers questions"), self.answers);
        assert!(said.of("POWER").contains(self.power), "{}", self.power);
        self.tells(&said, "leaves its station", |way| {
            way == format!("{}s", self.leaves)
        });
        self.tells(&said, "least power", |least| {
            let percent: f64 = least.split(' ').next().unwrap().parse().unwrap();
            // The power of a track has steps of 1.1 %.
            let config = Config::parse(&said.lines.join("\n"), "spykee.yaml").unwrap();
            assert_eq!(config.calibration.least_power, percent, "{:?}", said.lines);
            (self.dead_zone - 0.6..=f64::max(self.dead_zone + 3.6, 5.0)).contains(&percent)
        });
        let is_voltage = self.battery.contains("voltage");
        let kind = said.of("POWER is");
        assert_eq!(kind.starts_with("a voltage"), is_voltage, "{kind}");
        self.tells(&said, "without a connection", |cut| {
            cut.starts_with(if said.drove_on {
                "it drives on"
            } else {
                "it stops by itself"
            })
        });
    }

    /// Checks what is said; if somebody walks by, nothing may be said too.
    fn tells(&self, said: &Description, what: &str, is_right: impl Fn(&str) -> bool) {
        let found = said.of(what);
        let may_be_unknown = !self.walkers.is_empty() || self.unclear == what;
        let is_unknown = may_be_unknown && found.starts_with("not known");
        assert!(is_unknown || is_right(found), "{what}: {found}");
    }
}

async fn describe(simulation: &Simulation) -> Description {
    let plan = simulation.plan(Vec::new()).pilot;
    let (mut connector, mut cut) = LinkCut::new(plan.connector);
    let moving = Arc::new(Mutex::new(false));
    let seen = moving.clone();
    let sim = simulation.sim().clone();
    cut.disconnect = Box::new(move || {
        sim.disconnect_all();
        let sim = sim.clone();
        let seen = seen.clone();
        tokio::spawn(async move {
            tokio::time::sleep(Duration::from_millis(1900)).await;
            *seen.lock().unwrap() = sim.state().moving();
        });
    });
    let mut walk = Walk {
        yes: true,
        camera: Camera::default(),
        calibration: Calibration::default(),
        low: plan.settings.limits.low,
        is_docked: true,
        findings: Vec::new(),
        lines: Vec::new(),
        watchdog: Vec::new(),
    };
    stand(&mut walk, &mut connector).await.unwrap();
    let plan = PilotPlan {
        connector,
        settings: moving::as_reported(plan.settings),
        rescue: None,
        ..plan
    };
    let drives = async |driver: &mut Driver| move_about(&mut walk, driver, &cut).await;
    let exit = drive(plan, drives).await.unwrap();
    println!("{}", walk.summary());
    assert_eq!(exit, Exit::Done);
    let state = simulation.sim().state();
    assert!(!state.moving() && state.collisions == 0, "{state:?}");
    let drove_on = *moving.lock().unwrap();
    Description {
        findings: walk.findings,
        lines: walk.lines,
        drove_on,
    }
}

macro_rules! cases {
    ($($name:ident: { $($field:ident: $value:expr),* };)*) => {
        $(#[test]
        fn $name() {
            Case { $($field: $value,)* ..USUAL }.is_described_rightly();
        })*
    };
}

cases! {
    a_usual_robot: { room: "classroom" };
    it_leaves_forwards: { leaves: "forward" };
    it_stops_without_a_connection: { firmware: "stops_on_disconnect: true", dead_zone: 12.0 };
    five_commands_a_second: { firmware: "commands_per_second: 5", executes: Some(5.0) };
    a_short_queue: {
        firmware: "commands_per_second: 8\nqueue: 4",
        executes: Some(8.0),
        room: "living_room"
    };
    fifteen_a_second_and_it_stops: {
        firmware: "commands_per_second: 15\nstops_on_disconnect: true",
        executes: Some(15.0),
        room: "playpen",
        dead_zone: 27.0
    };
    a_voltage_and_no_level_while_it_charges: {
        firmware: "power_while_charging: out_of_range",
        battery: "{ level: 80, power: voltage }",
        power: "out of range (-110)"
    };
    a_late_voltage: {
        firmware: "power_late: 3",
        battery: "{ level: 60, power: voltage }",
        power: "82 %, charging",
        dead_zone: 8.0
    };
    it_does_not_answer_power: {
        firmware: "answers_power_query: false",
        answers: "CONFIG, LOG",
        room: "yard",
        leaves: "forward"
    };
    it_sends_power_every_second_and_does_not_answer_power: {
        firmware: "answers_power_query: false\npower_period: 1\ncommands_per_second: 8",
        unclear: "without a connection",
        answers: "CONFIG, LOG",
        executes: Some(8.0)
    };
    it_stops_after_a_while_without_a_connection: { firmware: "stops_without_repeat: 0.8" };
    somebody_walks_by: {
        leaves: "forward",
        walkers: "[{ name: Ada, at: [1.6, 2.0], path: { through: [[1.6, 2.0], [1.6, 4.0]], speed: 0.6, pause: 1 } }]"
    };
    its_camera_looks_down: { camera: "{ pitch: -8, roll: -2, latency: 0.15, exposure: 0.5 }" };
    its_camera_looks_up_and_it_leaves_forwards: {
        camera: "{ pitch: 6, roll: 1.5, latency: 0.15, shutter: 0.03 }",
        leaves: "forward",
        dead_zone: 33.0
    };
    the_tracks_move_at_once_and_a_move_ends_the_leaving: {
        firmware: "move_while_undocking: ignored",
        room: "hall",
        dead_zone: 0.0
    };
}

#[test]
fn a_config_that_exists_stays_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("spykee.yaml");
    assert!(create(&path, "robot: 172.17.6.1\n").unwrap());
    assert!(!create(&path, "robot: 172.17.6.2\n").unwrap());
    assert_eq!(
        std::fs::read_to_string(&path).unwrap(),
        "robot: 172.17.6.1\n"
    );
    assert!(create(&folder.path().join("none/spykee.yaml"), "").is_err());
}
