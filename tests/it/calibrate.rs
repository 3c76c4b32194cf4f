//! `spykee calibrate`: the simulator's true values, the config, and when it refuses.

use std::f64::consts::{PI, TAU};
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::process::{Child, Command};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rustix::fs::{Mode, OFlags, open};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use spykee::sim::{FULL_SPEED, Firmware, TRACK_WIDTH};
use tokio::time::timeout;

use crate::rig::{PATIENCE, QUIET_WORLD, Rig, Run};

fn number(text: &str, key: &str) -> f64 {
    let json = text.lines().find(|line| line.starts_with('{'));
    let json: serde_json::Value =
        serde_json::from_str(json.unwrap_or_else(|| panic!("{text}"))).unwrap();
    json[key].as_f64().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_simulators_true_values_come_out_within_3_percent_and_go_into_the_config() {
    let rig = Rig::quiet().await;
    rig.file("world.yaml", QUIET_WORLD);
    let mut runs: Vec<(String, Run)> = (1..=3)
        .map(|seed| {
            let config = format!("{seed}.yaml");
            rig.file(
                &config,
                "# mine\ndata: x # there\ncalibration: { full_speed: 1 } # old\n",
            );
            let seed = seed.to_string();
            let run = rig.spykee(&[
                "calibrate",
                "--sim",
                "world.yaml",
                "--seed",
                &seed,
                "--config",
                &config,
                "--yes",
                "--json",
            ]);
            (config, run)
        })
        .collect();
    for (config, run) in &mut runs {
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let (width, speed) = (
            number(&run.text(), "track_width"),
            number(&run.text(), "full_speed"),
        );
        assert!((width / TRACK_WIDTH - 1.0).abs() < 0.03, "{width}");
        assert!((speed / FULL_SPEED - 1.0).abs() < 0.03, "{speed}");
        let text = std::fs::read_to_string(rig.folder().join(&*config)).unwrap();
        assert!(
            text.starts_with("# mine\ndata: x # there\ncalibration: {"),
            "{text}"
        );
        assert!(
            text.ends_with("# old\n") && !text.contains("full_speed: 1 "),
            "{text}"
        );
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn on_its_station_or_with_a_low_battery_nothing_is_measured() {
    let start = "start: { at: [4, 4], heading_degrees: 90 }";
    for (world, code, why) in [
        (QUIET_WORLD.replace(start, ""), 2, "on its station"),
        (
            QUIET_WORLD.replace("level: 90", "level: 15"),
            5,
            "battery is low",
        ),
    ] {
        let rig = Rig::new(&world, Firmware::default()).await;
        let mut run = rig.spykee(&["calibrate", "--robot", &rig.address]);
        assert_eq!(run.code().await, Some(code), "{}", run.text());
        assert!(run.text().contains(why), "{}", run.text());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_person_nothing_moves() {
    let rig = Rig::quiet().await;
    let mut run = rig.spykee(&["calibrate", "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert!(rig.sim.state().commanded.left == 0 && !rig.sim.state().moving());
}

/// `spykee` with a person at a terminal.
struct Terminal {
    child: Child,
    keyboard: File,
    screen: Arc<Mutex<String>>,
    read: usize,
}

impl Terminal {
    fn start(args: &[&str], rig: &Rig) -> Terminal {
        let keyboard = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&keyboard).unwrap();
        unlockpt(&keyboard).unwrap();
        let name = ptsname(&keyboard, Vec::new()).unwrap();
        let end = || File::from(open(&name, OFlags::RDWR | OFlags::NOCTTY, Mode::empty()).unwrap());
        let child = Command::new(env!("CARGO_BIN_EXE_spykee"))
            .args(args)
            .current_dir(rig.folder())
            .env_remove("RUST_LOG")
            .stdin(end())
            .stdout(end())
            .stderr(end())
            .spawn()
            .unwrap();
        let (keyboard, screen) = (File::from(keyboard), Arc::new(Mutex::new(String::new())));
        let (mut output, shown) = (keyboard.try_clone().unwrap(), Arc::clone(&screen));
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = output.read(&mut bytes) {
                let text = String::from_utf8_lossy(&bytes[..count]);
                shown.lock().unwrap().push_str(&text);
            }
        });
        Terminal {
            child,
            keyboard,
            screen,
            read: 0,
        }
    }

    /// Waits until this is shown, behind what was waited for before.
    async fn shows(&mut self, words: &str) {
        let shown = async {
            loop {
                let found = self.screen.lock().unwrap()[self.read..].find(words);
                if let Some(at) = found {
                    return at + words.len();
                }
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        let end = timeout(PATIENCE, shown).await;
        self.read += end.unwrap_or_else(|_| panic!("no `{words}`: {}", self.text()));
    }

    fn types(&mut self, line: &str) {
        self.keyboard.write_all(line.as_bytes()).unwrap();
        self.keyboard.write_all(b"\n").unwrap();
    }

    fn text(&self) -> String {
        self.screen.lock().unwrap().clone()
    }

    async fn code(&mut self) -> Option<i32> {
        let ended = async {
            loop {
                if let Some(status) = self.child.try_wait().unwrap() {
                    return status.code();
                }
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(PATIENCE, ended).await.unwrap()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// What a tape measure and a protractor say of the next move: metres and radians.
async fn measured(rig: &Rig) -> (f64, f64) {
    let mut last = rig.sim.wait_state(|state| state.moving()).await;
    let (mut way, mut angle) = (0.0, 0.0);
    while last.moving() {
        let next = rig.sim.wait_state(|state| state.time > last.time).await;
        way += next.pose.point().distance(last.pose.point());
        angle += (next.pose.heading - last.pose.heading + PI).rem_euclid(TAU) - PI;
        last = next;
    }
    (way, angle)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_at_a_terminal_is_led_through_and_asked_before_the_config_is_written() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", "data: mine # stays\n");
    let mut terminal = Terminal::start(&["calibrate", "--robot", &rig.address], &rig);
    let mark = rig.sim.state().pose;
    for (step, again) in [("1/3", false), ("1/3", true), ("2/3", true)] {
        rig.sim.place(mark);
        terminal.shows(&format!("{step}  ")).await;
        terminal.shows("Enter starts it").await;
        assert!(!rig.sim.state().moving(), "nothing moves before Enter");
        terminal.types("");
        let (way, _) = measured(&rig).await;
        terminal.shows("in centimetres?").await;
        if again {
            terminal.types("far");
            terminal.shows("A number, such as").await;
            terminal.types(&format!("{:.1}", way * 100.0).replace('.', ","));
        } else {
            terminal.types("r");
        }
    }
    terminal.shows("3/3  ").await;
    terminal.shows("Enter starts it").await;
    terminal.types("");
    let (_, angle) = measured(&rig).await;
    terminal.shows("How many degrees").await;
    terminal.types(&format!("{:.0}", angle.to_degrees()));
    terminal.shows("+calibration:").await;
    terminal.shows("Write it? [y/N]").await;
    terminal.types("y");
    assert_eq!(terminal.code().await, Some(0), "{}", terminal.text());
    let text = std::fs::read_to_string(rig.folder().join("spykee.yaml")).unwrap();
    let config = spykee::config::Config::parse(&text, "spykee.yaml").unwrap();
    let (width, speed) = (
        config.calibration.track_width,
        config.calibration.full_speed,
    );
    assert!((width / TRACK_WIDTH - 1.0).abs() < 0.2, "{width}");
    assert!((speed / FULL_SPEED - 1.0).abs() < 0.2, "{speed}");
    assert!(text.starts_with("data: mine # stays\n"), "{text}");
}
