//! `spykee calibrate`: the simulator's true values, the config, and when it refuses.

use spykee::sim::{FULL_SPEED, Firmware, TRACK_WIDTH};

use crate::rig::{QUIET_WORLD, Rig, Run};

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
